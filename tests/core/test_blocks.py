from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats

from jenga_data.blocks import DISTRIBUTIONS, NOMINAL_SIZE, BlockDistribution, Blocks, Quantity, sample_blocks
from jenga_data.errors import JengaError

MANY = 20_000
QUANTITIES = [f.name for f in fields(BlockDistribution)]


def columns(blocks: Blocks) -> dict[str, np.ndarray]:
    return dict(zip(QUANTITIES, [*blocks.size.T, blocks.mass, blocks.wedge], strict=True))


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_samples_stay_within_what_was_measured(name):
    for quantity, values in columns(sample_blocks(name, np.random.default_rng(0), MANY, wedge=True)).items():
        measured: Quantity = getattr(DISTRIBUTIONS[name], quantity)
        assert measured.low <= values.min() <= values.max() <= measured.high


@pytest.mark.parametrize("name", ["measured", "measured-second"])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_samples_follow_the_truncated_normal_distribution(name, quantity):
    """Also near its ends: values that were clipped to the limits would pile up there."""
    measured: Quantity = getattr(DISTRIBUTIONS[name], quantity)
    values = columns(sample_blocks(name, np.random.default_rng(1), MANY, wedge=True))[quantity]
    low, high = (measured.low - measured.mean) / measured.sigma, (measured.high - measured.mean) / measured.sigma
    expected = stats.truncnorm(low, high, measured.mean, measured.sigma)
    assert stats.kstest(values, expected.cdf).pvalue > 0.001
    assert len(np.unique(values)) == MANY


def test_the_measured_set_has_the_published_mean_and_spread():
    """Figures of the real set in mm and g; cutting the tails off takes an eighth of the spread at most."""
    published = {
        "length": (75.03, 0.278), "width": (24.93, 0.245), "height": (14.84, 0.175), "mass": (19.27, 1.41),
        "wedge": (0.0, 0.070),
    }  # fmt: skip
    for quantity, values in columns(sample_blocks("measured", np.random.default_rng(2), MANY, wedge=True)).items():
        mean, sigma = published[quantity]
        assert values.mean() * 1e3 == pytest.approx(mean, abs=0.1 * sigma)
        assert 0.87 * sigma < values.std() * 1e3 < 1.01 * sigma


def test_quantities_are_independent():
    values = np.stack(list(columns(sample_blocks("measured", np.random.default_rng(3), MANY, wedge=True)).values()))
    correlation = np.corrcoef(values) - np.eye(len(values))
    assert np.abs(correlation).max() < 4 / np.sqrt(MANY)


def test_nominal_blocks_are_all_as_on_the_box():
    blocks = sample_blocks("nominal", np.random.default_rng(4))
    assert len(blocks) == 54
    np.testing.assert_allclose(blocks.size, np.tile(NOMINAL_SIZE, (54, 1)), rtol=1e-12)
    assert np.ptp(blocks.mass) == 0


def test_the_same_seed_draws_the_same_set():
    one, same, other = (sample_blocks("measured", np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert one.tower == same.tower
    np.testing.assert_array_equal(one.size, same.size)
    np.testing.assert_array_equal(one.mass, same.mass)
    assert one.tower != other.tower


@pytest.mark.parametrize(("block", "axis"), [(0, 0), (53, 2), (17, 1)])
def test_one_bit_of_a_size_makes_another_tower(block, axis):
    blocks = sample_blocks("measured", np.random.default_rng(7))
    size = blocks.size.copy()
    size[block, axis] = np.nextafter(size[block, axis], 1.0)
    assert replace(blocks, size=size).tower != blocks.tower


def test_one_bit_of_a_mass_makes_another_tower():
    blocks = sample_blocks("measured", np.random.default_rng(7))
    mass = blocks.mass.copy()
    mass[53] = np.nextafter(mass[53], 1.0)
    assert replace(blocks, mass=mass).tower != blocks.tower


def test_a_tower_is_named_by_its_numbers_and_not_by_how_they_lie_in_memory():
    blocks = sample_blocks("measured", np.random.default_rng(8))
    assert Blocks(np.asfortranarray(blocks.size), np.repeat(blocks.mass, 2)[::2]).tower == blocks.tower


def test_which_block_is_which_is_part_of_the_tower():
    blocks = sample_blocks("measured", np.random.default_rng(9))
    assert Blocks(blocks.size[::-1], blocks.mass[::-1]).tower != blocks.tower


def test_an_unknown_distribution_is_refused_with_the_known_ones():
    with pytest.raises(JengaError, match=r"'oak'; allowed: measured, measured-second, nominal$"):
        sample_blocks("oak", np.random.default_rng(0))


@pytest.mark.parametrize("change", [{"low": 2.0}, {"high": 0.5}, {"sigma": -0.1}])
def test_a_quantity_whose_mean_lies_outside_its_limits_is_refused(change):
    with pytest.raises(ValueError, match="need low <= mean <= high and sigma >= 0"):
        replace(Quantity(1.0, 0.1, 0.9, 1.1), **change)


@pytest.mark.parametrize(
    ("size", "mass", "message"),
    [
        (np.ones((2, 3)), np.ones(3), "2 sizes, 3 masses and 3 wedges"),
        (np.zeros((2, 3)), np.ones(2), "must be positive"),
        (np.ones((2, 3)), np.array([1.0, -1.0]), "must be positive"),
    ],
)
def test_blocks_that_cannot_be_are_refused(unchecked_shapes, size, mass, message):
    with pytest.raises(ValueError, match=message):
        Blocks(size, mass)
