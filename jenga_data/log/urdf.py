"""URDF texts that let a viewer draw an episode without a plugin: one floating joint and one box a body.

The joints only hang the bodies on the world; where they are comes from the transforms of /tf.
"""

import colorsys
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from jenga_data import palette

WORLD = "world"
HAND, LEFT_FINGER, RIGHT_FINGER = "hand", "left_finger", "right_finger"

Color = tuple[float, float, float, float]

_TARGET: Color = (*palette.TARGET, 1.0)
_TABLE: Color = (*palette.TABLE, 1.0)
_STEEL: Color = (*palette.STEEL, 1.0)
_RUBBER: Color = (*palette.RUBBER, 1.0)
_GHOST: Color = (*palette.PURPLE, 0.35)
_GHOST_TARGET: Color = (*palette.SKY_BLUE, 0.45)

TABLE_SIZE = (0.44, 0.44, 0.02)
TABLE_CENTRE = (0.0, 0.0, -0.02)
TURNTABLE_RADIUS, TURNTABLE_HEIGHT = 0.12, 0.01
HAND_SIZE = (0.06, 0.10, 0.04)
HAND_CENTRE = (-0.075, 0.0, 0.0)
FINGER_SIZE = (0.061, 0.008, 0.011)
FINGER_CENTRE = (-0.0225, 0.0, 0.0)
"""A schematic hand and fingers [m], as seen from the point between the fingertips: x away from the hand."""


def block_link(block: int) -> str:
    """Name of a block's link and transform frame, as in the scene's MJCF."""
    return f"block_{block}"


def wood(block: int) -> Color:
    """A natural wood tone, different for every block, so that neighbours can be told apart."""
    spread = (block * 0.6180339887) % 1.0
    red, green, blue = colorsys.hls_to_rgb(0.075 + 0.035 * ((block * 0.7548776662) % 1.0), 0.52 + 0.26 * spread, 0.48)
    return (round(red, 3), round(green, 3), round(blue, 3), 1.0)


def tower_urdf(size: Float[np.ndarray, "block 3"], target: int) -> str:
    """Table, turntable and one box a block; the target stands out."""
    robot = _robot("jenga")
    world = ElementTree.SubElement(robot, "link", name=WORLD)
    _box(world, TABLE_SIZE, TABLE_CENTRE, "table", _TABLE)
    _cylinder(world, TURNTABLE_RADIUS, TURNTABLE_HEIGHT, "turntable", _STEEL)
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
    robot: ElementTree.Element,
    parent: str,
    link: str,
    size: tuple[float, ...],
    centre: tuple[float, float, float],
    color: Color,
) -> None:
    _box(ElementTree.SubElement(robot, "link", name=link), size, centre, link, color)
    joint = ElementTree.SubElement(robot, "joint", name=f"{link}_joint", type="floating")
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=link)


def _box(
    link: ElementTree.Element,
    size: tuple[float, ...],
    centre: tuple[float, float, float],
    name: str,
    color: Color,
) -> None:
    geometry = _visual(link, centre, name, color)
    ElementTree.SubElement(geometry, "box", size=_numbers(size))


def _cylinder(link: ElementTree.Element, radius: float, height: float, name: str, color: Color) -> None:
    geometry = _visual(link, (0.0, 0.0, -height / 2), name, color)
    ElementTree.SubElement(geometry, "cylinder", radius=repr(radius), length=repr(height))


def _visual(
    link: ElementTree.Element, centre: tuple[float, float, float], name: str, color: Color
) -> ElementTree.Element:
    visual = ElementTree.SubElement(link, "visual", name=name)
    ElementTree.SubElement(visual, "origin", xyz=_numbers(centre), rpy="0 0 0")
    geometry = ElementTree.SubElement(visual, "geometry")
    material = ElementTree.SubElement(visual, "material", name=f"{name}_color")
    ElementTree.SubElement(material, "color", rgba=_numbers(color))
    return geometry


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)
