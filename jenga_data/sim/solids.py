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
    x, y, z = model.geom_size[geom].tolist()
    size = (2 * x, 2 * y, 2 * z) if shape == "box" else (x, 0.0 if shape == "sphere" else 2 * y, 0.0)
    place, turn = model.geom_pos[geom].tolist(), model.geom_quat[geom].tolist()
    red, green, blue, opacity = model.geom_rgba[geom].tolist()
    return Solid(shape, size, (*place, *turn), (red, green, blue, opacity))
