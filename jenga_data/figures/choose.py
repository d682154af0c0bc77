"""Which episodes a figure shows: by a rule and never by hand, so that nobody shows the pretty ones."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from jenga_data.episode import EpisodeHeader, Result
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_header
from jenga_data.outcome import Outcome
from jenga_data.progress import progress


@dataclass(frozen=True, eq=False)
class Logged:
    """One log, as far as choosing needs it."""

    path: Path
    header: EpisodeHeader
    result: Result

    @property
    def outcome(self) -> Outcome:
        return self.result.verdict.outcome

    @property
    def has_robot(self) -> bool:
        return self.header.robot is not None


def logged(where: Sequence[Path]) -> list[Logged]:
    """Every finished log below some folders, by key, each episode once; a collection may still be under way.

    Raises:
        JengaError: there is none, or one cannot be read.
    """
    paths = [path for folder in where for path in _logs_below(folder)]
    if not paths:
        raise JengaError(f"no log in {', '.join(map(str, where))}; `jenga collect` makes some")
    found: dict[str, Logged] = {}
    with progress("read headers", len(paths)) as bar:
        for path in paths:
            header, result = read_header(path)
            if result is not None:
                found.setdefault(header.key, Logged(path, header, result))
            bar.advance()
    return [found[key] for key in sorted(found)]


def _logs_below(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.rglob("*.mcap")) if not path.name.endswith(".prediction.mcap")]


def one_a_round(logs: Iterable[Logged]) -> list[Logged]:
    """The first log of each round, by key."""
    first: dict[int, Logged] = {}
    for log in logs:
        first.setdefault(log.header.round, log)
    return [first[number] for number in sorted(first)]


def first_of(logs: Iterable[Logged], *, outcome: Outcome | None = None, cause: str | None = None) -> Logged | None:
    """The first log, by key, that ended so; None if there is none."""
    fitting = (log for log in logs if outcome in (None, log.outcome) and cause in (None, log.result.cause))
    return next(fitting, None)
