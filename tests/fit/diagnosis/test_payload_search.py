"""A load is found from the score test of a body's numbers: its mass and its place, as a point mass has them."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.fit.diagnosis.score_test import Candidate, HeldNumber, Load, ScoreTest, find_load, steps_of

MASS, CENTRE, INERTIA = 40.0, (0.3, 0.0, 0.1), (0.8, 4.0, 4.1)
LOAD, PLACE = 3.0, np.array([0.7, 0.1, 0.05])


def numbers() -> list[HeldNumber]:
    centre = [HeldNumber(f"c_arm_{a}", "", c, "m", False, -1, 1, 0.01) for a, c in zip("xyz", CENTRE, strict=True)]
    inertia = [
        HeldNumber(f"I_arm_{a}{a}", "", i, "kg*m^2", True, -9, 9, 0.1) for a, i in zip("xyz", INERTIA, strict=True)
    ]
    return [HeldNumber("m_arm", "", MASS, "kg", True, -9, 9, 0.05), *centre, *inertia]


def searched(mass: float) -> tuple[Load | None, float]:
    """The load that is found of one of a mass at PLACE, by exact sums of a linear problem, and its drop of V."""
    members, rho = numbers(), PLACE - CENTRE
    change = np.array([mass / MASS, *(mass / MASS * rho), *(mass * (rho @ rho - rho**2) / INERTIA)])
    J = np.random.default_rng(0).standard_normal((100, len(members)))
    S = 1e6 * J.T @ J
    test = ScoreTest(tuple(members), S, -S @ change, np.zeros((0, len(members))), np.ones(len(members), dtype=bool))
    return find_load(test, Candidate("payload_arm", "payload", np.arange(7), np.eye(7)), 1.0, 0.0), change @ S @ change


def test_a_point_mass_is_found_with_its_place_and_changes_mass_and_centre_as_statics_says() -> None:
    """The new centre is that of both masses."""
    load, drop = searched(LOAD)
    assert load is not None
    assert load.mass == pytest.approx(LOAD, rel=1e-3)
    np.testing.assert_allclose(load.place, PLACE - CENTRE, atol=1e-3)
    assert load.drop == pytest.approx(drop, rel=1e-4)
    mass, x = MASS * np.exp(load.steps[0]), CENTRE[0] + load.steps[1]
    assert mass == pytest.approx(MASS + LOAD, rel=1e-3)
    assert x == pytest.approx((MASS * CENTRE[0] + LOAD * PLACE[0]) / (MASS + LOAD), rel=1e-3)


def test_a_load_that_nobody_forgets_is_none() -> None:
    """Half a thousandth of its body; two thousandths are found."""
    assert searched(5e-4 * MASS)[0] is None
    assert searched(2e-3 * MASS)[0] is not None


def test_an_inertia_of_one_number_is_that_in_a_plane() -> None:
    """Of a load at a distance of 0.5 m: 3 kg add 0.75 kg m^2, relative to the centre of both."""
    members = [numbers()[0], HeldNumber("I_arm", "", 1.0, "kg*m^2", True, -9, 9, 0.1)]
    steps = steps_of(members, np.array([LOAD, 0.5, 0.0, 0.0]))
    assert np.expm1(steps[1]) == pytest.approx(0.75 * MASS / (MASS + LOAD))
