"""The simulator's step and its inverse."""

import pytest
import torch

from jenga_models.simulator import Simulator, displaced, displacement


def some_towers(seed: int = 0, samples: int = 5) -> tuple[torch.Tensor, ...]:
    generator = torch.Generator().manual_seed(seed)
    pose, after = torch.randn(2, samples, 6, 7, generator=generator, dtype=torch.float64)
    after = pose + 0.1 * after
    for p in (pose, after):
        p[..., 3:] /= p[..., 3:].norm(dim=-1, keepdim=True)
    action = 1e-3 * torch.randn(samples, 1, 3, generator=generator, dtype=torch.float64)
    is_target = torch.nn.functional.one_hot(torch.arange(samples), 6).double()
    return pose, after, action, is_target


@pytest.mark.parametrize("residual", [True, False])
def test_next_pose_undoes_output_for(residual: bool):
    pose, after, action, is_target = some_towers()
    simulator = Simulator(torch.randn(2, 7).double(), torch.rand(2, 7).double() + 0.5, residual)
    output = simulator.output_for(pose, after, action, is_target)
    torch.testing.assert_close(simulator.next_pose(pose, output, action, is_target), after)


def test_displacement_does_not_see_the_sign_of_a_quaternion():
    pose, after, *_ = some_towers()
    flipped = after.clone()
    flipped[::2, :, 3:] *= -1
    assert torch.equal(displacement(pose, flipped), displacement(pose, after))


def test_a_displaced_quaternion_has_length_1():
    pose, after, *_ = some_towers()
    moved = displaced(pose, 0.3 * after)
    torch.testing.assert_close(moved[..., 3:].norm(dim=-1), torch.ones(moved.shape[:-1]).double())
    torch.testing.assert_close(moved[..., :3], pose[..., :3] + 0.3 * after[..., :3])


def test_an_output_of_0_is_the_trivial_prediction():
    pose, _, action, is_target = some_towers()
    simulator = Simulator(torch.zeros(2, 7).double(), torch.ones(2, 7).double(), residual=True)
    after = simulator.next_pose(pose, torch.zeros_like(pose), action, is_target)
    moved = after[..., :3] - pose[..., :3]
    torch.testing.assert_close(moved, is_target[..., None] * action)


def test_the_target_and_the_others_have_scales_of_their_own():
    pose, _, action, is_target = some_towers()
    simulator = Simulator(torch.zeros(2, 7).double(), torch.tensor([[0.1], [3.0]]).expand(2, 7).double(), False)
    after = simulator.next_pose(pose, torch.ones_like(pose), action, is_target)
    expected = torch.where(is_target[..., None] > 0, 3.0, 0.1).expand(*pose.shape[:-1], 3)
    torch.testing.assert_close(after[..., :3] - pose[..., :3], expected.double(), rtol=1e-6, atol=1e-8)
