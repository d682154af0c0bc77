# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

"""One whole rollout of the robot on a short tower, with a loose centre block: what it does and what it logs."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
import pytest
from robot_stage import LOOSE
from short_tower import PHYSICS, short_towers
from test_panda import LIMITS

from jenga_data.collect.draws import episode_rng
from jenga_data.collect.extraction import MAX_STEP_CHANGE, Pull, RandomPull, run_extraction
from jenga_data.collect.recording import Recording
from jenga_data.collect.robot_extraction import run_with_robot
from jenga_data.collect.skills import Skills
from jenga_data.collect.stage import Stage, set_stage
from jenga_data.episode import LEFT_FINGER, RIGHT_FINGER, TABLE, Episode, EpisodeHeader, Result
from jenga_data.geometry import in_table_frame, rotation_matrices
from jenga_data.log.reader import read_episode
from jenga_data.log.report import doctor
from jenga_data.log.writer import EpisodeWriter
from jenga_data.outcome import Outcome, judge
from jenga_data.sim.robot import STICK_PLACE, TRAY, Robot
from jenga_data.sim.world import STATE_SPEC

SEED, NUMBER = 0, 90
PHASES = ["turn", "take_stick", "push", "turn_back", "approach", "grasp", "pull", "put_down", "observe"]


class Watched(Skills):
    """Notes how exactly the hand follows, how near joints are to their limits, and what touches the stick."""

    def __init__(self, robot: Robot, recording: Recording, config) -> None:
        super().__init__(robot, recording, config)
        self.robot, self.errors, self.margins, self.carried = robot, [], [], []

    def substep(self, i, step=None) -> None:
        super().substep(i, step)
        self.errors.append((self._recording.phase_name, *self._arm.error((i + 1) / PHYSICS.steps_a_frame)))
        if i % 4 == 3:
            self.margins.append(self._robot.margins())

    def frame(self, turning=None) -> None:
        super().frame(turning)
        if self._recording.phase_name in ("push", "turn_back"):
            self.carried.append(touching(self.robot, "stick"))


def touching(robot: Robot, body: str) -> set[str]:
    """Names of the geoms that touch a body."""
    model, contact = robot.world.model, robot.world.data.contact
    own = model.geom_bodyid[contact.geom] == model.body(body).id
    return {model.geom(int(geom)).name for geom in contact.geom[own.any(1)][~own[own.any(1)]]}


@dataclass(frozen=True, eq=False)
class Rolled:
    """A rollout as it was logged, and what was seen beside the log."""

    path: Path
    stage: Stage
    result: Result
    skills: Watched

    @cached_property
    def episode(self) -> Episode:
        return read_episode(self.path)

    @cached_property
    def on_table(self) -> np.ndarray:
        """Poses of all frames in the table's frame."""
        return in_table_frame(self.episode.pose, self.episode.turntable)

    def frames(self, phase: str) -> slice:
        """From the first frame of a phase to the first of the next, both included."""
        starts = [p.frame for p in self.episode.phases] + [len(self.episode.pose) - 1]
        k = PHASES.index(phase)
        return slice(starts[k], starts[k + 1] + 1)

    def way(self, phase: str) -> np.ndarray:
        """How far each block went in a phase, in the world [m]."""
        pose = self.episode.pose[self.frames(phase)]
        return pose[-1, :, :3] - pose[0, :, :3]

    def others(self, way: np.ndarray) -> np.ndarray:
        return np.delete(np.linalg.norm(way, axis=1), self.stage.target)


def logging(folder: Path):
    def open_log(header: EpisodeHeader, scene: str) -> EpisodeWriter:
        return EpisodeWriter(folder / "episode.mcap", header, scene)

    return open_log


@pytest.fixture(scope="module")
def rolled(tmp_path_factory: pytest.TempPathFactory) -> Rolled:
    folder, watched = tmp_path_factory.mktemp("rolled"), []

    def make(*args) -> Skills:
        watched.append(Watched(*args))
        return watched[0]

    with short_towers():
        stage = set_stage(LOOSE, SEED, NUMBER)
    pull = Pull(RandomPull(LOOSE, episode_rng(SEED, NUMBER, "policy")), all_actions=True)
    result = run_with_robot(LOOSE, SEED, NUMBER, stage, logging(folder), pull, make_skills=make)
    return Rolled(folder / "episode.mcap", stage, result, watched[0])


# --- the six key frames --------------------------------------------------------------------------------------------


def test_the_skills_come_in_order_and_the_target_is_extracted(rolled):
    assert [phase.name for phase in rolled.episode.phases] == PHASES
    assert rolled.result.verdict.outcome is Outcome.EXTRACTED
    assert not rolled.result.verdict.dragged
    assert rolled.result.cause == ""
    assert rolled.episode.result == rolled.result


def test_the_target_is_an_inner_centre_block_of_a_tower_as_it_was_grown(rolled):
    place = rolled.stage.layout.place(rolled.stage.target)
    assert (place.level, place.slot) == (1, 1)
    np.testing.assert_array_equal(rolled.episode.pose[0], rolled.stage.state.pose)
    assert rolled.stage.turn == rolled.episode.header.turn == 3


