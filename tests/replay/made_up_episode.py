"""A made-up episode that looks like a real one: a fresh tower, a hand that pulls one block out, shaky neighbours."""

import numpy as np
from jaxtyping import Float

from jenga_data.blocks import BLOCK_COUNT, Blocks, sample_blocks
from jenga_data.episode import (
    CONTROL_STEP_NS,
    LEFT_FINGER,
    RIGHT_FINGER,
    TABLE,
    Contacts,
    Episode,
    EpisodeHeader,
    GripperTrack,
    Phase,
    Prediction,
    Result,
)
from jenga_data.graph import support_edges
from jenga_data.outcome import judge
from jenga_data.tower import Layout

TARGET = 27
"""The -y side block of level 9, which lies along y as built and along x after a quarter turn back."""
PULL_END = 0.125


def nominal_pose(layout: Layout, blocks: Blocks, quarter_turn: int) -> Float[np.ndarray, "block 7"]:
    """Every block where its layout has it, turned by a multiple of 90 degrees."""
    pose = np.zeros((len(blocks), 7))
    for block, place in layout:
        turned = (place.level + quarter_turn) % 4
        angle = turned * np.pi / 2
        across = (place.slot - 1) * 0.0251
        pose[block, :3] = -across * np.sin(angle), across * np.cos(angle), (place.level + 0.5) * blocks.size[0, 2]
        pose[block, 3], pose[block, 6] = np.cos(angle / 2), np.sin(angle / 2)
    return pose


def make_episode(frames: int = 120, pull: tuple[int, int] = (20, 70), robot: bool = True, seed: int = 0) -> Episode:
    """Pull block 27 out in -x between two frames while its neighbours follow by a few millimetres."""
    rng = np.random.default_rng(seed)
    layout = Layout.fresh()
    blocks = sample_blocks("nominal", rng)
    start = nominal_pose(layout, blocks, quarter_turn=-1)
    progress = np.clip((np.arange(frames) - pull[0]) / (pull[1] - pull[0]), 0, 1)
    pose = np.repeat(start[None], frames, axis=0)
    # What lies near the target follows it, by less the farther it is.
    follow = 0.004 * np.exp(-np.abs(layout.level - layout.level[TARGET]) / 2.0) * rng.uniform(0.4, 1, BLOCK_COUNT)
    pose[:, :, 0] -= np.minimum(progress * 3, 1)[:, None] * follow
    pose[:, :, 1] += 2e-4 * np.cumsum(rng.normal(0, 0.1, (frames, BLOCK_COUNT)), axis=0) * progress[:, None]
    sticking_out = 0.02 if robot else 0.0
    pose[:, TARGET, 0] = start[TARGET, 0] - sticking_out - progress * PULL_END
    time_ns = np.arange(frames) * CONTROL_STEP_NS + 1_000_000_000
    contacts = [_contacts(p, blocks, robot and k >= 12, rng) for k, p in enumerate(pose)]
    step = np.diff(pose[:, TARGET, :3], axis=0, append=pose[-1:, TARGET, :3])
    actions = np.arange(pull[0], min(pull[1], frames))
    header = EpisodeHeader(
        key="5f0c9a7be2d14c3380aa11d5e6f70912", kind="extraction" if robot else "selection", seed=7, number=3,
        blocks=blocks, layout=layout, target=TARGET, turn=3, face=0, config={"friction": 0.35},
        provenance={"jenga": "0.1.0", "mujoco": "4.0.0", "git": "0123abc", "machine": "Linux x86-64, 2 cores"},
    )  # fmt: skip
    names = ((0, "approach"), (12, "grasp"), (20, "pull"), (70, "hold")) if robot else ((0, "settle"), (20, "pull"))
    return Episode(
        header=header,
        time_ns=time_ns,
        pose=pose,
        twist=np.zeros((frames, BLOCK_COUNT, 6)),
        contacts=contacts,
        sim_state=np.zeros((frames, 0)),
        action_frame=actions,
        action=step[actions] + rng.normal(0, [0, 6e-4, 6e-4], (len(actions), 3)),
        action_reached=step[actions],
        gripper=_track(time_ns, pose, rng) if robot else _no_track(),
        phases=[Phase(f, int(time_ns[f]), name) for f, name in names if f < frames],
        result=Result(judge(pose, blocks.size, TARGET, CONTROL_STEP_NS * 1e-9)),
        turntable=np.zeros(frames),
        robot=None,
    )


