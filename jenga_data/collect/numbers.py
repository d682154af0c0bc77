"""Which episodes of a collection: the first ones, those of some numbers, or those of a dataset. Light: no numpy."""

from collections.abc import Sequence
from dataclasses import dataclass

from jenga_data.command_line import MaybeInt, MaybeText
from jenga_data.errors import JengaError

MOST = 1_000_000
"""More numbers than this are a slip of the keyboard, or a manifest that was forged."""


@dataclass(frozen=True)
class Which:
    """Options that say which episodes to collect; one of the first three."""

    episodes: MaybeInt = None
    """Rollouts in all, those that OUT holds already included."""
    numbers: MaybeText = None
    """In place of --episodes: rollouts of these numbers, such as 5,7,10-20."""
    of: MaybeText = None
    """In place of --episodes: rollouts of the numbers that a dataset (NAME@X.Y.Z or a folder) has in --split, on the
    same towers therefore. --pull 1 --of NAME@X.Y.Z pulls another block of each test tower."""
    split: str = "test"
    """Of that dataset: train, validation, test, or all."""

    def given(self) -> Sequence[int] | None:
        """The numbers, as far as they do not need a dataset: None with --of.

        Raises:
            JengaError: not one of the options was given, or it names nothing.
        """
        if sum(option is not None for option in (self.episodes, self.numbers, self.of)) != 1:
            raise JengaError("which episodes? allowed: one of --episodes N, --numbers 5,7,10-20 and --of DATASET")
        if self.episodes is not None:
            if self.episodes < 1:
                raise JengaError(f"--episodes is {self.episodes}; allowed: 1 and more")
            return range(self.episodes)
        return parse_numbers(self.numbers) if self.numbers is not None else None


def parse_numbers(text: str) -> list[int]:
    """Numbers of episodes from a list of numbers and ranges, such as "5,7,10-20": ascending, each once.

    Raises:
        JengaError: it is no such list, or names more than `MOST`.
    """
    found: set[int] = set()
    for part in text.split(","):
        first, dash, last = (piece.strip() for piece in part.partition("-"))
        last = last if dash else first
        if not all(piece.isascii() and piece.isdecimal() and len(piece) < 16 for piece in (first, last)):
            raise JengaError(f"--numbers is {text!r}; allowed: numbers and ranges, such as 5,7,10-20")
        if not int(first) <= int(last) < int(first) + MOST - len(found):
            raise JengaError(f"--numbers has {part.strip()!r}; allowed: first-last, {MOST:,} numbers in all at most")
        found.update(range(int(first), int(last) + 1))
    return sorted(found)
