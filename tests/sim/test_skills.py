# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

"""What can go wrong in a skill, made to go wrong: each failure by its name."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from robot_stage import CONFIG, RobotKept, Workplace, put, workplace
from short_tower import short_towers

from jenga_data.collect.careful_push import CarefulSkills
from jenga_data.collect.causes import CAUSES, Failure
from jenga_data.collect.extraction import Pull
from jenga_data.collect.robot_extraction import run_with_robot
from jenga_data.collect.skills import Skills
from jenga_data.collect.stage import set_stage
from jenga_data.errors import UnreachableError
from jenga_data.sim.robot import STICK_PLACE, STICK_REACH

pytestmark = pytest.mark.usefixtures("unchecked_shapes")  # which takes a quarter of the time


class Disturbed(Skills):
    """Skills during which something happens at once when blocks may be touched, or when they look for the end."""

    on_touch: Callable[[], None] | None = None
    on_look: Callable[[], None] | None = None

    def touch(self, *blocks: int) -> None:
        super().touch(*blocks)
        if self.on_touch:
            self.on_touch()

    def sticks_out(self) -> float:
        out = super().sticks_out()
        if self.on_look:
            self.on_look()
        return out


class Still:
    """A policy that does nothing, or always the same."""

    def __init__(self, *action: float) -> None:
        self.action = np.array(action or (0.0, 0.0, 0.0))

    def act(self, state, target):
        return self.action


def failure_of(skill: Callable[..., object], *args: object) -> str:
    with pytest.raises(Failure) as failed:
        skill(*args)
    cause = failed.value.cause
    assert str(failed.value) == f"{cause}: {CAUSES[cause]}"
    return cause


def with_stick(config=CONFIG, **options) -> Workplace:
    place = workplace(config, make_skills=Disturbed, **options)
    place.skills.take_stick()
    return place


def ready_to_grasp(out: float = 0.02, **options) -> Workplace:
    """A target that sticks out at -x, as after a push and half a turn."""
    place = workplace(make_skills=Disturbed, **options)
    target = place.recording.target
    put(place.world, f"block_{target}", place.world.pose[target, :3] - [out, 0, 0])
    place.world.allow_sleep(False)
    place.skills.hold(3)
    return place


def slippery(place: Workplace, friction: float) -> None:
    for side in ("left", "right"):
        place.world.model.geom(f"{side}_pad").friction[0] = friction


# --- the stick -----------------------------------------------------------------------------------------------------


def test_a_stick_that_is_not_there_is_missed():
    place = workplace()
    put(place.world, "stick", STICK_PLACE - np.array([0.0, 0.2, 0.0]))
    assert failure_of(place.skills.take_stick) == "stick_missed"


def test_a_stick_is_held_by_friction_and_without_it_stays_where_it_is():
    place = workplace()
    slippery(place, 1e-3)
    assert failure_of(place.skills.take_stick) == "stick_missed"
    np.testing.assert_allclose(place.robot.stick, STICK_PLACE, atol=0.01)


# --- the push ------------------------------------------------------------------------------------------------------


def test_a_push_that_becomes_too_hard_stops_and_the_target_cannot_be_grasped():
    place = with_stick(replace(CONFIG, robot=replace(CONFIG.robot, push_force=0.05)))
    before = place.recording.poses[-1]
    place.skills.push()
    assert place.skills.cause == "push_stuck"
    assert np.linalg.norm(place.recording.poses[-1][:, :3] - before[:, :3], axis=1).max() < 0.005
    assert failure_of(place.skills.grasp) == "push_stuck"


def test_a_push_that_takes_another_block_along_has_dragged_it():
    place = with_stick(replace(CONFIG, robot=replace(CONFIG.robot, push_force=20.0)))
    world, target = place.world, place.recording.target
    above = int(world.layout.grid[3, 1])
    for block in (target, above):  # two that stick together
        world.model.geom(f"block_{block}").friction[0] = 5.0
    for block in world.layout.grid[3]:
        world.data.xfrc_applied[world.model.body(f"block_{block}").id, 2] = -0.5
    place.skills.push()
    assert place.skills.cause == "push_dragged_layer"


def test_a_tower_that_falls_while_it_is_pushed_ends_the_push():
    place = with_stick()
    place.skills.on_touch = lambda: put(place.world, f"block_{place.world.layout.grid[3, 0]}", (0.0, 0.3, 0.1))
    assert failure_of(place.skills.push) == "push_toppled"


# --- the way -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("touchable", "cause"), [(False, "bumped"), (True, "grasp_two_blocks")])
def test_a_hand_that_runs_into_the_tower_is_noticed(touchable, cause):
    place = workplace()
    if touchable:
        place.skills.may_touch = frozenset({place.recording.target})
    # With the fingers' height between two levels, off the middle.
    into = place.skills.straight(np.array([-0.15, 0.02, 0.03]), np.array([-0.02, 0.02, 0.03]), speed=0.4)
    assert failure_of(place.skills.follow, into) == cause
    assert place.robot.arm.position[0] < -0.02


def test_a_tower_that_is_touched_while_it_turns_was_bumped_and_its_frame_is_whole():
    place = workplace()
    into = place.skills.straight(np.array([-0.15, 0.0, 0.03]), np.array([-0.02, 0.0, 0.03]), speed=0.4)
    assert failure_of(place.skills.turn, np.pi, into) == "bumped"
    assert place.recording.time_ns() == place.recording.frame * 32_000_000 == place.log.frames[-1].time_ns


def test_a_turn_ends_where_the_tower_wakes_whatever_woke_it():
    place = workplace()
    turning = place.robot.turntable.turn

    def woken(angle: float, seconds: float):
        for k, step in enumerate(turning(angle, seconds)):
            if k == 40:
                place.world.data.xfrc_applied[place.world.model.body("block_5").id, 2] = 0.1
            yield step

    place.robot.turntable.turn = woken
    assert failure_of(place.skills.turn, np.pi) == "bumped"
    assert place.recording.time_ns() == place.recording.frame * 32_000_000 == 3 * 32_000_000


@pytest.mark.parametrize(("skills", "seconds"), [(Skills, 3.0), (CarefulSkills, 10.0)])
def test_a_tower_that_does_not_come_to_rest_is_not_turned(skills, seconds):
    place = workplace(make_skills=skills)
    place.world.model.opt.sleep_tolerance = 0.0
    place.world.allow_sleep(False)
    place.world.step()
    frames = place.recording.frame
    assert failure_of(place.skills.turn, np.pi) == "unsettled"
    assert place.recording.frame - frames == pytest.approx(seconds / 0.032, abs=2)
    assert place.world.table_angle == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(
    "posture",
    [{4: -3.05}, dict(enumerate((-0.23, 0.03, 1.68, -2.79, 0.46, 0.73, 1.79), start=1))],
    ids=["the wrist in the foot", "the palm at the upper arm"],
)
def test_an_arm_that_touches_itself_is_noticed(posture):
    place = workplace()
    assert not place.robot.collides()
    for number, angle in posture.items():
        place.world.data.joint(f"joint_{number}").qpos[0] = angle
    mujoco.mj_forward(place.world.model, place.world.data)
    assert place.robot.collides()


def test_a_hand_that_goes_down_to_the_table_collides():
    place = workplace()
    down = place.skills.straight(place.robot.arm.set_point - [0, 0, 0.12], speed=0.4)
    assert failure_of(place.skills.follow, down) == "self_collision"
    wrist = 0.042  # the radius of its link, whose axis is the hand's
    assert place.robot.arm.position[2] == pytest.approx(-0.08 + wrist, abs=0.01)


def test_a_way_out_of_reach_is_refused_before_anything_moves():
    place = workplace()
    before, drives = place.world.integration_state(), place.world.data.ctrl.copy()
    set_point = place.robot.arm.set_point
    with pytest.raises(UnreachableError):
        place.skills.straight(np.array([-1.0, 0.0, 0.1]), speed=0.4)
    with pytest.raises(UnreachableError):
        place.robot.arm.begin(np.array([0.5, 0.0, 0.0]))
    np.testing.assert_array_equal(place.world.integration_state(), before)
    np.testing.assert_array_equal(place.world.data.ctrl, drives)
    np.testing.assert_array_equal(place.robot.arm.set_point, set_point)
    place.skills.hold(2)
    np.testing.assert_allclose(place.robot.arm.position, set_point, atol=1e-4)


# --- the grasp -----------------------------------------------------------------------------------------------------


def test_a_block_that_sticks_out_is_grasped_alone():
    place = ready_to_grasp()
    place.skills.grasp()
    assert place.skills.holds()
    assert [phase.name for phase in place.log.phases] == ["approach", "grasp"]
    assert place.skills.sticks_out() == pytest.approx(0.02, abs=0.002)


@pytest.mark.parametrize("out", [0.012, 0.02])
def test_the_fingertips_stay_clear_of_the_tower_behind_the_end_they_grasp(out):
    place = ready_to_grasp(out)
    face = (
        place.skills.sticks_out()
        + place.world.pose[place.recording.target, 0]
        - place.world.blocks.size[place.recording.target, 0] / 2
    )
    place.skills.grasp()
    front = place.robot.arm.position[0] + CONFIG.gripper.pad[0] / 2
    assert 0.0015 < face - front < out / 2
    assert place.skills.holds()


def test_a_target_that_tipped_out_of_its_level_sticks_out_of_nothing_and_is_no_error():
    place = ready_to_grasp()
    put(place.world, f"block_{place.recording.target}", (-0.3, 0.3, 0.5))
    place.skills.hold()
    assert place.skills.sticks_out() == pytest.approx(CONFIG.robot.push_distance)


def test_a_target_that_is_gone_is_missed():
    place = ready_to_grasp()
    place.skills.on_touch = lambda: put(place.world, f"block_{place.recording.target}", (0.3, 0.3, 0.1))
    assert failure_of(place.skills.grasp) == "grasp_missed"


def test_a_neighbour_that_sticks_out_too_is_taken_along():
    place = ready_to_grasp()
    neighbour = int(place.world.layout.grid[2, 0])
    beside = place.world.pose[neighbour, :3] - [0.02, 0, 0]
    place.skills.on_look = lambda: put(place.world, f"block_{neighbour}", beside)
    assert failure_of(place.skills.grasp) == "grasp_two_blocks"


def test_a_tower_that_falls_while_the_hand_is_at_it_is_told():
    place = ready_to_grasp()
    place.skills.on_touch = lambda: put(place.world, f"block_{place.world.layout.grid[3, 0]}", (0.0, 0.3, 0.1))
    assert failure_of(place.skills.grasp) == "approach_toppled"


# --- the pull and after --------------------------------------------------------------------------------------------


def pulled(place: Workplace, *action: float) -> str:
    pull = Pull(Still(*action), all_actions=True)
    return pull.run(place.recording, place.robot.arm, place.skills.substep, CONFIG.physics.steps_a_frame)


def test_a_pull_that_does_nothing_runs_out_of_time():
    place = ready_to_grasp()
    place.skills.grasp()
    assert pulled(place) == "out_of_time"
    assert len(place.log.actions) == 51


def test_a_block_that_stays_behind_has_slipped():
    place = ready_to_grasp()
    place.skills.grasp()
    slippery(place, 0.001)
    assert pulled(place, -0.003, 0.0, 0.0) == "slipped"


def test_a_hand_at_the_end_of_its_reach_stops():
    place = ready_to_grasp()
    place.skills.grasp()
    place.skills.draw_back()
    assert pulled(place, -0.02, 0.0, 0.0) == "out_of_reach"
    assert 10 < len(place.log.actions) < 51


def test_a_block_that_falls_on_its_way_to_the_tray_was_dropped():
    place = ready_to_grasp(level=0)
    place.skills.grasp()
    assert pulled(place, -0.004, 0.0, 0.0) == ""
    slippery(place, 0.001)
    assert failure_of(place.skills.put_down) == "dropped"


def test_the_first_cause_that_was_noted_is_the_episodes():
    skills = workplace().skills
    for cause in ("", "push_stuck", "", "dropped"):
        skills.note(cause)
    assert skills.cause == "push_stuck"


class OutOfReach(Skills):
    """Skills that would lead the hand out of its reach."""

    def take_stick(self) -> None:
        self.straight(np.array([-1.0, 0.0, 0.1]), speed=0.4)


def test_a_skill_that_leads_out_of_reach_ends_the_episode_by_name():
    with short_towers():
        stage = set_stage(CONFIG, 0, 1)
    log, pull = RobotKept(), Pull(Still(), True)
    result = run_with_robot(CONFIG, 0, 1, stage, lambda *_: log, pull, make_skills=OutOfReach)
    assert result.cause == "out_of_reach"
    assert [phase.name for phase in log.phases] == ["turn", "take_stick", "observe"]


def test_the_stick_reaches_as_far_as_the_fingers_take_it():
    place = with_stick()
    tip = place.robot.stick[0] + 0.07
    assert tip - place.robot.arm.position[0] == pytest.approx(STICK_REACH, abs=5e-4)
