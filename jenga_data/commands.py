"""The verbs that make and look after data: collect, convert, dataset, log, bench, report. Heavy imports stay inside."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import tyro

from jenga_data.command_line import Inline, Json, MaybePath, MaybeText, Shown, Verb
from jenga_data.errors import JengaError

if TYPE_CHECKING:
    from jenga_data.log.report import LogReport


def collect() -> dict[str, Verb]:
    from jenga_data.collect.config import CollectConfig, ExtractionConfig, SelectionConfig
    from jenga_data.collect.numbers import Which

    def run(
        config: CollectConfig,
        which: Which,
        out: Path,
        seed: int,
        workers: int,
        rounds: str | None,
        timeout: float,
        json: bool,
    ) -> Shown:
        numbers = which.given()
        config = replace(config, spawn=replace(config.spawn, **_rounds(rounds)))
        if numbers is None:
            from jenga_data.dataset.same_towers import numbers_on_towers

            numbers = numbers_on_towers(str(which.of), which.split, seed, config)
        from jenga_data.collect.set_aside import in_one_line
        from jenga_data.collect.workers import collect as start

        summary = start(config, seed, numbers, workers, out, timeout)
        outcomes = ", ".join(f"{count} {name}" for name, count in summary.outcomes.items())
        text = f"{summary.episodes} episodes in {summary.out} ({summary.resumed} were there before): {outcomes}"
        text = "\n".join(filter(None, [text, in_one_line(out, summary.set_aside)]))
        return Shown(json, asdict(summary), text, ok=not summary.set_aside)

    def selection(
        out: Path,
        which: Annotated[Which, Inline] = Which(),  # noqa: B008  (frozen)
        config: Annotated[SelectionConfig, Inline] = SelectionConfig(),  # noqa: B008  (frozen)
        seed: int = 0,
        workers: int = 2,
        rounds: MaybeText = None,
        episode_timeout: float = 600.0,
        json: Json = False,
    ) -> Shown:
        """Pull random legal blocks with a servo and log what becomes of the tower: data for the selector.

        Args:
            out: folder of the logs; the same command goes on where it was interrupted.
            seed: below 900000.
            workers: processes that simulate; their number changes nothing but the time. From 2 on, one that dies or
                hangs is replaced; 1 is the command itself.
            rounds: such as 1-15 or 7; short for spawn.first-round and spawn.last-round.
            episode_timeout: longest time for one episode [s]; after two tries it is set aside, and the exit code is 1.
        """
        return run(config, which, out, seed, workers, rounds, episode_timeout, json)

    def extraction(
        out: Path,
        which: Annotated[Which, Inline] = Which(),  # noqa: B008  (frozen)
        config: Annotated[ExtractionConfig, Inline] = ExtractionConfig(),  # noqa: B008  (frozen)
        robot: Annotated[bool, tyro.conf.arg(name="robot", help="short for --body robot")] = False,
        only_gripper: Annotated[bool, tyro.conf.arg(name="gripper", help="short for --body gripper")] = False,
        seed: int = 0,
        workers: int = 2,
        rounds: MaybeText = None,
        episode_timeout: float = 600.0,
        json: Json = False,
    ) -> Shown:
        """Push random legal blocks out and pull them over 51 actions with the robot: data for the dynamics model.

        Args:
            out: folder of the logs; the same command goes on where it was interrupted.
            seed: below 900000.
            workers: processes that simulate; their number changes nothing but the time. From 2 on, one that dies or
                hangs is replaced; 1 is the command itself.
            rounds: such as 1-15 or 7; short for spawn.first-round and spawn.last-round.
            episode_timeout: longest time for one episode [s]; after two tries it is set aside, and the exit code is 1.
        """
        if robot and only_gripper:
            raise JengaError("--robot and --gripper exclude each other; allowed: one of them")
        if robot or only_gripper:
            config = replace(config, body="robot" if robot else "gripper")
        return run(config, which, out, seed, workers, rounds, episode_timeout, json)

    return {"selection": selection, "extraction": extraction}


def _rounds(text: str | None) -> dict[str, int]:
    """The fields of a `SpawnConfig` that --rounds sets."""
    if text is None:
        return {}
    first, dash, last = text.partition("-")
    last = last if dash else first
    if not (first.isdecimal() and last.isdecimal()):
        raise JengaError(f"--rounds is {text!r}; allowed: one round or a range, such as 7 or 1-15")
    return {"first_round": int(first), "last_round": int(last)}


def convert(
    logs: tyro.conf.Positional[tuple[Path, ...]],
    name: str,
    version: str,
    out: Path,
    onto: MaybeText = None,
    licence: MaybeText = None,
    workers: int = 2,
    json: Json = False,
) -> Shown:
    """Make a Parquet graph dataset with a manifest from folders of logs.

    Args:
        logs: folders (or files) of MCAP logs, all selection or all extraction.
        name: of the dataset.
        version: X.Y.Z, semantic versioning.
        out: new folder of the dataset.
        onto: a dataset (NAME@X.Y.Z or folder) that the new one continues: its files are taken over as they are, logs
            that it holds already are skipped.
        licence: of the data, by its SPDX name; CC-BY-4.0 where none is given, with --onto that of the dataset.
        workers: processes that read logs; their number changes nothing but the time.
    """
    from jenga_data.dataset.edit_text import conversion_text, edit_lines
    from jenga_data.dataset.episode_table import by_round
    from jenga_data.dataset.read import open_dataset

    if not logs:
        raise JengaError("no folder of logs was given; name at least one: jenga convert FOLDER --name ... --out ...")
    data, lines = {}, []
    if onto is None:
        from jenga_data.dataset.convert import convert as run
        from jenga_data.dataset.describe import LICENCE

        manifest = run(logs, out, name, version, licence=licence or LICENCE, workers=workers)
    else:
        from jenga_data.dataset.onto import convert_onto

        edited = convert_onto(onto, logs, out, name, version, licence=licence, workers=workers)
        manifest, data, lines = edited.manifest, edited.as_dict(), edit_lines(edited)
    rounds = by_round(open_dataset(out).episodes())
    data |= {"dataset": manifest.identifier, "hash": manifest.hash, "out": str(out)}
    data |= {"counts": msgspec.to_builtins(manifest.counts), "rounds": rounds}
    return Shown(json, data, "\n".join([f"{manifest.identifier} in {out}", *lines, conversion_text(manifest, rounds)]))


def log() -> dict[str, Verb]:
    def show(report: "LogReport", json: bool) -> Shown:
        data = asdict(report)
        text = "\n".join(f"{key}: {value}" for key, value in data.items() if value not in ("", [], {}))
        return Shown(json, data, text, report.ok)

    def info(file: tyro.conf.Positional[Path], json: Json = False) -> Shown:
        """Say what a log holds."""
        from jenga_data.log.report import inspect

        return show(inspect(file), json)

    def doctor(file: tyro.conf.Positional[Path], json: Json = False) -> Shown:
        """Check a log against the profile; exit code 1 if something is lost or wrong."""
        from jenga_data.log.report import doctor as run

        return show(run(file), json)

    def recover(file: tyro.conf.Positional[Path], out: MaybePath = None, json: Json = False) -> Shown:
        """Save what can be read of an unfinished or damaged log into a whole one.

        Args:
            file: the log.
            out: the new log; by default beside it.
        """
        from jenga_data.log.recover import recover as run
        from jenga_data.log.recover import recovered_path

        report = run(file, out or recovered_path(file))
        data = asdict(report)
        return Shown(json, data, "\n".join(f"{key}: {value}" for key, value in data.items()), not report.lost)

    return {"info": info, "doctor": doctor, "recover": recover}


def bench() -> dict[str, Verb]:
    from jenga_data.collect.config import ExtractionConfig, SelectionConfig

    def sim(
        towers: int = 8,
        config: Annotated[SelectionConfig, Inline] = SelectionConfig(),  # noqa: B008  (frozen)
        seed: int = 0,
        workers: int = 2,
        rounds: MaybeText = None,
        out: Path = Path("runs/bench-sim"),
        json: Json = False,
    ) -> Shown:
        """What selection episodes cost: physics steps, the log, workers, 2,000 of them.

        Args:
            towers: episodes to measure; one takes about 20 s on idle cores.
            seed: below 900000.
            workers: processes that simulate at the same time.
            rounds: such as 1-15 or 7; short for spawn.first-round and spawn.last-round.
            out: folder of the report: bench-sim.json, .md and .png.
        """
        from jenga_data.bench.sim import bench_sim

        config = replace(config, spawn=replace(config.spawn, **_rounds(rounds)))
        report = bench_sim(config, towers, seed, workers, out)
        text = report.pop("text")
        return Shown(json, report, f"{text}\n{out}")

    def robot(
        towers: int = 200,
        config: Annotated[ExtractionConfig, Inline] = ExtractionConfig(),  # noqa: B008  (frozen)
        seed: int = 0,
        workers: int = 2,
        rounds: MaybeText = None,
        out: Path = Path("runs/bench-robot"),
        json: Json = False,
    ) -> Shown:
        """What the robot's skills achieve and cost: pushes, grasps, failures, joints, CPU time.

        Args:
            towers: episodes, each of a tower of its own; one takes about 20 s.
            seed: below 900000.
            workers: processes that simulate.
            rounds: such as 1-15 or 7; short for spawn.first-round and spawn.last-round.
            out: folder of the report; the same command goes on where it was interrupted.
        """
        from jenga_data.bench.robot import bench_robot
        from jenga_data.calibrate.run import Run

        config = replace(config, spawn=replace(config.spawn, **_rounds(rounds)))
        report = bench_robot(Run(towers, seed, workers, out), config)
        return Shown(json, report, report.pop("text"))

    def log(
        towers: int = 2,
        config: Annotated[SelectionConfig, Inline] = SelectionConfig(),  # noqa: B008  (frozen)
        seed: int = 0,
        rounds: MaybeText = None,
        out: Path = Path("runs/bench-log"),
        json: Json = False,
    ) -> Shown:
        """How fast logs are written and read, beside the plain way to do it, and their part of an episode's time.

        Args:
            towers: episodes to measure; one takes about 20 s on idle cores.
            seed: below 900000.
            rounds: such as 1-15 or 7; short for spawn.first-round and spawn.last-round.
            out: folder of the report: bench-log.json and .md.
        """
        from jenga_data.bench.log import bench_log

        config = replace(config, spawn=replace(config.spawn, **_rounds(rounds)))
        report = bench_log(config, towers, seed, out)
        return Shown(json, report, f"{report.pop('text')}\n{out}")

    return {"sim": sim, "robot": robot, "log": log}


def report() -> dict[str, Verb]:
    def touch(logs: tyro.conf.Positional[tuple[Path, ...]], out: Path, json: Json = False) -> Shown:
        """How erratic the fingertip forces of extractions are, and whether that tells failure from success.

        Args:
            logs: folders (or files) of MCAP logs; those in which no gripper pulls are counted and left out.
            out: folder of the report: touch.json, .md and .png.
        """
        from jenga_data.touch_report import touch_report

        if not logs:
            raise JengaError("no folder of logs was given; name at least one: jenga report touch FOLDER --out ...")
        found = touch_report(logs, out)
        text = f"{found.pop('text')}\nwritten: {', '.join(found['written'])}"
        return Shown(json, found, text)

    return {"touch": touch}
