"""The verbs of `jenga dataset`. Heavy imports stay inside."""

import msgspec
import tyro

from jenga_data.command_line import Json, Shown, Verb
from jenga_data.dataset.edit_commands import edits
from jenga_data.dataset.origin_commands import origins
from jenga_data.dataset.share_commands import sharing


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

    def verify(name: tyro.conf.Positional[str], resim: int = 0, workers: int = 2, json: Json = False) -> Shown:
        """Check every byte and every promise of a dataset.

        Args:
            name: NAME@X.Y.Z or a folder.
            resim: make so many episodes again from their seeds, too, and compare their states and labels.
            workers: processes that simulate those.
        """
        from jenga_data.dataset.verify import verify as run

        report = run(name)
        if resim:
            from jenga_data.dataset.check_resim import with_resim

            report = with_resim(report, name, resim, workers)
        lines = [f"{'ok    ' if c.ok else 'FAILED'} {name}: {c.detail}" for name, c in report.checks.items()]
        return Shown(json, report.as_dict(), "\n".join(lines), report.ok)

    return {"list": list_, "info": info, "verify": verify, **origins(), **edits(), **sharing()}
