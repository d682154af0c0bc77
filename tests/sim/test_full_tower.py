"""One episode on all 18 levels, by the verb's own function: what short towers cannot show."""

from pathlib import Path

import numpy as np
import pytest

from jenga_data.agreement import edge_agreement
from jenga_data.blocks import GRAVITY
from jenga_data.collect.config import SelectionConfig, SpawnConfig
from jenga_data.collect.workers import collect
from jenga_data.episode import Episode
from jenga_data.graph import support_edges
from jenga_data.log.reader import read_episode

CONFIG = SelectionConfig(pull_seconds=0.064, spawn=SpawnConfig(last_round=2, stand=0.32))


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    out: Path = tmp_path_factory.mktemp("full") / "out"
    assert collect(CONFIG, seed=3, episodes=1, workers=1, out=out).episodes == 1
    return read_episode(next(out.glob("*.mcap")))


def test_a_tower_has_54_measured_blocks_on_18_levels(episode):
    header = episode.header
    assert len(header.blocks) == 54
    assert header.round in (1, 2)
    assert len(header.layout.grid) == 18 + header.layout.moves
    assert np.ptp(header.blocks.size, axis=0).min() > 0.0004


def test_the_edges_of_a_settled_tower_are_the_simulators_contacts(episode):
    """Nearly all contacts are edges; edges without a contact are blocks that hang loose by some tenths of a mm."""
    found = edge_agreement([episode])
    assert found.both > 80
    assert found.recall >= 0.99
    assert 0.5 < found.precision < 1
    assert found.both + found.edge_only == support_edges(episode.pose[0], episode.header.blocks.size).shape[1]


def test_what_touches_beside_the_edges_lifts_next_to_nothing(episode):
    """Blocks of a level lean on each other; the tower stands on the edges."""
    edges = set(map(tuple, support_edges(episode.pose[0], episode.header.blocks.size).T.tolist()))
    contacts = episode.contacts[0]
    between = contacts.second >= 0
    pairs = zip(contacts.first[between], contacts.second[between], contacts.force[between, 2], strict=True)
    beside = [abs(up) for a, b, up in pairs if (a, b) not in edges and (b, a) not in edges]
    assert len(beside) > 0
    assert sum(beside) < 0.05 * episode.header.blocks.mass.sum() * GRAVITY
