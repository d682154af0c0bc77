"""The verbs that make new versions of datasets and compare them. Heavy imports stay inside."""

from pathlib import Path
from typing import Annotated

import tyro

from jenga_data.command_line import Json, MaybeText, Shown, Verb


def edits() -> dict[str, Verb]:
    def merge(
        names: Annotated[tuple[str, ...], tyro.conf.Positional],
        name: str,
        version: str,
        out: Path,
        licence: MaybeText = None,
        description: MaybeText = None,
        json: Json = False,
    ) -> Shown:
        """Make one dataset of several: their files as they are, an episode that several hold once.

        Args:
            names: the datasets (NAME@X.Y.Z or folder), of one kind and number of blocks.
            name: of the new dataset.
            version: X.Y.Z; above that of a dataset of the same name it is made from.
            out: new folder of the dataset.
            licence: of the new dataset; needed where those of the others differ.
            description: of the new dataset; by default that of the others if it is the same.
        """
        from jenga_data.dataset.edit_text import edited_shown
        from jenga_data.dataset.merge import merge as run

        edited = run(names, out, name, version, licence=licence, description=description)
        return edited_shown(edited, out, json)

    def drop(
        dataset: tyro.conf.Positional[str],
        version: str,
        out: Path,
        episodes: tuple[str, ...] = (),
        where: tuple[str, ...] = (),
        name: MaybeText = None,
        json: Json = False,
    ) -> Shown:
        """Make a new version of a dataset without some episodes; files that hold none of them stay as they are.

        Args:
            dataset: NAME@X.Y.Z or folder.
            version: X.Y.Z, above the old one.
            out: new folder of the dataset.
            episodes: keys of the episodes to drop.
            where: conditions on columns of episodes.parquet, all of which a dropped episode meets: "round > 12",
                "outcome == stuck,collapsed", "dragged == true"; allowed are == != < <= > >=.
            name: of the new dataset; by default that of the old one.
        """
        from jenga_data.dataset.drop import drop as run
        from jenga_data.dataset.edit_text import edited_shown

        edited = run(dataset, out, version, episodes=episodes, conditions=where, name=name)
        return edited_shown(edited, out, json)

    def diff(first: tyro.conf.Positional[str], second: tyro.conf.Positional[str], json: Json = False) -> Shown:
        """Say what two datasets have different; exit code 0 if they are equal, 1 if they differ.

        Args:
            first: NAME@X.Y.Z or folder.
            second: likewise.
        """
        from jenga_data.dataset.diff import diff as run

        found = run(first, second)
        return Shown(json, found.as_dict(), found.text(), found.equal)

    def migrate(dataset: tyro.conf.Positional[str], out: Path, version: MaybeText = None, json: Json = False) -> Shown:
        """Lift a dataset of an older format to the present one, as a new version.

        Args:
            dataset: its folder, or NAME@X.Y.Z.
            out: new folder of the dataset.
            version: X.Y.Z of the new dataset; by default the next patch version.
        """
        from jenga_data.dataset.migrate import migrate as run

        made = run(dataset, out, version)
        data = {"dataset": made.identifier, "hash": made.hash, "format_version": made.format_version, "out": str(out)}
        return Shown(json, data, f"{made.identifier} in {out} has format version {made.format_version}")

    return {"merge": merge, "drop": drop, "diff": diff, "migrate": migrate}
