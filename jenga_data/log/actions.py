"""The actions of an episode without its frames, for who counts over many logs."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jenga_data.log import codec, profile
from jenga_data.log.gather import gather, refuse_damage
from jenga_data.log.header import check_kind
from jenga_data.log.index import select
from jenga_data.log.records import one_line, open_log


def read_actions(path: Path) -> tuple[Int[np.ndarray, " action"], Float[np.ndarray, "action 3"]]:
    """At which frame each action began, and the displacement [m], in the order of the frames.

    Raises:
        JengaError: as `jenga_data.log.reader.read_episode`.
    """
    with one_line(path):
        with open_log(path) as stream:
            raw = gather(select(stream, (profile.ACTION,), ()))
        check_kind(path, raw)
        refuse_damage(path, raw)
        actions = [codec.read_action(data, time) for time, data in raw.messages.get(profile.ACTION, [])]
    actions.sort(key=lambda action: action.frame)
    displacement = np.array([action.displacement for action in actions]).reshape(-1, 3)
    return np.array([action.frame for action in actions], np.int64), displacement
