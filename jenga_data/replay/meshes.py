"""The look of the arm's maker over our own shapes: visual meshes of a Panda's MJCF, such as mujoco-menagerie's.

No mesh ships with this project; whoever has `franka_emika_panda/panda.xml` of
https://github.com/google-deepmind/mujoco_menagerie can see the arm with it. Its link frames are those of the
maker's Denavit-Hartenberg parameters, as ours.
"""

# MuJoCo's Python module has no type stubs.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Int

from jenga_data.errors import JengaError
from jenga_data.geometry import rotation_matrices

DOWNLOAD = "menagerie"
"""Instead of a file: fetched by `robot_descriptions`, where that is installed and its download works."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of one link in its frame [m], with a colour a vertex."""

    vertex: Float[np.ndarray, "vertex 3"]
    triangle: Int[np.ndarray, "triangle 3"]
    color: Float[np.ndarray, "vertex 4"]


def link_meshes(source: str) -> dict[str, Mesh]:
    """The visual meshes of `link0` to `link7` in an MJCF file, under our links' names.

    Args:
        source: the file, or `DOWNLOAD`.

    Raises:
        JengaError: it cannot be had or read, or has no such meshes.
    """
    path = _downloaded() if source == DOWNLOAD else Path(source)
    try:
        model = mujoco.MjSpec.from_file(str(path)).compile()
    except (ValueError, OSError) as error:
        first = str(error).splitlines()[0] if str(error) else "unknown error"
        raise JengaError(f"{path} cannot be read as MJCF: {first}") from None
    found = {f"link_{i}": mesh for i in range(8) if (mesh := _mesh_of(model, f"link{i}")) is not None}
    if not found:
        raise JengaError(f"{path} has no visual meshes of link0 to link7; give mujoco-menagerie's panda.xml")
    return found


def _downloaded() -> Path:
    try:
        from robot_descriptions import panda_mj_description  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise JengaError(
            "robot_descriptions, which fetches the meshes, is not installed; run: pip install robot_descriptions, "
            "or give a panda.xml with --meshes"
        ) from None
    except Exception as error:
        raise JengaError(
            f"robot_descriptions could not fetch the meshes ({type(error).__name__}); give a panda.xml with --meshes"
        ) from None
    return Path(panda_mj_description.MJCF_PATH)


def _mesh_of(model: mujoco.MjModel, body: str) -> Mesh | None:
    """All of a body's meshes that nothing collides with, as one."""
    number = mujoco.mj_name2id(model, int(mujoco.mjtObj.mjOBJ_BODY), body)
    if number < 0:
        return None
    vertices, triangles, colors, count = [], [], [], 0
    for geom in np.flatnonzero(model.geom_bodyid == number).tolist():
        mesh = int(model.geom_dataid[geom])
        collides = model.geom_contype[geom] or model.geom_conaffinity[geom]
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH or mesh < 0 or collides:
            continue
        first, size = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        turn = rotation_matrices(model.geom_quat[geom])
        vertices.append(model.mesh_vert[first : first + size] @ turn.T + model.geom_pos[geom])
        first, sides = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        triangles.append(model.mesh_face[first : first + sides] + count)
        material = int(model.geom_matid[geom])
        color = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        colors.append(np.tile(color, (size, 1)))
        count += size
    if not vertices:
        return None
    return Mesh(
        np.concatenate(vertices).astype(float), np.concatenate(triangles).astype(np.int64),
        np.concatenate(colors).astype(float),
    )  # fmt: skip
