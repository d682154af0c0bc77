"""`jenga report figures`: every figure and table of the paper from this project's own logs and results."""

import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jenga_control.summary.paper_tables import PaperTable, extraction_table, selection_table, tables_figure
from jenga_control.summary.results import Results
from jenga_data.episode import Episode, Prediction
from jenga_data.errors import JengaError
from jenga_data.figures.choose import Logged, first_of, logged, one_a_round
from jenga_data.figures.pushes import CASES, chosen_pushes, pushes_figure
from jenga_data.log.reader import read_episode
from jenga_data.outcome import Outcome
from jenga_data.replay import style
from jenga_data.replay.side_by_side import film_strip, tower_grid
from jenga_data.report import markdown_table, write_report
from jenga_data.tower import TowerState

NAME = "figures"
ROUNDS = range(1, 16)
NO_SELECTION = "no selection logs were given: add --selection, collected with `jenga collect selection`"
NO_EXTRACTION = "no extraction logs were given: add --extraction, collected with `jenga collect extraction`"
NO_MODEL = "no model was given: add --models CKPT, trained by `jenga train dynamics`"
NO_ROBOT = "none of the extraction logs is of the whole robot: `jenga collect extraction --robot`"


@dataclass(frozen=True)
class Drawn:
    """A figure, or why there is none. `shows` are the episodes in it, `rule` says how they were chosen."""

    name: str
    title: str
    path: str = ""
    shows: tuple[str, ...] = ()
    rule: str = ""
    missing: str = ""
    numbers: dict[str, Any] = field(default_factory=dict)


class _Missing(Exception):
    """A figure that cannot be drawn from what was given; its text says why."""


