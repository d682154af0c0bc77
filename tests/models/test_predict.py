"""Predictions on live towers, and over datasets agree with each other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from fake_towers import FakeDataset, small_tower

from jenga_data.errors import JengaError
from jenga_data.graph import support_edges
from jenga_models.checkpoint import load
from jenga_models.columns import Towers
from jenga_models.metrics import advance, predict_dynamics, predict_selection, rollout_dynamics, windows
from jenga_models.predict import CPU_SAMPLES, LearnedDynamics, Selector


def test_a_live_tower_gets_the_probability_of_its_row(selector_path: Path, rng: np.random.Generator):
    state = small_tower(rng)
    targets = state.layout.legal_targets()
    selector = Selector(selector_path)
    together = selector.failure_probability(state, targets)
    alone = [selector.failure_probability(state, [target])[0] for target in targets]
    np.testing.assert_allclose(together, alone, atol=1e-6)
    assert ((together > 0) & (together < 1)).all()
    assert len(np.unique(together)) == len(targets)
    assert selector.failure_probability(state, []).shape == (0,)


def test_a_live_tower_gets_what_its_dataset_row_gets(
    selector_path: Path, selection_data: FakeDataset, rng: np.random.Generator
):
    """The dataset's float32 and the live tower's float64 are one tower to the model."""
    state = small_tower(np.random.default_rng(0))  # the first row of the made-up dataset is drawn like this
    target = int(selection_data.column("target")[0])
    np.testing.assert_allclose(state.pose, selection_data.column("block_pose")[0], atol=1e-6)
    live = Selector(selector_path).failure_probability(state, [target])
    np.testing.assert_allclose(live, predict_selection(selector_path, selection_data, np.array([0])), atol=1e-5)


def test_samples_of_a_step_do_not_see_each_other(simulator_path: Path, rng: np.random.Generator):
    state, samples = small_tower(rng), CPU_SAMPLES + 3
    target = int(state.layout.grid[0, 0])
    dynamics = LearnedDynamics(simulator_path)
    dynamics.start(state, target)
    pose = torch.tensor(state.pose).float().repeat(samples, 1, 1)
    pose[..., :3] += 1e-4 * torch.randn(samples, 6, 3)
    action = 1e-3 * torch.randn(samples, 3)
    together = dynamics.step(pose, action)
    for sample in range(samples):
        one = dynamics.step(pose[sample : sample + 1], action[sample : sample + 1])[0]
        torch.testing.assert_close(together[sample], one, atol=1e-6, rtol=0)
    torch.testing.assert_close(together[..., 3:].norm(dim=-1), torch.ones(samples, 6))


def test_the_controllers_step_equals_the_evaluations(simulator_path: Path, rng: np.random.Generator):
    state = small_tower(rng)
    target = int(state.layout.grid[0, 0])
    action, later = rng.normal(0, 1e-3, (1, 3)), state.pose[None].copy()
    later[..., :3] += rng.normal(0, 1e-4, (1, 6, 3))
    later[:, target, 0] -= 0.005
    towers = Towers.of_state(state, np.array([target]))
    dynamics = LearnedDynamics(simulator_path)
    dynamics.start(state, target)
    for pose in (state.pose[None], later):
        expected = advance(load(simulator_path), replace(towers, block_pose=pose), action)
        stepped = dynamics.step(torch.tensor(pose).float(), torch.tensor(action).float())
        np.testing.assert_allclose(stepped.numpy(), expected, atol=1e-6)


def test_wrong_checkpoints_and_blocks_are_refused(selector_path: Path, simulator_path: Path, rng: np.random.Generator):
    state = small_tower(rng)
    with pytest.raises(JengaError, match="wanted: dynamics"):
        LearnedDynamics(selector_path)
    with pytest.raises(JengaError, match="wanted: selection"):
        Selector(simulator_path)
    with pytest.raises(JengaError, match="no block 6 in a tower of 6"):
        Selector(selector_path).failure_probability(state, [0, 6])
    with pytest.raises(JengaError, match="no block 9 in a tower of 6"):
        LearnedDynamics(simulator_path).start(state, 9)


def test_windows_are_runs_of_frames_in_one_episode(dynamics_data: FakeDataset):
    episode, frame = dynamics_data.column("episode"), dynamics_data.column("frame")
    rows = np.random.default_rng(0).permutation(dynamics_data.rows("train"))
    found = windows(dynamics_data, rows, 2)
    assert (episode[found] == episode[found[:, :1]]).all()
    assert (np.diff(frame[found], axis=1) == 1).all()
    assert len(np.unique(found)) == found.size == 2 * 2 * len(np.unique(episode[rows]))  # 5 frames hold 2 pairs
    without_1 = rows[frame[rows] != 1]
    assert set(frame[windows(dynamics_data, without_1, 2)[:, 0]]) == {2}
    with pytest.raises(JengaError, match="no episode of 6 transitions in a row"):
        windows(dynamics_data, rows, 6)


def test_a_rollout_starts_with_the_one_step_prediction_and_goes_on_from_it(
    simulator_path: Path, dynamics_data: FakeDataset
):
    window = windows(dynamics_data, dynamics_data.rows("test"), 3)
    rolled = rollout_dynamics(simulator_path, dynamics_data, window)
    one_step = predict_dynamics(simulator_path, dynamics_data, window[:, 0])
    np.testing.assert_allclose(rolled[:, 0], one_step, atol=1e-6)
    first = dynamics_data.column("block_size")[window[:, 0]]
    mass, level, slot, target = (
        dynamics_data.column(name)[window[:, 0]] for name in ("block_mass", "level", "slot", "target")
    )
    towers = Towers.of_poses(first, mass, rolled[:, 0], level, slot, target)
    again = advance(load(simulator_path), towers, dynamics_data.column("action")[window[:, 1]])
    np.testing.assert_allclose(rolled[:, 1], again, atol=1e-6)


def test_towers_of_poses_have_the_edges_of_each_tower(rng: np.random.Generator):
    states = [small_tower(rng) for _ in range(3)]
    lifted = states[1].pose.copy()
    lifted[int(states[1].layout.grid[1, 0]), 2] += 0.02
    poses = [states[0].pose, lifted, states[2].pose]
    towers = Towers.of_poses(
        np.stack([s.blocks.size for s in states]),
        np.stack([s.blocks.mass for s in states]),
        np.stack(poses),
        np.stack([s.layout.level for s in states]),
        np.stack([s.layout.slot for s in states]),
        np.zeros(3, np.int64),
    )
    for row, (state, pose) in enumerate(zip(states, poses, strict=True)):
        own = slice(towers.offset[row], towers.offset[row + 1])
        assert np.array_equal([towers.upper[own], towers.lower[own]], support_edges(pose, state.blocks.size))
    assert np.diff(towers.offset).tolist() == [9, 6, 9]
