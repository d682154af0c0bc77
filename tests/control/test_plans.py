"""The plans that a controller sampled, computed again from its log, and what replay does where it cannot."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_loops import CHEAP, MODEL, copied, evaluated
from made_up_dataset import dynamics_dataset, untrained

from jenga_control.extraction.closed_loop import CONTROLLERS
from jenga_control.extraction.evaluate import evaluate_extraction
from jenga_control.planning.plans import sampled_plans
from jenga_control.replay import replay, shown_with
from jenga_data.episode import Episode
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_episode
from jenga_models.checkpoint import load
from jenga_models.config import DYNAMICS_PRESETS


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return evaluated(tmp_path_factory.getbasetemp())[0]


@pytest.fixture(scope="module")
def logs(folder) -> dict[str, Path]:
    return {name: next(p for p in (folder / "logs" / name).glob("*.mcap") if "." not in p.stem) for name in CONTROLLERS}


@pytest.fixture(scope="module")
def naive(logs) -> Episode:
    return read_episode(logs["naive"])


@pytest.mark.parametrize("controller", ["naive", "full"])
def test_plans_computed_again_start_at_the_hand_and_lead_to_the_logged_actions(logs, folder, controller):
    episode = read_episode(logs[controller])
    plans = sampled_plans(episode, [load(folder / "model")])
    assert plans is not None
    assert "they give the logged actions" in plans.note
    assert plans.path.shape == (len(episode.action), 100, 6, 3)
    assert plans.frame.tolist() == episode.action_frame.tolist()
    first_step = plans.chosen[:, 1] - plans.chosen[:, 0]
    np.testing.assert_allclose(first_step, episode.action, atol=2e-4)  # but for the limits of what is executed
    assert (plans.path[:, :, 0] == plans.chosen[:, :1]).all()


def test_a_model_that_is_told_how_far_the_hand_is_ahead_is_told_so_by_the_log(tmp_path, monkeypatch):
    """`best` asks for it: without, it says something else from the second action on."""
    config = replace(DYNAMICS_PRESETS["best"], width=8, decoder_width=8, layers=1, accelerator="cpu")
    model = untrained(tmp_path / "model", config, dynamics_dataset())
    evaluate_extraction(model, tmp_path / "logs", ("full",), towers=1, workers=1, config=CHEAP)
    episode = read_episode(next((tmp_path / "logs" / "full").glob("*.mcap")))
    assert np.abs(episode.lag).max() > 1e-5
    plans = sampled_plans(episode, [load(model)])
    assert plans is not None
    assert "they give the logged actions" in plans.note
    monkeypatch.setattr(Episode, "lag", property(lambda self: np.zeros_like(self.action)))
    untold = sampled_plans(episode, [load(model)])
    assert untold is not None
    assert "differs from the logged one" in untold.note


def test_without_the_model_that_acted_its_plans_are_not_known(logs, folder, tmp_path):
    episode = read_episode(logs["full"])
    other = load(untrained(tmp_path / "other", replace(MODEL, width=8), dynamics_dataset()))
    for checkpoints in ([], [other]):
        plans = sampled_plans(episode, checkpoints)
        assert plans is not None
        assert len(plans.frame) == 0
        assert (
            plans.note == f"not shown: give the checkpoint that acted, {episode.header.checkpoint[:12]}, with --model"
        )


def test_plans_that_do_not_give_the_logged_actions_are_not_shown(naive):
    action = naive.action.copy()
    action[3, 0] += 0.001
    plans = sampled_plans(replace(naive, action=action))
    assert plans is not None
    assert len(plans.frame) == 0
    assert "differs from the logged one by 1 mm" in plans.note


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"touch": {}}, "heeds touch"),
        ({"dynamics": "simulator"}, "the simulator was the model"),
        ({"search": 1}, "none of this version"),
    ],
)
def test_plans_that_nothing_computes_again_say_why(logs, settings, why):
    episode = read_episode(logs["full"])
    config = dict(episode.header.config)
    config["controller"] = config["controller"] | settings
    plans = sampled_plans(replace(episode, header=replace(episode.header, config=config)))
    assert plans is not None
    assert len(plans.frame) == 0
    assert why in plans.note


def test_who_did_not_sample_has_no_plans(logs, naive):
    assert sampled_plans(read_episode(logs["straight"])) is None
    header = replace(naive.header, config={"kind": "extraction"})
    assert sampled_plans(replace(naive, header=header)) is None


def test_models_predict_one_step_and_in_an_open_loop_from_the_frame_asked_for(logs, folder, tmp_path):
    log = Path(shutil.copy(logs["naive"], tmp_path))
    episode = read_episode(log)
    start = int(episode.action_frame[4])
    shown = shown_with(log, episode, [folder / "model"], start)
    one_step, open_loop = shown.predictions
    assert (one_step.kind, open_loop.kind) == ("one_step", "open_loop")
    assert open_loop.frame[0] == start + 1
    assert one_step.frame[0] == episode.action_frame[0] + 1
    assert len(list(tmp_path.glob("*.prediction.mcap"))) == 2


def test_a_dynamics_model_says_nothing_of_an_episode_without_actions_and_the_replay_says_so(naive, folder, tmp_path):
    none = np.zeros(0, np.int64)
    still = replace(naive, action_frame=none, action=np.zeros((0, 3)), action_reached=np.zeros((0, 3)))
    shown = shown_with(tmp_path / "never-read.mcap", still, [folder / "model"])
    assert shown.predictions == []
    assert shown.notes == ["model predicts nothing here: the episode has no action"]


@pytest.mark.parametrize(
    ("count", "options", "line"),
    [
        (0, {}, "no log was given; name one or more"),
        (7, {}, "7 logs were given; at most 6 fit side by side"),
        (2, {"strip": Path("a.png")}, "--strip shows one episode, 2 were given"),
        (2, {"film": Path("a.gif")}, "--film shows one episode, 2 were given"),
        (1, {"film": Path("a.mp4")}, r"--film writes .gif or .webp; a.mp4 ends in neither"),
        (1, {"film": Path("a.gif"), "web": True}, "--film write files; choose one"),
        (1, {"from_frame": 3}, "--from-frame is where models begin an open loop; add --model"),
    ],
)
def test_what_cannot_be_replayed_is_refused_in_one_line(logs, count, options, line):
    with pytest.raises(JengaError, match=line):
        replay([logs["naive"]] * count, **options)


def test_one_command_writes_a_log_with_its_plans_and_several_side_by_side(logs, tmp_path):
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    def entities(path: Path) -> set[str]:
        return {str(chunk.entity_path) for chunk in RrdReader(path).stream()}

    copies = copied(logs["naive"].parent, tmp_path / "naive")
    log = copies / logs["naive"].name
    replay([log], save=tmp_path / "one.rrd")
    assert {"/plans/sampled", "/plans/chosen", "/world/tower"} <= entities(tmp_path / "one.rrd")
    replay([log, logs["straight"]], save=tmp_path / "two.rrd")
    columns = entities(tmp_path / "two.rrd")
    assert {"/episode_0/world/tower", "/episode_1/world/tower", "/episode_1/curve/moved"} <= columns
    assert "/world/tower" not in columns
