"""Run as a program: datasets with spoiled Parquet files and right hashes, read one after the other.

Prints the number of each before it is read. Ends with a traceback on anything but a `JengaError`.
"""

import random
import resource
import shutil
import signal
import sys
from contextlib import suppress
from pathlib import Path

import msgspec

from jenga_data.dataset.manifest import MANIFEST, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.schema import COLUMNS, EPISODES
from jenga_data.dataset.staging import file_entry
from jenga_data.dataset.verify import verify
from jenga_data.errors import JengaError

MEMORY = 1536 * 2**20
"""Memory that reading may take beside what the interpreter and its libraries have reserved [bytes]."""
SECONDS = 20


def spoil(data: bytes, rng: random.Random) -> bytes:
    """Flip bits or overwrite bytes, more often where Parquet describes itself: at the end, and before each page."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        near_end = rng.random() < 0.5
        at = rng.randrange(max(len(out) - 3000, 0) if near_end else 0, len(out))
        if rng.random() < 0.5:
            out[at] ^= 1 << rng.randrange(8)
        else:
            out[at : at + rng.randint(1, 8)] = rng.choice([b"\xff" * 8, b"\0" * 4, rng.randbytes(4)])
    return bytes(out)


def read(folder: Path) -> None:
    for look in (verify, read_columns):
        with suppress(JengaError):
            look(folder)


def read_columns(folder: Path) -> None:
    dataset = open_dataset(folder)
    for column in COLUMNS[dataset.manifest.kind]:
        if not column.ragged:
            dataset.column(column.name)
    dataset.edges()
    dataset.episodes()


def main(victim: Path, folder: Path, count: int, start: int) -> None:
    reserved = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (reserved + MEMORY, reserved + MEMORY))
    manifest = load_manifest(victim)
    for number in range(start, count):
        sys.stdout.write(f"{number}\n")
        sys.stdout.flush()
        rng = random.Random(number)
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(victim, folder)
        name = EPISODES if rng.random() < 0.3 else manifest.data_files[0].path
        (folder / name).write_bytes(spoil((victim / name).read_bytes(), rng))
        files = [file_entry(folder, f.path, f.rows) if f.path == name else f for f in manifest.files]
        (folder / MANIFEST).write_bytes(canonical_bytes(sealed(msgspec.structs.replace(manifest, files=files))))
        signal.setitimer(signal.ITIMER_PROF, SECONDS)  # ends the process where a reading hangs
        read(folder)
        signal.setitimer(signal.ITIMER_PROF, 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
