"""The verbs that act and show: demo, eval, bench, report, replay. Heavy imports stay inside."""

from pathlib import Path
from typing import Literal

import tyro

from jenga_data.collect.config import SEED_LIMIT
from jenga_data.command_line import Json, MaybeFloat, MaybeInt, MaybePath, Shown, Verb


def demo(
    out: MaybePath = None,
    workers: int = 2,
    seed: int = 0,
    selection_episodes: int = 12,
    extraction_episodes: int = 6,
    robot_episodes: int = 2,
    towers: int = 2,
    epochs: MaybeInt = None,
    json: Json = False,
) -> Shown:
    """The whole loop, small, in minutes: simulate, log, convert, train, evaluate, control, replay.

    Args:
        out: new folder for everything; by default the first free one of runs/demo-1, runs/demo-2, ...
        workers: processes that simulate.
        seed: decides every tower and pull.
        selection_episodes: rollouts that pull a block with a servo.
        extraction_episodes: rollouts that pull a block with a gripper without an arm.
        robot_episodes: rollouts of the whole robot.
        towers: held-out towers on which every controller pulls.
        epochs: of both trainings; by default those of the preset "fast".
    """
    from jenga_control.demo import DemoSize, closing_words, free_folder, run_demo

    size = DemoSize(selection_episodes, extraction_episodes, robot_episodes, towers, epochs)
    result = run_demo(out or free_folder(), workers, seed, size)
    return Shown(json, result, closing_words(result))


def evaluate() -> dict[str, Verb]:
    def selection(
        model: MaybePath = None,
        dataset: str = "jenga-selection@1.0.0",
        baselines: Literal["none", "quick", "all"] = "quick",
        ceiling: MaybePath = None,
        workers: int = 2,
        json: Json = False,
    ) -> Shown:
        """Accuracy of a selector on the test towers, next to the baselines.

        Args:
            model: folder of a checkpoint; by default the one that jenga comes with.
            dataset: NAME@X.Y.Z or a folder.
            baselines: rules alone (none), learners on hand-made features as well (quick), or mechanics too (all).
            ceiling: ceiling.json, as `jenga calibrate ceiling` writes it.
            workers: processes that compute mechanics.
        """
        from jenga_control.selection.evaluate import evaluate_selection, pretrained
        from jenga_control.tables import selection_tables
        from jenga_data.dataset.read import open_dataset

        report = evaluate_selection(model or pretrained(), open_dataset(dataset), baselines, workers, ceiling)
        return Shown(json, report, selection_tables(report))

    def dynamics(
        model: Path, dataset: str, truth: MaybePath = None, figure: MaybePath = None, json: Json = False
    ) -> Shown:
        """Errors of a dynamics model on the test towers, one step and open loop, next to the trivial prediction.

        Args:
            model: folder of a checkpoint.
            dataset: NAME@X.Y.Z or a folder.
            truth: folder of `jenga eval simulator`: adds the ceiling, and the rank correlation of plans.
            figure: a PNG of true and predicted towers, as in the paper's appendix.
        """
        from jenga_control.prediction.evaluate import evaluate_dynamics
        from jenga_control.tables import dynamics_tables
        from jenga_data.dataset.read import open_dataset

        rows = open_dataset(dataset)
        report = evaluate_dynamics(model, rows, truth)
        if figure:
            from jenga_control.prediction.figure import draw_towers

            report["figure"] = str(draw_towers(model, rows, figure))
        return Shown(json, report, dynamics_tables(report))

    def simulator(
        logs: tyro.conf.Positional[tuple[Path, ...]],
        out: Path,
        states: int = 200,
        decisions: int = 60,
        candidates: int = 100,
        horizon: int = 1,
        every_tower: bool = False,
        seed: int = SEED_LIMIT,
        workers: int = 2,
        json: Json = False,
    ) -> Shown:
        """What the simulator itself says of logged pulls, restarted from what a model is told, and under other plans.

        Args:
            logs: folders (or files) of MCAP logs of extraction.
            out: folder of the states; the same command goes on where it was interrupted, and takes more of them.
            states: how many to restart, of held-out towers: a second of one core and more each.
            decisions: how many to make all candidate plans from, half a minute of one core each.
            candidates: plans of a decision.
            horizon: steps of a plan.
            every_tower: take towers that models train on as well.
            seed: decides which states.
            workers: processes that simulate.
        """
        from jenga_control.prediction.ceiling import from_folder
        from jenga_control.prediction.restarts import Candidates, Restarts, choose, simulate
        from jenga_control.tables import ceiling_tables
        from jenga_data.dataset.sources import find_logs

        found = find_logs(logs)
        if states:
            simulate(Restarts(out), choose(found, states, seed, not every_tower), workers, "restarting")
        if decisions:
            work = Candidates(out, candidates, horizon)
            simulate(work, choose(found, decisions, seed + 1, not every_tower), workers, "branching")
        report = from_folder(out, None)
        return Shown(json, report, ceiling_tables(report))

    def extraction(
        out: Path,
        model: tuple[Path, ...] = (),
        objective: tuple[str, ...] = ("full", "naive", "straight"),
        dynamics: Literal["learned", "simulator", "trivial"] = "learned",
        towers: int = 100,
        preset: Literal["paper", "best"] = "best",
        select: MaybePath = None,
        push_control: bool = False,
        touch: bool = False,
        simulator_samples: int = 16,
        simulator_horizon: int = 3,
        gripper: bool = False,
        seed: int = 900_000,
        workers: int = 2,
        json: Json = False,
    ) -> Shown:
        """Pull random legal blocks of new towers in closed loop and count how many come out.

        Args:
            out: folder of the logs; the same command goes on where it was interrupted.
            model: folders of dynamics checkpoints; the objective "full" needs one, and is evaluated with each.
            objective: MPPI on O_a + O_d (full) or on O_a alone (naive), a straight pull (straight-0.15, in m/s), or
                hindsight (hindsight-12), the best of 8 (12) pulls; full-paper, full-best and full-simulator say what
                the options below do. The first is reported, the others are its baselines from the same grasp.
            dynamics: what predicts the tower for the objective "full".
            towers: how many.
            preset: of the search; the paper's clips what it executes, the best one samples within the limits.
            select: folder of a selection checkpoint, which picks the target among all legal ones.
            push_control: the push watches the other blocks and turns back.
            touch: the pull slows down, wiggles or gives up when the fingertip forces get erratic.
            simulator_samples: of the search where the simulator is the model...
            simulator_horizon: ...and its horizon; with 100 and 5 a decision would take minutes.
            gripper: a hand without an arm pulls, at a block that sticks out already; by default the whole robot does
                everything.
            seed: from 900000 up, which no training data may have.
            workers: processes that simulate.
        """
        from jenga_control.extraction.evaluate import Switches, evaluate_extraction
        from jenga_control.extraction.touch import TouchConfig
        from jenga_control.tables import extraction_tables
        from jenga_data.collect.config import ExtractionConfig

        config = ExtractionConfig(body="gripper") if gripper else None
        switches = Switches(select, push_control, TouchConfig() if touch else None)
        search = simulator_samples, simulator_horizon
        report = evaluate_extraction(
            model, out, objective, towers, seed, workers, preset, config, dynamics, switches, search
        )
        return Shown(json, report, extraction_tables([report, *report["baselines"].values()]))

    return {"selection": selection, "dynamics": dynamics, "simulator": simulator, "extraction": extraction}


