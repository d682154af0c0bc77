import numpy as np
import pytest
from made_up_dataset import selection_dataset, untrained

from jenga_control.selection import rank
from jenga_data.blocks import sample_blocks
from jenga_data.errors import JengaError
from jenga_data.tower import Layout, TowerState
from jenga_models.config import SelectionTraining
from jenga_models.predict import Selector


def tower(blocks=12):
    rng = np.random.default_rng(0)
    pose = np.zeros((blocks, 7))
    pose[:, :3], pose[:, 3] = rng.normal(size=(blocks, 3)), 1
    return TowerState(
        sample_blocks("nominal", rng, blocks), Layout.fresh(np.arange(blocks)), pose, np.zeros((blocks, 6))
    )


class Says:
    def __init__(self, probability):
        self.probability = probability

    def failure_probability(self, state, targets):
        return np.array([self.probability[t] for t in targets], float)


def test_ranks_all_legal_targets_and_no_others_the_safest_first():
    state = tower()
    ranked = rank(state, Says({b: ((5 * b) % 9) / 10 for b in range(12)}))
    assert sorted(b for b, _ in ranked) == state.layout.legal_targets()
    probabilities = [p for _, p in ranked]
    assert probabilities == sorted(probabilities)
    assert all(p == ((5 * b) % 9) / 10 for b, p in ranked)


def test_equally_safe_targets_come_in_the_order_of_their_numbers():
    state = tower()
    assert [b for b, _ in rank(state, Says(dict.fromkeys(range(12), 0.5)))] == state.layout.legal_targets()


def test_a_checkpoint_ranks(tmp_path):
    model = Selector(untrained(tmp_path / "gcn", SelectionTraining(), selection_dataset()))
    ranked = rank(tower(), model)
    assert len(ranked) == 9
    assert all(0 <= p <= 1 for _, p in ranked)


def test_refuses_a_tower_without_legal_targets():
    with pytest.raises(JengaError, match="1 levels in round 1 has no legal target"):
        rank(tower(3), Says({}))


def test_refuses_probabilities_that_are_none():
    with pytest.raises(JengaError, match="not all between 0 and 1"):
        rank(tower(), Says(dict.fromkeys(range(12), float("nan"))))
