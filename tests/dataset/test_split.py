import pytest

from jenga_data.dataset.manifest import SPLITS
from jenga_data.dataset.split import position, split_towers
from jenga_data.errors import JengaError

TOWERS = [f"{i:016x}" for i in range(4000)]


def test_every_tower_is_on_one_side():
    splits = split_towers(TOWERS)
    assert sorted(t for s in SPLITS for t in splits.towers(s)) == TOWERS


def test_order_and_repetition_do_not_matter():
    assert split_towers(TOWERS) == split_towers(TOWERS[::-1] + TOWERS[:7])


def test_shares_are_near_4_to_1_and_a_tenth_of_it():
    splits = split_towers(TOWERS)
    assert 0.18 < len(splits.test) / len(TOWERS) < 0.22
    assert 0.08 < len(splits.validation) / (len(TOWERS) - len(splits.test)) < 0.12


def test_a_new_tower_moves_no_old_one():
    before, after = split_towers(TOWERS[:200]), split_towers(TOWERS)
    for split in SPLITS:
        assert set(before.towers(split)) <= set(after.towers(split))


@pytest.mark.parametrize("start", range(0, 300, 3))
def test_no_side_is_ever_empty(start):
    for count in (3, 20):
        splits = split_towers(TOWERS[start : start + count])
        assert all(splits.towers(s) for s in SPLITS)


def test_towers_of_one_side_are_still_shared_out():
    late = [t for t in TOWERS if position(t) > 0.5][:5]
    early = [t for t in TOWERS if position(t) < 0.1][:5]
    assert [len(split_towers(late).towers(s)) for s in SPLITS] == [3, 1, 1]
    assert [len(split_towers(early).towers(s)) for s in SPLITS] == [1, 1, 3]


def test_two_towers_are_too_few():
    with pytest.raises(JengaError, match=r"2 towers .*at least 3"):
        split_towers(TOWERS[:2])