def bench() -> dict[str, Verb]:
    def control(
        model: Path,
        towers: int = 2,
        threads: int = 2,
        simulator_samples: int = 4,
        preset: Literal["paper", "best"] = "best",
        device: str = "cpu",
        json: Json = False,
    ) -> Shown:
        """Decisions a second of the controller, beside graphs composed one by one and the simulator as the model.

        Args:
            model: folder of a dynamics checkpoint.
            towers: on which is timed, each at its grasp.
            threads: of the model and of the simulator.
            simulator_samples: samples that the simulator is given; its time grows with their number.
            preset: of the search.
            device: cpu or cuda.
        """
        from jenga_control.planning.bench import bench_control

        found = bench_control(model, towers, threads, simulator_samples, preset, device)
        return Shown(json, found, found.pop("text"))

    def replay(seconds: float = 60.0, model: MaybePath = None, repeats: int = 3, json: Json = False) -> Shown:
        """How long a recording for rerun of a long episode takes, without and with a model.

        Args:
            seconds: length of a made-up episode [s], with fingertip forces at 250 Hz.
            model: folder of a dynamics checkpoint; by default a network of the preset "best" with random weights.
            repeats: tries, of which the fastest counts.
        """
        from jenga_control.bench_replay import bench_replay

        report = bench_replay(seconds, model, repeats)
        return Shown(json, report, report.pop("text"))

    return {"control": control, "replay": replay}


