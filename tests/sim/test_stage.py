from dataclasses import replace

import numpy as np
import pytest
from short_tower import EXTRACTION, PHYSICS, SELECTION, SPAWN, short_towers

from jenga_data.collect.config import CollectConfig
from jenga_data.collect.stage import Stage, set_stage
from jenga_data.errors import JengaError
from jenga_data.geometry import rotation_matrices
from jenga_data.sim.scene import add_tower, base_spec
from jenga_data.sim.world import World
from jenga_data.tower import quarter_turns_for


@pytest.fixture(scope="module", params=[SELECTION, EXTRACTION], ids=["selection", "extraction"])
def stages(request: pytest.FixtureRequest) -> tuple[CollectConfig, list[Stage]]:
    with short_towers():
        return request.param, [set_stage(request.param, 0, number) for number in range(8)]


def test_the_target_is_legal_and_its_face_and_turn_are_told(stages):
    _, all_of_them = stages
    assert {stage.face for stage in all_of_them} == {0, 1}
    assert len({stage.turn for stage in all_of_them}) > 2
    for stage in all_of_them:
        assert stage.layout.is_legal(stage.target)
        assert stage.turn == quarter_turns_for(stage.layout, stage.target, stage.face)
        assert SPAWN.first_round <= stage.layout.round <= SPAWN.last_round
        assert 1 <= stage.tries <= SPAWN.tries


def test_the_target_lies_along_x_with_its_face_to_be_pulled(stages):
    for stage in stages[1]:
        own_x = rotation_matrices(stage.state.pose[stage.target, 3:])[:, 0]
        np.testing.assert_allclose((2 * stage.face - 1) * own_x, [-1, 0, 0], atol=0.02)


def test_the_target_of_an_extraction_sticks_out_at_minus_x(stages):
    config, all_of_them = stages
    expected = -EXTRACTION.sticks_out if config is EXTRACTION else 0.0
    for stage in all_of_them:
        assert stage.state.pose[stage.target, 0] == pytest.approx(expected, abs=0.003)


def test_a_robot_finds_the_tower_as_it_was_grown_and_knows_how_to_turn_it():
    """The same draws as without one: only the turn is yet to be made."""
    config = replace(EXTRACTION, body="robot")
    with short_towers():
        for number in range(4):
            grown, turned = set_stage(config, 0, number), set_stage(SELECTION, 0, number)
            assert (grown.target, grown.face, grown.turn) == (turned.target, turned.face, turned.turn)
            np.testing.assert_array_equal(grown.state.turned(grown.turn).pose, turned.state.pose)
            along = rotation_matrices(grown.state.pose[:, 3:])[:, :, 0]
            odd = grown.layout.orientation == 1
            assert (np.abs(along[odd, 1]) > 0.99).all()
            assert (np.abs(along[~odd, 0]) > 0.99).all()


def test_the_same_seed_and_number_set_the_same_stage():
    with short_towers():
        one, same, other = (set_stage(SELECTION, 0, number) for number in (3, 3, 4))
    np.testing.assert_array_equal(one.state.pose, same.state.pose)
    assert (one.target, one.turn, one.face, one.tries) == (same.target, same.turn, same.face, same.tries)
    assert one.blocks.tower != other.blocks.tower


def test_the_pulls_of_a_tower_have_different_targets_and_the_same_tower():
    with short_towers():
        first = set_stage(SELECTION, 0, 3)
        legal = sorted(first.layout.legal_targets())
        all_pulls = [first, *(set_stage(replace(SELECTION, pull=n), 0, 3) for n in range(1, len(legal)))]
        with pytest.raises(JengaError, match=f"has pulls 0 to {len(legal) - 1}$"):
            set_stage(replace(SELECTION, pull=len(legal)), 0, 3)
    assert sorted(stage.target for stage in all_pulls) == legal
    assert {stage.face for stage in all_pulls} == {0, 1}
    for stage in all_pulls:
        assert stage.blocks.tower == first.blocks.tower
        np.testing.assert_allclose(
            stage.state.turned(-stage.turn).pose, first.state.turned(-first.turn).pose, atol=1e-12
        )


def test_a_tower_on_a_stage_stands_by_itself(stages):
    for stage in stages[1][:3]:
        assert not stage.state.twist.any()
        spec = base_spec(PHYSICS)
        add_tower(spec, stage.blocks, stage.state.pose, -1, PHYSICS)
        world = World(spec, stage.blocks, stage.layout)
        world.step(250)
        moved = np.linalg.norm(world.pose[:, :3] - stage.state.pose[:, :3], axis=1)
        assert moved.max() < SPAWN.creep_allowance


def test_rounds_are_drawn_from_the_whole_range():
    config = replace(SELECTION, spawn=replace(SPAWN, first_round=1, last_round=3))
    with short_towers():
        rounds = [set_stage(config, 1, number).layout.round for number in range(12)]
    assert set(rounds) == {1, 2, 3}


def test_a_round_in_which_no_tower_stands_is_told_with_what_to_do():
    config = replace(SELECTION, spawn=replace(SPAWN, tries=2, creep_allowance=1e-9))
    with short_towers(), pytest.raises(JengaError) as refused:
        set_stage(config, 7, 3)
    assert "seed 7, number 3: no tower of round" in str(refused.value)
    assert "in 2 tries; raise spawn.tries or spawn.creep-allowance" in str(refused.value)
    assert "\n" not in str(refused.value)
