"""Which frames of an episode tell its story: a few moments, chosen by its phases and by how it ended."""

from dataclasses import dataclass, replace

import numpy as np

from jenga_data.episode import Episode
from jenga_data.outcome import THRESHOLDS, Outcome, collapsed
from jenga_data.replay.measures import frame_at, phase_name

MOMENTS = 6

_BEFORE_FALL = 0.24
"""So long before a block has lost its level a toppling tower still looks whole [s]."""


@dataclass(frozen=True)
class Moment:
    """A frame and what it shows, in a word or three."""

    frame: int
    name: str


def telling_moments(episode: Episode, count: int = MOMENTS) -> list[Moment]:
    """The moments that show how an episode went, in order: `count` of them, or every frame of a shorter episode.

    An extraction is shown until 2 s after the target was clear, a collapse around the fall, a stuck block until the
    end. Physics that broke are shown up to the last frame in which every number is finite.
    """
    finite = np.asarray(np.isfinite(episode.pose).all(axis=(1, 2)))
    last = len(finite) - 1 if finite.all() else max(int(np.argmin(finite)) - 1, 0)
    chosen: dict[int, str] = {}
    for moment in _events(episode, last):
        if 0 <= moment.frame <= last and len(chosen) < count:
            chosen.setdefault(moment.frame, moment.name)
    while len(chosen) < min(count, last + 1):
        edges = np.array(sorted({*chosen, 0, last}))
        widest = int(np.argmax(np.diff(edges, append=edges[-1])))
        frame = next(f for f in (int(edges[widest : widest + 2].sum()) // 2, 0, last) if f not in chosen)
        chosen[frame] = phase_name(episode, frame)
    return [Moment(frame, chosen[frame]) for frame in sorted(chosen)]


def _events(episode: Episode, last: int) -> list[Moment]:
    """What must be seen, the most important first where two fall on one frame."""
    start, end = Moment(0, "start"), Moment(last, "end")
    verdict = episode.result.verdict if episode.result else None
    if episode.robot is not None:
        return _key_frames(episode, last)
    pull = _phase_start(episode, "pull")
    if pull is None or verdict is None or verdict.outcome is Outcome.INVALID:
        return [start, end]
    release = _phase_start(episode, "observe") or last
    grasped = [Moment(pull, "grasped")] if pull > 0 else []
    if verdict.outcome is Outcome.EXTRACTED:
        clear = verdict.clear_frame
        later = [Moment(_later(episode, clear, seconds), f"{seconds} s later") for seconds in (1, 2)]
        return [start, Moment(clear, "clear"), *later, *grasped, *_pulling(episode, pull, clear, 2 - len(grasped))]
    if verdict.outcome is Outcome.COLLAPSED:
        fall = _fall(episode)
        before = max(_later(episode, fall, -_BEFORE_FALL), (pull + fall) // 2)
        falling = [Moment(fall, "falls"), Moment((fall + last) // 2, "falls")]
        under_way = [] if grasped else [Moment((pull + min(release, before)) // 2, "pull")]
        return [start, end, *falling, Moment(before, "before the fall"), *grasped, *under_way]
    share = (release - pull) / (3 - len(grasped))
    under_way = [Moment(round(pull + share * i), "pull") for i in range(1, 3 - len(grasped))]
    return [start, end, Moment(release, "pull ends"), Moment((release + last) // 2, "observe"), *grasped, *under_way]


_STORY = {"push": "stick taken", "approach": "turned back", "pull": "grasped", "put_down": "extracted"}
"""Phases of a robot's rollout, and what has been done when they begin."""


def _key_frames(episode: Episode, last: int) -> list[Moment]:
    """The paper's six: stick taken, pushed out, turned back, grasped, pulling, extracted; or as far as it came, and
    how it ended."""
    begun = {phase.name: phase.frame for phase in episode.phases}
    events = [Moment(begun[phase], name) for phase, name in _STORY.items() if phase in begun]
    if (push := begun.get("push")) is not None:
        until = begun.get("turn_back", last)
        way = np.abs(
            episode.pose[push : until + 1, episode.header.target, 0] - episode.pose[push, episode.header.target, 0]
        )
        events.insert(1, Moment(push + int(np.argmax(way >= 0.98 * way.max())), "pushed"))
    if (pull := begun.get("pull")) is not None:
        clear = episode.result.verdict.clear_frame if episode.result else -1
        ends = [clear, begun.get("put_down", -1), begun.get("release", -1)]
        until = min((end for end in ends if end > pull), default=last)
        events.append(Moment((pull + until) // 2, "pull"))
    if "put_down" not in begun:
        events.append(Moment(last, "end"))
    elif episode.result and episode.result.verdict.failure:  # the block is out, but the tower came down with it
        events = [replace(m, name="block out") if m.name == "extracted" else m for m in events[1:]]
        events.append(Moment(last, "end"))
    return events


def _phase_start(episode: Episode, name: str) -> int | None:
    """The frame at which the first phase of that name begins."""
    return next((phase.frame for phase in episode.phases if phase.name == name), None)


def _later(episode: Episode, frame: int, seconds: float) -> int:
    """The frame so many seconds after another one."""
    return int(frame_at(episode, episode.time_ns[[frame]] + round(seconds * 1e9))[0])


def _fall(episode: Episode) -> int:
    """The first frame in which a block has lost the level it lay on."""
    fallen = collapsed(episode.pose[0], episode.pose, episode.header.target, THRESHOLDS.drop)
    return int(np.argmax(fallen))


def _pulling(episode: Episode, pull: int, clear: int, count: int) -> list[Moment]:
    """Frames that part the target's way from the pull to where it is clear into `count` + 1 equal pieces."""
    way = episode.pose[pull, episode.header.target, 0] - episode.pose[pull : clear + 1, episode.header.target, 0]
    part = np.arange(1, count + 1) / (count + 1)
    return [Moment(pull + int(np.argmax(way >= share * way[-1])), "pull") for share in part]
