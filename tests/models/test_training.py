"""Training learns, repeats itself, takes up where it stopped, and keeps its folder clean."""

import csv
import json
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset, fake_dataset

from jenga_data.errors import CheckFailed, JengaError
from jenga_models.batch import Batch
from jenga_models.checkpoint import load
from jenga_models.committee import Committee
from jenga_models.config import DYNAMICS_PRESETS, SELECTION_PRESETS, DynamicsTraining, SelectionTraining
from jenga_models.metrics import predict_dynamics, predict_selection
from jenga_models.modules import SelectionModule
from jenga_models.train import train_dynamics, train_selection

SELECTION = replace(SELECTION_PRESETS["fast"], width=8, layers=2, epochs=5, accelerator="cpu")
STOPPING = replace(SELECTION, train_on_validation=False, patience=2, epochs=40, learning_rate=0.05)
DYNAMICS = replace(DYNAMICS_PRESETS["fast"], width=8, layers=2, epochs=4, accelerator="cpu")
SWEEP = replace(
    SELECTION, model="sweep", flow="down", shared_layers=False, dropout=0.2, mirror=True, members=2, calibrate=True,
    train_on_validation=False,
)  # fmt: skip
PAPER = replace(DYNAMICS_PRESETS["paper"], width=8, epochs=3, accelerator="cpu")


@contextmanager
def interrupted(monkeypatch: pytest.MonkeyPatch, epoch: int) -> Iterator[None]:
    """Ctrl-C in the second batch of that epoch."""
    step = SelectionModule.training_step

    def training_step(self: SelectionModule, batch: Batch, batch_idx: int) -> torch.Tensor:
        if self.current_epoch == epoch and batch_idx == 1:
            signal.raise_signal(signal.SIGINT)
        return step(self, batch)

    with monkeypatch.context() as patch:
        patch.setattr(SelectionModule, "training_step", training_step)
        yield


def test_a_selector_beats_the_majority(selection_data: FakeDataset, selector_path: Path):
    rows = selection_data.rows("test")
    failure = selection_data.column("failure")[rows]
    right = (predict_selection(selector_path, selection_data, rows) > 0.5) == failure
    assert right.mean() > max(failure.mean(), 1 - failure.mean()) + 0.2


def test_a_simulator_beats_the_trivial_prediction(dynamics_data: FakeDataset, simulator_path: Path):
    """Of the other blocks that nothing moves, of the target that it moves by the action (which is exact here)."""
    rows = dynamics_data.rows("test")
    predicted = predict_dynamics(simulator_path, dynamics_data, rows)[..., :3]
    before, after = (dynamics_data.column(name)[rows][..., :3] for name in ("block_pose", "next_pose"))
    others = np.arange(before.shape[1]) != dynamics_data.column("target")[rows][:, None]
    assert ((predicted - after)[others] ** 2).mean() < 0.2 * ((before - after)[others] ** 2).mean()
    assert np.abs((predicted - after)[~others]).max() < 2e-4


@pytest.mark.parametrize(("config", "interrupted_in"), [(SELECTION, 0), (SELECTION, 3), (SWEEP, 3)])
def test_resumed_training_equals_one_that_was_never_interrupted(
    selection_data: FakeDataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    config: SelectionTraining,
    interrupted_in: int,
):
    whole = train_selection(selection_data, config, tmp_path / "whole")
    handler = signal.getsignal(signal.SIGINT)
    with interrupted(monkeypatch, interrupted_in), pytest.raises(KeyboardInterrupt):
        train_selection(selection_data, config, tmp_path / "resumed")
    assert signal.getsignal(signal.SIGINT) is handler
    epochs: list[int] = []
    monkeypatch.setattr(SelectionModule, "on_train_epoch_start", lambda self: epochs.append(self.current_epoch))
    resumed = train_selection(selection_data, config, tmp_path / "resumed", resume=True)
    assert epochs == list(range(interrupted_in, config.epochs))
    assert resumed.hash == whole.hash
    assert (resumed.path / "metrics.csv").read_text() == (whole.path / "metrics.csv").read_text()


