"""As much of a log as the rows of a dataset need: few of its frames, whole and checked."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int

from jenga_data.clock import CONTROL_STEP_NS, MOMENTS
from jenga_data.episode import Episode, EpisodeHeader, Result
from jenga_data.log import codec, profile
from jenga_data.log.gather import Raw, gather, refuse_damage
from jenga_data.log.header import check_kind, read_header_of
from jenga_data.log.index import Window, select
from jenga_data.log.reader import read_episode, read_header, result_of, stack
from jenga_data.log.records import one_line, open_log
from jenga_data.outcome import Outcome

_ONCE = (profile.TOWER, profile.OUTCOME)
_PER_FRAME = (profile.STATE, profile.CONTACTS)
_AROUND = (*_PER_FRAME, profile.GRIPPER)
_MARGIN_NS = 2 * CONTROL_STEP_NS
"""So long after the last action the frame is looked for to which it led."""
_BEGUN = Window(first=_PER_FRAME, first_ns=(max(MOMENTS) + 1) * CONTROL_STEP_NS)
_ACTED = Window(first=_PER_FRAME, around=profile.ACTION, topics=_AROUND, margin_ns=_MARGIN_NS)


@dataclass(frozen=True, eq=False)
class Read:
    """What a log says of its episode, and what rows are made from: nothing where its physics broke or it has no end."""

    header: EpisodeHeader
    result: Result | None
    excerpt: "Excerpt | None"


@dataclass(frozen=True, eq=False)
class Excerpt:
    """Some frames of an episode, in order, as an episode of their own whose actions count through them.

    `number` is what each of them is called in the log, which has `frames` of them in all.
    """

    episode: Episode
    number: Int[np.ndarray, " frame"]
    frames: int


def read_for_rows(path: Path, selection: bool, intact: bool) -> Read:
    """As much of a log as the rows of a dataset need, opened once.

    Messages that no row needs are not decoded: that is what `doctor` does.

    Args:
        selection: read no actions, frame 0 and the moments that a row of a selection tells of.
        intact: whether the file is known to be as its writer wrote it (`index.fingerprint`); otherwise all of it is
            read and checked.

    Raises:
        JengaError: as `read_episode`.
        CheckFailed: as `read_episode`.
    """
    with one_line(path):
        if not intact:
            header, result = read_header(path)
            return Read(header, result, _whole(path) if _makes_rows(result) else None)
        topics, window = (_ONCE, _BEGUN) if selection else ((*_ONCE, profile.ACTION), _ACTED)
        with open_log(path) as stream:
            raw = gather(select(stream, topics, (profile.CONFIG,), window))
        check_kind(path, raw)
        refuse_damage(path, raw)
        header, result = read_header_of(raw), result_of(raw)
        if not _makes_rows(result):
            return Read(header, result, None)
        return Read(header, result, (_begun if selection else _acted)(raw, header) or _whole(path))


def _makes_rows(result: Result | None) -> bool:
    return result is not None and result.verdict.outcome is not Outcome.INVALID


def _whole(path: Path) -> Excerpt:
    episode = read_episode(path)
    count = len(episode.pose)
    return Excerpt(episode, np.arange(count), count)


def _begun(raw: Raw, header: EpisodeHeader) -> Excerpt | None:
    """Frame 0, and the frames at `MOMENTS` or the last one before them; None where their times do not lead to them."""
    raw.messages = {topic: raw.messages[topic] for topic in (*_ONCE, *_PER_FRAME) if topic in raw.messages}
    last = raw.counted(profile.STATE) - 1
    number = sorted({0, *(min(moment, last) for moment in MOMENTS)})
    for topic in _PER_FRAME:
        messages = [(codec.frame_of(topic, data), time, data) for time, data in raw.messages.get(topic, [])]
        kept = [message for message in messages if message[0] in number]
        if len(kept) != (len(number) if raw.counted(topic) or topic == profile.STATE else 0):
            return None
        raw.messages[topic] = [(time, data) for _, time, data in kept]
    return Excerpt(stack(raw, header, number), np.array(number), last + 1)


def _acted(raw: Raw, header: EpisodeHeader) -> Excerpt | None:
    """Frame 0, and the frames before and after each action; None where the times of messages do not lead to them.

    Most of a robot's episode is its way to the block and back: no row is made of it. Without actions, as where the
    push failed, no row is made at all.
    """
    actions = [codec.read_action(data, time) for time, data in raw.messages.get(profile.ACTION, [])]
    acted = {action.frame + k for action in actions for k in (0, 1)}
    number = sorted({0} | acted)
    if len(actions) != raw.counted(profile.ACTION) or number[-1] >= raw.counted(profile.STATE):
        return None
    start = min((a.time_ns for a in actions), default=0)
    end = max((a.time_ns for a in actions), default=0) + _MARGIN_NS
    for topic in _PER_FRAME:
        messages = [(codec.frame_of(topic, data), time, data) for time, data in raw.messages.get(topic, [])]
        kept = [message for message in messages if message[0] in {0} | acted]
        if len(kept) != (len(number) if raw.counted(topic) else 0):
            return None
        # Samples of the gripper were read around the actions: every step of a row must lie there.
        if not all(start <= time <= end for frame, time, _ in kept if frame in acted):
            return None
        raw.messages[topic] = [(time, data) for _, time, data in kept]
    return Excerpt(stack(raw, header, number), np.array(number), raw.counted(profile.STATE))
