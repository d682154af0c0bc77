"""Which episodes to collect: the options, and other pulls of the same towers."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from short_tower import EXTRACTION, SELECTION, short_towers

from jenga_data.collect.numbers import Which, parse_numbers
from jenga_data.collect.workers import collect
from jenga_data.dataset.convert import convert
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.same_towers import numbers_on_towers
from jenga_data.errors import JengaError
from jenga_data.log.reader import read_header

SEED = 3
QUICK = replace(SELECTION, pull_seconds=0.1)


@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 50)), min_size=1, max_size=8))
def test_numbers_and_ranges_are_read_in_any_order(ranges):
    text = ", ".join(f"{a}-{a + more}" if more else str(a) for a, more in ranges)
    assert parse_numbers(text) == sorted({n for a, more in ranges for n in range(a, a + more + 1)})


@pytest.mark.parametrize("text", ["", "a", "3-", "-3", "1,,2", "1.5", "²", "5-3", "0-1000000", "1" * 20, "1-2-3"])
def test_what_is_no_list_of_numbers_is_refused(text):
    with pytest.raises(JengaError, match=r"--numbers (is|has) .*; allowed: "):
        parse_numbers(text)


def test_one_option_says_which_episodes():
    assert list(Which(episodes=3).given() or ()) == [0, 1, 2]
    assert Which(numbers="7,2-4").given() == [2, 3, 4, 7]
    assert Which(of="x@1.0.0").given() is None
    for none in (Which(), Which(episodes=3, numbers="1"), Which(numbers="1", of="x")):
        with pytest.raises(JengaError, match=r"which episodes. allowed: one of --episodes N, --numbers"):
            none.given()
    with pytest.raises(JengaError, match="--episodes is 0; allowed: 1 and more"):
        Which(episodes=0).given()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A selection dataset of four towers, two a seed. Read only."""
    folder = tmp_path_factory.mktemp("recorded")
    with short_towers():
        for seed in (SEED, SEED + 1):
            collect(QUICK, seed, [2, 5], 1, folder / str(seed))
    convert([folder / str(SEED), folder / str(SEED + 1)], folder / "dataset", "short", "1.0.0")
    return folder / "dataset"


def test_the_numbers_of_a_split_are_those_of_its_towers(recorded):
    table = open_dataset(recorded).episodes()
    splits = open_dataset(recorded).manifest.splits
    of_seed = {t: n for t, n, s in zip(table["tower"], table["number"], table["seed"], strict=True) if s == SEED}
    assert numbers_on_towers(recorded, "all", SEED, QUICK) == [2, 5]
    for split in ("train", "validation", "test"):
        wanted = sorted(of_seed[t] for t in splits.towers(split) if t in of_seed)
        if wanted:
            assert numbers_on_towers(recorded, split, SEED, QUICK) == wanted
        else:
            with pytest.raises(JengaError, match=f"no {split} episode of seed {SEED}; its seeds there: {SEED + 1}"):
                numbers_on_towers(recorded, split, SEED, QUICK)


def test_another_pull_of_the_same_numbers_takes_another_block_of_the_same_tower(recorded, tmp_path):
    other = replace(QUICK, pull=1)
    with short_towers():
        collect(other, SEED, numbers_on_towers(recorded, "all", SEED, other), 1, tmp_path / "out")
    headers = [read_header(path)[0] for path in (tmp_path / "out").glob("*.mcap")]
    table = open_dataset(recorded).episodes()
    first = {t: b for t, b, s in zip(table["tower"], table["target"], table["seed"], strict=True) if s == SEED}
    assert {h.blocks.tower for h in headers} == first.keys()
    assert all(h.target != first[h.blocks.tower] for h in headers)


@pytest.mark.parametrize(
    ("config", "part"),
    [
        (replace(QUICK, spawn=replace(QUICK.spawn, last_round=3)), "spawn"),
        (replace(QUICK, physics=replace(QUICK.physics, friction=0.4)), "physics"),
        (EXTRACTION, "kind"),
    ],
)
def test_a_configuration_of_other_towers_is_refused(recorded, config, part):
    with pytest.raises(JengaError, match=f"{part} differs from that of short@1.0.0, so the towers would be others"):
        numbers_on_towers(recorded, "all", SEED, config)


def test_a_split_that_is_none_is_refused(recorded):
    with pytest.raises(JengaError, match="no split 'dev'; allowed: train, validation, test, all"):
        numbers_on_towers(recorded, "dev", SEED, QUICK)
