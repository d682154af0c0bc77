"""The verbs that follow a dataset back to its logs. Heavy imports stay inside."""

from pathlib import Path

import tyro

from jenga_data.command_line import Json, MaybeInt, MaybePath, Shown, Verb


def origins() -> dict[str, Verb]:
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

    return {"trace": trace, "rebuild": rebuild}
