"""The verbs of `jenga dataset`. Heavy imports stay inside."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import tyro

from jenga_data.command_line import Json, Shown, Verb


def dataset() -> dict[str, Verb]:
    def list_(json: Json = False) -> Shown:
        """Name the datasets at hand: in datasets_manifest/ of the checkout and here, and along $JENGA_DATASETS."""
        from jenga_data.dataset.locate import known_datasets, search_folders

        known = {name: str(folder) for name, folder in known_datasets().items()}
        none = f"no datasets in {', '.join(map(str, search_folders()))}; make one with jenga collect and jenga convert"
        return Shown(json, known, "\n".join(f"{name}  {folder}" for name, folder in known.items()) or none)

    def info(name: tyro.conf.Positional[str], json: Json = False) -> Shown:
        """Say what a dataset holds: its manifest."""
        from jenga_data.dataset.read import open_dataset

        plain = msgspec.to_builtins(open_dataset(name).manifest)
        return Shown(json, plain, msgspec.json.format(msgspec.json.encode(plain), indent=2).decode())

    def verify(name: tyro.conf.Positional[str], json: Json = False) -> Shown:
        """Check every byte and every promise of a dataset."""
        from jenga_data.dataset.verify import verify as run

        report = run(name)
        lines = [f"{'ok    ' if c.ok else 'FAILED'} {name}: {c.detail}" for name, c in report.checks.items()]
        return Shown(json, report.as_dict(), "\n".join(lines), report.ok)

    def push(dataset: tyro.conf.Positional[str], address: tyro.conf.Positional[str], json: Json = False) -> Shown:
        """Copy a dataset to a folder, s3://bucket/path, hf://datasets/USER/NAME or any other fsspec address.

        Args:
            dataset: folder or NAME@X.Y.Z.
            address: holds nothing yet, or what an interrupted push has left there.
        """
        from jenga_data.dataset.share.push import push as run

        done = run(dataset, address)
        text = f"{done.dataset} at {done.address}: {done.sent} files sent ({done.sent_bytes / 1e6:.1f} MB)"
        return Shown(json, asdict(done), f"{text}, {done.kept} were there, {done.seconds:.1f} s")

    def pull(
        address: tyro.conf.Positional[str],
        out: Path,
        split: str = "",
        episodes: tuple[str, ...] = (),
        json: Json = False,
    ) -> Shown:
        """Get a dataset, or a part of it, from a folder, s3://, hf://, https:// or any other fsspec address.

        Args:
            address: where it was pushed to.
            out: new folder; the same command goes on where it was interrupted.
            split: only these rows: train, validation, test, or several joined by +.
            episodes: only the rows of the episodes with these keys.
        """
        from jenga_data.dataset.share.pull import pull as run

        done = run(address, out, split, episodes)
        text = f"{done.dataset} in {done.out}: {done.rows} rows of {done.episodes} episodes; {done.fetched} files"
        more = f"fetched ({done.fetched_bytes / 1e6:.1f} MB), {done.kept} had come before, {done.seconds:.1f} s"
        return Shown(json, asdict(done), f"{text} {more}")

    def export(
        dataset: tyro.conf.Positional[str],
        out: Path,
        form: Annotated[Literal["croissant", "hf", "lerobot"], tyro.conf.arg(name="format")],
        json: Json = False,
    ) -> Shown:
        """Write a dataset as other tools want it: Croissant 1.1, a Hugging Face dataset, a LeRobotDataset v3.0.

        Args:
            dataset: folder or NAME@X.Y.Z.
            out: new folder.
            form: lerobot takes dynamics datasets only.
        """
        from jenga_data.dataset.export.run import export as run

        done = run(dataset, out, form)
        size = f"{len(done.files)} files, {done.bytes / 1e6:.1f} MB"
        return Shown(json, asdict(done), f"{done.dataset} as {done.format} in {done.out}: {size}")

    return {"list": list_, "info": info, "verify": verify, "push": push, "pull": pull, "export": export}
