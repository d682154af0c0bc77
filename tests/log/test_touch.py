"""How erratic a pull feels: the statistic on made-up forces, and `jenga report touch` on made-up logs."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from synthetic_log import STEP_NS, Script, make_script, write

import cli
from jenga_data.episode import Phase
from jenga_data.log.reader import read_episode
from jenga_data.outcome import Outcome, Verdict
from jenga_data.touch import erraticness, open_until, pull_touch

FRAMES = 24
PULL = 2
CLEAR = 16
"""Frame in which the target, about 75 mm long and 5 mm further out at every frame, has left the tower."""
DT = STEP_NS / 4 * 1e-9


def felt(force: np.ndarray, frames: int = FRAMES, **changes: Any) -> Script:
    """An extraction with these forces, (sample, finger, axis) or what broadcasts to it, four samples a frame."""
    script = make_script(frames=frames, state=2)
    force = np.broadcast_to(force, (4 * frames, 2, 3))
    samples = [replace(s, left_force=f[0], right_force=f[1]) for s, f in zip(script.gripper, force, strict=True)]
    return replace(script, gripper=samples, **changes)


def noise(size: float = 1.0, seed: int = 0, frames: int = FRAMES) -> np.ndarray:
    return size * np.random.default_rng(seed).normal(size=(4 * frames, 2, 3))


@pytest.fixture
def measured(tmp_path: Path) -> Callable[[Script], float]:
    return lambda script: erraticness(read_episode(write(tmp_path / "measured.mcap", script)))


GRIP = np.array([[0.0, 15.0, 0.0], [0.0, -15.0, 0.0]])


def test_a_steady_grip_is_not_erratic_however_strong(measured):
    assert measured(felt(GRIP)) == 0.0
    assert measured(felt(GRIP + noise())) == pytest.approx(measured(felt(noise())), rel=1e-6)


def test_a_ramp_has_its_slope(measured):
    time = DT * np.arange(4 * FRAMES)[:, None, None]
    assert measured(felt(np.array([[3.0, 0, 0], [0, 0, -4.0]]) * time)) == pytest.approx(5.0, rel=1e-5)


def test_twice_the_force_is_twice_as_erratic(measured):
    assert measured(felt(noise(2.0))) == pytest.approx(2 * measured(felt(noise())), rel=1e-5)


def test_more_noise_on_the_same_pull_is_more_erratic(measured):
    pull = GRIP * np.linspace(0.5, 1, 4 * FRAMES)[:, None, None]
    values = [measured(felt(pull + noise(size))) for size in (0.0, 0.1, 1.0)]
    assert values == sorted(values)
    # Independent samples of variance 1 in six components differ by sqrt(2 * 6) in the root mean square.
    assert values[2] == pytest.approx(np.sqrt(12) / DT, rel=0.15)


def test_a_longer_pull_is_not_more_erratic(measured):
    swing = np.where(np.arange(4 * FRAMES) % 2, 1.0, -1.0)[:, None, None] * GRIP
    assert measured(felt(swing)) == pytest.approx(measured(felt(swing[:40], frames=10)))


@pytest.mark.parametrize("at", [0, 4 * PULL - 1, 4 * CLEAR + 1, 4 * FRAMES - 1])
def test_what_comes_before_the_pull_or_after_the_target_is_clear_does_not_count(measured, at):
    force = np.zeros((4 * FRAMES, 2, 3))
    force[at] = 1e3
    assert measured(felt(force)) == 0.0


@pytest.mark.parametrize("at", [4 * PULL, 4 * CLEAR])
def test_the_moments_that_bound_the_pull_count(measured, at):
    force = np.zeros((4 * FRAMES, 2, 3))
    force[at] = 1e3
    assert measured(felt(force)) > 0.0


def test_the_pull_ends_with_its_phase(tmp_path):
    phases = [Phase(0, 0, "grasp"), Phase(2, 2 * STEP_NS, "pull"), Phase(6, 6 * STEP_NS, "observe")]
    episode = read_episode(write(tmp_path / "a.mcap", felt(noise(), phases=phases)))
    assert open_until(episode) == (2 * STEP_NS, 6 * STEP_NS)
    assert pull_touch(episode).time_ns[[0, -1]].tolist() == [2 * STEP_NS, 6 * STEP_NS]


def test_the_pull_is_decided_when_a_block_has_dropped(tmp_path):
    script = felt(noise())
    for frame in script.frames[9:]:
        frame.pose[4, 2] -= 0.008
    assert open_until(read_episode(write(tmp_path / "a.mcap", script))) == (2 * STEP_NS, 9 * STEP_NS)


def test_no_pull_has_no_value(measured):
    assert np.isnan(measured(felt(noise(), phases=[Phase(0, 0, "grasp")])))
    assert np.isnan(measured(make_script(gripper=False)))


# --- jenga report touch ---


def log_episode(folder: Path, number: int, outcome: Outcome, force: np.ndarray) -> None:
    script = felt(force)
    blocks = replace(script.header.blocks, mass=script.header.blocks.mass * (1 + 0.01 * number))  # another tower
    header = replace(script.header, key=f"{number:016x}", number=number, blocks=blocks)
    verdict = Verdict(outcome, dragged=False, moved=0.0, clear_frame=-1)
    folder.mkdir(exist_ok=True)
    write(folder / f"{number}.mcap", replace(script, header=header, result=replace(script.result, verdict=verdict)))


@pytest.fixture
def jenga(monkeypatch, capsys):
    def run(*args: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["jenga", "report", "touch", *map(str, args)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return int(stop.value.code or 0), *capsys.readouterr()

    return run


@pytest.fixture
def report(jenga, tmp_path):
    """The object that the verb prints of the logs in tmp_path/logs."""

    def run() -> dict[str, Any]:
        code, out, err = jenga(tmp_path / "logs", "--out", tmp_path / "out", "--json")
        assert (code, err) == (0, "")
        return json.loads(out)

    return run


def test_a_report_of_smooth_successes_and_erratic_failures(report, tmp_path):
    for number, size in enumerate((1.0, 2.0, 9.0)):
        log_episode(tmp_path / "logs", number, Outcome.EXTRACTED, GRIP + noise(size))
    for number, size in enumerate((5.0, 10.0, 20.0), start=3):
        outcome = Outcome.STUCK if number == 3 else Outcome.COLLAPSED
        log_episode(tmp_path / "logs", number, outcome, GRIP + noise(size))
    log_episode(tmp_path / "logs", 6, Outcome.INVALID, noise(99.0))
    said = report()

    unit = said["erraticness"]["success"]["median"] / 2.0
    assert (said["n"], said["episodes"], said["invalid"], said["without_pull"]) == (6, 7, 1, 0)
    assert said["erraticness"]["failure"]["median"] == pytest.approx(10 * unit, rel=1e-5)
    assert said["erraticness"]["collapsed"] == {
        "n": 2,
        "median": pytest.approx(15 * unit, rel=1e-5),
        "5 %": pytest.approx(10.5 * unit, rel=1e-5),
        "95 %": pytest.approx(19.5 * unit, rel=1e-5),
    }
    # Of nine pairs only (5, 9) is the wrong way round; all pulls are equally fast.
    assert said["auroc"]["value"] == pytest.approx(8 / 9)
    low, high = said["auroc"]["ci95"]
    assert 0 <= low < 8 / 9 < high <= 1
    assert said["auroc_same_speed"]["value"] == pytest.approx(8 / 9)
    assert said["auroc_same_speed"]["pairs"] == 9
    assert said["baselines"]["speed"]["auroc"]["value"] == 0.5
    assert {name: one["episode"] for name, one in said["figure"].items()} == {
        "success": f"{1:016x}",
        "failure": f"{4:016x}",
    }
    written = [Path(path) for path in said["written"]]
    assert [path.name for path in written] == ["touch.json", "touch.md", "touch.png"]
    assert json.loads(written[0].read_text())["auroc"] == said["auroc"]
    assert "failures" in written[1].read_text()
    assert len(np.unique(matplotlib.image.imread(written[2]).reshape(-1, 4), axis=0)) > 20


def test_pairs_of_unequal_speed_do_not_count(report, tmp_path):
    for number, (outcome, speed) in enumerate(((Outcome.EXTRACTED, 1.0), (Outcome.STUCK, 1.2), (Outcome.STUCK, 2.0))):
        script = felt(noise(number + 1.0))
        for k, sample in enumerate(script.gripper):
            sample.pose[0] = -0.001 * speed * k
        header = replace(script.header, key=f"{number:016x}", number=number)
        verdict = Verdict(outcome, dragged=False, moved=0.0, clear_frame=-1)
        (tmp_path / "logs").mkdir(exist_ok=True)
        script = replace(script, header=header, result=replace(script.result, verdict=verdict))
        write(tmp_path / "logs" / f"{number}.mcap", script)
    said = report()
    assert said["auroc_same_speed"]["pairs"] == 1
    assert said["auroc_same_speed"]["value"] == 1.0
    assert said["baselines"]["speed"]["auroc"]["value"] == 1.0
    assert said["auroc"]["ci95"] is None  # all of one tower


@pytest.mark.parametrize(("outcome", "missing"), [(Outcome.EXTRACTED, "failure"), (Outcome.STUCK, "success")])
def test_one_class_alone_tells_nothing_and_is_no_error(jenga, tmp_path, outcome, missing):
    for number in range(2):
        log_episode(tmp_path / "logs", number, outcome, noise(seed=number))
    code, out, err = jenga(tmp_path / "logs", "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    assert out.startswith(f"2 pulls of 2 episodes; no {missing} among them")
    said = json.loads((tmp_path / "out" / "touch.json").read_text())
    assert said["auroc"]["value"] is None
    assert said["figure"][missing] is None
    assert said["erraticness"][missing] == {"n": 0, "median": None, "5 %": None, "95 %": None}


def test_copies_of_a_log_count_once_and_logs_without_a_pull_are_counted(report, tmp_path):
    log_episode(tmp_path / "logs", 0, Outcome.STUCK, noise())
    (tmp_path / "logs" / "copy.mcap").write_bytes((tmp_path / "logs" / "0.mcap").read_bytes())
    write(tmp_path / "logs" / "no-hand.mcap", make_script(gripper=False))
    said = report()
    assert (said["n"], said["episodes"], said["without_pull"]) == (1, 2, 1)


def refused(jenga, out: Path, *args: object) -> str:
    code, said, err = jenga(*args, "--out", out)
    assert (code, said, err.count("\n"), out.exists()) == (2, "", 1, False)
    return err


def test_what_has_no_pull_at_all_is_refused(jenga, tmp_path):
    write(tmp_path / "no-hand.mcap", make_script(gripper=False))
    out = tmp_path / "out"
    assert "in none of 1 logs a gripper pulls" in refused(jenga, out, tmp_path / "no-hand.mcap")
    assert "no folder of logs was given" in refused(jenga, out)
    assert "no such folder" in refused(jenga, out, tmp_path / "nowhere")