def test_the_table_turns_the_target_along_x_and_then_its_end_to_the_robot(rolled):
    """The logged turn (here 270 degrees, or -90) is what both turns of the table make together."""
    angle = rolled.episode.turntable
    assert angle[0] == 0
    first, last = angle[rolled.frames("turn")][-1], angle[rolled.frames("turn_back")][-1]
    assert first == pytest.approx(np.pi / 2, abs=1e-4)
    assert last - first == pytest.approx(np.pi, abs=1e-4)
    assert last == pytest.approx(rolled.stage.turn * np.pi / 2, abs=1e-3)
    own_x = rotation_matrices(rolled.episode.pose[:, rolled.stage.target, 3:])[..., 0]
    face = 2 * rolled.stage.face - 1  # the end to be pulled looks along face * own_x
    np.testing.assert_allclose(face * own_x[rolled.frames("push")][0], [1, 0, 0], atol=0.02)
    np.testing.assert_allclose(face * own_x[rolled.frames("grasp")][0], [-1, 0, 0], atol=0.02)


def test_turns_leave_every_block_where_it_is_on_the_table(rolled):
    """The pull's forces turn the drive a little; the free turns do not move a block by a micrometre."""
    for phase in ("turn", "take_stick", "turn_back", "approach"):
        poses = rolled.on_table[rolled.frames(phase)][..., :3]
        assert np.linalg.norm(poses - poses[0], axis=-1).max() < 2e-4, phase
    turned = np.linalg.norm(rolled.way("turn_back"), axis=1)
    assert turned.max() > 0.05


def test_the_stick_pushes_the_target_alone_2_cm_out(rolled):
    way = rolled.way("push")
    assert way[rolled.stage.target, 0] == pytest.approx(0.02, abs=0.003)
    assert abs(way[rolled.stage.target, 1]) < 0.002
    assert rolled.others(way).max() < 0.005


def test_the_target_comes_out_along_minus_x_and_lies_on_the_tray(rolled):
    assert rolled.way("pull")[rolled.stage.target, 0] < -0.075 - 0.02
    end = rolled.episode.pose[-1, rolled.stage.target]
    size = rolled.episode.header.blocks.size[rolled.stage.target]
    np.testing.assert_allclose(end[:2], TRAY[:2], atol=0.02)
    assert end[2] == pytest.approx(TRAY[2] + size[2] / 2, abs=0.001)
    last = rolled.episode.contacts[-1]
    assert (last.second[last.first == rolled.stage.target] == TABLE).all()
    np.testing.assert_allclose(rolled.episode.twist[-1], 0, atol=1e-3)


def test_the_verdict_is_that_of_the_poses_in_the_tables_frame(rolled):
    """In the world half a turn would count as a tower that moved."""
    sizes, target = rolled.episode.header.blocks.size, rolled.stage.target
    assert judge(rolled.on_table, sizes, target, 0.032) == rolled.result.verdict
    assert judge(rolled.episode.pose, sizes, target, 0.032).dragged


# --- the stick and the block in the hand ---------------------------------------------------------------------------


def links(rolled: Rolled) -> list[str]:
    assert rolled.episode.header.robot is not None
    return [link.name for link in rolled.episode.header.robot.links]


def test_the_stick_is_back_in_its_holder(rolled):
    assert rolled.episode.robot is not None
    stick = rolled.episode.robot.link_pose[:, links(rolled).index("stick"), :3]
    np.testing.assert_allclose(stick[0], STICK_PLACE, atol=1e-3)
    assert np.linalg.norm(stick - stick[0], axis=1).max() > 0.15
    np.testing.assert_allclose(stick[-1], STICK_PLACE, atol=2e-3)
    np.testing.assert_allclose(stick[rolled.frames("approach")][0], STICK_PLACE, atol=2e-3)


def test_the_stick_is_carried_by_the_fingertips_alone(rolled):
    carried = rolled.skills.carried
    assert all({"left_pad", "right_pad"} <= names for names in carried[:60])
    others = {name for names in carried[:60] for name in names} - {"left_pad", "right_pad"}
    assert others == {f"block_{rolled.stage.target}"}
    assert not any("pad" in name for name in carried[-1])


def test_the_block_is_carried_by_the_fingertips_friction(rolled):
    """Between the pull and the tray nothing else touches it, and their forces bear its weight."""
    frame = rolled.frames("put_down").start + 10
    contacts = rolled.episode.contacts[frame]
    on_target = contacts.first == rolled.stage.target
    assert set(contacts.second[on_target].tolist()) == {LEFT_FINGER, RIGHT_FINGER}
    force = contacts.force[on_target]
    acceleration = (rolled.episode.twist[frame + 1] - rolled.episode.twist[frame - 1])[rolled.stage.target, :3] / 0.064
    weight = rolled.episode.header.blocks.mass[rolled.stage.target] * (acceleration + np.array([0, 0, 9.81]))
    np.testing.assert_allclose(force.sum(axis=0), weight, atol=0.03)
    assert np.abs(force[:, 1]).min() > 10


