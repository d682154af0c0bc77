"""The verbs that hand datasets on. Heavy imports stay inside."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jenga_data.command_line import Json, Shown, Verb


def sharing() -> dict[str, Verb]:
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

    return {"push": push, "pull": pull, "export": export}
