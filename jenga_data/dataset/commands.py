"""The verbs of `jenga dataset`. Heavy imports stay inside."""

from pathlib import Path

import msgspec
import tyro

from jenga_data.command_line import Json, MaybeInt, MaybePath, Shown, Verb


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

    def trace(
        name: tyro.conf.Positional[str],
        row: tyro.conf.Positional[int],
        logs: tuple[Path, ...] = (),
        replay: bool = False,
        out: Path = Path("runs/traced"),
        json: Json = False,
    ) -> Shown:
        """Name the log of a row and the moment in it; a log that is not at hand is made again from its seed.

        Args:
            name: NAME@X.Y.Z or a folder.
            row: number of the row, from 0.
            logs: folders to look in first; after them along $JENGA_LOGS, in logs/ and datasets_manifest/samples/.
            replay: open the viewer at that moment.
            out: where a log is made again.
        """
        from jenga_data.dataset.trace import trace as run

        found = run(name, row, logs, out)
        if replay and found.log.path:
            from jenga_data.replay.show import show_frame

            show_frame(found.log.path, found.moment.frame)
        return Shown(json, found.as_dict(), found.text, found.ok)

    def rebuild(
        name: tyro.conf.Positional[str],
        episodes: MaybeInt = None,
        workers: int = 2,
        out: MaybePath = None,
        json: Json = False,
    ) -> Shown:
        """Make a dataset again from the recipes in its manifest, and compare: bytes, and states and labels.

        Args:
            name: NAME@X.Y.Z or a folder.
            episodes: make so many of its episodes, evenly spread; by default the whole dataset.
            workers: processes that simulate.
            out: folder of the logs and the new dataset, by default in runs/rebuilt; the same command goes on where it
                was interrupted.
        """
        from jenga_data.dataset.rebuild import rebuild as run

        found = run(name, episodes, workers, out)
        return Shown(json, found.as_dict(), found.text, found.ok)

    return {"list": list_, "info": info, "verify": verify, "trace": trace, "rebuild": rebuild}