def report_figures(
    out: Path,
    selection: Path | None = None,
    extraction: Path | None = None,
    models: Sequence[Path] = (),
    results: Results | None = None,
) -> dict[str, Any]:
    """Draw what can be drawn into `out`, with figures.json and figures.md that say what each shows.

    Args:
        selection: folder of selection logs or a selection dataset.
        extraction: folder of extraction logs.
        models: checkpoints; the dynamics models among them are drawn beside the truth.

    Raises:
        JengaError: a folder holds nothing readable, or `out` cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise JengaError(f"cannot write to {out}: {error.strerror}; choose another --out") from None
    logs, found = logged([extraction]) if extraction else [], results or Results(())
    drawn = [
        _tried("rounds", "Towers of rounds 1 to 15", out, lambda path: _rounds(path, selection)),
        _tried("key-frames", "Key frames of a rollout", out, lambda path: _key_frames(path, logs)),
        _tried("pushes", "Good and bad pushes", out, lambda path: _pushes(path, logs)),
        *_predictions(out, logs, models),
        _tried("touch", "Fingertip forces of a success and a failure", out, lambda path: _touch(path, extraction)),
        _tried("tables", "The paper's two tables with ours", out, lambda path: _tables(path, found)),
    ]
    report = {"figures": [asdict(figure) for figure in drawn], "out": str(out)}
    text = _text(drawn)
    images = "\n".join(f"## {d.title}\n\n![{d.title}]({Path(d.path).name})\n" for d in drawn if d.path)
    tables = "\n".join(_table_text(table) for table in (selection_table(found), extraction_table(found)))
    written = write_report(out, NAME, report, f"{text}\n{tables}\n{images}")
    paths = [*map(str, written), *(d.path for d in drawn if d.path)]
    return report | {"written": paths, "text": text}


def _tried(name: str, title: str, out: Path, draw: Callable[[Path], dict[str, Any]]) -> Drawn:
    path = out / f"{name}.png"
    try:
        found = draw(path)
    except _Missing as why:
        return Drawn(name, title, missing=str(why))
    return Drawn(name, title, str(path), **found)


def _rounds(path: Path, where: Path | None) -> dict[str, Any]:
    if where is None:
        raise _Missing(NO_SELECTION)
    states, keys, targets = _one_tower_a_round(where)
    absent = sorted(set(ROUNDS) - {state.layout.round for state in states})
    titles = [f"round {state.layout.round}" for state in states]
    with style.applied():
        style.save(tower_grid(states, titles, targets=targets), path)
    rule = "the first tower of each round, by the episode's key; the block that was pulled is blue"
    if absent:
        rule += f"; no tower of round {', '.join(map(str, absent))} is there"
    return {"shows": tuple(keys), "rule": rule}


def _one_tower_a_round(where: Path) -> tuple[list[TowerState], list[str], list[int | None]]:
    if (where / "manifest.json").exists():
        from jenga_control.selection.towers import state_of
        from jenga_data.dataset.read import open_dataset

        dataset = open_dataset(where)
        if dataset.manifest.kind != "selection":
            raise JengaError(f"{where} is a {dataset.manifest.kind} dataset; --selection takes logs or a selection one")
        episode, played = dataset.column("episode"), dataset.column("round")
        order = np.argsort(episode, kind="stable")
        _, first = np.unique(played[order], return_index=True)
        rows = [int(row) for row in order[first]]
        targets: list[int | None] = [int(dataset.column("target")[row]) for row in rows]
        return [state_of(dataset, row) for row in rows], [str(episode[row]) for row in rows], targets
    chosen = one_a_round(logged([where]))
    states = [read_episode(log.path).tower_state(0) for log in chosen]
    return states, [log.header.key for log in chosen], [log.header.target for log in chosen]


def _key_frames(path: Path, logs: Sequence[Logged]) -> dict[str, Any]:
    if not logs:
        raise _Missing(NO_EXTRACTION)
    robots = [log for log in logs if log.has_robot]
    chosen = first_of(robots, outcome=Outcome.EXTRACTED)
    if chosen is None:
        raise _Missing("none of the logged robots extracted its target" if robots else NO_ROBOT)
    with style.applied():
        style.save(film_strip(read_episode(chosen.path)), path)
    return {"shows": (chosen.header.key,), "rule": "the first extraction by the robot, by key"}


def _pushes(path: Path, logs: Sequence[Logged]) -> dict[str, Any]:
    if not logs:
        raise _Missing(NO_EXTRACTION)
    chosen = chosen_pushes(logs)
    if not chosen:
        raise _Missing(NO_ROBOT)
    with style.applied():
        figure = pushes_figure({cause: read_episode(log.path) for cause, log in chosen.items()})
        if figure is None:
            raise _Missing("in none of the chosen logs the stick pushes")
        style.save(figure, path)
    robots = [log for log in logs if log.has_robot]
    counts = {words: sum(log.result.cause == cause for log in robots) for cause, words in CASES.items()}
    rule = "the first of each case, by key"
    return {
        "shows": tuple(log.header.key for log in chosen.values()),
        "rule": rule,
        "numbers": {"robots": len(robots), **counts},
    }


def _predictions(out: Path, logs: Sequence[Logged], models: Sequence[Path]) -> list[Drawn]:
    """Truth against prediction, a figure a dynamics model."""
    title = "Truth against prediction"
    if not logs or not models:
        return [Drawn("prediction", title, missing=NO_MODEL if logs else NO_EXTRACTION)]
    from jenga_models.checkpoint import load

    checkpoints = [checkpoint for checkpoint in map(load, models) if checkpoint.kind == "dynamics"]
    if not checkpoints:
        return [Drawn("prediction", title, missing="none of the models is a dynamics model: `jenga train dynamics`")]
    drawn = []
    for checkpoint in checkpoints:
        name = "prediction" if len(checkpoints) == 1 else f"prediction-{checkpoint.hash[:8]}"
        drawn.append(_tried(name, f"{title}: {checkpoint.name}", out, lambda p, c=checkpoint: _prediction(p, logs, c)))
    return drawn


def _prediction(path: Path, logs: Sequence[Logged], checkpoint: Any) -> dict[str, Any]:
    from jenga_control.prediction.paper_figure import errors, prediction_figure, until_decided
    from jenga_models.overlay import predict_open_loop

    pairs: list[tuple[Episode, Prediction]] = []
    for outcome in (Outcome.EXTRACTED, Outcome.COLLAPSED):
        for log in (log for log in logs if log.outcome is outcome):
            episode = read_episode(log.path)
            if len(episode.action):
                pairs.append((episode, until_decided(episode, predict_open_loop(checkpoint, episode))))
                break
    if not pairs:
        raise _Missing("in no extracted or collapsed episode of the logs somebody pulls")
    with style.applied():
        style.save(prediction_figure(pairs), path)
    return {
        "shows": tuple(episode.header.key for episode, _ in pairs),
        "rule": "the first extraction and the first collapse during a pull, by key; open loop from the first action",
        "numbers": {episode.header.key: errors(episode, prediction) for episode, prediction in pairs},
    }


def _touch(path: Path, extraction: Path | None) -> dict[str, Any]:
    if extraction is None:
        raise _Missing(NO_EXTRACTION)
    from jenga_data.touch_report import touch_report

    try:
        report = touch_report([extraction], path.parent)
    except JengaError as error:
        raise _Missing(str(error)) from error
    shown = [row["episode"] for row in report["figure"].values() if row]
    numbers = {key: report[key] for key in ("n", "auroc", "auroc_same_speed", "erraticness")}
    return {"shows": tuple(shown), "rule": "the success and the failure nearest to their medians", "numbers": numbers}


def _tables(path: Path, results: Results) -> dict[str, Any]:
    tables = [selection_table(results), extraction_table(results)]
    with style.applied():
        style.save(tables_figure(tables), path)
    return {"rule": "ours: " + "; ".join(table.source or f"not measured (`{table.missing}`)" for table in tables)}


def _table_text(table: PaperTable) -> str:
    head = (table.title, "the paper", "ours", "")
    return markdown_table(head, table.rows())


def _text(drawn: Sequence[Drawn]) -> str:
    rows = [(d.title, shlex.quote(d.path) if d.path else f"missing: {d.missing}", d.rule) for d in drawn]
    return markdown_table(("figure", "where", "what it shows"), rows)