def _contacts(pose: Float[np.ndarray, "block 7"], blocks: Blocks, held: bool, rng: np.random.Generator) -> Contacts:
    upper, lower = support_edges(pose, blocks.size)
    load = 9.81 * 0.0193 * (pose[:, 2].max() - pose[upper, 2]) / 0.015 / 3
    force = load[:, None] * rng.uniform([-0.1, -0.1, 0.6], [0.1, 0.1, 1.2], (len(upper), 3))
    bottom = np.flatnonzero(pose[:, 2] < 0.01)
    first = [upper, bottom]
    second = [lower, np.full(len(bottom), TABLE)]
    forces = [force, rng.uniform([-0.2, -0.2, 3.0], [0.2, 0.2, 4.0], (len(bottom), 3))]
    if held:
        first.append(np.array([TARGET, TARGET]))
        second.append(np.array([LEFT_FINGER, RIGHT_FINGER]))
        forces.append(np.array([[-2.0, -8.0, 0.2], [-2.0, 8.0, 0.2]]))
    return Contacts(np.concatenate(first), np.concatenate(second), np.concatenate(forces))


def _track(time_ns: np.ndarray, pose: Float[np.ndarray, "frame block 7"], rng: np.random.Generator) -> GripperTrack:
    """Sampled eight times a frame: comes from -x, closes at frame 12, then moves with the block's -x end."""
    at = np.arange(time_ns[0], time_ns[-1] + 1, CONTROL_STEP_NS // 8)
    frame = (at - time_ns[0]) / CONTROL_STEP_NS
    block = np.stack([np.interp(frame, np.arange(len(pose)), pose[:, TARGET, i]) for i in range(3)], axis=1)
    approach = np.clip(frame / 10, 0, 1)
    held = frame >= 12
    sample_pose = np.zeros((len(at), 7))
    sample_pose[:, :3] = block - np.array([0.0375 - 0.009, 0, 0])
    sample_pose[:, 0] -= 0.06 * (1 - approach)
    sample_pose[:, 3] = 1
    pulling = held & (frame > 20) & (frame < 70)
    shake = rng.normal(0, 0.3, (len(at), 3)) * held[:, None]
    left = np.stack([2.0 * pulling, 8.0 * held, 0.2 * held], axis=1) + shake
    right = np.stack([2.0 * pulling, -8.0 * held, 0.2 * held], axis=1) + shake[::-1]
    return GripperTrack(at, sample_pose, np.where(held, 0.025, 0.034), left, right)


def _no_track() -> GripperTrack:
    none = np.zeros((0, 3))
    return GripperTrack(np.zeros(0, np.int64), np.zeros((0, 7)), np.zeros(0), none, none)


def make_prediction(episode: Episode, name: str, kind: str, frames: np.ndarray, scale: float, seed: int) -> Prediction:
    """The truth plus an error that grows along an open loop, and a selector's probabilities for legal targets."""
    rng = np.random.default_rng(seed)
    growth = np.arange(1, len(frames) + 1) if kind == "open_loop" else np.ones(len(frames))
    pose = episode.pose[frames].copy()
    pose[..., :3] += scale * growth[:, None, None] * rng.normal(0, 1, (1, BLOCK_COUNT, 3))
    pose[:, TARGET, 0] += 3 * scale * growth
    probability = np.full(BLOCK_COUNT, np.nan)
    legal = episode.header.layout.legal_targets()
    probability[legal] = rng.beta(0.7, 1.2, len(legal))
    return Prediction(name, "sha256:" + name, kind, frames, pose, probability)


def random_quaternions(rng: np.random.Generator, count: int) -> Float[np.ndarray, "count 4"]:
    quaternions = rng.normal(size=(count, 4))
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
