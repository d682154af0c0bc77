"""Saving what can be read of an unfinished, cut off or damaged episode into a new, complete file."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from google.protobuf.message import DecodeError
from mcap.records import Attachment, McapRecord, Message, Metadata

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log import profile
from jenga_data.log.checks import spans
from jenga_data.log.gather import MESSAGES, Raw, gather
from jenga_data.log.header import check_kind
from jenga_data.log.output import PARTIAL, Output
from jenga_data.log.records import Damage, one_line, open_log, walk

_PER_FRAME = (profile.STATE, profile.CONTACTS, profile.SIM, profile.ROBOT_STATE)
_WITH_FRAME = (*_PER_FRAME, profile.ACTION, profile.PHASE)


@dataclass
class RecoveryReport:
    """What `jenga log recover` prints. All plain values."""

    path: str
    out: str
    frames: int
    """Complete frames that were saved."""
    has_outcome: bool
    messages: dict[str, int] = field(default_factory=dict)
    """Saved messages by topic."""
    lost: list[str] = field(default_factory=list)
    """What was not saved, one line each; empty if nothing was lost."""


def recovered_path(path: Path) -> Path:
    """Where `jenga log recover` writes if not told: `KEY.mcap.partial` gives `KEY.recovered.mcap` beside it."""
    name = path.name.removesuffix(PARTIAL).removesuffix(".mcap")
    return path.with_name(f"{name}.recovered.mcap")


def recover(path: Path, out: Path) -> RecoveryReport:
    """Copy everything readable, frame by frame: of a frame all or nothing.

    Raises:
        JengaError: no episode, or `out` exists already.
        CheckFailed: the header or every frame is lost, so there is nothing to save. Nothing is written.
    """
    if out.exists():
        raise JengaError(f"{out} exists; choose another name with --out")
    with one_line(path), open_log(path) as stream:
        raw = gather(walk(stream))
    check_kind(path, raw)
    if profile.EPISODE_METADATA not in raw.metadata or not raw.messages.get(profile.TOWER):
        raise CheckFailed(f"{path}: the header is lost ({_first(raw)}); nothing can be recovered")
    frames, lost = _complete_frames(raw)
    if not frames:
        raise CheckFailed(f"{path}: there is no complete frame ({_first(raw)}); nothing can be recovered")
    alone = _half_a_robot(raw)
    lost = [str(damage) for damage in raw.damage] + [f"{topic}: its other half is lost" for topic in alone] + lost
    report = RecoveryReport(str(path), str(out), len(frames), bool(raw.messages.get(profile.OUTCOME)), lost=lost)
    # Not `<out>.partial`: that may be the very file to recover.
    output = Output(out, raw.profile or profile.PROFILE, partial=out.with_name(out.name + ".recovering"))
    try:
        with one_line(path), open_log(path) as stream:
            _copy(walk(stream), raw, frames, output, report)
        output.commit()
    except BaseException:
        output.discard()
        raise
    return report


def _first(raw: Raw) -> str:
    return str(raw.damage[0]) if raw.damage else "the file ends before it"


def _frame_of(topic: str, data: bytes) -> int | None:
    """The frame that a message belongs to, None where it cannot be read."""
    try:
        return int(getattr(MESSAGES[topic].FromString(data), "frame"))  # noqa: B009 - one field of several types
    except DecodeError:
        return None


def _half_a_robot(raw: Raw) -> set[str]:
    """What there is of a robot's model and states where the other is lost: alone it would be refused."""
    found = {topic for topic in (profile.ROBOT, profile.ROBOT_STATE) if raw.messages.get(topic)}
    return found if len(found) == 1 else set()


def _complete_frames(raw: Raw) -> tuple[set[int], list[str]]:
    found = {
        topic: {_frame_of(topic, data) for _, data in raw.messages[topic]} - {None}
        for topic in _PER_FRAME
        if raw.messages.get(topic) and topic not in _half_a_robot(raw)
    }
    states = found.get(profile.STATE, set())
    complete = set.intersection(states, *found.values())
    lost = []
    if partly := [frame for frame in set.union(set(), *found.values()) if frame is not None and frame not in complete]:
        lost.append(f"frames {spans(partly)}: only some of their messages are left")
    whole = {frame for frame in complete if frame is not None}
    last = max(whole, default=-1)
    if last < 2 * len(whole) + 10**5 and (gaps := sorted(set(range(last)) - whole)):
        lost.append(f"frames {spans(gaps)} are missing in the middle")
    if not raw.messages.get(profile.OUTCOME):
        lost.append("the outcome: the episode counts as unfinished")
    return whole, lost


def _copy(
    records: Iterator[McapRecord | Damage], raw: Raw, frames: set[int], output: Output, report: RecoveryReport
) -> None:
    channels: dict[int, int] = {}
    alone = _half_a_robot(raw)
    for record in records:
        match record:
            case Metadata() if record.name != profile.RECOVERY_METADATA:
                output.metadata(record.name, record.metadata)
            case Attachment():
                output.attachment(record.name, record.media_type, record.data)
            case Message() if (channel := raw.channels.get(record.channel_id)) is not None:
                if channel.topic in alone:
                    continue
                if channel.topic in _WITH_FRAME and _frame_of(channel.topic, record.data) not in frames:
                    continue
                if channel.id not in channels:
                    channels[channel.id] = output.channel(channel, raw.schemas.get(channel.schema_id))
                number = channels[channel.id]
                output.raw(number, record.data, record.log_time, record.publish_time, record.sequence)
                report.messages[channel.topic] = report.messages.get(channel.topic, 0) + 1
    before = raw.metadata.get(profile.RECOVERY_METADATA, {}).get("lost", "")
    if lost := "\n".join(filter(None, [before, *report.lost])):
        output.metadata(profile.RECOVERY_METADATA, {"lost": lost})
