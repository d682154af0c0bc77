"""Worlds that note what their steps cost in CPU time."""

from dataclasses import dataclass
from time import thread_time_ns

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from jenga_data.blocks import Blocks
from jenga_data.sim.world import World
from jenga_data.tower import Layout


@dataclass(frozen=True, eq=False)
class Steps:
    """Physics steps, one row each."""

    seconds: Float[np.ndarray, " step"]
    """CPU time."""
    iterations: Int[np.ndarray, " step"]
    """Of the constraint solver, summed over islands."""
    asleep: Bool[np.ndarray, " step"]
    """Whether nothing was awake after it."""
    force: Float[np.ndarray, "step block 6"]
    """What was exerted on each block from outside, in the order of the bodies [N, N m]."""

    def part(self, part: slice) -> "Steps":
        return Steps(self.seconds[part], self.iterations[part], self.asleep[part], self.force[part])


class TracedWorld(World):
    """A world that notes what each of its steps costs."""

    def __init__(self, spec: mujoco.MjSpec, blocks: Blocks, layout: Layout) -> None:
        super().__init__(spec, blocks, layout)
        self._bodies = [self.model.body(f"block_{i}").id for i in range(len(blocks))]
        self._rows: list[tuple[float, int, bool, np.ndarray]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            force = self.data.xfrc_applied[self._bodies]
            began = thread_time_ns()
            super().step()
            seconds = (thread_time_ns() - began) * 1e-9
            islands = max(1, min(self.data.nisland, len(self.data.solver_niter)))
            self._rows.append((seconds, int(self.data.solver_niter[:islands].sum()), self.asleep, force))

    def steps(self) -> Steps:
        seconds, iterations, asleep, force = zip(*self._rows, strict=True)
        return Steps(np.array(seconds), np.array(iterations), np.array(asleep), np.array(force))


class Twin:
    """A second state of a world's model, moved by MuJoCo alone."""

    def __init__(self, world: World) -> None:
        self._model = world.model
        self._data = mujoco.MjData(world.model)
        mujoco.mj_forward(self._model, self._data)

    def step(self, block: int, force: Float[np.ndarray, "6"]) -> float:
        """One bare `mj_step` with a force and torque on a block [N, N m]: its CPU time [s]."""
        self._data.xfrc_applied[self._model.body(f"block_{block}").id] = force
        began = thread_time_ns()
        mujoco.mj_step(self._model, self._data)
        return (thread_time_ns() - began) * 1e-9

    def is_where(self, world: World) -> bool:
        """Whether the world is in the same state, bit for bit."""
        return np.array_equal(self._data.qpos, world.data.qpos) and np.array_equal(self._data.qvel, world.data.qvel)
