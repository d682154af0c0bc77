"""Which episodes of a collection: all up to a count, or those that are named. Light: the command line reads it."""

from jenga_data.errors import JengaError

MOST = 1_000_000
"""More numbers than this are a slip of the keyboard."""


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
