"""A disk that is really full, and one that is really read-only: small file systems of their own."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from jenga_runs import COLLECT, Made, contents, jenga, run_apart

KIB = 1024


def mounted(folder: Path, options: str) -> bool:
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "none", str(folder)], capture_output=True, check=False
    )
    return done.returncode == 0


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 3 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if sys.platform != "linux" or os.geteuid() != 0 or not mounted(folder, "size=3m"):
        pytest.skip("mounts a small tmpfs, which takes root on Linux")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def fill(folder: Path, leave: int) -> Path:
    """Put a file on a disk that takes all but so many bytes."""
    filler = folder / "filler"
    filler.write_bytes(bytes(max(shutil.disk_usage(folder).free - leave, 0)))
    return filler


def test_collect(selection_logs: Made, disk: Path):
    """There is room for one episode and a half: the first one stays, and the same command goes on from there."""
    out, whole = disk / "logs", contents(selection_logs.path, "*.mcap")
    args = (*COLLECT["selection"], "--episodes", 2, "--workers", 1, "--out", out)
    filler = fill(disk, leave=max(map(len, whole.values())) + 200 * KIB)
    line = jenga(*args).line()
    assert "No space left on device; make room or choose another folder" in line or "the disk is full" in line
    kept = contents(out, "*.mcap")
    assert len(kept) == 1
    assert kept.items() <= whole.items()

    filler.unlink()
    again = jenga(*args, "--json").object()
    assert (again["episodes"], again["resumed"], again["set_aside"]) == (2, 1, [])
    assert contents(out, "*.mcap").items() <= whole.items()
    assert not contents(out, "*.partial")


def test_a_worker_of_collect(disk: Path):
    """In another process, from the first byte on."""
    fill(disk, leave=0)
    args = (*COLLECT["selection"], "--episodes", 2, "--workers", 2, "--out", disk / "logs")
    line = run_apart(*args).line()
    assert "No space left on device" in line or "the disk is full" in line
    assert not contents(disk, "*.mcap")


def test_convert(selection_logs: Made, selection: Made, disk: Path):
    args = ("convert", selection_logs.path, "--name", "pulls", "--version", "0.1.0", "--out", disk / "dataset")
    filler = fill(disk, leave=20 * KIB)
    assert "No space left on device; nothing was kept" in jenga(*args).line()
    assert list(disk.iterdir()) == [filler]
    filler.unlink()
    assert jenga(*args).code == 0
    assert contents(disk / "dataset") == contents(selection.path)


def test_a_disk_that_may_only_be_read(selection_logs: Made, disk: Path):
    """As a folder without permission, which does not stop root."""
    subprocess.run(["mount", "-o", "remount,size=32m", str(disk)], check=True)
    shutil.copytree(selection_logs.path, disk / "logs")
    before = contents(disk)
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    for args, says in (
        (
            (*COLLECT["selection"], "--episodes", 9, "--out", disk / "logs"),
            f"cannot write to {disk / 'logs'}: Read-only",
        ),
        ((*COLLECT["selection"], "--episodes", 1, "--out", disk / "new"), f"cannot write to {disk / 'new'}: Read-only"),
        (
            ("convert", disk / "logs", "--name", "pulls", "--version", "0.1.0", "--out", disk / "dataset"),
            f"cannot write {disk / 'dataset'}: Read-only",
        ),
    ):
        assert says in jenga(*args).line()
    assert contents(disk) == before
