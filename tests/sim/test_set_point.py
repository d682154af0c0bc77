import numpy as np
import pytest

from jenga_data.sim.set_point import PERIOD, SetPoint

PARTS = np.linspace(0, 1, 2001)


def way(knots: np.ndarray, velocities: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Position, velocity and acceleration over each period, from rest at zero."""
    point, out = SetPoint(np.zeros(knots.shape[1])), []
    for knot, velocity in zip(knots, velocities, strict=True):
        point.begin(knot, velocity)
        out.append(tuple(np.array(values) for values in zip(*(point.at(part) for part in PARTS), strict=True)))
    return out


@pytest.fixture
def periods() -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(0)
    return way(np.cumsum(rng.normal(0, 0.01, (6, 3)), axis=0), rng.normal(0, 0.3, (6, 3)))


def test_it_passes_each_knot_with_its_velocity():
    rng = np.random.default_rng(1)
    knots, velocities = rng.normal(size=(4, 2)), rng.normal(size=(4, 2))
    for (position, velocity, _), knot, speed in zip(way(knots, velocities), knots, velocities, strict=True):
        np.testing.assert_allclose(position[-1], knot, atol=1e-12)
        np.testing.assert_allclose(velocity[-1], speed, atol=1e-10)


def test_position_and_velocity_have_no_steps(periods):
    before = np.zeros(3), np.zeros(3)
    for position, velocity, _ in periods:
        np.testing.assert_allclose(position[0], before[0], atol=1e-12)
        np.testing.assert_allclose(velocity[0], before[1], atol=1e-10)
        before = position[-1], velocity[-1]


def test_velocity_and_acceleration_are_the_derivatives_in_time(periods):
    step = PERIOD / 2000
    for position, velocity, acceleration in periods:
        np.testing.assert_allclose((position[2:] - position[:-2]) / (2 * step), velocity[1:-1], atol=1e-4)
        np.testing.assert_allclose((velocity[2:] - velocity[:-2]) / (2 * step), acceleration[1:-1], atol=1e-6)


def test_a_steady_way_is_straight_and_unaccelerated():
    (_, _, _), (position, velocity, acceleration) = way(np.array([[0.5], [0.5 + 0.2 * PERIOD]]), np.full((2, 1), 0.2))
    np.testing.assert_allclose(position[:, 0], 0.5 + 0.2 * PERIOD * PARTS, atol=1e-12)
    np.testing.assert_allclose(velocity, 0.2, atol=1e-9)
    np.testing.assert_allclose(acceleration, 0, atol=1e-6)
