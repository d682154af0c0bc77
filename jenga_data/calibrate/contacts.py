"""Choosing contact settings: how a tower rests, how it is played with, and how it is pulled at, setting by setting.

Rest alone decides nothing: settings under which a fresh tower stands quietly differ several times in how many played
towers stand and how many fall under a pull.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from jenga_data.blocks import NOMINAL_SIZE, sample_blocks
from jenga_data.calibrate import figures
from jenga_data.calibrate.cases import Case
from jenga_data.calibrate.run import Run
from jenga_data.calibrate.trial import described, judged_pull, tower_and_targets
from jenga_data.clock import CONTROL_STEP_NS
from jenga_data.collect.config import SelectionConfig, SpawnConfig
from jenga_data.collect.draws import episode_rng
from jenga_data.collect.spawn import GrownTower, grow_tower
from jenga_data.collect.stage import standing_pose
from jenga_data.errors import JengaError
from jenga_data.outcome import THRESHOLDS, collapsed
from jenga_data.report import markdown_table, with_interval
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World
from jenga_data.statistics import Proportion, paired_difference, proportion_over_towers
from jenga_data.tower import Layout, nominal_poses

CHOSEN = PhysicsConfig()

SETTINGS: Mapping[str, PhysicsConfig] = {
    "chosen": CHOSEN,
    # One thing changed at a time.
    "half the step": replace(CHOSEN, timestep_ns=1_000_000),
    "twice the step": replace(CHOSEN, timestep_ns=4_000_000, time_constant=0.008, damping_ratio=3.0),
    "less damping": replace(CHOSEN, damping_ratio=4.0),
    "little damping": replace(CHOSEN, damping_ratio=1.0),
    "softer when loaded": replace(CHOSEN, impedance=0.995),
    "hard at touch": replace(CHOSEN, touch_impedance=0.999),
    "wider ramp": replace(CHOSEN, impedance_width=2e-4),
    "impratio 1": replace(CHOSEN, impratio=1.0),
    "impratio 10": replace(CHOSEN, impratio=10.0),
    "discrete integrator": replace(CHOSEN, integrator="discrete"),
    # What others used: `facts.md`, first and second setting, and MuJoCo's own default.
    "prototype 1": PhysicsConfig(
        integrator="discrete", impratio=3.0, time_constant=0.01, damping_ratio=1.0,
        touch_impedance=0.9, impedance=0.99, impedance_width=2e-4,
    ),
    "prototype 2": PhysicsConfig(
        impratio=10.0, time_constant=0.02, damping_ratio=2.0,
        touch_impedance=0.99, impedance=0.999, impedance_width=1e-4,
    ),
    "MuJoCo's default": PhysicsConfig(
        impratio=1.0, time_constant=0.02, damping_ratio=1.0,
        touch_impedance=0.9, impedance=0.95, impedance_width=1e-3,
    ),
}  # fmt: skip
"""What the sweep compares; all with the same friction."""

REST_SECONDS = 10.0
SETTLED_SECONDS = 2.0
_AIR = 0.0002
"""Between the blocks of a level whose sag is measured [m]."""


def rest(physics: PhysicsConfig, seed: int, number: int) -> dict[str, Any]:
    """A fresh tower, awake and untouched for 10 s.

    Returns:
        `fell`; `drift` [mm/s] of the block that moves most from second 2 to second 10; simulated seconds a second of
        CPU time as `realtime_factor`.
    """
    spawn = SpawnConfig(last_round=1)
    grown = _grown(spawn, physics, 1, episode_rng(seed, number, "rest"))
    world = _world(physics, grown)
    frame = CONTROL_STEP_NS * 1e-9
    start, began = world.pose, process_time()
    settled = start
    for k in range(round(REST_SECONDS / frame)):
        if k == round(SETTLED_SECONDS / frame):
            settled = world.pose
        world.step(physics.steps_a_frame)
        if not np.isfinite(world.pose).all() or collapsed(start, world.pose, -1, THRESHOLDS.drop):
            return {"fell": True, "drift": None, "realtime_factor": None}
    distance = np.linalg.norm(world.pose[:, :3] - settled[:, :3], axis=1).max()
    return {
        "fell": False,
        "drift": float(distance) / (REST_SECONDS - SETTLED_SECONDS) * 1e3,
        "realtime_factor": REST_SECONDS / (process_time() - began),
    }


def sag(physics: PhysicsConfig) -> dict[str, Any]:
    """How far a nominal tower's blocks sink into each other at rest: the median over its interfaces [mm]."""
    blocks = sample_blocks("nominal", np.random.default_rng(0))
    layout = Layout.fresh()
    spec = base_spec(physics)
    add_tower(spec, blocks, nominal_poses(layout, _AIR), target=-1, physics=physics)
    world = World(spec, blocks, layout)
    world.step(round(1e9 / physics.timestep_ns))
    height = np.array([world.pose[layout.grid[level], 2].mean() for level in range(len(layout.grid))])
    between = NOMINAL_SIZE[2] - np.diff(np.concatenate([[-NOMINAL_SIZE[2] / 2], height]))
    return {"sag": float(np.median(between)) * 1e3, "worst": float(between.max()) * 1e3}