def test_early_stopping_resumes_to_the_same_end(
    selection_data: FakeDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    whole = train_selection(selection_data, STOPPING, tmp_path / "whole")
    assert whole.metrics["epochs"] < STOPPING.epochs
    assert whole.metrics["epoch"] == whole.metrics["epochs"] - 1 - STOPPING.patience
    last = int(whole.metrics["epochs"]) - 1
    with interrupted(monkeypatch, last), pytest.raises(KeyboardInterrupt):
        train_selection(selection_data, STOPPING, tmp_path / "resumed")
    assert train_selection(selection_data, STOPPING, tmp_path / "resumed", resume=True).hash == whole.hash


def test_the_epoch_kept_is_the_one_with_the_lowest_validation_loss(selection_data: FakeDataset, tmp_path: Path):
    result = train_selection(selection_data, STOPPING, tmp_path / "out")
    rows = selection_data.rows("validation")
    failure = selection_data.column("failure")[rows]
    probability = predict_selection(result.path, selection_data, rows)
    loss = -np.log(np.where(failure, probability, 1 - probability)).mean()
    with (result.path / "metrics.csv").open() as file:
        logged = [float(row["validation_loss"]) for row in csv.DictReader(file)]
    assert loss == pytest.approx(min(logged), rel=1e-4)
    assert result.metrics["validation_loss"] == min(logged)


def test_validation_towers_are_trained_on_where_the_config_says_so(selection_data: FakeDataset, tmp_path: Path):
    both, one = (
        train_selection(
            selection_data, replace(STOPPING, epochs=1, patience=0, train_on_validation=both), tmp_path / str(both)
        )
        for both in (True, False)
    )
    train, validation = (len(selection_data.rows(split)) for split in ("train", "validation"))
    assert (both.metrics["training_rows"], one.metrics["training_rows"]) == (train + validation, train)
    assert "validation_loss" in one.metrics
    assert "validation_loss" not in both.metrics


def test_training_shows_towers_mirrored_where_the_config_says_so(selection_data: FakeDataset, tmp_path: Path):
    config = replace(SWEEP, epochs=1, dropout=0.0, calibrate=False)
    weights = []
    for mirror in (True, False):
        path = train_selection(selection_data, replace(config, mirror=mirror), tmp_path / str(mirror)).path
        weights.append((path / "model.safetensors").read_bytes())
    assert weights[0] != weights[1]


def test_a_calibrated_committee_is_stored_with_its_temperature(selection_data: FakeDataset, tmp_path: Path):
    network = load(train_selection(selection_data, SWEEP, tmp_path / "out").path).model
    assert isinstance(network, Committee)
    assert network.temperature.item() != 1.0
    rows = selection_data.rows("validation")
    wanted = torch.tensor(selection_data.column("failure")[rows].astype(np.int64))
    said = torch.tensor(predict_selection(tmp_path / "out", selection_data, rows)).clamp(1e-12, 1)
    logits = torch.stack([(1 - said).log(), said.log()], dim=-1)
    loss = [torch.nn.functional.cross_entropy(logits * factor, wanted).item() for factor in (0.9, 1.0, 1.1)]
    assert min(loss) == loss[1]


def test_a_learning_curve_trains_on_whole_towers_of_which_more_hold_the_fewer(
    selection_data: FakeDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    seen: dict[int, set[str]] = {}

    def note(dataset: FakeDataset, config: SelectionTraining, spec: object, train: np.ndarray) -> None:
        seen[config.training_towers] = set(dataset.column("tower")[train])
        raise InterruptedError

    monkeypatch.setattr("jenga_models.train.selection_problem", note)
    for count in (0, 20, 5):
        with pytest.raises(InterruptedError):
            train_selection(selection_data, replace(SELECTION, training_towers=count), tmp_path / str(count))
    assert [len(seen[count]) for count in (20, 5)] == [20, 5]
    assert seen[5] < seen[20] < seen[0]
    with pytest.raises(JengaError, match=r"training_towers is 9999; tiny@1.0.0 has \d+ to train on"):
        train_selection(selection_data, replace(SELECTION, training_towers=9999), tmp_path / "too many")


def test_weight_decay_is_decoupled_and_none_is_adam():
    plain, decayed = (
        SelectionModule(torch.nn.Linear(1, 1), replace(SELECTION, weight_decay=w, schedule="constant"))
        for w in (0.0, 0.1)
    )
    assert type(plain.configure_optimizers()) is torch.optim.Adam
    assert type(decayed.configure_optimizers()) is torch.optim.AdamW


def test_dynamics_training_repeats_itself_and_differs_by_seed(dynamics_data: FakeDataset, tmp_path: Path):
    first, again = (train_dynamics(dynamics_data, PAPER, tmp_path / name).hash for name in ("a", "b"))
    other = train_dynamics(dynamics_data, replace(PAPER, seed=1), tmp_path / "c").hash
    assert first == again != other


def test_a_finished_folder_holds_nothing_but_the_checkpoint_and_its_log(
    dynamics_data: FakeDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    result = train_dynamics(dynamics_data, DYNAMICS, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    names = sorted(path.name for path in result.path.iterdir())
    assert names == ["checkpoint.json", "metrics.csv", "model.safetensors"]
    assert capfd.readouterr() == ("", "")
    assert json.loads((result.path / "checkpoint.json").read_text())["metrics"] == result.metrics


def test_resuming_what_is_finished_gives_it_back(dynamics_data: FakeDataset, tmp_path: Path):
    first = train_dynamics(dynamics_data, DYNAMICS, tmp_path / "out")
    again = train_dynamics(dynamics_data, DYNAMICS, tmp_path / "out", resume=True)
    assert (again.hash, again.metrics) == (first.hash, first.metrics)


def test_folders_that_do_not_fit_are_refused(dynamics_data: FakeDataset, tmp_path: Path):
    out = tmp_path / "out"
    with pytest.raises(JengaError, match=r"nothing to resume in .*out; start without --resume"):
        train_dynamics(dynamics_data, DYNAMICS, out, resume=True)
    assert not out.exists()
    train_dynamics(dynamics_data, DYNAMICS, out)
    with pytest.raises(JengaError, match="out exists; choose another folder, or add --resume"):
        train_dynamics(dynamics_data, DYNAMICS, out)
    with pytest.raises(JengaError, match=r"another layers \(2 there, 3 now\); resume with the same"):
        train_dynamics(dynamics_data, replace(DYNAMICS, layers=3), out, resume=True)
    with pytest.raises(JengaError, match="another dataset"):
        train_dynamics(replace(dynamics_data, hash="0" * 64), DYNAMICS, out, resume=True)


def test_a_damaged_state_is_refused(selection_data: FakeDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with interrupted(monkeypatch, 1), pytest.raises(KeyboardInterrupt):
        train_selection(selection_data, SELECTION, tmp_path / "out")
    state = tmp_path / "out" / "state" / "last.ckpt"
    state.write_bytes(state.read_bytes()[:1000])
    with pytest.raises(CheckFailed, match=r"last.ckpt is damaged; delete it and resume"):
        train_selection(selection_data, SELECTION, tmp_path / "out", resume=True)
    with pytest.raises(JengaError, match=r"is no checkpoint: it has no checkpoint.json; .*finish it with --resume"):
        load(tmp_path / "out")
    state.unlink()
    assert train_selection(selection_data, SELECTION, tmp_path / "out", resume=True).metrics["epochs"] == 5


def test_a_folder_that_cannot_be_written_is_one_line(selection_data: FakeDataset, tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(JengaError, match=r"cannot write .*Not a directory"):
        train_selection(selection_data, SELECTION, tmp_path / "file" / "out")


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without a GPU")
def test_a_gpu_that_is_not_there_is_refused(selection_data: FakeDataset, tmp_path: Path):
    with pytest.raises(JengaError, match="torch sees no GPU"):
        train_selection(selection_data, replace(SELECTION, accelerator="cuda"), tmp_path / "out")


@pytest.mark.parametrize(
    ("split", "config", "message"),
    [
        ("train", SELECTION, "has no training rows"),
        ("validation", STOPPING, "has no validation rows to stop early and calibrate by"),
    ],
)
def test_an_empty_side_is_refused(tmp_path: Path, split: str, config: SelectionTraining, message: str):
    data = fake_dataset("selection", 20)
    kept = {name: rows[:0] if name in (split, "validation") else rows for name, rows in data.split.items()}
    with pytest.raises(JengaError, match=message):
        train_selection(replace(data, split=kept), config, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_dataset_of_the_other_kind_is_refused(selection_data: FakeDataset, tmp_path: Path):
    with pytest.raises(JengaError, match=r"tiny@1.0.0 is a selection dataset; wanted: dynamics"):
        train_dynamics(selection_data, DYNAMICS, tmp_path / "out")


def test_a_diverging_training_says_so(dynamics_data: FakeDataset, tmp_path: Path):
    config: DynamicsTraining = replace(PAPER, learning_rate=1e30, epochs=5)
    with pytest.raises(JengaError, match=r"training diverged in epoch .*lower learning_rate"):
        train_dynamics(dynamics_data, config, tmp_path / "out")
