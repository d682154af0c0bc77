# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

"""The simulator itself as the model of the controller: the paper's comparison, and the upper bound of any model.

It predicts what will happen to the last bit, and a decision takes it seconds: 100 samples of 5 steps are 8,000 steps
of the full tower. `REDUCED` is a search that it can be asked for.
"""

from copy import copy
from functools import cached_property

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco.batch import Batch

from jenga_data.collect.extraction import View
from jenga_data.errors import JengaError, UnreachableError
from jenga_data.sim.fingers import Fingers
from jenga_data.tower import TowerState

REDUCED = {"samples": 16, "horizon": 3}
"""Samples and horizon of the search with the simulator, in place of 100 and 5."""


class Simulated:
    """Runs copies of the whole physics state, hand and arm included, under each plan.

    A tower's poses are not enough for it: it is shown the running world (`enter`) before the first `start`.
    """

    def __init__(self, threads: int = 1) -> None:
        """Args:
        threads: of MuJoCo's pool, 0 for all cores; the result is the same.
        """
        self._threads = threads
        self._view: View | None = None

    def enter(self, view: View) -> None:
        """The world that the next decisions are about."""
        if not isinstance(view.hand, Fingers):
            raise JengaError(
                "the simulator as a model needs a hand whose drives it can preview, an arm's or a gripper's"
            )
        self._view, self._hand = view, view.hand
        self.__dict__.pop("_model", None)
        self._batch: Batch | None = None

    def start(self, state: TowerState, target: int) -> None:
        if self._view is None:
            raise JengaError("the simulator as a model needs the running world; a log alone cannot give it")
        self._state = self._view.recording.world.integration_state()
        self._pose = state.pose.copy()

    @cached_property
    def _model(self) -> mujoco.MjModel:
        """As the world's, but nothing sleeps: what is asleep, and since when, is no part of a batch's state."""
        assert self._view is not None
        model = copy(self._view.recording.world.model)
        model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        return model

    def _batch_of(self, samples: int) -> Batch:
        if self._batch is None or self._batch.nsim != samples:
            self._batch = Batch(self._model, samples, self._threads)
        return self._batch

    def rollout(self, actions: Float[np.ndarray, "sample horizon 3"]) -> Float[np.ndarray, "sample horizon+1 block 7"]:
        """A plan that the arm cannot make predicts NaN.

        Raises:
            UnreachableError: it can make none of them.
        """
        view = self._view
        assert view is not None
        samples, horizon, _ = actions.shape
        world, steps = view.recording.world, view.steps
        control = np.tile(world.data.ctrl, (samples, horizon * steps, 1))
        reached = np.ones(samples, bool)
        for sample, plan in enumerate(actions):
            try:
                control[sample] = self._hand.preview(plan, steps)
            except UnreachableError:
                reached[sample] = False
        if not reached.any():
            raise UnreachableError("the arm can make none of the plans")
        batch = self._batch_of(samples)
        batch.state[:] = self._state
        spec = int(mujoco.mjtState.mjSTATE_CTRL)
        found = batch.rollout(horizon * steps, control, control_spec=spec, record=["qpos"])["qpos"]
        after = found[:, steps - 1 :: steps][..., world.block_qpos]
        poses = np.concatenate([np.broadcast_to(self._pose, (samples, 1, *self._pose.shape)), after], axis=1)
        poses[~reached] = np.nan
        return poses