def report() -> dict[str, Verb]:
    def selection(
        out: Path,
        models: tuple[Path, ...] = (),
        dataset: str = "jenga-selection@1.0.0",
        more: tuple[str, ...] = (),
        baselines: Literal["none", "quick", "all"] = "all",
        ceiling: MaybePath = None,
        logs: MaybePath = None,
        workers: int = 2,
        json: Json = False,
    ) -> Shown:
        """Which block: models, baselines and the ceiling in one table, with tests, figures and the worst mistakes.

        Args:
            out: folder of the report: selection.json, .md and figures.
            models: folders of checkpoints; those that differ by their seed alone share a row.
            dataset: NAME@X.Y.Z or a folder; its test towers decide.
            more: further datasets whose training towers the baselines may see, as the models did.
            baselines: rules alone (none), learners on hand-made features as well (quick), or mechanics too (all).
            ceiling: ceiling.json, as `jenga calibrate ceiling` writes it.
            logs: folder of the dataset's logs, for the commands that replay mistakes.
            workers: processes that compute mechanics.
        """
        from jenga_control.selection.report import report_selection
        from jenga_data.dataset.read import open_dataset

        others = [open_dataset(name) for name in more]
        found = report_selection(models, open_dataset(dataset), out, baselines, others, ceiling, logs, workers)
        text = f"{found.pop('text')}\nwritten: {', '.join(found['written'])}"
        return Shown(json, found, text)

    def extraction(logs: tyro.conf.Positional[tuple[Path, ...]], out: Path, json: Json = False) -> Shown:
        """Who pulls how well: rates, causes, rounds and speeds of every way that was evaluated, with figures.

        Args:
            logs: folders that `jenga eval extraction --out` left, one or several.
            out: folder of the report: extraction.json, .md and figures.
        """
        from jenga_control.extraction.report import report_extraction

        found = report_extraction(logs, out)
        text = f"{found.pop('text')}\nwritten: {', '.join(found['written'])}"
        return Shown(json, found, text)

    def figures(
        out: Path,
        selection: MaybePath = None,
        extraction: MaybePath = None,
        models: tuple[Path, ...] = (),
        results: tuple[Path, ...] = (),
        json: Json = False,
    ) -> Shown:
        """Every figure and table of the paper from own logs: rounds, key frames, pushes, predictions, touch, tables.

        Args:
            out: folder of the figures, with figures.json and .md that say what each shows and which are missing.
            selection: folder of selection logs, or of a selection dataset.
            extraction: folder of extraction logs.
            models: folders of checkpoints; dynamics models are drawn beside the truth.
            results: folders (or files) with JSON of `report selection` and `eval extraction`, for the tables.
        """
        from jenga_control.summary.figures import report_figures
        from jenga_control.summary.results import read_results

        found = report_figures(out, selection, extraction, models, read_results(results))
        return Shown(json, found, f"{found.pop('text')}\nwritten: {', '.join(found['written'])}")

    def page(
        out: Path,
        results: tuple[Path, ...] = (),
        selection: MaybePath = None,
        extraction: MaybePath = None,
        models: tuple[Path, ...] = (),
        json: Json = False,
    ) -> Shown:
        """One HTML page over everything that was measured, beside the paper; it measures nothing itself.

        Args:
            out: folder of report.html, which needs no other file; figures are drawn beside it if logs are given.
            results: folders (or files) with the JSON of calibrate, bench, eval, report and of datasets (manifest.json).
            selection: folder of selection logs, or of a selection dataset, for the figures.
            extraction: folder of extraction logs, for the figures.
            models: folders of checkpoints, for the figures.
        """
        from jenga_control.summary.figures import report_figures
        from jenga_control.summary.page import report_page
        from jenga_control.summary.results import read_results

        measured = read_results(results)
        drawn = report_figures(out, selection, extraction, models, measured)
        found = report_page(out, measured, drawn)
        verdicts = [f"{verdict:>30}  {claim}" for claim, verdict in found["findings"].items()]
        return Shown(json, found, "\n".join([*verdicts, found["page"]]))

    return {"selection": selection, "extraction": extraction, "figures": figures, "page": page}


def replay(
    episode: tyro.conf.Positional[tuple[Path, ...]],
    model: tuple[Path, ...] = (),
    from_frame: MaybeInt = None,
    save: MaybePath = None,
    web: bool = False,
    png: MaybePath = None,
    time: MaybeFloat = None,
    frame: MaybeInt = None,
    strip: MaybePath = None,
    meshes: str = "",
    json: Json = False,
) -> Shown:
    """Show an episode in rerun, with models' predictions drawn over the truth; several of them side by side.

    Args:
        episode: an MCAP log, or up to six.
        model: folders of checkpoints. Where MPPI acted, its sampled plans are shown; if it had a learned model, that
            has to be among these.
        from_frame: every dynamics model predicts in an open loop from this frame on, besides every single step.
        save: write a recording for rerun instead of opening it.
        web: serve it to a browser.
        png: take a screenshot without a screen (needs a Vulkan driver, such as Debian's mesa-vulkan-drivers).
        time: moment at which the viewer opens, or that the screenshot shows, since the first frame [s]...
        frame: ...or the number of its frame, as `jenga dataset trace` prints it.
        strip: write six moments of the episode side by side as a PNG; needs neither rerun nor Vulkan.
        meshes: draw the arm with its maker's look: a panda.xml of mujoco-menagerie, or "menagerie" to have
            robot_descriptions fetch it (needs that package and the network).
    """
    from jenga_control.replay import replay as run

    shown = run(
        episode, model, from_frame=from_frame, save=save, web=web, png=png, time=time, frame=frame, strip=strip,
        meshes=meshes,
    )  # fmt: skip
    data = {"episode": str(episode[0]), "episodes": [str(path) for path in episode], "written": list(map(str, shown))}
    return Shown(json, data, "\n".join(data["written"]))
