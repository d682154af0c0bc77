"""Whatever a person or a file gets wrong ends in one clear line and the right exit code, and nothing is lost."""

import os
import shutil
from pathlib import Path

import pytest
from jenga_runs import COLLECT, Made, contents, jenga

from jenga_models.pretrained import pretrained

NAMES = ("--name", "x", "--version", "0.1.0")


@pytest.fixture
def half(extraction_logs: Made, tmp_path: Path) -> Path:
    """A log that was cut in half, alone in its folder."""
    (tmp_path / "cut").mkdir()
    whole = min(extraction_logs.path.glob("*.mcap"))
    log = tmp_path / "cut" / whole.name
    log.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    return log


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    """A folder with something in it that must stay as it is."""
    folder = tmp_path / "precious"
    folder.mkdir()
    (folder / "thesis.txt").write_text("all of it")
    return folder


def test_seeds_of_training_evaluate_nothing(tmp_path):
    out = tmp_path / "out"
    line = jenga("eval", "extraction", "--objective", "naive", "--seed", 899_999, "--out", out).line()
    assert "evaluation uses seeds from 900000 up" in line
    assert not out.exists()


def test_another_recipe_does_not_mix_with_a_collection(selection_logs: Made):
    before = contents(selection_logs.path)
    line = jenga(*COLLECT["selection"], "--episodes", 4, "--seed", 1, "--out", selection_logs.path).line()
    assert "holds episodes of another configuration or seed" in line
    assert contents(selection_logs.path) == before


def test_a_folder_of_something_else_is_no_collection(precious):
    assert (
        "is no collection (it holds thesis.txt)"
        in jenga(*COLLECT["selection"], "--episodes", 1, "--out", precious).line()
    )
    assert {"thesis.txt": b"all of it"}.items() <= contents(precious).items()


def test_a_bench_into_a_file(precious):
    before = contents(precious)
    assert "choose another --out" in jenga("bench", "sim", "--out", precious / "thesis.txt").line()
    assert contents(precious) == before


@pytest.mark.parametrize("verb", [("eval", "selection", "--model", "m"), ("train", "selection", "--out", "o")])
def test_an_unknown_dataset_is_told_the_known_ones(verb, selection: Made, monkeypatch):
    monkeypatch.setenv("JENGA_DATASETS", str(selection.path.parent))
    line = jenga(*verb, "--dataset", "pulls@9.9.9").line()
    assert "no dataset 'pulls@9.9.9'; known: " in line
    assert "pulls@0.1.0" in line
    assert "jenga convert" in line


def test_a_dataset_folder_that_does_not_exist(tmp_path):
    for verb in (("dataset", "verify"), ("dataset", "info")):
        assert f"no folder or dataset {tmp_path / 'none'}" in jenga(*verb, tmp_path / "none").line()
    assert "manifest.json" in jenga("dataset", "info", tmp_path).line()


