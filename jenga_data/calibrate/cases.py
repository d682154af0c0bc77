"""Running the cases of a calibration: in parallel, and each only once, so that a long run can be interrupted."""

import errno
import hashlib
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from filelock import FileLock, Timeout

from jenga_data.errors import JengaError
from jenga_data.pool import run_every
from jenga_data.progress import progress

Case = tuple[Callable[..., dict[str, Any]], dict[str, Any]]
"""A function of a module and its keyword arguments; both decide the result to the last bit."""


def run_cases(cases: Sequence[Case], store: Path, workers: int, label: str) -> list[dict[str, Any]]:
    """What each case gives, in the order of the cases.

    Results are kept in `store`, one line of JSON each under a hash of function and arguments. A line that was cut
    short is done again. A result is always what JSON makes of it (a NaN is None), whether it is new or was kept.

    Raises:
        JengaError: the store cannot be written or is in use, or a case ended its worker twice.
    """
    if workers < 1:
        raise JengaError(f"workers is {workers}; allowed: 1 or more")
    keys = [_key(case) for case in cases]
    try:
        store.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(store.with_suffix(".lock")).acquire(timeout=0):
            known = _read(store)
            missing = {key: case for key, case in zip(keys, cases, strict=True) if key not in known}
            with progress(label, len(cases)) as bar, store.open("ab") as file:
                bar.advance(len(cases) - len(missing))
                for (key, _), result in run_every(
                    _work, missing.items(), workers, f"what is done is kept in {store}: "
                ):
                    line = msgspec.json.encode({"key": key, "result": result}, enc_hook=_plain)
                    known[key] = msgspec.json.decode(line)["result"]
                    file.write(line + b"\n")
                    file.flush()
                    bar.advance(1)
    except Timeout:
        raise JengaError(
            f"another process calibrates into {store.parent}; wait for it or choose another --out"
        ) from None
    except OSError as error:
        why = "the disk is full" if error.errno == errno.ENOSPC else os.strerror(error.errno or 0)
        raise JengaError(f"cannot write to {store.parent}: {why}; what is done is kept") from None
    return [known[key] for key in keys]


def _work(item: tuple[str, Case]) -> dict[str, Any]:
    _, (function, arguments) = item
    return function(**arguments)


def _key(case: Case) -> str:
    function, arguments = case
    name = f"{function.__module__}.{function.__qualname__}"
    return hashlib.sha256(msgspec.json.encode([name, arguments], order="deterministic")).hexdigest()[:20]


def _plain(value: object) -> object:
    """numpy's scalars as Python's own."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a result holds {value!r}")


def _read(store: Path) -> dict[str, dict[str, Any]]:
    """The results of a store; a last line that is cut short is cut off, so that what is added stands on its own."""
    known: dict[str, dict[str, Any]] = {}
    if not store.exists():
        return known
    whole = 0
    for line in store.read_bytes().splitlines(keepends=True):
        if not line.endswith(b"\n"):
            break
        try:
            entry = msgspec.json.decode(line)
            known[entry["key"]] = entry["result"]
        except (msgspec.DecodeError, KeyError, TypeError):
            break
        whole += len(line)
    with store.open("r+b") as file:
        file.truncate(whole)
    return known
