"""As much of a log as the rows of a dataset need: few of its frames, whole and checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Int

from jenga_data.clock import CONTROL_STEP_NS, MOMENTS
from jenga_data.episode import Episode
from jenga_data.log import codec, profile
from jenga_data.log.gather import Raw, gather, refuse_damage
from jenga_data.log.header import check_kind
from jenga_data.log.index import Window, is_intact, select
from jenga_data.log.reader import read_episode, stack
from jenga_data.log.records import one_line, open_log

_ONCE = (profile.TOWER, profile.OUTCOME)
_PER_FRAME = (profile.STATE, profile.CONTACTS)
_AROUND = (*_PER_FRAME, profile.GRIPPER)
_MARGIN_NS = 2 * CONTROL_STEP_NS
"""So long after the last action the frame is looked for to which it led."""


@dataclass(frozen=True, eq=False)
class Excerpt:
    """Some frames of an episode, in order, as an episode of their own whose actions count through them.

    `number` is what each of them is called in the log, which has `frames` of them in all.
    """

    episode: Episode
    number: Int[np.ndarray, " frame"]
    frames: int


def read_for_rows(path: Path, selection: bool) -> Excerpt:
    """As much of a log as the rows of a dataset need.

    Every byte of the file is compared with the file's checksums. Messages that no row needs are not decoded: that
    is what `doctor` does.

    Args:
        selection: read no actions, frame 0 and the moments that a row of a selection tells of.

    Raises:
        JengaError: as `read_episode`.
        CheckFailed: as `read_episode`.
    """
    with one_line(path):
        with open_log(path) as stream:
            intact = is_intact(stream)
            found = (_begun(path, stream) if selection else _acted(path, stream)) if intact else None
        return found or _whole(path)


def _whole(path: Path) -> Excerpt:
    episode = read_episode(path)
    count = len(episode.pose)
    return Excerpt(episode, np.arange(count), count)


def _begun(path: Path, stream: BinaryIO) -> Excerpt | None:
    """Frame 0, and the frames at `MOMENTS` or the last one before them; None where their times do not lead to them."""
    window = Window(first=_PER_FRAME, first_ns=(max(MOMENTS) + 1) * CONTROL_STEP_NS)
    raw = _gathered(path, stream, _ONCE, window)
    raw.messages = {topic: raw.messages[topic] for topic in (*_ONCE, *_PER_FRAME) if topic in raw.messages}
    last = raw.counted(profile.STATE) - 1
    number = sorted({0, *(min(moment, last) for moment in MOMENTS)})
    for topic in _PER_FRAME:
        messages = [(codec.frame_of(topic, data), time, data) for time, data in raw.messages.get(topic, [])]
        kept = [message for message in messages if message[0] in number]
        if len(kept) != (len(number) if raw.counted(topic) or topic == profile.STATE else 0):
            return None
        raw.messages[topic] = [(time, data) for _, time, data in kept]
    return Excerpt(stack(raw, number), np.array(number), last + 1)


def _acted(path: Path, stream: BinaryIO) -> Excerpt | None:
    """Frame 0, and the frames before and after each action; None where the times of messages do not lead to them.

    Most of a robot's episode is its way to the block and back: no row is made of it.
    """
    window = Window(first=_PER_FRAME, around=profile.ACTION, topics=_AROUND, margin_ns=_MARGIN_NS)
    raw = _gathered(path, stream, (*_ONCE, profile.ACTION), window)
    actions = [codec.read_action(data, time) for time, data in raw.messages.get(profile.ACTION, [])]
    acted = {action.frame + k for action in actions for k in (0, 1)}
    number = sorted({0} | acted)
    if not actions or number[-1] >= raw.counted(profile.STATE):
        return None
    start, end = min(a.time_ns for a in actions), max(a.time_ns for a in actions) + _MARGIN_NS
    for topic in _PER_FRAME:
        messages = [(codec.frame_of(topic, data), time, data) for time, data in raw.messages.get(topic, [])]
        kept = [message for message in messages if message[0] in {0} | acted]
        if len(kept) != (len(number) if raw.counted(topic) else 0):
            return None
        # Samples of the gripper were read around the actions: every step of a row must lie there.
        if not all(start <= time <= end for frame, time, _ in kept if frame in acted):
            return None
        raw.messages[topic] = [(time, data) for _, time, data in kept]
    return Excerpt(stack(raw, number), np.array(number), raw.counted(profile.STATE))


def _gathered(path: Path, stream: BinaryIO, topics: Sequence[str], window: Window) -> Raw:
    raw = gather(select(stream, topics, (profile.CONFIG,), window))
    check_kind(path, raw)
    refuse_damage(path, raw)
    return raw
