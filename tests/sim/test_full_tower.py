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
    assert collect(CONFIG, seed=3, numbers=range(1), workers=1, out=out).episodes == 1
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


def test_the_edges_of_a_settled_tower_bear_it_at_every_level(episode):
    """Blocks of a level may lean on each other, but what stands above a level comes down through its edges."""
    header = episode.header
    level = header.layout.level
    edges = set(map(tuple, np.sort(support_edges(episode.pose[0], header.blocks.size).T).tolist()))
    contacts = episode.contacts[0]
    first, second = contacts.first, contacts.second
    on_edge = np.array([tuple(sorted(pair)) in edges for pair in zip(first.tolist(), second.tolist(), strict=True)])
    upwards = contacts.force[:, 2] * np.where(level[first] > level[second], 1, -1)
    upper = np.maximum(level[first], level[second])
    for above in range(1, len(header.layout.grid)):
        weight = header.blocks.mass[level >= above].sum() * GRAVITY
        assert upwards[on_edge & (upper == above)].sum() == pytest.approx(weight, rel=0.05)
