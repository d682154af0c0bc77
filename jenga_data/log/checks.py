"""Whether the messages of an episode make sense. One line a problem, and no end at the first one."""

from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from jenga_data.episode import ROBOT, Contacts, RobotModel, RobotState
from jenga_data.log import codec, profile
from jenga_data.log.gather import Raw
from jenga_data.log.header import read_header_of
from jenga_data.log.reader import result_of
from jenga_data.outcome import Outcome

T = TypeVar("T")


def content_problems(raw: Raw) -> list[str]:
    """Everything that keeps an episode from being read or believed."""
    problems = list(raw.wrong_schema)
    try:
        header = read_header_of(raw)
    except ValueError as error:
        return [*problems, f"header: {error}"]
    try:
        result = result_of(raw)
        if result is None:
            problems.append(f"no {profile.OUTCOME}: the episode did not end")
    except ValueError as error:
        result = None
        problems.append(f"{profile.OUTCOME}: {error}")
    count = len(header.blocks)
    states = _decode(raw, profile.STATE, lambda data: codec.read_state(data, count), problems)
    contacts = _decode(raw, profile.CONTACTS, codec.read_contacts, problems)
    sim_states = _decode(raw, profile.SIM, codec.read_sim_state, problems)
    robot_states = _robot_states(raw, header.robot, problems)
    if not states:
        problems.append(f"no messages on {profile.STATE}")

    problems += _time_problems(raw, profile.STATE)
    problems += _gaps(profile.STATE, states, max(states, default=-1) + 1)
    per_frame = ((profile.CONTACTS, contacts), (profile.SIM, sim_states), (profile.ROBOT_STATE, robot_states))
    for topic, found in per_frame:
        if found:
            problems += _gaps(topic, found, max(states, default=-1) + 1)
    # Where the physics broke, numbers that are none are what the log should show.
    if result is None or result.verdict.outcome is not Outcome.INVALID:
        problems += _pose_problems({frame: pose for frame, (pose, _, _) in states.items()})
        problems += _finite(f"{profile.STATE} twist", {frame: twist for frame, (_, twist, _) in states.items()})
        problems += _finite(profile.SIM, sim_states)
        problems += _robot_problems(robot_states)
        problems += _turntable_problems({frame: angle for frame, (_, _, angle) in states.items()})
    problems += _contact_problems(contacts, count)
    if len(lengths := {len(state) for state in sim_states.values()}) > 1:
        problems.append(f"{profile.SIM}: states of {len(lengths)} different lengths")

    samples = [_try(codec.read_gripper, pair, profile.GRIPPER, problems) for pair in _messages(raw, profile.GRIPPER)]
    problems += _pose_problems({i: s.pose[None] for i, s in enumerate(samples) if s}, f"{profile.GRIPPER} sample")
    actions = [_try(codec.read_action, pair, profile.ACTION, problems) for pair in _messages(raw, profile.ACTION)]
    problems += _finite(profile.ACTION, {a.frame: np.stack([a.displacement, a.reached]) for a in actions if a})
    phases = [_try(codec.read_phase, pair, profile.PHASE, problems) for pair in _messages(raw, profile.PHASE)]
    problems += _without_state(profile.ACTION, [a.frame for a in actions if a], states)
    problems += _without_state(profile.PHASE, [p.frame for p in phases if p], states)
    return problems


def spans(frames: list[int]) -> str:
    """Frame numbers as a short text: [1, 2, 3, 7] is "1-3, 7"."""
    runs: list[list[int]] = []
    for frame in sorted(frames):
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    shown = [f"{a}-{b}" if b > a else str(a) for a, b in runs[:8]]
    return ", ".join(shown) + (f" and {len(runs) - 8} more" if len(runs) > 8 else "")


def _messages(raw: Raw, topic: str) -> list[tuple[int, bytes]]:
    return raw.messages.get(topic, [])


def _try(read: Callable[[bytes, int], T], pair: tuple[int, bytes], topic: str, problems: list[str]) -> T | None:
    time, data = pair
    try:
        return read(data, time)
    except ValueError as error:
        problems.append(f"{topic} at {time} ns: {error}")
        return None


