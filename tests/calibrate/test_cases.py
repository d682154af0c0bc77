"""Each case is done once, whatever happened to the run before."""

import errno
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from filelock import FileLock

from jenga_data.calibrate import cases
from jenga_data.calibrate.cases import Case, run_cases
from jenga_data.errors import JengaError
from jenga_data.sim.physics import PhysicsConfig


def squared(number: int, notes: str | None = None) -> dict[str, Any]:
    """Leaves a note of having been done."""
    if notes is not None:
        with Path(notes).open("a") as file:
            file.write(f"{number}\n")
    return {"square": number**2}


def doubled(number: int) -> dict[str, Any]:
    return {"double": 2 * number}


def of_numpy() -> dict[str, Any]:
    numbers = {"mean": np.float64(0.1), "count": np.int64(3), "stands": np.bool_(True)}
    return {**numbers, "none": float("nan"), "pair": (1, 2)}


def of_array() -> dict[str, Any]:
    return {"pose": np.zeros(3)}


def dies_at_three(number: int) -> dict[str, Any]:
    if number == 3:
        os._exit(9)
    return {"number": number}


def refuses(number: int) -> dict[str, Any]:
    raise JengaError(f"number {number}: no tower stood")


def described(physics: PhysicsConfig) -> dict[str, Any]:
    return {"friction": physics.friction}


@pytest.fixture
def store(tmp_path: Path) -> Path:
    return tmp_path / "calibration" / "squares.jsonl"


@pytest.fixture
def noted(tmp_path: Path) -> list[Case]:
    """Cases 0 to 5; `done` tells which were worked on."""
    return [(squared, {"number": n, "notes": str(tmp_path / "notes")}) for n in range(6)]


def done(tmp_path: Path) -> list[int]:
    """Which were worked on since this was asked last."""
    notes = tmp_path / "notes"
    numbers = [int(line) for line in notes.read_text().splitlines()] if notes.exists() else []
    notes.unlink(missing_ok=True)
    return sorted(numbers)


def refused(of: list[Case], store: Path, workers: int = 1) -> str:
    with pytest.raises(JengaError) as error:
        run_cases(of, store, workers, "x")
    assert "\n" not in str(error.value)
    return str(error.value)


SQUARES = [{"square": n**2} for n in range(6)]


@pytest.mark.parametrize("workers", [1, 2])
def test_results_are_in_the_order_of_the_cases(store, noted, workers):
    assert run_cases(noted, store, workers, "x") == SQUARES
    assert run_cases(noted[::-1], store, workers, "x") == SQUARES[::-1]


def test_each_case_is_done_only_once(store, noted, tmp_path):
    run_cases(noted[:4], store, 1, "x")
    assert done(tmp_path) == [0, 1, 2, 3]
    assert run_cases([*noted, noted[5], noted[1]], store, 1, "x") == [*SQUARES, SQUARES[5], SQUARES[1]]
    assert done(tmp_path) == [4, 5]
    before = store.read_bytes()
    assert run_cases(noted, store, 1, "x") == SQUARES
    assert done(tmp_path) == []
    assert store.read_bytes() == before


def test_function_and_arguments_tell_cases_apart_and_their_order_does_not(store):
    with_arguments: list[Case] = [
        (squared, {"number": 3}),
        (doubled, {"number": 3}),
        (squared, {"number": 4, "notes": None}),
        (squared, {"notes": None, "number": 4}),
        *((described, {"physics": PhysicsConfig(friction=friction)}) for friction in (0.3, 0.4)),
    ]
    expected = [{"square": 9}, {"double": 6}, {"square": 16}, {"square": 16}, {"friction": 0.3}, {"friction": 0.4}]
    assert run_cases(with_arguments, store, 1, "x") == expected
    assert len(store.read_bytes().splitlines()) == 5


@pytest.mark.parametrize("cut", [1, 2, 20])
def test_a_last_line_that_was_cut_is_done_again_and_stands_on_its_own(store, noted, tmp_path, cut):
    """Also one of which only the end of the line is missing."""
    run_cases(noted[:3], store, 1, "x")
    done(tmp_path)
    whole = store.read_bytes()
    store.write_bytes(whole[:-cut])
    assert run_cases(noted[:4], store, 1, "x") == SQUARES[:4]
    assert done(tmp_path) == [2, 3]
    assert store.read_bytes().startswith(whole)
    assert run_cases(noted[:4], store, 1, "x") == SQUARES[:4]
    assert done(tmp_path) == []


