"""A dataset made again from the recipes in its manifest, and compared with itself."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jenga_data.dataset.convert import convert
from jenga_data.dataset.episode_origin import origins_of, recipe_origins, sort_out
from jenga_data.dataset.manifest import Manifest
from jenga_data.dataset.read import Dataset, open_dataset
from jenga_data.dataset.remade import Resim, compare, resim, resim_notes
from jenga_data.dataset.resim import code_hash, make_again
from jenga_data.errors import JengaError

OUT = Path("runs/rebuilt")
"""Where datasets are made again, each in a folder of its name."""

COMPARED = ("kind", "blocks", "features", "splits", "statistics", "labels", "counts", "licence", "description")
"""Parts of a manifest that the same episodes give, whoever logged them. The rest is provenance: hashes, commits and
versions of what wrote logs and dataset, parents, and where to get it."""


@dataclass(frozen=True)
class Whole:
    """A dataset beside what was converted again. `files` says "same", "differs", "missing" (only recorded) or "extra"
    (only made) of every file of rows; `parts` are the parts of the manifest that differ, of those in `COMPARED`."""

    same_hash: bool
    files: dict[str, str]
    parts: list[str]


@dataclass(frozen=True)
class Rebuild:
    """A dataset and what it became when it was made again; `whole` is None where only episodes were compared."""

    dataset: Dataset
    out: Path
    resim: Resim
    whole: Whole | None = None

    @property
    def beyond(self) -> list[str]:
        """What no other platform or version explains, a line each."""
        lines = self.resim.beyond
        # Other rows have other statistics, and another configuration or an edit puts episodes in other files.
        if self.whole and not (self.resim.largest or self.resim.notes):
            if self.whole.parts:
                lines.append(f"the rows are the same, but not the manifest's {', '.join(self.whole.parts)}")
            odd = [path for path, state in self.whole.files.items() if state != "same"]
            if odd and not self.dataset.manifest.parents:
                lines.append(f"the rows are the same, but not {len(odd)} data files, first {odd[0]}")
        return lines

    @property
    def ok(self) -> bool:
        return not self.beyond

    def as_dict(self) -> dict[str, Any]:
        """What `jenga dataset rebuild --json` prints."""
        whole = self.whole
        more = {"same_hash": whole.same_hash, "files": whole.files, "manifest_differs_in": whole.parts} if whole else {}
        own = {"ok": self.ok, "dataset": self.dataset.manifest.identifier, "hash": self.dataset.hash}
        return own | {"out": str(self.out)} | self.resim.as_dict() | more | {"beyond_tolerance": self.beyond}

    @property
    def text(self) -> str:
        """For people."""
        lines = [f"{self.dataset.manifest.identifier} made again in {self.out}", *self.resim.lines]
        if self.whole:
            states = list(self.whole.files.values())
            lines.append(f"{states.count('same')} of {len(states)} data files have the same bytes")
            lines.append(_on_hash(self.whole, self.dataset.hash, self.resim))
        return "\n  ".join([*lines, *(f"FAILED {line}" for line in self.beyond)])


def _on_hash(whole: Whole, digest: str, resim: Resim) -> str:
    if whole.same_hash:
        return f"the whole dataset has the same hash, {digest[:12]}"
    if whole.parts or set(whole.files.values()) != {"same"}:
        return "the dataset's hash differs, for its data do"
    if all(r.same_code for r in resim.remade):
        return "the dataset's hash differs in what wrote or edited the dataset; all data are the same"
    return "the dataset's hash differs in provenance alone: other code wrote these logs, and their hashes stand in it"


def rebuild(where: str | Path, episodes: int | None = None, workers: int = 2, out: Path | None = None) -> Rebuild:
    """Make a dataset again, or some of its episodes, and compare.

    A dataset of which some episodes cannot be made again (a controller pulled, or the configuration is unknown) is
    compared episode by episode, and not converted.

    Args:
        episodes: how many, evenly spread; None for the whole dataset, which is converted again too.
        out: for the logs and the dataset; by default below `OUT`. What the same code left there is gone on with.

    Raises:
        JengaError: there is no such dataset, or `out` cannot be written.
        CheckFailed: the dataset is damaged.
    """
    if episodes is not None and episodes < 1:
        raise JengaError(f"--episodes is {episodes}; allowed: 1 and more, or none for the whole dataset")
    dataset = open_dataset(where)
    manifest = dataset.manifest
    out = out or OUT / manifest.identifier
    can, cannot = sort_out(manifest, recipe_origins(manifest))
    if episodes is not None or cannot:
        return Rebuild(dataset, out, resim(dataset, episodes, workers, out / "logs"))
    logs = make_again(manifest, can, workers, out / "logs")
    made = _converted(manifest, list(logs.values()), out / f"dataset-{code_hash()[:8]}")
    remade = compare(dataset, {key: logs[origin] for key, origin in origins_of(dataset).items()})
    return Rebuild(dataset, out, Resim(remade, {}, resim_notes(manifest, can)), _compare_manifests(manifest, made))


def _converted(manifest: Manifest, logs: list[Path], folder: Path) -> Manifest:
    """The dataset of the same name and texts in `folder`; one that the same code left there is taken as it is."""
    if not folder.exists():
        convert(
            logs,
            folder,
            manifest.name,
            manifest.version,
            licence=manifest.licence,
            description=manifest.description,
        )
    return open_dataset(folder).manifest


def _compare_manifests(recorded: Manifest, made: Manifest) -> Whole:
    one, other = ({f.path: f.sha256 for f in manifest.data_files} for manifest in (recorded, made))
    files = {path: "same" if other.get(path) == digest else "differs" for path, digest in one.items()}
    files |= dict.fromkeys(one.keys() - other.keys(), "missing") | dict.fromkeys(other.keys() - one.keys(), "extra")
    parts = [name for name in COMPARED if getattr(recorded, name) != getattr(made, name)]
    return Whole(recorded.hash == made.hash, dict(sorted(files.items())), parts)
