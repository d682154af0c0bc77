"""URDF texts that let a viewer draw an episode without a plugin: one floating joint a body.

The joints only hang the bodies on the world; where they are comes from the transforms of /tf.
"""

import colorsys
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from jenga_data import palette
from jenga_data.episode import RobotModel, Solid
from jenga_data.geometry import rotation_matrices
from jenga_data.scenery import (
    COLUMN_HEIGHT,
    COLUMN_RADIUS,
    TABLE_CENTRE,
    TABLE_SIZE,
    TURNTABLE_HEIGHT,
    TURNTABLE_RADIUS,
)

WORLD = "world"
HAND, LEFT_FINGER, RIGHT_FINGER = "hand", "left_finger", "right_finger"

Color = tuple[float, float, float, float]
Triple = tuple[float, float, float]

_TARGET: Color = (*palette.TARGET, 1.0)
_TABLE: Color = (*palette.TABLE, 1.0)
_STEEL: Color = (*palette.STEEL, 1.0)
_RUBBER: Color = (*palette.RUBBER, 1.0)
_GHOST: Color = (*palette.PURPLE, 0.35)
_GHOST_TARGET: Color = (*palette.SKY_BLUE, 0.45)

HAND_SIZE = (0.06, 0.10, 0.04)
HAND_CENTRE = (-0.075, 0.0, 0.0)
FINGER_SIZE = (0.061, 0.008, 0.011)
FINGER_CENTRE = (-0.0225, 0.0, 0.0)
"""A schematic hand and fingers [m], as seen from the point between the fingertips: x away from the hand."""


_UPRIGHT = 1e-7
"""Where pitch is a right angle to within so much [rad], roll and yaw turn about one axis: then roll is 0."""


def block_link(block: int) -> str:
    """Name of a block's link and transform frame, as in the scene's MJCF."""
    return f"block_{block}"


def robot_link(name: str) -> str:
    """Name of the transform frame of a robot's link: no link can be taken for a block or for the world."""
    return f"robot/{name}"


def wood(block: int) -> Color:
    """A natural wood tone, different for every block, so that neighbours can be told apart."""
    spread = (block * 0.6180339887) % 1.0
    red, green, blue = colorsys.hls_to_rgb(0.075 + 0.035 * ((block * 0.7548776662) % 1.0), 0.52 + 0.26 * spread, 0.48)
    return (round(red, 3), round(green, 3), round(blue, 3), 1.0)


def tower_urdf(size: Float[np.ndarray, "block 3"], target: int) -> str:
    """Table, column, turntable and one box a block; the target stands out."""
    robot = _robot("jenga")
    world = ElementTree.SubElement(robot, "link", name=WORLD)
    _box(world, TABLE_SIZE, TABLE_CENTRE, "table", _TABLE)
    _cylinder(world, COLUMN_RADIUS, COLUMN_HEIGHT, -TURNTABLE_HEIGHT, "column", _STEEL)
    _cylinder(world, TURNTABLE_RADIUS, TURNTABLE_HEIGHT, 0.0, "turntable", _STEEL)
    for i, edges in enumerate(size.tolist()):
        _floating(robot, WORLD, block_link(i), tuple(edges), (0.0, 0.0, 0.0), _TARGET if i == target else wood(i))
    return _text(robot)


def gripper_urdf() -> str:
    """A hand and two fingers as boxes."""
    robot = _robot("jenga_gripper")
    ElementTree.SubElement(robot, "link", name=WORLD)
    _floating(robot, WORLD, HAND, HAND_SIZE, HAND_CENTRE, _STEEL)
    for finger, side in ((LEFT_FINGER, 0.5), (RIGHT_FINGER, -0.5)):
        x, _, z = FINGER_CENTRE
        _floating(robot, WORLD, finger, FINGER_SIZE, (x, side * FINGER_SIZE[1], z), _RUBBER)
    return _text(robot)


def robot_urdf(model: RobotModel) -> str:
    """The robot's links; a capsule, which URDF does not know, is a cylinder and two spheres."""
    robot = _robot("jenga_robot")
    ElementTree.SubElement(robot, "link", name=WORLD)
    for part in model.links:
        link = _hung(robot, WORLD, robot_link(part.name))
        for number, solid in enumerate(part.solids):
            _solid(link, solid, f"{robot_link(part.name)}_{number}")
    return _text(robot)


