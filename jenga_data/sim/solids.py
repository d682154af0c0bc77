"""What a body of the simulation looks like, for logs and viewers."""

import mujoco

from jenga_data.episode import Link, Solid

_SHAPES = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
}


def link_of(model: mujoco.MjModel, body: str) -> Link:
    """A body and its primitive geoms."""
    number = model.body(body).id
    first, count = int(model.body_geomadr[number]), int(model.body_geomnum[number])
    return Link(body, tuple(_solid(model, geom) for geom in range(first, first + count)))


def _solid(model: mujoco.MjModel, geom: int) -> Solid:
    shape = _SHAPES[int(model.geom_type[geom])]
    half = model.geom_size[geom]
    size = {
        "box": (2 * half[0], 2 * half[1], 2 * half[2]),
        "sphere": (half[0], 0.0, 0.0),
        "cylinder": (half[0], 2 * half[1], 0.0),
        "capsule": (half[0], 2 * half[1], 0.0),
    }[shape]
    pose = (*model.geom_pos[geom].tolist(), *model.geom_quat[geom].tolist())
    return Solid(shape, tuple(map(float, size)), pose, tuple(map(float, model.geom_rgba[geom])))