@pytest.mark.parametrize("line", ["[]", '{"key": "a"}', "\0\0\0\0", "no JSON", '{"result": {}}'])
def test_a_line_of_something_else_ends_what_is_known(store, noted, tmp_path, line):
    run_cases(noted[:2], store, 1, "x")
    done(tmp_path)
    kept = store.read_bytes()
    store.write_bytes(kept + line.encode() + b"\n")
    assert run_cases(noted[:3], store, 1, "x") == SQUARES[:3]
    assert done(tmp_path) == [2]
    assert store.read_bytes().startswith(kept)
    assert len(store.read_bytes().splitlines()) == 3


def test_a_store_that_is_in_use_is_refused_and_not_touched(store, noted, tmp_path):
    run_cases(noted[:2], store, 1, "x")
    before, _ = store.read_bytes(), done(tmp_path)
    with FileLock(store.with_suffix(".lock")):
        said = refused(noted, store)
    assert said == f"another process calibrates into {store.parent}; wait for it or choose another --out"
    assert store.read_bytes() == before
    assert done(tmp_path) == []
    assert run_cases(noted, store, 1, "x") == SQUARES


def test_a_place_that_cannot_be_written_is_told_in_one_line(tmp_path, noted):
    (tmp_path / "taken").write_text("a file")
    for store in (tmp_path / "taken" / "x.jsonl", tmp_path / "taken" / "deeper" / "x.jsonl"):
        assert re.fullmatch(rf"cannot write to {store.parent}: \w.*; what is done is kept", refused(noted, store))
    assert done(tmp_path) == []


@pytest.mark.parametrize(("number", "why"), [(errno.EACCES, "Permission denied"), (errno.ENOSPC, "the disk is full")])
def test_what_the_system_refuses_is_told_in_one_line(store, noted, monkeypatch, number, why):
    def refuse(path: Path, *args: object, **options: object) -> None:
        raise OSError(number, os.strerror(number), path)

    monkeypatch.setattr(Path, "open", refuse)
    assert refused(noted, store) == f"cannot write to {store.parent}: {why}; what is done is kept"


def test_a_worker_that_dies_costs_only_what_was_under_way(store):
    of: list[Case] = [(dies_at_three, {"number": n}) for n in (0, 1, 2, 3, 4)]
    kept = run_cases(of[:3], store, 2, "x")
    before = store.read_bytes()
    said = refused(of, store, workers=2)
    assert said.startswith("a task was given up: its worker process died (")
    assert said.endswith(f"what is done is kept in {store}: run the same command again")
    assert store.read_bytes().startswith(before)
    assert run_cases(of[:3], store, 1, "x") == kept


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_case_refuses_is_refused_and_the_store_is_free_again(store, noted, workers):
    assert refused([(refuses, {"number": 7})], store, workers) == "number 7: no tower stood"
    assert run_cases(noted, store, 1, "x") == SQUARES


@pytest.mark.parametrize("workers", [0, -1])
def test_no_workers_are_refused(store, noted, workers):
    assert refused(noted, store, workers) == f"workers is {workers}; allowed: 1 or more"
    assert not store.parent.exists()


def test_a_new_result_is_what_a_kept_one_will_be(store):
    """numpy's scalars become Python's own, and what JSON does not have becomes None."""
    new, kept = (run_cases([(of_numpy, {})], store, 1, "x") for _ in range(2))
    assert new == kept == [{"mean": 0.1, "count": 3, "stands": True, "none": None, "pair": [1, 2]}]
    assert [type(value) for value in new[0].values()] == [float, int, bool, type(None), list]
    assert json.loads(store.read_bytes())["result"] == new[0]


def test_an_array_in_a_result_is_a_bug_and_leaves_the_store_whole(store, noted):
    with pytest.raises(TypeError, match="a result holds array"):
        run_cases([*noted[:2], (of_array, {})], store, 1, "x")
    assert len(store.read_bytes().splitlines()) == 2
    assert run_cases(noted[:3], store, 1, "x") == SQUARES[:3]


def test_the_bar_counts_what_was_kept(store, noted, monkeypatch):
    steps: list[float] = []

    class Counting:
        def __enter__(self) -> "Counting":
            return self

        def __exit__(self, *error: object) -> None:
            pass

        def advance(self, by: float = 1, note: str = "") -> None:
            steps.append(by)

    run_cases(noted[:4], store, 1, "x")
    monkeypatch.setattr(cases, "progress", lambda label, total: Counting())
    run_cases(noted, store, 1, "x")
    assert steps == [4, 1, 1]