def ghost_urdf(size: Float[np.ndarray, "block 3"], target: int, prefix: str) -> str:
    """The tower as a model expects it: translucent, every link named `<prefix>block_N`."""
    robot = _robot(prefix.rstrip("/"))
    ElementTree.SubElement(robot, "link", name=WORLD)
    for i, edges in enumerate(size.tolist()):
        color = _GHOST_TARGET if i == target else _GHOST
        _floating(robot, WORLD, prefix + block_link(i), tuple(edges), (0.0, 0.0, 0.0), color)
    return _text(robot)


def _robot(name: str) -> ElementTree.Element:
    return ElementTree.Element("robot", name=name)


def _text(robot: ElementTree.Element) -> str:
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def _floating(
    robot: ElementTree.Element, parent: str, link: str, size: tuple[float, ...], centre: Triple, color: Color
) -> None:
    _box(_hung(robot, parent, link), size, centre, link, color)


def _hung(robot: ElementTree.Element, parent: str, link: str) -> ElementTree.Element:
    """A new link on a floating joint."""
    joint = ElementTree.Element("joint", name=f"{link}_joint", type="floating")
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=link)
    element = ElementTree.SubElement(robot, "link", name=link)
    robot.append(joint)
    return element


def _box(link: ElementTree.Element, size: tuple[float, ...], centre: Triple, name: str, color: Color) -> None:
    ElementTree.SubElement(_visual(link, centre, name, color), "box", size=_numbers(size))


def _cylinder(link: ElementTree.Element, radius: float, height: float, top: float, name: str, color: Color) -> None:
    geometry = _visual(link, (0.0, 0.0, top - height / 2), name, color)
    ElementTree.SubElement(geometry, "cylinder", radius=repr(radius), length=repr(height))


def _solid(link: ElementTree.Element, solid: Solid, name: str) -> None:
    turn = rotation_matrices(np.array(solid.pose[3:]))
    x, y, z = solid.pose[:3]
    geometry = _visual(link, (x, y, z), name, solid.color, _numbers(_roll_pitch_yaw(turn)))
    radius, length, _ = solid.size
    match solid.shape:
        case "box":
            ElementTree.SubElement(geometry, "box", size=_numbers(solid.size))
        case "sphere":
            ElementTree.SubElement(geometry, "sphere", radius=repr(radius))
        case "cylinder" | "capsule":
            ElementTree.SubElement(geometry, "cylinder", radius=repr(radius), length=repr(length))
        case other:
            raise ValueError(f"no solid has the shape {other!r}")
    if solid.shape == "capsule":
        for side in (-0.5, 0.5):
            cx, cy, cz = (np.array(solid.pose[:3]) + side * length * turn[:, 2]).tolist()
            cap = _visual(link, (cx, cy, cz), f"{name}_{'low' if side < 0 else 'high'}", solid.color)
            ElementTree.SubElement(cap, "sphere", radius=repr(radius))


def _roll_pitch_yaw(turn: Float[np.ndarray, "3 3"]) -> Triple:
    """Angles about the fixed x, y and z axes, in this order, that make up a rotation."""
    pitch = float(np.arctan2(-turn[2, 0], np.hypot(turn[0, 0], turn[1, 0])))
    if np.hypot(turn[0, 0], turn[1, 0]) < _UPRIGHT:
        return 0.0, pitch, float(np.arctan2(-turn[0, 1], turn[1, 1]))
    return float(np.arctan2(turn[2, 1], turn[2, 2])), pitch, float(np.arctan2(turn[1, 0], turn[0, 0]))


def _visual(
    link: ElementTree.Element, centre: Triple, name: str, color: Color, turn: str = "0 0 0"
) -> ElementTree.Element:
    visual = ElementTree.SubElement(link, "visual", name=name)
    ElementTree.SubElement(visual, "origin", xyz=_numbers(centre), rpy=turn)
    geometry = ElementTree.SubElement(visual, "geometry")
    material = ElementTree.SubElement(visual, "material", name=f"{name}_color")
    ElementTree.SubElement(material, "color", rgba=_numbers(color))
    return geometry


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)
