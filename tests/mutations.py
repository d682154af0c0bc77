"""Ways to spoil a file: what disks, networks and attackers do to one, as a hypothesis strategy over real bytes."""

import os
import resource
import signal
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

from jenga_data.errors import JengaError

_CUTS = 2**16
"""Positions are drawn as fractions of the file, so that one drawn example fits files of any length."""
ABSURD = (0, 1, 0x7F, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)
"""Numbers that lengths, counts and times are replaced with."""

Edit = Callable[[bytes], bytes]


def _at(data: bytes, fraction: int) -> int:
    return len(data) * fraction // _CUTS


def _flip(where: int, bit: int) -> Edit:
    def edit(data: bytes) -> bytes:
        if not data:
            return data
        out = bytearray(data)
        out[_at(data, where)] ^= 1 << bit
        return bytes(out)

    return edit


def _cut(where: int) -> Edit:
    return lambda data: data[: _at(data, where)]


def _remove(start: int, count: int) -> Edit:
    return lambda data: data[: _at(data, start)] + data[_at(data, start) + count :]


def _insert(where: int, what: bytes) -> Edit:
    return lambda data: data[: _at(data, where)] + what + data[_at(data, where) :]


def _overwrite(where: int, what: bytes) -> Edit:
    return lambda data: data[: _at(data, where)] + what + data[_at(data, where) + len(what) :]


def _move(start: int, count: int, to: int) -> Edit:
    """Swap a stretch with another of the same length: chunks in another order, pages of another column."""

    def edit(data: bytes) -> bytes:
        a, b = sorted((_at(data, start), _at(data, to)))
        size = min(count, b - a, len(data) - b)
        return data[:a] + data[b : b + size] + data[a + size : b] + data[a : a + size] + data[b + size :]

    return edit


_POSITION = st.integers(0, _CUTS - 1)
_NUMBER = st.tuples(st.sampled_from(ABSURD), st.sampled_from("BHIQ")).map(
    lambda pair: struct.pack("<" + pair[1], pair[0] % 2 ** (8 * struct.calcsize(pair[1])))
)


def edits(at_most: int = 4) -> st.SearchStrategy[Sequence[Edit]]:
    """One to `at_most` ways to spoil a file, one after the other."""
    one = st.one_of(
        st.builds(_flip, _POSITION, st.integers(0, 7)),
        st.builds(_cut, _POSITION),
        st.builds(_remove, _POSITION, st.integers(1, 5000)),
        st.builds(_insert, _POSITION, st.binary(min_size=1, max_size=40)),
        st.builds(_overwrite, _POSITION, _NUMBER),
        st.builds(_overwrite, _POSITION, st.binary(min_size=1, max_size=40)),
        st.builds(_move, _POSITION, st.integers(1, 5000), _POSITION),
    )
    return st.lists(one, min_size=1, max_size=at_most)


def spoiled(data: bytes, how: Sequence[Edit]) -> bytes:
    for edit in how:
        data = edit(data)
    return data


# --- how many, and how long ----------------------------------------------------------------------------------------

DEFAULT_INPUTS = 300
SECONDS = 10.0
"""Most CPU time that reading one spoiled file may take; they are small."""


def inputs(share: float) -> int:
    """A test's share of the spoiled files in a run: of $JENGA_FUZZ_INPUTS, or of few enough for every day."""
    return max(1, round(share * int(os.environ.get("JENGA_FUZZ_INPUTS", DEFAULT_INPUTS))))


def fuzz(share: float) -> Callable[[Any], Any]:
    """Settings of a test over its share of the inputs: the same ones every time, times bounded by `in_time`."""
    return settings(
        max_examples=inputs(share),
        derandomize=True,
        deadline=None,
        database=None,
        suppress_health_check=(HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much),
        phases=(Phase.generate, Phase.shrink),
    )


@contextmanager
def in_time(seconds: float = SECONDS) -> Iterator[None]:
    """Fail where the body takes more CPU time: what other work there is on the machine does not count."""

    def stop(*_: object) -> None:
        raise AssertionError(f"still not done after {seconds} s of CPU time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def peak_mib() -> float:
    """Most memory that this process ever had [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def refused(read: Callable[[], object]) -> str:
    """What reading says against a file, "" where it accepts it. Anything but a `JengaError` of one line fails."""
    with in_time():
        try:
            read()
        except JengaError as error:
            said = str(error)
            assert "\n" not in said
            assert len(said) < 3000
            return said
    return ""
