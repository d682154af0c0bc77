"""The verb eval: models and controllers on held-out towers."""

from pathlib import Path
from typing import Literal

import tyro

from jenga_data.collect.config import SEED_LIMIT
from jenga_data.command_line import Json, MaybePath, Shown, Verb
from jenga_data.dataset.reference import DYNAMICS, SELECTION


def evaluate() -> dict[str, Verb]:
    def selection(
        model: MaybePath = None,
        dataset: str = SELECTION,
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
        from jenga_control.selection.evaluate import evaluate_selection
        from jenga_control.tables import selection_tables
        from jenga_data.dataset.read import open_dataset
        from jenga_models.pretrained import pretrained

        report = evaluate_selection(
            model or pretrained("selection"), open_dataset(dataset), baselines, workers, ceiling
        )
        return Shown(json, report, selection_tables(report))

    def dynamics(
        model: MaybePath = None,
        dataset: str = DYNAMICS,
        truth: MaybePath = None,
        figure: MaybePath = None,
        json: Json = False,
    ) -> Shown:
        """Errors of a dynamics model on the test towers, one step and open loop, next to the trivial prediction.

        Args:
            model: folder of a checkpoint; by default the one that jenga comes with.
            dataset: NAME@X.Y.Z or a folder.
            truth: folder of `jenga eval simulator`: adds the ceiling, and the rank correlation of plans.
            figure: a PNG of true and predicted towers, as in the paper's appendix.
        """
        from jenga_control.prediction.evaluate import evaluate_dynamics
        from jenga_control.tables import dynamics_tables
        from jenga_data.dataset.read import open_dataset
        from jenga_models.pretrained import pretrained

        model, rows = model or pretrained("dynamics"), open_dataset(dataset)
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
            model: folders of dynamics checkpoints; the objective "full" is evaluated with each, by default with the one
                that jenga comes with.
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