def play(physics: PhysicsConfig, seed: int, number: int, round_number: int) -> dict[str, Any]:
    """A played tower that is in equilibrium by computation: does it stand in the simulator, awake for 2 s?"""
    spawn = SpawnConfig()
    grown = _grown(spawn, physics, round_number, episode_rng(seed, number, f"play {round_number}"))
    began = process_time()
    stands = standing_pose(spawn, physics, grown, sleep=False) is not None
    quick = standing_pose(spawn, physics, grown, sleep=True) is not None
    return {"round": round_number, "stands": stands, "quick": quick, "cpu": process_time() - began}


def pulls(config: SelectionConfig, seed: int, number: int, repeats: int) -> dict[str, Any]:
    """One random legal target of one tower, pulled several times with other noise; the CPU time of a pull."""
    try:
        _, (stage,) = tower_and_targets(config, seed, number, 1)
    except JengaError:
        return {"stood": False}
    began = process_time()
    results = [judged_pull(config, stage, seed, repeat) for repeat in range(repeats)]
    cpu = (process_time() - began) / repeats
    return {"stood": True, "cpu": cpu, "tries": stage.tries, **described(stage), "repeats": results}


def _grown(spawn: SpawnConfig, physics: PhysicsConfig, round_number: int, rng: np.random.Generator) -> GrownTower:
    """The first tower that can be grown; whether it stands is what is asked."""
    for _ in range(1000):
        grown = grow_tower(spawn, physics.contact_law, round_number, rng)
        if grown is not None:
            return grown
    raise JengaError(f"no tower of round {round_number} is in equilibrium under these contacts in 1,000 tries")


def _world(physics: PhysicsConfig, grown: GrownTower) -> World:
    spec = base_spec(physics)
    add_tower(spec, grown.blocks, grown.pose, target=-1, physics=physics)
    return World(spec, grown.blocks, grown.layout)


