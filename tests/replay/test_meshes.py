"""Meshes of the arm's maker, from an MJCF file made up here: none ships with this project."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_episode import make_episode
from rerun.chunk import RrdReader
from three_link_robot import MODEL, track

from jenga_data.episode import Link, Solid
from jenga_data.errors import JengaError
from jenga_data.replay.meshes import link_meshes
from jenga_data.replay.rerun_adapter import write_rrd

TETRAHEDRON = "0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"
PANDA = f"""
<mujoco>
  <asset>
    <mesh name="part" vertex="{TETRAHEDRON}"/>
    <material name="white" rgba="0.9 0.9 0.9 1"/>
  </asset>
  <worldbody>
    <body name="link0">
      <geom type="mesh" mesh="part" material="white" contype="0" conaffinity="0"/>
      <geom type="mesh" mesh="part" pos="0 0 1" rgba="0 0 1 1" contype="0" conaffinity="0"/>
      <geom type="mesh" mesh="part" rgba="1 0 0 1"/>
      <body name="link1"><joint/><geom size="0.1"/></body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def panda(tmp_path: Path) -> Path:
    path = tmp_path / "panda.xml"
    path.write_text(PANDA)
    return path


def test_what_is_only_to_be_seen_becomes_one_mesh_in_the_links_frame(panda: Path) -> None:
    """What collides is left out; a mesh that stands 1 m higher than the other does so here."""
    (mesh,) = link_meshes(str(panda)).values()
    corners = {tuple(v) for v in mesh.vertex.round(6) + 0.0}
    base = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1)]
    assert corners == {(x, y, round(z + up, 6)) for x, y, z in base for up in (0.0, 1.0)}
    assert len(mesh.triangle) == 8
    assert mesh.triangle.max() == len(mesh.vertex) - 1
    lower = mesh.vertex[:, 2] < 0.5
    np.testing.assert_allclose(mesh.color[lower], [[0.9, 0.9, 0.9, 1]] * 4, atol=1e-6)
    np.testing.assert_allclose(mesh.color[~lower], [[0, 0, 1, 1]] * 4, atol=1e-6)


def test_a_link_with_a_mesh_is_drawn_with_it_and_the_others_as_they_were(panda: Path, tmp_path: Path) -> None:
    episode = make_episode()
    solid = Solid("box", (0.1, 0.1, 0.1), (0, 0, 0, 1, 0, 0, 0), (1, 1, 1, 1))
    names = ("link_0", "link_1", *(link.name for link in MODEL.links[2:]))
    model = replace(MODEL, links=tuple(Link(name, (solid,)) for name in names))
    header = replace(episode.header, robot=model)
    shown = replace(episode, header=header, robot=track(len(episode.time_ns)))
    write_rrd(shown, [], tmp_path / "x.rrd", link_meshes(str(panda)))
    paths = {str(chunk.entity_path) for chunk in RrdReader(tmp_path / "x.rrd").stream()}
    assert "/world/robot/link_0/mesh" in paths
    assert "/world/robot/link_0/box" not in paths
    assert "/world/robot/link_1/box" in paths


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("<mujoco><worldbody/></mujoco>", "has no visual meshes of link0 to link7"),
        ("no xml", "cannot be read as MJCF"),
    ],
)
def test_a_file_that_has_none_is_refused_in_one_line(tmp_path: Path, content: str, says: str) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(content)
    with pytest.raises(JengaError, match=says) as error:
        link_meshes(str(path))
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JengaError, match="cannot be read as MJCF"):
        link_meshes(str(tmp_path / "none.xml"))


def test_without_the_downloader_the_way_out_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "robot_descriptions", None)
    with pytest.raises(JengaError, match="pip install robot_descriptions"):
        link_meshes("menagerie")
