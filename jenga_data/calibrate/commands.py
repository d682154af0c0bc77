"""`jenga calibrate`: how the simulated tower behaves, next to what is known of real ones. Heavy imports stay inside."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from jenga_data.collect.config import SelectionConfig
from jenga_data.command_line import Inline, Json, MaybeFloat, MaybeInt, Shown, Verb

if TYPE_CHECKING:
    from jenga_data.calibrate.run import Run

_ENOUGH_TO_COMPARE = 20
"""Fewer towers tell no settings apart, and a small run should take a minute."""


@dataclass(frozen=True)
class Common:
    """The options of every calibration."""

    # Below the seeds of evaluation, above any that data are collected with.
    seed: int = 800_000
    """decides the towers."""
    workers: int = 2
    """processes that simulate."""
    out: Path = Path("runs/calibrate")
    """folder of the report; the same command goes on where it was interrupted."""
    json: Json = False

    def run(self, towers: int) -> "Run":
        from jenga_data.calibrate.run import Run

        return Run(towers, self.seed, self.workers, self.out)

    def shown(self, report: dict[str, Any]) -> Shown:
        text = f"{report.pop('text')}\nwritten: {', '.join(report['written'])}"
        return Shown(self.json, report, text)


CommonOptions = Annotated[Common, Inline]
_COMMON = Common()


def movable(
    towers: int = 45,
    force_limit: MaybeFloat = None,
    friction: MaybeFloat = None,
    common: CommonOptions = _COMMON,
) -> Shown:
    """Push every block of fresh towers: how many slide out, and at which force.

    Args:
        towers: fresh towers of 54 blocks, about a minute and a half of CPU each.
        force_limit: the most force of a push [N].
        friction: of wood on wood; by default that of all data.
    """
    from jenga_data.calibrate.movable import MovableConfig, movable_report

    config = MovableConfig()
    if force_limit is not None:
        config = replace(config, push=replace(config.push, force_limit=force_limit))
    if friction is not None:
        config = replace(config, physics=replace(config.physics, friction=friction))
    return common.shown(movable_report(common.run(towers), config))


def contacts(
    towers: int = 100,
    few: MaybeInt = None,
    settings: tuple[str, ...] = (),
    common: CommonOptions = _COMMON,
) -> Shown:
    """Compare contact settings at rest, in play and under a pull.

    Args:
        towers: fresh towers that rest for 10 s under the chosen setting.
        few: fresh towers that rest under each of the others; twice as many play and are pulled at. By default an
            eighth of the towers.
        settings: names of the settings to compare; by default all, of fewer than 20 towers only the chosen one.
    """
    from jenga_data.calibrate.contacts import SETTINGS, contacts_report

    run = common.run(towers)
    names = settings or (tuple(SETTINGS) if towers >= _ENOUGH_TO_COMPARE else ("chosen",))
    few = max(1, towers // 8) if few is None else min(few, towers)
    return common.shown(contacts_report(run, SelectionConfig(), few, names))


def ceiling(
    towers: int = 200,
    targets: int = 3,
    repeats: int = 10,
    repeated: MaybeInt = None,
    common: CommonOptions = _COMMON,
) -> Shown:
    """Make the same pulls again with other noise: how well anyone could predict their outcome.

    Args:
        towers: of random rounds.
        targets: legal targets of each, pulled twice.
        repeats: pulls of the same target, for the first of them...
        repeated: ...about so many; by default one for every two towers.
    """
    from jenga_data.calibrate.ceiling import ceiling_report

    run = common.run(towers)
    return common.shown(
        ceiling_report(run, SelectionConfig(), targets, repeats, towers // 2 if repeated is None else repeated)
    )


def speed(
    towers: int = 60,
    speeds: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.4),
    common: CommonOptions = _COMMON,
) -> Shown:
    """Pull the same targets at several speeds.

    Args:
        towers: of random rounds, one target each.
        speeds: of the pull [m/s].
    """
    from jenga_data.calibrate.speed import speed_report

    return common.shown(speed_report(common.run(towers), SelectionConfig(), speeds))


def sleep(towers: int = 400, common: CommonOptions = _COMMON) -> Shown:
    """Compare the outcomes of pulls with and without sleep, and with starts a micrometre apart.

    Args:
        towers: of random rounds, one target each.
    """
    from jenga_data.calibrate.sleep import sleep_report

    return common.shown(sleep_report(common.run(towers), SelectionConfig()))


def rounds(towers: int = 40, common: CommonOptions = _COMMON) -> Shown:
    """Count the tries until a tower of each round stands, and what rejecting the others changes.

    Args:
        towers: seeds a round.
    """
    from jenga_data.calibrate.rounds import rounds_report

    return common.shown(rounds_report(common.run(towers), SelectionConfig()))


def turntable(towers: int = 300, round: int = 15, common: CommonOptions = _COMMON) -> Shown:
    """Turn towers by 180 degrees on the turntable.

    Args:
        towers: how many.
        round: of each of them.
    """
    from jenga_data.calibrate.turntable import turntable_report

    return common.shown(turntable_report(common.run(towers), SelectionConfig(), round))


def calibrate() -> dict[str, Verb]:
    return {
        "movable": movable,
        "contacts": contacts,
        "ceiling": ceiling,
        "speed": speed,
        "rounds": rounds,
        "turntable": turntable,
        "sleep": sleep,
    }
