"""The verb report, as far as models have a part in it."""

from pathlib import Path
from typing import Literal

import tyro

from jenga_data.command_line import Json, MaybePath, Shown, Verb
from jenga_data.dataset.reference import SELECTION


def report() -> dict[str, Verb]:
    def selection(
        out: Path,
        models: tuple[Path, ...] = (),
        dataset: str = SELECTION,
        more: tuple[str, ...] = (),
        baselines: Literal["none", "quick", "all"] = "all",
        ceiling: MaybePath = None,
        logs: MaybePath = None,
        workers: int = 2,
        json: Json = False,
    ) -> Shown:
        """Which block: models, baselines and the ceiling in one table, with tests, figures and the worst mistakes.

        Args:
            out: folder of the report: selection.json, .md and figures.
            models: folders of checkpoints; those that differ by their seed alone share a row.
            dataset: NAME@X.Y.Z or a folder; its test towers decide.
            more: further datasets whose training towers the baselines may see, as the models did.
            baselines: rules alone (none), learners on hand-made features as well (quick), or mechanics too (all).
            ceiling: ceiling.json, as `jenga calibrate ceiling` writes it.
            logs: folder of the dataset's logs, for the commands that replay mistakes.
            workers: processes that compute mechanics.
        """
        from jenga_control.selection.report import report_selection
        from jenga_data.dataset.read import open_dataset

        others = [open_dataset(name) for name in more]
        found = report_selection(models, open_dataset(dataset), out, baselines, others, ceiling, logs, workers)
        text = f"{found.pop('text')}\nwritten: {', '.join(found['written'])}"
        return Shown(json, found, text)

    def extraction(logs: tyro.conf.Positional[tuple[Path, ...]], out: Path, json: Json = False) -> Shown:
        """Who pulls how well: rates, causes, rounds and speeds of every way that was evaluated, with figures.

        Args:
            logs: folders that `jenga eval extraction --out` left, one or several.
            out: folder of the report: extraction.json, .md and figures.
        """
        from jenga_control.extraction.report import report_extraction

        found = report_extraction(logs, out)
        text = f"{found.pop('text')}\nwritten: {', '.join(found['written'])}"
        return Shown(json, found, text)

    def figures(
        out: Path,
        selection: str = SELECTION,
        extraction: MaybePath = None,
        models: tuple[Path, ...] = (),
        results: tuple[Path, ...] = (),
        json: Json = False,
    ) -> Shown:
        """Every figure and table of the paper from own logs: rounds, key frames, pushes, predictions, touch, tables.

        Args:
            out: folder of the figures, with figures.json and .md that say what each shows and which are missing.
            selection: folder of selection logs, or a selection dataset by folder or NAME@X.Y.Z.
            extraction: folder of extraction logs.
            models: folders of checkpoints; dynamics models are drawn beside the truth.
            results: folders (or files) with JSON of `report selection` and `eval extraction`, for the tables.
        """
        from jenga_control.summary.figures import report_figures
        from jenga_control.summary.results import read_results
        from jenga_data.dataset.locate import locate

        found = report_figures(out, locate(selection), extraction, models, read_results(results))
        return Shown(json, found, f"{found.pop('text')}\nwritten: {', '.join(found['written'])}")

    def page(
        out: Path,
        results: tuple[Path, ...] = (),
        selection: str = SELECTION,
        extraction: MaybePath = None,
        models: tuple[Path, ...] = (),
        json: Json = False,
    ) -> Shown:
        """One HTML page over everything that was measured, beside the paper; it measures nothing itself.

        Args:
            out: folder of report.html, which needs no other file; figures are drawn beside it if logs are given.
            results: folders (or files) with the JSON of calibrate, bench, eval and report, and manifests of datasets
                beside those that `jenga dataset list` knows.
            selection: folder of selection logs, or a selection dataset by folder or NAME@X.Y.Z, for the figures.
            extraction: folder of extraction logs, for the figures.
            models: folders of checkpoints, for the figures.
        """
        from jenga_control.summary.figures import report_figures
        from jenga_control.summary.page import report_page
        from jenga_control.summary.results import read_results
        from jenga_data.dataset.locate import known_datasets, locate
        from jenga_data.dataset.manifest import MANIFEST

        measured = read_results([*results, *(folder / MANIFEST for folder in known_datasets().values())])
        drawn = report_figures(out, locate(selection), extraction, models, measured)
        found = report_page(out, measured, drawn)
        verdicts = [f"{verdict:>30}  {claim}" for claim, verdict in found["findings"].items()]
        return Shown(json, found, "\n".join([*verdicts, found["page"]]))

    return {"selection": selection, "extraction": extraction, "figures": figures, "page": page}
