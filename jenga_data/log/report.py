"""What a log holds and what is wrong with it: `inspect` looks at the file, `doctor` at what the messages say too."""

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Chunk, ChunkIndex, McapRecord, Message

from jenga_data.log import profile
from jenga_data.log.checks import content_problems
from jenga_data.log.gather import Raw, gather
from jenga_data.log.header import check_kind
from jenga_data.log.reader import result_of
from jenga_data.log.records import Damage, one_line, open_log, size_of, walk


@dataclass
class LogReport:
    """What `jenga log info` and `jenga log doctor` print. All plain values: `dataclasses.asdict` gives JSON."""

    path: str
    bytes: int = 0
    complete: bool = False
    """Whether the file reaches its end; a `.partial` file does not."""
    duration_s: float = 0.0
    frames: int = 0
    outcome: str | None = None
    cause: str = ""
    episode: dict[str, str] = field(default_factory=dict)
    """The metadata record "jenga"."""
    provenance: dict[str, str] = field(default_factory=dict)
    recovery: dict[str, str] = field(default_factory=dict)
    """What was lost, if the file was recovered from a damaged one."""
    topics: dict[str, int] = field(default_factory=dict)
    """Number of readable messages by topic."""
    attachments: dict[str, int] = field(default_factory=dict)
    """Size by name [bytes]."""
    problems: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        return not self.problems


def inspect(path: Path) -> LogReport:
    """What is in a file, unfinished and damaged ones too. `problems` lists what cannot be read.

    Raises:
        JengaError: no MCAP file, no episode, or of another major profile version.
    """
    return _examine(path)[0]


def doctor(path: Path) -> LogReport:
    """As `inspect`, with every message decoded and checked against the profile and its neighbours.

    Raises:
        JengaError: as `inspect`.
    """
    report, raw = _examine(path)
    report.problems += content_problems(raw)
    return report


def _examine(path: Path) -> tuple[LogReport, Raw]:
    report = LogReport(str(path))
    tally = _Tally(report)
    with one_line(path):
        with open_log(path) as stream:
            report.bytes = size_of(stream)
            raw = gather(tally.watch(record) for record in walk(stream))
        check_kind(path, raw)
        tally.sum_up(raw)
    return report, raw


class _Tally:
    """Counts records on their way to somebody else."""

    def __init__(self, report: LogReport) -> None:
        self._report = report
        self._counts: dict[int, int] = {}
        self._chunks = self._indexed = 0
        self._first_ns, self._last_ns = 2**64, 0

    def watch(self, record: McapRecord | Damage) -> McapRecord | Damage:
        match record:
            case Message():
                self._counts[record.channel_id] = self._counts.get(record.channel_id, 0) + 1
                self._first_ns = min(self._first_ns, record.log_time)
                self._last_ns = max(self._last_ns, record.log_time)
            case Chunk():
                self._chunks += 1
            case ChunkIndex():
                self._indexed += 1
            case Damage():
                self._report.problems.append(str(record))
        return record

    def sum_up(self, raw: Raw) -> None:
        report = self._report
        report.complete = raw.complete
        report.episode = raw.metadata.get(profile.EPISODE_METADATA, {})
        report.provenance = raw.metadata.get(profile.PROVENANCE_METADATA, {})
        report.recovery = raw.metadata.get(profile.RECOVERY_METADATA, {})
        report.attachments = {name: len(data) for name, data in raw.attachments.items()}
        for channel, count in sorted(self._counts.items()):
            topic = raw.channels[channel].topic if channel in raw.channels else f"channel {channel}"
            report.topics[topic] = report.topics.get(topic, 0) + count
        report.frames = report.topics.get(profile.STATE, 0)
        report.duration_s = max(self._last_ns - self._first_ns, 0) / 1e9
        if raw.complete and self._indexed != self._chunks:
            report.problems.append(
                f"{self._chunks} chunks, {self._indexed} of them in the index; run: jenga log recover"
            )
        # `doctor` says what is wrong with an outcome that cannot be read.
        with suppress(ValueError):
            if result := result_of(raw):
                report.outcome, report.cause = result.verdict.outcome.value, result.cause
