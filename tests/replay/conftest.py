"""One made-up episode and a model's predictions over it, made once for all tests of the room."""

import numpy as np
import pytest
from made_up_episode import make_episode, make_prediction

from jenga_data.episode import Episode, Prediction


@pytest.fixture(scope="session")
def episode() -> Episode:
    return make_episode()


@pytest.fixture(scope="session")
def predictions(episode: Episode) -> list[Prediction]:
    one_step = make_prediction(episode, "gns", "one_step", np.arange(1, 100), 2e-4, 1)
    open_loop = make_prediction(episode, "gns", "open_loop", np.arange(21, 72), 4e-5, 2)
    return [one_step, open_loop]