def test_a_dataset_that_was_changed_fails_its_check(selection: Made, tmp_path):
    broken = shutil.copytree(selection.path, tmp_path / "broken")
    file = next((broken / "data").iterdir())
    damaged = bytearray(file.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    file.write_bytes(damaged)
    ran = jenga("dataset", "verify", broken, "--json")
    assert ran.code == 1
    said = ran.object()
    assert said["ok"] is False
    assert "SHA-256" in said["checks"]["files"]["detail"]
    file.unlink()
    assert "is missing" in jenga("dataset", "info", broken).line(1)


def test_half_a_log(half, tmp_path):
    rrd, out = tmp_path / "half.rrd", tmp_path / "out"
    for args in (("replay", half, "--save", rrd), ("convert", half.parent, *NAMES, "--out", out)):
        assert f"run: jenga log recover {half}" in jenga(*args).line(1)
    for verb in ("doctor", "info"):
        ran = jenga("log", verb, half, "--json")
        assert ran.code == 1
        said = ran.object()
        assert said["complete"] is False
        assert said["problems"]
    assert list(tmp_path.iterdir()) == [half.parent]


def test_half_a_log_is_recovered_as_its_refusal_says(half, extraction_logs: Made):
    ran = jenga("log", "recover", half, "--json")
    assert ran.code == 1  # something was lost, and is named
    said = ran.object()
    assert said["lost"]
    assert said["frames"] > 0
    assert jenga("log", "info", said["out"], "--json").object()["recovery"]


def test_a_cut_log_in_a_collection_stops_it(half, extraction_logs: Made, tmp_path):
    collection = shutil.copytree(extraction_logs.path, tmp_path / "collection")
    shutil.copy(half, collection)
    before = contents(collection, "*.mcap")
    line = jenga(*COLLECT["extraction"], "--episodes", 3, "--out", collection).line(1)
    assert half.name in line
    assert contents(collection, "*.mcap") == before


@pytest.mark.parametrize("verb", [("log", "info"), ("log", "doctor"), ("log", "recover"), ("replay",)])
def test_a_log_that_is_none(verb, tmp_path, precious):
    assert "No such file" in jenga(*verb, tmp_path / "none.mcap").line()
    assert "is no MCAP file" in jenga(*verb, precious / "thesis.txt").line()
    assert "Is a directory" in jenga(*verb, precious).line()
    assert contents(tmp_path) == {"precious/thesis.txt": b"all of it"}


def test_a_model_of_the_other_kind(selector: Made, simulator: Made, selection: Made, dynamics: Made, tmp_path):
    wrong = (
        (("eval", "dynamics", "--model", selector.path, "--dataset", dynamics.path), "dynamics"),
        (("eval", "selection", "--model", simulator.path, "--dataset", selection.path), "selection"),
        (("eval", "extraction", "--model", selector.path, "--out", tmp_path / "out"), "dynamics"),
    )
    for args, kind in wrong:
        assert f"wanted: {kind} (`jenga train {kind}` makes one)" in jenga(*args).line()
    assert list(tmp_path.iterdir()) == []


def test_data_of_the_other_kind(selector: Made, selection: Made, dynamics: Made, tmp_path):
    assert "dynamics" in jenga("eval", "selection", "--model", selector.path, "--dataset", dynamics.path).line()
    line = jenga("train", "dynamics", "--dataset", selection.path, "--preset", "fast", "--out", tmp_path / "out").line()
    assert "pulls@0.1.0 is a selection dataset; wanted: dynamics" in line
    assert list(tmp_path.iterdir()) == []


def test_a_checkpoint_without_weights(simulator: Made, dynamics: Made, extraction_logs: Made, tmp_path):
    bare = shutil.copytree(simulator.path, tmp_path / "bare")
    (bare / "model.safetensors").unlink()
    log = min(extraction_logs.path.glob("*.mcap"))
    for args in (
        ("eval", "dynamics", "--model", bare, "--dataset", dynamics.path),
        ("eval", "extraction", "--model", bare, "--out", tmp_path / "out"),
        ("replay", log, "--model", bare, "--save", tmp_path / "out.rrd"),
    ):
        assert f"{bare} is no checkpoint: it has no model.safetensors" in jenga(*args).line()
    none = ("--model", tmp_path / "none", "--dataset", dynamics.path)
    assert "no checkpoint at" in jenga("eval", "dynamics", *none).line()
    assert list(tmp_path.iterdir()) == [bare]


def test_a_checkpoint_whose_weights_changed(simulator: Made, dynamics: Made, tmp_path):
    damaged = shutil.copytree(simulator.path, tmp_path / "damaged")
    weights = damaged / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1] + b"!")
    assert "is damaged" in jenga("eval", "dynamics", "--model", damaged, "--dataset", dynamics.path).line(1)


def test_an_output_folder_that_exists_is_left_alone(selection_logs: Made, selection: Made, precious):
    for args in (
        ("convert", selection_logs.path, *NAMES, "--out", precious),
        ("train", "selection", "--dataset", selection.path, "--preset", "fast", "--out", precious),
        ("demo", "--out", precious),
    ):
        assert f"{precious} exists" in jenga(*args).line()
    assert contents(precious) == {"thesis.txt": b"all of it"}


def test_logs_of_both_kinds_make_no_dataset(selection_logs: Made, extraction_logs: Made, tmp_path):
    args = ("convert", selection_logs.path, extraction_logs.path, *NAMES, "--out", tmp_path / "out")
    assert "logs of different kinds" in jenga(*args).line()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--name", "A B", "--version", "0.1.0"), "bad dataset name 'A B'"),
        (("--name", "x", "--version", "1"), "bad version '1': use X.Y.Z"),
    ],
)
def test_a_dataset_s_name_and_version(options, says, selection_logs: Made, tmp_path):
    assert says in jenga("convert", selection_logs.path, *options, "--out", tmp_path / "out").line()
    assert list(tmp_path.iterdir()) == []


