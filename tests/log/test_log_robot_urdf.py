"""The URDF of a robot: each link once, every solid in its place."""

from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from three_link_robot import MODEL

from jenga_data.episode import Link, RobotModel, Solid
from jenga_data.log.urdf import robot_urdf


def test_the_urdf_has_each_link_once_and_every_solid():
    robot = ElementTree.fromstring(robot_urdf(MODEL))
    names = ["robot/base", "robot/arm", "robot/tool 1"]
    assert [link.get("name") for link in robot.findall("link")] == ["world", *names]
    assert [child.get("link") for child in robot.findall("joint/child")] == names
    assert {joint.get("type") for joint in robot.findall("joint")} == {"floating"}
    shapes = {name: [g[0].tag for g in robot.findall(f"link[@name='{name}']/visual/geometry")] for name in names}
    assert shapes == {
        "robot/base": ["box", "cylinder"],
        "robot/arm": ["cylinder", "sphere", "sphere"],
        "robot/tool 1": ["sphere", "box"],
    }
    visuals = [visual.get("name") for visual in robot.iter("visual")]
    assert len(set(visuals)) == len(visuals)


def test_a_capsule_s_spheres_sit_on_the_ends_of_its_cylinder():
    robot = ElementTree.fromstring(robot_urdf(MODEL))
    origins = [o.attrib for o in robot.findall("link[@name='robot/arm']/visual/origin")]
    middle, low, high = (np.array([float(v) for v in origin["xyz"].split()]) for origin in origins)
    np.testing.assert_allclose(sorted([low[0], high[0]]), [0.0, 0.16], atol=1e-12)
    np.testing.assert_allclose((low + high) / 2, middle, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_the_urdf_turns_solids_as_their_quaternions_do(seed):
    """Against scipy; the last two are upright, where roll and yaw turn about one axis."""
    turn = Rotation.random(rng=seed) if seed < 4 else Rotation.from_euler("zy", [0.7, (-1) ** seed * np.pi / 2])
    x, y, z, w = turn.as_quat().tolist()
    solid = Solid("box", (0.1, 0.2, 0.3), (0.0, 0.0, 0.0, w, x, y, z), (1.0, 1.0, 1.0, 1.0))
    (origin,) = ElementTree.fromstring(robot_urdf(RobotModel((), (Link("a", (solid,)),)))).iter("origin")
    found = Rotation.from_euler("xyz", [float(v) for v in origin.attrib["rpy"].split()])
    np.testing.assert_allclose(found.as_matrix(), turn.as_matrix(), atol=1e-7)