def contacts_report(run: Run, config: SelectionConfig, few: int, names: Sequence[str]) -> dict[str, Any]:
    """Compare contact settings at rest, in play and under a pull; the chosen one rests on `run.towers` towers, the
    others on `few`, and each plays and is pulled on 2 x `few` towers.

    Raises:
        JengaError: `few` is no positive number, or a name is not one of `SETTINGS`.
    """
    if few < 1:
        raise JengaError(f"few is {few}; allowed: 1 or more")
    unknown = [name for name in names if name not in SETTINGS]
    if unknown:
        raise JengaError(f"unknown setting {unknown[0]!r}; allowed: {', '.join(SETTINGS)}")
    chosen = {"chosen": config.physics}
    settings = chosen | {
        name: replace(SETTINGS[name], friction=config.physics.friction) for name in names if name != "chosen"
    }
    rested = {name: run.towers if name == "chosen" else min(few, run.towers) for name in settings}
    played = [(n, r) for n in range(few) for r in (8, 15)]
    of_setting: dict[str, list[Case]] = {
        name: [
            *((rest, {"physics": p, "seed": run.seed, "number": n}) for n in range(rested[name])),
            (sag, {"physics": p}),
            *((play, {"physics": p, "seed": run.seed, "number": n, "round_number": r}) for n, r in played),
            *(
                (
                    pulls,
                    {"config": replace(config, physics=p), "seed": run.seed, "number": n, "repeats": 2},
                )
                for n in range(2 * few)
            ),
        ]
        for name, p in settings.items()
    }
    flat = iter(run.cases("contacts", [case for cases in of_setting.values() for case in cases]))
    found = {name: [next(flat) for _ in cases] for name, cases in of_setting.items()}
    summary = {
        name: _setting(results, rested[name], len(played), found["chosen"][-2 * few :])
        for name, results in found.items()
    }
    first = summary["chosen"]
    report = {
        **{key: first[key] for key in ("fallen", "drift_mm_per_s", "sag_mm", "realtime_factor")},
        "towers": run.towers,
        "seed": run.seed,
        "settings": summary,
        "physics": {name: _plain(physics) for name, physics in settings.items()},
    }
    rows = [
        (
            name, s["fallen"], s["drift_mm_per_s"]["median"], s["drift_mm_per_s"]["worst"], s["sag_mm"],
            s["realtime_factor"], s["played_stand"], s["failure"], s["pull_seconds"],
        )
        for name, s in summary.items()
    ]  # fmt: skip
    header = (
        "Setting", "Fresh towers fallen in 10 s", "drift, median [mm/s]", "worst", "sag [mm]", "real-time factor",
        "played towers stand", "failure of pulls", "CPU s a pull",
    )  # fmt: skip
    appendix = [(name, s["same_label"], s["label_repeats"], s["failure_minus_chosen"]) for name, s in summary.items()]
    text = (
        markdown_table(header, rows)
        + "\nWhich outcomes depend on the setting: the same seeds under each. A label that changes more often than "
        + "when a pull is repeated with other noise depends on the setting.\n\n"
        + markdown_table(
            ("Setting", "Same label as chosen", "Same label when repeated", "Failure rate minus chosen"), appendix
        )
    )
    return run.write("contacts", report, text, partial(figures.contacts, summary))


def _setting(
    results: list[dict[str, Any]], rested: int, played: int, reference: list[dict[str, Any]]
) -> dict[str, Any]:
    """One row of the sweep."""
    rest, sag, play = results[:rested], results[rested], results[rested + 1 : rested + 1 + played]
    pulls = results[rested + 1 + played :]
    fell = np.array([r["fell"] for r in rest])
    drift = np.array([r["drift"] for r in rest if not r["fell"]])
    pulled = [r for r in pulls if r["stood"]]
    failure = np.array([r["repeats"][0]["failure"] for r in pulled], bool)
    tower = np.array([r["tower"] for r in pulled])
    again = np.array([r["repeats"][1]["failure"] for r in pulled], bool)
    pairs = [(a, b) for a, b in zip(pulls, reference, strict=True) if a["stood"] and b["stood"]]
    mine, chosen = (np.array([pair[i]["repeats"][0]["failure"] for pair in pairs], bool) for i in (0, 1))
    where = np.array([b["tower"] for _, b in pairs])
    apart = paired_difference(mine, chosen, where)
    return {
        "fallen": Proportion.of(fell).as_dict(),
        "drift_mm_per_s": {
            "median": float(np.median(drift)) if len(drift) else None,
            "worst": float(drift.max()) if len(drift) else None,
        },
        "sag_mm": sag["sag"],
        "realtime_factor": float(np.median([r["realtime_factor"] for r in rest if not r["fell"]] or [np.nan])),
        "played_stand": Proportion.of(np.array([r["stands"] for r in play])).as_dict(),
        "played_quick_and_full_agree": Proportion.of(np.array([r["stands"] == r["quick"] for r in play])).as_dict(),
        "failure": proportion_over_towers(failure, tower),
        "pull_seconds": float(np.mean([r["cpu"] for r in pulled])) if pulled else None,
        "label_repeats": Proportion.of(failure == again).as_dict(),
        "same_label": Proportion.of(mine == chosen).as_dict(),
        "failure_minus_chosen": with_interval(apart["difference"], apart["ci95"]),
    }


def _plain(physics: PhysicsConfig) -> dict[str, Any]:
    return {name: getattr(physics, name) for name in physics.__dataclass_fields__}
