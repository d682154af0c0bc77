# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

"""The arm against its maker's figures, written down here a second time."""

import mujoco
import numpy as np
import pytest

from jenga_data.sim.panda import FLANGE, JOINTS, add_arm, limits

DH = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
)
"""a [m], d [m], alpha [rad] of each joint; then 0.107 m to the flange."""
LIMITS = {
    "lower": (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    "upper": (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    "speed": (2.1750, 2.1750, 2.1750, 2.1750, 2.6100, 2.6100, 2.6100),
    "acceleration": (15, 7.5, 10, 12.5, 15, 20, 20),
    "torque": (87, 87, 87, 87, 12, 12, 12),
}
MASSES = (4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522)
BASE, YAW = np.array([-0.35, -0.5, -0.08]), 0.7


def modified_dh(a: float, d: float, alpha: float, theta: float) -> np.ndarray:
    """From a joint's frame to the one before it (Craig 2005, eq. 3.6)."""
    ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array([[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]])


def forward(joint: np.ndarray) -> np.ndarray:
    """From the flange's frame to that of the foot."""
    out = np.eye(4)
    for (a, d, alpha), theta in zip(DH, joint, strict=True):
        out = out @ modified_dh(a, d, alpha, theta)
    out[:3, 3] += 0.107 * out[:3, 2]
    return out


def compiled(base: np.ndarray = BASE, yaw: float = YAW) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The arm alone."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    add_arm(spec, base, yaw, {})
    model = spec.compile()
    return model, mujoco.MjData(model)


def random_joints(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(LIMITS["lower"], LIMITS["upper"], (count, JOINTS))


# --- geometry ------------------------------------------------------------------------------------------------------


def test_the_flange_is_where_the_makers_parameters_have_it():
    model, data = compiled()
    turn = np.array([[np.cos(YAW), -np.sin(YAW), 0], [np.sin(YAW), np.cos(YAW), 0], [0, 0, 1]])
    for joint in random_joints(50):
        data.qpos[:] = joint
        mujoco.mj_kinematics(model, data)
        flange, expected = data.body("flange"), forward(joint)
        np.testing.assert_allclose(flange.xpos, BASE + turn @ expected[:3, 3], atol=1e-9)
        np.testing.assert_allclose(flange.xmat.reshape(3, 3), turn @ expected[:3, :3], atol=1e-9)
    assert FLANGE == 0.107


def test_in_its_ready_posture_the_flange_is_where_the_makers_arm_shows_it():
    """0.307 m before the foot and 0.590 m over it, pointing down, as its own software says."""
    joint = np.array([0, -np.pi / 4, 0, -3 * np.pi / 4, 0, np.pi / 2, np.pi / 4])
    model, data = compiled(np.zeros(3), 0.0)
    data.qpos[:] = joint
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.body("flange").xpos, [0.307, 0, 0.590], atol=5e-4)
    np.testing.assert_allclose(data.body("flange").xmat.reshape(3, 3)[:, 2], [0, 0, -1], atol=1e-9)


# --- figures -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LIMITS)
def test_limits_are_the_makers(name):
    np.testing.assert_array_equal(limits(name), LIMITS[name])


def test_the_model_keeps_angles_and_torques_within_the_limits():
    model, _ = compiled()
    for i in range(JOINTS):
        joint, drive = model.joint(f"joint_{i + 1}"), model.actuator(f"joint_{i + 1}")
        np.testing.assert_array_equal(joint.range, [LIMITS["lower"][i], LIMITS["upper"][i]])
        assert joint.limited[0] == drive.forcelimited[0] == 1
        np.testing.assert_array_equal(drive.forcerange, [-LIMITS["torque"][i], LIMITS["torque"][i]])


def test_links_weigh_and_turn_as_they_were_identified_and_shapes_add_nothing():
    model, data = compiled()
    for i, mass in enumerate(MASSES):
        assert model.body(f"link_{i + 1}").mass[0] == mass
    assert model.body("flange").mass[0] == 0
    # The trace is the sum of the principal moments, whatever the axes.
    assert model.body("link_1").inertia.sum() == pytest.approx(0.70337 + 0.70661 + 0.009117)
    assert model.body("link_7").inertia.sum() == pytest.approx(0.012516 + 0.010027 + 0.004815)
    np.testing.assert_array_equal(model.body("link_4").ipos, [-0.05317, 0.104419, 0.027454])
    mujoco.mj_forward(model, data)


def test_gravity_does_not_move_the_arm():
    """Without a drive, at any posture; with no compensation it falls."""
    model, data = compiled()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    for joint in random_joints(5) * 0.9 + 0.1 * (np.array(LIMITS["lower"]) + LIMITS["upper"]) / 2:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = joint
        mujoco.mj_step(model, data, nstep=100)
        np.testing.assert_allclose(data.qpos, joint, atol=1e-9)
    model.body_gravcomp[:] = 0
    held = data.qpos.copy()
    mujoco.mj_step(model, data, nstep=100)
    assert np.abs(data.qpos - held).max() > 1e-3
