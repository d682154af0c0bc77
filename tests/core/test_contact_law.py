from dataclasses import replace

import numpy as np
import pytest

from jenga_data.contact_law import ContactLaw
from jenga_data.sim.physics import PhysicsConfig

LAW = PhysicsConfig().contact_law
WIDE = ContactLaw(rate=4000.0, touch=0.5, full=0.99, width=2e-4)
DEPTHS = np.concatenate([np.geomspace(1e-8, 6.9e-5, 40), [8e-5, 2.5e-4, 1e-3]])
LAWS = pytest.mark.parametrize("law", [LAW, WIDE, ContactLaw.linear(5e5)], ids=["default", "wide", "linear"])


@LAWS
def test_what_does_not_sink_bears_nothing(law):
    above = np.array([-1.0, -1e-9, 0.0])
    np.testing.assert_array_equal(law.force(above), 0.0)
    np.testing.assert_array_equal(law.stiffness(above), 0.0)


@LAWS
def test_the_stiffness_is_the_derivative_of_the_force(law):
    step = 1e-5 * DEPTHS
    slope = (law.force(DEPTHS + step) - law.force(DEPTHS - step)) / (2 * step)
    np.testing.assert_allclose(law.stiffness(DEPTHS), slope, rtol=1e-5)


@LAWS
def test_deeper_bears_more(law):
    """The energy of a tower is convex, and Newton's method finds its minimum."""
    assert (np.diff(law.force(DEPTHS)) > 0).all()
    assert (law.stiffness(DEPTHS) > 0).all()


def test_a_linear_law_is_a_spring_of_the_stiffness_that_it_is_given():
    law = ContactLaw.linear(5e5)
    np.testing.assert_allclose(law.force(DEPTHS), 5e5 * DEPTHS)
    np.testing.assert_allclose(law.stiffness(DEPTHS), 5e5)


def test_a_constant_impedance_is_a_spring():
    law = replace(WIDE, touch=WIDE.full)
    spring = ContactLaw.linear(law.rate * law.full**2 / (1 - law.full))
    np.testing.assert_allclose(law.force(DEPTHS), spring.force(DEPTHS))


def test_a_contact_is_soft_where_it_touches_and_stiff_where_it_is_loaded():
    """Between the springs of its two impedances: it begins as the one and goes over into the other."""
    soft, stiff = (ContactLaw.linear(WIDE.rate * d**2 / (1 - d)) for d in (WIDE.touch, WIDE.full))
    inside = DEPTHS[WIDE.width > DEPTHS]
    assert (WIDE.force(inside) > soft.force(inside)).all()
    assert (WIDE.force(inside) < stiff.force(inside)).all()
    touching, deep = np.array([1e-8]), np.array([WIDE.width, 3 * WIDE.width])
    np.testing.assert_allclose(WIDE.force(touching), soft.force(touching), rtol=1e-3)
    np.testing.assert_allclose(WIDE.force(deep), stiff.force(deep))


def test_the_force_has_neither_steps_nor_kinks():
    """The two parabolas of the impedance meet in the middle, and end level."""
    for joint in (WIDE.width / 2, WIDE.width):
        around = joint + np.array([-1e-12, 1e-12])
        np.testing.assert_allclose(np.diff(WIDE.force(around)), 0.0, atol=1e-5)
        np.testing.assert_allclose(np.diff(WIDE.stiffness(around)), 0.0, atol=WIDE.stiffness(around)[0] * 1e-5)


def test_a_law_follows_from_the_physics_that_are_configured():
    """MuJoCo's stiffness k = d / (d_full * time constant * damping ratio)^2."""
    physics = PhysicsConfig(time_constant=0.01, damping_ratio=2.0, touch_impedance=0.6, impedance=0.8)
    law = physics.contact_law
    assert law.rate == pytest.approx(1 / (0.8 * 0.01 * 2.0) ** 2)
    assert (law.touch, law.full, law.width) == (0.6, 0.8, physics.impedance_width)
