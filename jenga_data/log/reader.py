"""Reading episodes, whoever wrote them. Nothing in a file is run, and nothing it claims is believed unchecked."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from jenga_data.episode import (
    Action,
    Contacts,
    Episode,
    EpisodeHeader,
    Result,
    RobotModel,
    RobotTrack,
)
from jenga_data.errors import JengaError
from jenga_data.log import codec, profile
from jenga_data.log.gather import Raw, gather, refuse_damage
from jenga_data.log.header import check_kind, read_header_of
from jenga_data.log.index import select
from jenga_data.log.records import one_line, open_log, walk

T = TypeVar("T")


def read_episode(path: Path) -> Episode:
    """The whole log, stacked by frame.

    Raises:
        JengaError: no MCAP file, no episode, or one of another major profile version.
        CheckFailed: damaged, unfinished, frames are missing, or a message does not fit the profile.
    """
    with one_line(path):
        with open_log(path) as stream:
            raw = gather(walk(stream))
        check_kind(path, raw)
        refuse_damage(path, raw)
        return stack(raw, read_header_of(raw))


def read_header(path: Path) -> tuple[EpisodeHeader, Result | None]:
    """What the episode is and how it ended; frames are neither read nor checked.

    Raises:
        JengaError: as `read_episode`.
    """
    with one_line(path):
        with open_log(path) as stream:
            raw = gather(select(stream, (profile.TOWER, profile.ROBOT, profile.OUTCOME), (profile.CONFIG,)))
        check_kind(path, raw)
        refuse_damage(path, raw)
        return read_header_of(raw), result_of(raw)


def attachment(path: Path, name: str) -> bytes:
    """One attachment, e.g. "scene.xml".

    Raises:
        JengaError: there is none of that name; the message lists those that there are.
    """
    with one_line(path):
        with open_log(path) as stream:
            raw = gather(select(stream, (), (name,)), _no_topic)
            if name in raw.attachments:
                return raw.attachments[name]
            raw = gather(walk(stream), _no_topic)
        refuse_damage(path, raw)
        raise JengaError(f"{path} has no attachment {name!r}; it has: {', '.join(raw.attachments) or 'none'}")


def stack(raw: Raw, header: EpisodeHeader, number: Sequence[int] | None = None) -> Episode:
    """The episode of which everything was gathered.

    Args:
        header: its own, as `read_header_of` says.
        number: the frames that were, in order, where it is an excerpt: the result's frames and actions count through
            them.

    Raises:
        ValueError: a frame is missing, or a message does not fit the profile.
    """
    place = None if number is None else {frame: i for i, frame in enumerate(number)}

    def placed(found: tuple[int, T]) -> tuple[int, T]:
        return found if place is None else (place[found[0]], found[1])

    frames = by_frame(raw, profile.STATE, lambda data: placed(codec.read_state(data, len(header.blocks))))
    if not frames:
        raise ValueError(f"no messages on {profile.STATE}; needed: one a control step")
    count = len(frames)
    contacts = by_frame(raw, profile.CONTACTS, lambda data: placed(codec.read_contacts(data)), count)
    states = by_frame(raw, profile.SIM, codec.read_sim_state, count)
    if len({len(state) for _, state in states}) > 1:
        raise ValueError(f"{profile.SIM} has states of different lengths; needed: one length")
    actions = [codec.read_action(data, time) for time, data in raw.messages.get(profile.ACTION, [])]
    actions = sorted((placed((action.frame, action)) for action in actions), key=lambda pair: pair[0])
    phases = [codec.read_phase(data, time) for time, data in raw.messages.get(profile.PHASE, [])]
    for topic, frame in [(profile.ACTION, f) for f, _ in actions] + [(profile.PHASE, p.frame) for p in phases]:
        if frame >= count:
            raise ValueError(f"{topic} has frame {frame}, the last frame of {profile.STATE} is {count - 1}")
    return Episode(
        header=header,
        time_ns=np.array([time for time, _ in frames], np.int64),
        pose=np.stack([pose for _, (pose, _, _) in frames]),
        twist=np.stack([twist for _, (_, twist, _) in frames]),
        contacts=[found for _, found in contacts] or [_no_contacts() for _ in frames],
        sim_state=np.stack([state for _, state in states]) if states else np.zeros((count, 0)),
        action_frame=np.array([frame for frame, _ in actions], np.int64),
        action=np.array([action.displacement for _, action in actions]).reshape(-1, 3),
        action_reached=np.array([action.reached for _, action in actions]).reshape(-1, 3),
        action_wanted=_wanted([action for _, action in actions]),
        gripper=codec.read_gripper_track(raw.messages.get(profile.GRIPPER, [])),
        phases=sorted(phases, key=lambda phase: phase.time_ns),
        result=result_of(raw),
        turntable=np.array([angle for _, (_, _, angle) in frames]),
        robot=_robot_track(raw, header.robot, count),
    )


def _wanted(actions: list[Action]) -> np.ndarray | None:
    if all(action.wanted is None for action in actions):
        return None
    return np.array([action.displacement if action.wanted is None else action.wanted for action in actions])


def _robot_track(raw: Raw, robot: RobotModel | None, count: int) -> RobotTrack | None:
    """The robot's states at `count` frames, None where there is no robot.

    Raises:
        ValueError: a state is missing or does not fit the robot, or there are states of no robot.
    """
    messages = raw.messages.get(profile.ROBOT_STATE, [])
    if robot is None and not messages:
        return None
    if robot is None or not messages:
        there, missing = (profile.ROBOT, profile.ROBOT_STATE) if robot else (profile.ROBOT_STATE, profile.ROBOT)
        raise ValueError(f"no messages on {missing}; needed where there is {there}")
    states = [s for _, s in by_frame(raw, profile.ROBOT_STATE, lambda data: codec.read_robot_state(data, robot), count)]
    return RobotTrack(
        position=np.stack([state.position for state in states]),
        velocity=np.stack([state.velocity for state in states]),
        torque=np.stack([state.torque for state in states]),
        link_pose=np.stack([state.link_pose for state in states]),
    )


def by_frame(
    raw: Raw, topic: str, read: Callable[[bytes], tuple[int, T]], count: int | None = None
) -> list[tuple[int, T]]:
    """Time and value of each message of a topic, in the order of the frames.

    Raises:
        ValueError: a frame comes twice, is missing, or there are not `count` of them (none at all is allowed).
    """
    found: dict[int, tuple[int, T]] = {}
    for time, data in raw.messages.get(topic, []):
        frame, value = read(data)
        if frame in found:
            raise ValueError(f"{topic} has frame {frame} twice")
        found[frame] = (time, value)
    expected = count if count is not None and found else len(found)
    if missing := [frame for frame in range(expected) if frame not in found]:
        raise ValueError(
            f"{topic} lacks frame {missing[0]} ({len(missing)} missing of {max(expected, max(found) + 1)})"
        )
    if len(found) > expected:
        raise ValueError(f"{topic} has {len(found)} frames, {profile.STATE} has {expected}")
    return [found[frame] for frame in range(expected)]


def result_of(raw: Raw) -> Result | None:
    """How the episode ended, None where it did not.

    Raises:
        ValueError: there are several outcomes, or an unknown one.
    """
    outcomes = raw.messages.get(profile.OUTCOME, [])
    if len(outcomes) > 1:
        raise ValueError(f"{len(outcomes)} messages on {profile.OUTCOME}; allowed: 1")
    return codec.read_outcome(outcomes[0][1]) if outcomes else None


def _no_topic(topic: str) -> None:
    """For `gather`: no messages at all."""


def _no_contacts() -> Contacts:
    return Contacts(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)))