def test_nothing_but_the_gear_of_the_fingers_ties_anything(rolled):
    model = rolled.skills.robot.world.model
    assert [model.equality(k).name for k in range(model.neq)] == ["fingers"]
    assert model.nmocap == model.ntendon == 0


# --- the pull ------------------------------------------------------------------------------------------------------


def test_all_actions_are_made_and_reached(rolled):
    episode = rolled.episode
    pull = rolled.frames("pull")
    assert len(episode.action) == 51
    np.testing.assert_array_equal(episode.action_frame, pull.start + np.arange(51))
    assert (np.abs(np.diff(episode.action[:, 0], prepend=0)) <= MAX_STEP_CHANGE + 1e-15).all()
    assert (np.abs(episode.action[:, 1:]) <= LOOSE.side).all()
    # A joint's set points are cubics, and the hand comes late by what the tower's drag bends the arm.
    np.testing.assert_allclose(episode.action_reached, episode.action, atol=5e-4)
    np.testing.assert_allclose(episode.action_reached.sum(axis=0), episode.action.sum(axis=0), atol=5e-4)


def test_the_block_goes_with_the_hand(rolled):
    np.testing.assert_allclose(
        rolled.way("pull")[rolled.stage.target], rolled.episode.action_reached.sum(axis=0), atol=1e-3
    )


# --- motion --------------------------------------------------------------------------------------------------------


def test_in_the_air_the_hand_keeps_to_its_straight_lines(rolled):
    air = ("take_stick", "turn_back", "approach", "put_down")
    across, along = np.array([error[1:] for error in rolled.skills.errors if error[0] in air]).T
    assert across.max() < 0.0005
    assert along.max() < 0.005


def test_joints_keep_the_makers_limits(rolled):
    assert min(m["angle"] for m in rolled.skills.margins) > 20
    assert max(m["speed"] for m in rolled.skills.margins) < 0.9
    assert max(m["torque"] for m in rolled.skills.margins) < 0.9


def test_the_robots_state_is_logged_each_frame(rolled):
    track, episode = rolled.episode.robot, rolled.episode
    assert track is not None
    assert track.position.shape == track.velocity.shape == track.torque.shape == (len(episode.pose), 7)
    assert track.link_pose.shape == (len(episode.pose), len(links(rolled)), 7)
    assert ((track.position > LIMITS["lower"]) & (track.position < LIMITS["upper"])).all()
    assert (np.abs(track.velocity) < LIMITS["speed"]).all()
    assert (np.abs(track.torque) <= LIMITS["torque"]).all()
    slope = (track.position[2:] - track.position[:-2]) / 0.064
    assert np.abs(track.velocity[1:-1] - slope).mean() < 0.01
    hand = track.link_pose[:, links(rolled).index("hand"), :3]
    frames = episode.time_ns[1:]
    samples = episode.gripper.pose[np.searchsorted(episode.gripper.time_ns, frames), :3]
    # MuJoCo's places of bodies are those at the beginning of its last step: 0.8 mm at the hand's 0.4 m/s.
    np.testing.assert_allclose(samples, hand[1:], atol=1e-3)


# --- the log -------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unchecked_shapes")  # which takes a quarter of the time
def test_the_log_is_whole_and_the_same_bytes_when_it_is_made_again(rolled, tmp_path):
    assert doctor(rolled.path).ok
    with short_towers():
        again = run_extraction(LOOSE, SEED, NUMBER, logging(tmp_path))
    assert again == rolled.result
    assert (tmp_path / "episode.mcap").read_bytes() == rolled.path.read_bytes()


@pytest.mark.parametrize("moment", ["push", "grasp", "pull", "put_down"])
def test_a_sparse_jacobian_moves_the_scene_as_a_dense_one_does(rolled, moment):
    """MuJoCo 4.0.0 has a wrong sparse Newton Hessian in some models (google-deepmind/mujoco #3767): not in this one."""
    world, frames = rolled.skills.robot.world, rolled.frames(moment)
    state = rolled.episode.sim_state[(frames.start + frames.stop) // 2]
    velocity = []
    for jacobian in (mujoco.mjtJacobian.mjJAC_SPARSE, mujoco.mjtJacobian.mjJAC_DENSE):
        model = world.spec.compile()
        model.opt.jacobian, model.opt.tolerance = jacobian, 1e-14
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, state, STATE_SPEC)
        mujoco.mj_step(model, data, nstep=8)
        assert mujoco.mj_isSparse(model) == (jacobian == mujoco.mjtJacobian.mjJAC_SPARSE)
        velocity.append(data.qvel.copy())
    assert np.abs(velocity[0]).max() > 1e-3
    np.testing.assert_allclose(velocity[0], velocity[1], atol=1e-6)
