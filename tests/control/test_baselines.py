"""Hand-made features keep what physics keeps, know what they are told and no more, and no test label reaches a fit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_up_dataset import selection_dataset

from jenga_control.selection.baselines.features import FeatureTable, contact_laws
from jenga_control.selection.baselines.graph_features import graph_features, longest_path, reach, siblings
from jenga_control.selection.baselines.layout_features import layout_features
from jenga_control.selection.baselines.learners import LEARNERS, fit
from jenga_control.selection.baselines.mechanics import MechanicalCase, mechanical_features
from jenga_control.selection.baselines.structure import Structure, structures
from jenga_control.selection.baselines.suite import LEARNED, Side, predict_baselines
from jenga_data.blocks import GRAVITY, sample_blocks
from jenga_data.sim.physics import PhysicsConfig
from jenga_data.tower import Layout, nominal_poses, turn_poses

BLOCKS = 18
LAW = PhysicsConfig().contact_law


def tower(seed: int, moves: int = 3) -> Structure:
    """A random tower of a few moves and one of its legal targets; every block rests on all those right below."""
    rng = np.random.default_rng(seed)
    blocks = sample_blocks("measured", rng, BLOCKS)
    layout = Layout.fresh(rng.permutation(BLOCKS))
    for _ in range(moves):
        places = layout.next_places()
        layout = layout.moved(int(rng.choice(layout.legal_targets())), places[rng.integers(len(places))])
    level, target = layout.level, int(rng.choice(layout.legal_targets()))
    pose = nominal_poses(layout)
    pose[:, :2] += rng.normal(0, 3e-4, (BLOCKS, 2))
    pose = turn_poses(pose, -np.pi / 2 * (level[target] % 2))  # the target along x
    supports = level[:, None] == level[None] + 1
    return Structure(blocks.size, blocks.mass, pose, level, layout.slot, supports, target)


def renumbered(t: Structure, seed: int = 0) -> Structure:
    order = np.random.default_rng(seed).permutation(len(t))
    return Structure(
        t.size[order],
        t.mass[order],
        t.pose[order],
        t.level[order],
        t.slot[order],
        t.supports[np.ix_(order, order)],
        int(np.flatnonzero(order == t.target)[0]),
    )


def half_turned(t: Structure) -> Structure:
    return replace(t, slot=2 - t.slot, pose=turn_poses(t.pose, np.pi))


def mirrored(t: Structure, parity: int) -> Structure:
    """In a mirror that swaps the sides of every other level; the poses, which it would bend, left out."""
    return replace(t, slot=np.where(t.level % 2 == parity, 2 - t.slot, t.slot), pose=np.zeros_like(t.pose))


def mechanics(t: Structure, posed: bool) -> dict[str, float]:
    return mechanical_features(MechanicalCase(t, LAW, posed))


def same(found: dict[str, float], wanted: dict[str, float], tolerance: float = 1e-9) -> None:
    assert found == pytest.approx(wanted, rel=1e-6, abs=tolerance)


@pytest.mark.parametrize("features", [graph_features, layout_features])
@pytest.mark.parametrize("seed", range(8))
def test_features_do_not_depend_on_numbers_or_sides(features, seed):
    t = tower(seed)
    for other in (renumbered(t), half_turned(t), mirrored(t, 0), mirrored(t, 1)):
        same(features(other), features(t))


@pytest.mark.parametrize("posed", [False, True])
def test_mechanics_does_not_depend_on_numbers_or_a_half_turn(posed):
    t = tower(3)
    same(mechanics(renumbered(t), posed), mechanics(t, posed), 1e-4)
    same(mechanics(half_turned(t), posed), mechanics(t, posed), 1e-4)


def test_mechanics_without_poses_does_not_depend_on_sides():
    t = tower(4)
    same(mechanics(mirrored(t, 0), False), mechanics(t, False), 1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_features_know_what_they_are_told_and_no_more(seed):
    t, rng = tower(seed), np.random.default_rng(seed)
    elsewhere = replace(t, pose=rng.normal(size=t.pose.shape))
    same(layout_features(elsewhere), layout_features(t))
    anywhere = replace(elsewhere, level=rng.permutation(t.level), slot=rng.permutation(t.slot))
    same(graph_features(anywhere), graph_features(t))
    # They do look at sizes, masses, edges and the target: other ones give other features.
    assert graph_features(replace(t, size=rng.permutation(t.size))) != graph_features(t)
    assert graph_features(replace(t, mass=rng.permutation(t.mass))) != graph_features(t)
    assert graph_features(replace(t, supports=t.supports.T)) != graph_features(t)
    assert graph_features(replace(t, target=(t.target + 1) % BLOCKS)) != graph_features(t)


def test_mechanics_looks_at_poses_only_where_it_may():
    t = tower(5)
    pose = t.pose.copy()
    pose[t.target, 1] += 2e-3
    shifted = replace(t, pose=pose)
    same(mechanics(shifted, False), mechanics(t, False))
    assert mechanics(shifted, True) != pytest.approx(mechanics(t, True), rel=1e-3)


def test_siblings_reach_and_paths_are_those_of_the_levels():
    t = tower(6, moves=0)
    own, level = t.level[t.target], t.level
    assert set(siblings(t.supports, t.target)) == set(np.flatnonzero(level == own)) - {t.target}
    np.testing.assert_array_equal(reach(t.supports.T, t.target), level > own)
    np.testing.assert_array_equal(reach(t.supports, t.target), level < own)
    assert longest_path(t.supports, t.target) == own
    assert longest_path(t.supports.T, t.target) == level.max() - own
    assert graph_features(t)["weight_above"] == pytest.approx(t.mass[level > own].sum() * GRAVITY)


def test_a_loop_in_the_support_graph_ends():
    ring = np.roll(np.eye(4, dtype=bool), 1, axis=1)
    assert longest_path(ring, 0) == 4
    assert reach(ring, 0).tolist() == [False, True, True, True]


def test_the_crown_says_whether_the_centre_carries():
    layout = Layout.fresh(np.arange(9))
    size = np.tile([0.075, 0.025, 0.015], (9, 1))
    supports = layout.level[:, None] == layout.level[None] + 1
    flat = Structure(size, np.full(9, 0.019), nominal_poses(layout), layout.level, layout.slot, supports, 1)
    size = size.copy()
    size[1, 2] += 2e-4
    high = layout_features(replace(flat, size=size))
    assert layout_features(flat)["crown"] == pytest.approx(0)
    assert high["crown"] == high["crown_against"] == pytest.approx(0.2)
    assert layout_features(replace(flat, size=size, target=0))["crown_against"] == pytest.approx(-0.2)
    carries, loose = mechanics(replace(flat, size=size), False), mechanics(replace(flat, size=size, target=0), False)
    assert carries["load"] > 3 * loose["load"] + 0.1


@pytest.mark.parametrize("seed", range(3))
def test_forces_balance(seed):
    t = tower(seed)
    found = mechanics(t, False)
    assert found["borne"] == pytest.approx(found["load"] + t.mass[t.target] * GRAVITY, abs=1e-3)
    mates = (t.level == t.level[t.target]).sum() - 1
    assert found["load"] + mates * found["least_mate_before"] <= found["weight_above"] + 1e-3
    assert found["load"] + mates * found["most_mate_before"] >= found["weight_above"] - 1e-3
    if found["stands"]:
        assert found["taken_by_mates"] == pytest.approx(found["load"], abs=1e-2)


def test_the_law_is_the_one_of_each_row_s_collection():
    dataset = selection_dataset()
    assert contact_laws(dataset, np.arange(3)) == [LAW] * 3
    configs = {"soft": {"physics": {"time_constant": 0.02}}, "stiff": {"physics": {}}}
    dataset.manifest.provenance = SimpleNamespace(configs=configs)
    which = np.where(np.arange(len(dataset)) % 2, "soft", "stiff")
    dataset.episodes = lambda: {"episode": dataset.column("episode"), "config": which}
    soft = PhysicsConfig(time_constant=0.02).contact_law
    assert contact_laws(dataset, np.array([0, 1, 3])) == [LAW, soft, soft]


def rows_to_learn(n=60, seed=0):
    rng = np.random.default_rng(seed)
    feature = rng.normal(size=(n, 3))
    return feature, feature[:, 0] + 0.3 * rng.normal(size=n) > 0, np.repeat([f"t{i}" for i in range(n // 2)], 2)


@pytest.mark.parametrize("learner", ["logistic", "boosting"])
def test_learners_learn_and_repeat_themselves(learner):
    feature, failure, tower_of = rows_to_learn()
    first, again = (fit(learner, feature, failure, tower_of) for _ in range(2))
    assert set(first.settings) == set(LEARNERS[learner].choices)
    probability = first.probability(feature)
    assert ((probability > 0.5) == failure).mean() > 0.85
    assert ((probability >= 0) & (probability <= 1)).all()
    np.testing.assert_array_equal(probability, again.probability(feature))


def test_rows_of_one_class_or_one_tower_are_no_trouble():
    feature, failure, tower_of = rows_to_learn(20)
    assert fit("logistic", feature, np.ones(20, bool), tower_of).probability(feature).tolist() == [1.0] * 20
    assert fit("logistic", feature, np.zeros(20, bool), tower_of).probability(feature).tolist() == [0.0] * 20
    alone = fit("logistic", feature, failure, np.full(20, "t"))
    assert alone.settings == {}
    assert alone.probability(feature[:0]).shape == (0,)


def sides_of(dataset):
    return (Side.of([(dataset, dataset.rows(split))]) for split in ("train", "test"))


def test_labels_of_the_test_rows_reach_no_baseline():
    said = []
    for spoilt in (False, True):
        dataset = selection_dataset()
        if spoilt:
            dataset.columns["failure"] = dataset.columns["failure"] ^ (dataset.splits == "test")
        train, test = sides_of(dataset)
        # Boosting stands for the forest, which takes longer; both go through the same `fit`.
        said.append(predict_baselines(train, test, "none"))
        for baseline in (b for b in LEARNED if b.name in ("logistic_layout", "boosting_graph")):
            fitted = fit(
                baseline.learner, train.features.matrix(baseline.features), train.pulls.failure, train.pulls.tower
            )
            said[-1].append(fitted.probability(test.features.matrix(baseline.features)))
    for first, second in zip(*said, strict=True):
        one, two = (getattr(p, "probability", p) for p in (first, second))
        np.testing.assert_array_equal(one, two)


def test_rules_turn_round_where_the_opposite_holds():
    dataset = selection_dataset()
    train, test = sides_of(dataset)
    middle = next(p for p in predict_baselines(train, test, "none") if p.name == "middle_first")
    np.testing.assert_array_equal(middle.said, test.pulls.slot != 1)
    upside_down = Side(replace(train.pulls, failure=~train.pulls.failure), train.features)
    middle = next(p for p in predict_baselines(upside_down, test, "none") if p.name == "middle_first")
    np.testing.assert_array_equal(middle.said, test.pulls.slot == 1)
    assert middle.settings == {"as_named": False}


def test_features_of_several_datasets_stand_one_after_the_other():
    one, two = selection_dataset(6), selection_dataset(9, seed=1)
    parts = [(one, np.array([4, 0])), (two, np.array([7]))]
    table = FeatureTable(parts)
    assert len(table) == 3
    single = [layout_features(s) for dataset, rows in parts for s in structures(dataset, rows)]
    np.testing.assert_array_equal(table.matrix("layout"), [list(row.values()) for row in single])
    assert table.matrix("mechanics+layout").shape[1] > table.matrix("layout").shape[1]
    np.testing.assert_array_equal(
        FeatureTable(parts, workers=2).matrix("mechanics"), table.matrix("mechanics"), strict=True
    )
