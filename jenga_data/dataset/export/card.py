"""The card of a Hugging Face dataset, with nothing left to fill in: all of it stands in the manifest.

https://huggingface.co/docs/hub/datasets-cards
"""

import json
from collections.abc import Iterable, Sequence

from jenga_data.dataset.manifest import SPLITS, File, Label, Manifest, Provenance

CARD = "README.md"

_SIZES = ((10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M"), (10**7, "1M<n<10M"))
_TASKS = {
    "selection": "Predict from a tower and a block whether pulling the block fails (graph classification).",
    "dynamics": "Predict from a tower, a block and the gripper's action the tower one control step later.",
}


def card(manifest: Manifest, files: dict[str, File]) -> str:
    """The whole of README.md.

    Args:
        files: what lies beside it, by the name of the split, and "episodes".
    """
    splits = [s for s in SPLITS if s in files]
    sections = (
        _front_matter(manifest, files, splits),
        f"# {manifest.identifier}\n\n{manifest.description}\n",
        f"## Task\n\n{_TASKS[manifest.kind]}\n",
        f"## Splits\n\n{_splits(manifest, files, splits)}",
        f"## Columns of a row\n\n{_features(manifest)}",
        f"## Labels\n\n{_labels(manifest.labels)}",
        f"## What is in it\n\n{_counts(manifest)}",
        f"## Where it comes from\n\n{_provenance(manifest)}",
        f"## How to load it\n\n{_loading(splits[0])}",
        f"## Licence\n\n{manifest.licence}\n",
        "## Citation\n\n" + "".join(f"- {line}\n" for line in manifest.citation),
    )
    return "\n".join(sections)


def size_category(rows: int) -> str:
    """The hub's name of a size."""
    return next((name for limit, name in _SIZES if rows < limit), "n>10M")


def _front_matter(manifest: Manifest, files: dict[str, File], splits: Sequence[str]) -> str:
    """YAML, of which JSON is a part: texts are quoted as JSON quotes them."""
    data = "".join(f"  - split: {split}\n    path: {files[split].path}\n" for split in splits)
    name = f"Jenga {manifest.kind} ({manifest.identifier})"
    return (
        f"---\nlicense: {json.dumps(manifest.licence.lower())}\npretty_name: {json.dumps(name)}\n"
        f"task_categories:\n- robotics\nsize_categories:\n- {size_category(manifest.counts.rows)}\n"
        f"tags:\n- jenga\n- contact-rich-manipulation\n- graph\n- simulation\n- mujoco\n- {manifest.kind}\n"
        f"configs:\n- config_name: rows\n  default: true\n  data_files:\n{data}"
        f"- config_name: episodes\n  data_files:\n  - split: episodes\n    path: {files['episodes'].path}\n---\n"
    )


def _table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(str(cell).replace('|', '/') for cell in line)} |\n" for line in lines)


def _splits(manifest: Manifest, files: dict[str, File], splits: Sequence[str]) -> str:
    rows = [(s, len(manifest.splits.towers(s)), files[s].rows) for s in splits]
    return f"{_table(('split', 'towers', 'rows'), rows)}\nRule: {manifest.splits.rule}.\n"


def _features(manifest: Manifest) -> str:
    rows = [
        (f.name, f.dtype, "x".join("?" if n is None else str(n) for n in f.shape), f.unit, f.frame, f.description)
        for f in manifest.features
    ]
    note = "Poses are x y z and a quaternion w x y z; units are SI; `?` is a length that differs from row to row."
    return f"{_table(('column', 'type', 'shape', 'unit', 'frame', 'meaning'), rows)}\n{note}\n"


def _labels(labels: Sequence[Label]) -> str:
    """Decided in this order."""
    rows = [(f.name, f.definition, ", ".join(f"{k} = {v:g}" for k, v in f.thresholds.items())) for f in labels]
    return _table(("label", "definition", "thresholds (SI)"), rows)


def _counts(manifest: Manifest) -> str:
    count = manifest.counts
    lines = [
        f"{count.rows} rows of {count.episodes} episodes with {count.towers} towers of {manifest.blocks} blocks.",
        f"Outcomes: {_listed(count.outcome)}. In {count.dragged} episodes another block was dragged along.",
        f"Rounds: {_listed(dict(sorted(count.round.items(), key=lambda item: int(item[0]))))}.",
        f"Causes on the robot's side: {_listed(count.cause) or 'none'}.",
        f"Episodes whose physics broke, and that are in no file: {count.invalid}.",
    ]
    return "".join(f"- {line}\n" for line in lines)


def _listed(counts: dict[str, int]) -> str:
    return ", ".join(f"{name}: {count}" for name, count in counts.items())


def _provenance(manifest: Manifest) -> str:
    parents = ", ".join(f"{p.name}@{p.version} ({p.hash})" for p in manifest.parents)
    lines = [
        f"Manifest {manifest.identifier}, format {manifest.format_version}, SHA-256 `{manifest.hash}`.",
        f"Made from {parents}." if parents else "Made from logs of episodes; every one is named in `episodes.parquet`.",
        *_recipes(manifest.provenance),
        f"Logged with {_versions(manifest.provenance.versions)}; commits: "
        f"{', '.join(manifest.provenance.commits) or 'not recorded'}.",
    ]
    return "".join(f"- {line}\n" for line in lines)


def _recipes(provenance: Provenance) -> Iterable[str]:
    for recipe in provenance.recipes:
        episodes = sum(last - first + 1 for first, last in recipe.numbers)
        model = f", model {recipe.checkpoint}" if recipe.checkpoint else ""
        yield f"{episodes} episodes from seed {recipe.seed} with config `{recipe.config}`{model}."


def _versions(versions: dict[str, list[str]]) -> str:
    shown = (f"{name.removesuffix('_version')} {'/'.join(numbers)}" for name, numbers in versions.items())
    return ", ".join(shown) or "versions not recorded"


def _loading(split: str) -> str:
    return (
        "In the folder of this card:\n\n```python\n"
        'import datasets; rows = datasets.load_dataset(".", "rows")\n'
        f'import polars; rows = polars.read_parquet("data/{split}.parquet")\n'
        f"import duckdb; rows = duckdb.sql(\"SELECT * FROM 'data/{split}.parquet'\")\n```\n"
    )
