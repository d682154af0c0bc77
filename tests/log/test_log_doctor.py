"""Each kind of nonsense that a well-formed file can hold is named."""

import dataclasses
import re

import numpy as np
import pytest
from mcap.writer import IndexType, Writer
from synthetic_log import SCENE, STEP_NS, make_script, play, write

from jenga_data.episode import Action, Contacts, Phase, Result
from jenga_data.log.checks import spans
from jenga_data.log.report import doctor, inspect
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome, Verdict

SCRIPT = make_script(frames=8)


def with_frame(at, /, **changes):
    """The script with one frame changed."""
    frames = list(SCRIPT.frames)
    frames[at] = dataclasses.replace(frames[at], **changes)
    return dataclasses.replace(SCRIPT, frames=frames)


def spoiled(array, value):
    out = array.copy()
    out.flat[5] = value
    return out


F = SCRIPT.frames
ONE = np.array([0])
PROBLEMS = {
    "nan pose": (with_frame(3, pose=spoiled(F[3].pose, np.nan)), "/tower/state pose: .* not finite in frames 3"),
    "nan twist": (with_frame(3, twist=spoiled(F[3].twist, np.inf)), "/tower/state twist: .* not finite in frames 3"),
    "nan state": (with_frame(3, sim_state=spoiled(F[3].sim_state, np.nan)), "/sim/state: .* not finite in frames 3"),
    "state length": (with_frame(3, sim_state=np.zeros(1)), "/sim/state: states of 2 different lengths"),
    "quaternion": (with_frame(3, pose=spoiled(F[3].pose, 0.01)), "quaternions of a length other than 1 in frames 3"),
    "vast": (with_frame(3, pose=np.full_like(F[3].pose, 1e200)), "quaternions of a length other than 1 in frames 3"),
    "gap": (with_frame(3, index=9), r"/tower/state lacks frames 3, 8"),
    "twice": (with_frame(3, index=4), "/tower/state has frame 4 twice"),
    "time": (with_frame(3, time_ns=0), "/tower/state goes back in time 1 times, first after 64000000 ns"),
    "body": (with_frame(3, contacts=Contacts(ONE, ONE - 9, np.zeros((1, 3)))), "bodies that are none in frames 3"),
    "force": (with_frame(3, contacts=Contacts(ONE, ONE, np.full((1, 3), np.nan))), "/tower/contacts: .* in frames 3"),
    "gripper": (
        dataclasses.replace(SCRIPT, gripper=[dataclasses.replace(SCRIPT.gripper[0], pose=np.zeros(7))]),
        "/gripper sample: quaternions",
    ),
}


def test_a_good_episode_has_no_problems(log, script):
    report = doctor(log)
    assert report.ok
    assert report.problems == []
    assert report.frames == len(script.frames)
    assert report.topics["/tower/state"] == report.topics["/tower/contacts"] == report.frames
    assert report.duration_s == pytest.approx((len(script.frames) - 1) * STEP_NS / 1e9, abs=STEP_NS / 1e9)
    assert (report.outcome, report.cause, report.complete) == ("stuck", "slipped", True)
    assert report.episode["key"] == script.header.key
    assert report.provenance == script.header.provenance
    assert set(report.attachments) == {"config.json", "scene.xml"}
    assert inspect(log) == report


@pytest.mark.parametrize("name", PROBLEMS)
def test_nonsense_is_named(name, tmp_path):
    script, message = PROBLEMS[name]
    path = write(tmp_path / "e.mcap", script)
    assert inspect(path).ok  # the file itself is sound
    assert any(re.search(message, line) for line in doctor(path).problems), doctor(path).problems


def test_actions_and_phases_without_their_frame_are_named(tmp_path):
    path = tmp_path / "e.mcap"
    with EpisodeWriter(path, SCRIPT.header, SCENE) as writer:
        play(writer, SCRIPT)
        writer.action(Action(99, 0, np.zeros(3), np.zeros(3)))
        writer.phase(Phase(98, 0, "pull"))
        writer.finish(SCRIPT.result)
    assert doctor(path).problems == [
        "/action refers to frames 99, which are not there",
        "/phase refers to frames 98, which are not there",
    ]


def test_an_episode_without_an_end_is_named(tmp_path):
    with EpisodeWriter(tmp_path / "e.mcap", SCRIPT.header, SCENE) as writer:
        play(writer, SCRIPT)
    problems = doctor(tmp_path / "e.mcap.partial").problems
    assert "no /outcome: the episode did not end" in problems
    assert any("the file ends without a footer" in line for line in problems)


def test_broken_physics_may_have_broken_numbers(tmp_path):
    script = with_frame(3, pose=np.full_like(F[3].pose, np.nan), sim_state=np.full(20, np.nan))
    verdict = Verdict(Outcome.INVALID, dragged=False, moved=float("nan"), clear_frame=-1)
    path = write(tmp_path / "e.mcap", dataclasses.replace(script, result=Result(verdict)))
    assert doctor(path).problems == []


def test_a_missing_index_is_named(tmp_path):
    path = tmp_path / "noindex.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, index_types=IndexType.NONE)
        writer.start()
        channel = writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 0, b"{}", 0)
        writer.add_metadata("jenga", {"version": "1.0"})
        writer.finish()
    assert "1 chunks, 0 of them in the index; run: jenga log recover" in inspect(path).problems
    assert not inspect(path).episode.get("key")
    assert any(line.startswith("header:") for line in doctor(path).problems)


def test_frame_numbers_are_shown_as_spans():
    assert spans([7, 1, 2, 3]) == "1-3, 7"
    assert spans(list(range(0, 40, 2))) == "0, 2, 4, 6, 8, 10, 12, 14 and 12 more"
