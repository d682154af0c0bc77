"""`rebuild` and `verify --resim`: the same platform gives the same bits, and whatever differs is found and measured."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from short_recordings import EXTRACTION, NUMBERS, SEED, SELECTION, never, record
from short_towers import short_towers

from jenga_data.collect import workers
from jenga_data.dataset import rebuild as rebuild_module
from jenga_data.dataset import resim as resim_module
from jenga_data.dataset.check_resim import with_resim
from jenga_data.dataset.episode_origin import Origin, evenly, recipe_origins
from jenga_data.dataset.manifest import MANIFEST, Manifest, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.rebuild import Rebuild, rebuild
from jenga_data.dataset.resim import code_hash
from jenga_data.dataset.schema import EPISODES
from jenga_data.dataset.verify import CHECKS, VerifyReport, verify
from jenga_data.errors import JengaError


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six selection episodes of two seeds. Read only."""
    return record(SELECTION, tmp_path_factory.mktemp("recorded"), (SEED, SEED + 1))


@pytest.fixture(autouse=True)
def towers_are_short() -> Iterator[None]:
    with short_towers():
        yield


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where all tests that change no code may make the same episodes again: each is simulated once."""
    return tmp_path_factory.mktemp("made") / "again"


def again(folder: Path, out: Path, episodes: int | None = None) -> Rebuild:
    return rebuild(folder, episodes, workers=1, out=out)


def resealed(folder: Path, out: Path, change: Callable[[Manifest], Manifest]) -> Path:
    """A copy whose manifest was changed, with every hash right."""
    shutil.copytree(folder, out)
    (out / MANIFEST).write_bytes(canonical_bytes(sealed(change(load_manifest(folder)))))
    return out


def with_config(manifest: Manifest, change: Callable[[dict[str, Any]], dict[str, Any]]) -> Manifest:
    """All configs changed, under their old names."""
    configs = {name: change(config) for name, config in manifest.provenance.configs.items()}
    return msgspec.structs.replace(manifest, provenance=msgspec.structs.replace(manifest.provenance, configs=configs))


# --- the same bits -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("config", [SELECTION, EXTRACTION])
def test_a_rebuilt_dataset_has_the_same_bytes_and_hash(config, tmp_path):
    folder = record(config, tmp_path)
    found = again(folder, tmp_path / "out")
    assert found.ok, found.text
    assert found.whole is not None
    assert found.whole.same_hash
    assert set(found.whole.files.values()) == {"same"}
    assert found.resim.largest == {}
    assert all(r.same_log and r.same_code for r in found.resim.remade)
    assert "the whole dataset has the same hash" in found.text
    said = msgspec.json.decode(msgspec.json.encode(found.as_dict()))
    assert (said["ok"], said["same_hash"], said["episodes"], said["same_logs"]) == (True, True, 3, 3)


def test_some_episodes_are_evenly_spread_and_nothing_is_converted(recorded, out):
    found = again(recorded, out, 2)
    assert found.ok
    assert found.whole is None
    assert [(r.origin.seed, r.origin.number) for r in found.resim.remade] == [(SEED, 0), (SEED + 1, NUMBERS[-1])]
    assert len(list(out.rglob("*.mcap"))) == 2
    assert not list(out.rglob(MANIFEST))


def test_what_was_made_is_not_made_twice(recorded, out, monkeypatch):
    assert again(recorded, out).ok
    monkeypatch.setattr(workers, "run_one", never)
    found = again(recorded, out)
    assert found.ok
    assert len(found.resim.remade) == 6


def test_logs_of_other_code_are_not_taken_for_its_own(recorded, out, monkeypatch):
    again(recorded, out)
    monkeypatch.setattr(resim_module, "code_hash", lambda: "f" * 64)
    monkeypatch.setattr(workers, "run_one", never)
    with pytest.raises(AssertionError, match="nothing to simulate"):
        again(recorded, out, 1)


def test_every_line_of_code_is_in_its_hash(tmp_path, monkeypatch):
    package = shutil.copytree(Path(resim_module.__file__).parents[1], tmp_path / "jenga_data")
    monkeypatch.setattr(resim_module, "__file__", str(package / "dataset" / "resim.py"))
    hashes = []
    for text in ("", "# a remark\n", ""):
        (package / "sim" / "new.py").write_text(text)
        code_hash.cache_clear()
        hashes.append(code_hash())
    code_hash.cache_clear()
    assert hashes[0] == hashes[2] != hashes[1]


# --- differences ---------------------------------------------------------------------------------------------------


def moved_by(distance: float) -> Callable[[np.ndarray], np.ndarray]:
    def change(pose: np.ndarray) -> np.ndarray:
        pose[0, 4, 2] += np.float32(distance)
        return pose

    return change


@pytest.mark.parametrize(("distance", "ok"), [(5e-4, True), (5e-3, False)])
def test_a_difference_is_measured_and_beyond_its_tolerance_refused(recorded, out, forge, distance, ok):
    found = again(forge(recorded, block_pose=moved_by(distance)), out)
    assert found.ok is ok
    assert found.resim.largest == {"block_pose.position": pytest.approx(distance, rel=1e-3)}
    assert sum(bool(r.differences) for r in found.resim.remade) == 1
    assert found.whole is not None
    assert sorted(found.whole.files.values()) == ["differs", "same"]
    assert not found.whole.same_hash
    if not ok:
        assert "block_pose.position differs by 0.005 at the start; allowed: 0.001" in found.text


def test_other_labels_are_counted_and_more_than_a_few_are_refused(recorded, out, forge):
    def flipped(count: int) -> Rebuild:
        values = {"failure": lambda v: np.r_[~v[:count], v[count:]]}
        folder = forge(recorded, EPISODES, **values)
        found = again(folder, out)
        shutil.rmtree(folder)
        return found

    assert flipped(1).ok
    assert flipped(2).beyond == ["labels differ in 2 of 6 episodes; allowed: in 1"]


def test_another_tower_is_never_within_a_tolerance(recorded, out, forge):
    found = again(forge(recorded, level=lambda v: v[:, ::-1]), out)
    assert "level differs in" in found.beyond[0]


def test_provenance_may_differ_where_other_code_wrote_the_logs(recorded, out, forge):
    folder = forge(recorded, EPISODES, commit=lambda v: np.full(len(v), "older"), log_sha256=lambda v: v[::-1])
    found = again(folder, out)
    assert found.ok
    assert found.resim.largest == {}
    assert found.whole is not None
    assert not found.whole.same_hash
    assert not any(r.same_code for r in found.resim.remade)
    assert "differs in provenance alone" in found.text


def test_a_manifest_that_does_not_follow_from_the_rows_is_refused(recorded, out, tmp_path):
    def swapped(manifest: Manifest) -> Manifest:
        splits = manifest.splits
        return msgspec.structs.replace(
            manifest, splits=msgspec.structs.replace(splits, test=splits.validation, validation=splits.test)
        )

    assert again(resealed(recorded, tmp_path / "set", swapped), out).beyond == [
        "the rows are the same, but not the manifest's splits"
    ]


# --- what cannot be made again -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda c: c | {"magnets": 2}, "fields that this jenga does not know: magnets"),
        (lambda c: c | {"kind": "stacking"}, "unknown kind of collection 'stacking'"),
        (lambda c: c | {"controller": {"horizon": 5}}, "only `jenga eval extraction` makes such a log"),
        (lambda c: c | {"speed": "fast"}, "this configuration cannot be read"),
    ],
)
def test_what_cannot_be_made_again_is_counted_and_named(recorded, out, tmp_path, change, why):
    folder = resealed(recorded, tmp_path / "set", lambda m: with_config(m, change))
    found = again(folder, out)
    assert found.resim.remade == []
    assert not found.ok
    (line,) = [line for line in found.resim.lines if "cannot be made again" in line]
    assert line.startswith("6 cannot be made again, first ")
    assert why in line


def test_a_config_from_before_a_field_came_is_filled_in_and_said(recorded, tmp_path):
    def before(config: dict[str, Any]) -> dict[str, Any]:
        return {k: v for k, v in config.items() if k != "pull"} | {
            "spawn": {k: v for k, v in config["spawn"].items() if k != "wedge"}
        }

    found = again(resealed(recorded, tmp_path / "set", lambda m: with_config(m, before)), tmp_path / "out", 1)
    assert found.ok
    assert found.resim.largest == {}
    assert "lacks pull, spawn.wedge: their defaults were used" in found.text


def test_a_config_s_name_leads_out_of_no_folder(recorded, out, tmp_path):
    def renamed(manifest: Manifest) -> Manifest:
        provenance = manifest.provenance
        configs = {f"../../{name}": config for name, config in provenance.configs.items()}
        recipes = [msgspec.structs.replace(r, config=f"../../{r.config}") for r in provenance.recipes]
        return msgspec.structs.replace(
            manifest, provenance=msgspec.structs.replace(provenance, configs=configs, recipes=recipes)
        )

    folder = resealed(recorded, tmp_path / "set", renamed)
    assert not again(folder, out).ok
    with pytest.raises(JengaError, match="has no config"):
        resim_module.make_again(load_manifest(folder), [next(recipe_origins(load_manifest(folder)))], 1, out)


def test_absurdly_many_numbers_are_refused_unread(recorded, tmp_path):
    def many(manifest: Manifest) -> Manifest:
        recipes = [msgspec.structs.replace(r, numbers=[(0, 10**15)]) for r in manifest.provenance.recipes]
        return msgspec.structs.replace(
            manifest, provenance=msgspec.structs.replace(manifest.provenance, recipes=recipes)
        )

    with pytest.raises(JengaError, match="name 2000000000000002 episodes; allowed: at most"):
        again(resealed(recorded, tmp_path / "set", many), tmp_path / "out")


def test_no_episodes_are_refused(recorded, tmp_path):
    with pytest.raises(JengaError, match="--episodes is 0; allowed: 1 and more"):
        again(recorded, tmp_path / "out", 0)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("have", "want"), [(7, 1), (7, 2), (7, 6), (7, 7), (7, 9), (1, 1)])
def test_evenly_takes_different_ones_from_the_first_on(have, want):
    items = [Origin("a", 0, number) for number in range(have)]
    found = evenly(items, want)
    assert len(set(found)) == len(found) == min(have, want)
    assert found == sorted(found)
    assert found[0] == items[0]
    assert want == 1 or found[-1] == items[-1]


# --- verify --resim ------------------------------------------------------------------------------------------------


def checked(folder: Path, episodes: int = 2) -> VerifyReport:
    return with_resim(verify(folder), folder, episodes, workers=1)


def test_resim_is_one_more_check_and_leaves_nothing_behind(recorded, monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    report = checked(recorded)
    assert report.ok
    assert tuple(report.checks) == (*CHECKS, "resim")
    assert report.checks["resim"].detail.startswith("2 episodes made again; the largest difference is 0; 2 of 2 logs")
    assert report.as_dict()["resim"]["largest_difference"] == {}
    assert list(tmp_path.iterdir()) == []


def test_resim_finds_what_the_other_checks_cannot(recorded, forge):
    folder = forge(recorded, EPISODES, clear_frame=lambda v: v + 1)
    report = checked(folder, 1)
    assert report.ok  # what follows the pull is reported, not limited
    assert report.as_dict()["resim"]["largest_difference"] == {"clear_frame": 1.0}


def test_resim_is_not_run_on_what_failed_before(recorded, forge, monkeypatch):
    monkeypatch.setattr(workers, "run_one", never)
    report = checked(forge(recorded, block_mass=lambda v: -v))
    assert asdict(report.checks["resim"]) == {"ok": False, "detail": "not run, for what failed before"}


def test_resim_of_nothing_that_can_be_made_again_fails(recorded, tmp_path):
    folder = resealed(recorded, tmp_path / "set", lambda m: with_config(m, lambda c: c | {"magnets": 2}))
    found = with_resim(verify(recorded), folder, 2, 1)
    assert not found.ok
    assert "no episode could be made again" in found.checks["resim"].detail
    assert "6 cannot be made again" in found.checks["resim"].detail


def test_a_count_that_is_none_is_refused(recorded):
    with pytest.raises(JengaError, match="--resim is -1; allowed: 1 and more"):
        checked(recorded, -1)


def test_the_default_folder_is_of_the_dataset_s_name(recorded, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert rebuild(recorded, 1, 1).out == rebuild_module.OUT / "short@1.0.0"
    assert (tmp_path / "runs" / "rebuilt" / "short@1.0.0" / "logs").is_dir()