def test_too_few_towers_make_no_dataset(selection_logs: Made, tmp_path):
    two = sorted(selection_logs.path.glob("*.mcap"))[:2]
    assert "collect at least 3" in jenga("convert", *two, *NAMES, "--out", tmp_path / "out").line()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["selection", "dynamics"])
def test_an_unknown_preset_is_told_the_known_ones(kind):
    for preset in (("--preset", "slow"), ("--preset=slow",)):
        line = jenga("train", kind, "--dataset", "d", "--out", "o", *preset).line()
        assert line == "jenga: unknown preset 'slow'; allowed: paper, best, fast"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--width", 0), "width is 0; allowed: 1 and more"),
        (("--learning-rate", 0), "learning_rate is 0.0; allowed: above 0"),
        (("--graph", "G_x"), "G_x"),
        (("--model", "mlp"), "unknown model 'mlp' for selection; registered: gcn, interaction"),
    ],
)
def test_a_hyperparameter_that_is_none(options, says, selection: Made, tmp_path):
    args = ("train", "selection", "--dataset", selection.path, "--preset", "fast", "--out", tmp_path / "out")
    assert says in jenga(*args, *options).line()
    assert list(tmp_path.iterdir()) == []


def test_nothing_to_resume(selection: Made, tmp_path):
    args = ("train", "selection", "--dataset", selection.path, "--preset", "fast", "--out", tmp_path / "out")
    assert "nothing to resume" in jenga(*args, "--resume").line()
    assert list(tmp_path.iterdir()) == []


def test_the_full_objective_takes_a_dynamics_model_that_is_there(tmp_path):
    line = jenga("eval", "extraction", "--out", tmp_path / "out", "--model", tmp_path / "none").line()
    assert f"no checkpoint at {tmp_path / 'none'}: there is no such folder; `jenga train` makes one" in line
    line = jenga("eval", "extraction", "--out", tmp_path / "out", "--model", pretrained("selection")).line()
    assert "is a selection checkpoint; wanted: dynamics" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("objective", "given"), [((), "none"), (("naive", "naive"), "naive, naive")])
def test_every_way_to_pull_is_evaluated_once(objective, given, tmp_path):
    line = jenga("eval", "extraction", "--out", tmp_path / "out", "--objective", *objective).line()
    assert f"ways to pull: {given}; allowed: one or more of full, naive, straight-SPEED and hindsight" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "size", [("--epochs", 0), ("--towers", 0), ("--selection-episodes", 2), ("--extraction-episodes", 2)]
)
def test_a_demo_too_small_to_end_is_refused_before_it_starts(size, tmp_path):
    line = jenga("demo", "--out", tmp_path / "out", *size).line()
    assert "at least" in line
    assert list(tmp_path.iterdir()) == []


def test_replay_shows_or_writes(extraction_logs: Made, tmp_path):
    log = min(extraction_logs.path.glob("*.mcap"))
    assert "choose one" in jenga("replay", log, "--web", "--save", tmp_path / "x.rrd").line()
    assert "No such file" in jenga("replay", log, "--save", tmp_path / "none" / "x.rrd").line()
    assert "No such file" in jenga("replay", log, "--strip", tmp_path / "none" / "x.png").line()
    assert "No such file" in jenga("replay", log, "--film", tmp_path / "none" / "x.gif").line()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into a read-only folder")
def test_a_folder_that_may_not_be_written(selection_logs: Made, selection: Made, tmp_path):
    tmp_path.chmod(0o500)
    out = tmp_path / "out"
    for args in (
        (*COLLECT["selection"], "--episodes", 1, "--out", out),
        ("convert", selection_logs.path, *NAMES, "--out", out),
        ("train", "selection", "--dataset", selection.path, "--preset", "fast", "--out", out),
    ):
        assert "Permission denied" in jenga(*args).line()
    tmp_path.chmod(0o700)
    assert list(tmp_path.iterdir()) == []