def _decode(raw: Raw, topic: str, read: Callable[[bytes], tuple[int, T]], problems: list[str]) -> dict[int, T]:
    found: dict[int, T] = {}
    for time, data in _messages(raw, topic):
        try:
            frame, value = read(data)
        except ValueError as error:
            problems.append(f"{topic} at {time} ns: {error}")
            continue
        if frame in found:
            problems.append(f"{topic} has frame {frame} twice")
        found[frame] = value
    return found


def _gaps(topic: str, found: Mapping[int, object], count: int) -> list[str]:
    problems = []
    # A single absurd frame number must not make a list of four billion missing ones.
    if len(missing := sorted(set(range(min(count, len(found) + 10**5))) - found.keys())):
        problems.append(f"{topic} lacks frames {spans(missing)}")
    if extra := [frame for frame in found if frame >= count]:
        problems.append(f"{topic} has frames {spans(extra)} without {profile.STATE}")
    return problems


def _time_problems(raw: Raw, topic: str) -> list[str]:
    times = np.array([time for time, _ in _messages(raw, topic)], np.int64)
    back = np.flatnonzero(np.diff(times) <= 0)
    return [f"{topic} goes back in time {len(back)} times, first after {times[back[0]]} ns"] if len(back) else []


def _finite(what: str, values: dict[int, np.ndarray]) -> list[str]:
    bad = [frame for frame, value in values.items() if not np.isfinite(value).all()]
    return [f"{what}: numbers that are not finite in frames {spans(bad)}"] if bad else []


def _pose_problems(poses: dict[int, Float[np.ndarray, "body 7"]], what: str = f"{profile.STATE} pose") -> list[str]:
    problems = _finite(what, poses)
    with np.errstate(over="ignore"):  # of absurd numbers the length is infinite, and so not 1
        off = {frame: np.abs(np.linalg.norm(pose[:, 3:], axis=1) - 1) for frame, pose in poses.items()}
    if bad := [frame for frame, error in off.items() if (error > codec.UNIT_TOLERANCE).any()]:
        problems.append(f"{what}: quaternions of a length other than 1 in frames {spans(bad)}")
    return problems


def _robot_states(raw: Raw, robot: RobotModel | None, problems: list[str]) -> dict[int, RobotState]:
    there, states = robot is not None, bool(_messages(raw, profile.ROBOT_STATE))
    if there != states:
        problems.append(
            f"{profile.ROBOT if there else profile.ROBOT_STATE} without "
            f"{profile.ROBOT_STATE if there else profile.ROBOT}"
        )
    if robot is None:
        return {}
    return _decode(raw, profile.ROBOT_STATE, lambda data: codec.read_robot_state(data, robot), problems)


def _robot_problems(states: dict[int, RobotState]) -> list[str]:
    problems = []
    for name in ("position", "velocity", "torque"):
        problems += _finite(f"{profile.ROBOT_STATE} {name}", {frame: getattr(s, name) for frame, s in states.items()})
    return problems + _pose_problems({frame: s.link_pose for frame, s in states.items()}, f"{profile.ROBOT_STATE} link")


def _turntable_problems(angle: dict[int, float]) -> list[str]:
    problems = _finite(f"{profile.STATE} turntable", {frame: np.array(value) for frame, value in angle.items()})
    if angle.get(0, 0.0):
        problems.append(f"{profile.STATE} turntable: {angle[0]} rad in frame 0, from which it counts; needed: 0")
    return problems


def _contact_problems(contacts: dict[int, Contacts], blocks: int) -> list[str]:
    problems = _finite(profile.CONTACTS, {frame: found.force for frame, found in contacts.items()})
    bad = [
        frame
        for frame, found in contacts.items()
        if ((found.first < 0) | (found.first >= blocks) | (found.second < ROBOT) | (found.second >= blocks)).any()
    ]
    if bad:
        problems.append(f"{profile.CONTACTS}: bodies that are none in frames {spans(bad)}")
    return problems


def _without_state(topic: str, frames: list[int], states: dict[int, T]) -> list[str]:
    missing = sorted(set(frames) - states.keys())
    return [f"{topic} refers to frames {spans(missing)}, which are not there"] if missing else []
