"""The static law through levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.published_friction import TERMS, drawn, published_levels

from elastid.base.errors import FitError
from elastid.friction_study.laws import Terms, derivative, fit_curve

WHOLE = replace(TERMS, linear=(*TERMS.linear, "directions.coulomb", "directions.viscous", "quadratic"))


def test_the_published_surface_is_refitted() -> None:
    """240 exact levels, 12 numbers: exact to rounding."""
    levels = published_levels()
    fit = fit_curve(levels, TERMS)
    np.testing.assert_allclose(fit.torque(levels.conditions), levels.torque, rtol=1e-8)
    assert fit.values["exponent"] == pytest.approx(1.36, rel=1e-7)
    assert fit.values["load.stribeck_velocity"] == pytest.approx(9.22, rel=1e-7)
    assert fit.values["stribeck_velocity"] == pytest.approx(-24.81 + 0.98 * fit.T_0, rel=1e-7)


@pytest.mark.parametrize("shared", [False, True], ids=["the load's own Stribeck velocity", "one for both"])
def test_derivatives_are_those_of_differences(shared: bool) -> None:
    """By every number, of levels with direction, load and temperature."""
    levels = replace(published_levels(), direction=np.where(np.arange(240) % 2, 1.0, -1.0))
    terms = (
        replace(WHOLE, searched=tuple(n for n in WHOLE.searched if n != "load.stribeck_velocity")) if shared else WHOLE
    )
    fit = fit_curve(drawn(levels, 1), terms)
    J = derivative(levels.conditions, terms, fit.values, fit.T_0)
    for i, name in enumerate(fit.names):
        h = 1e-6 * max(abs(fit.values[name]), 1e-6)
        above, below = (replace(fit, values={**fit.values, name: fit.values[name] + s * h}) for s in (1, -1))
        numeric = (above.torque(levels.conditions) - below.torque(levels.conditions)) / (2 * h)
        np.testing.assert_allclose(J[:, i], numeric, rtol=1e-4, atol=1e-6 * np.abs(numeric).max())


@pytest.mark.slow
def test_the_stated_std_is_the_scatter_and_the_intervals_hold_the_truth() -> None:
    """60 data sets: scatter over stated std 0.8 to 1.25 for each of 12 numbers, 720 intervals at 95 %."""
    levels = published_levels()
    truth = fit_curve(levels, TERMS)
    exact = np.array([truth.values[name] for name in truth.names])
    fits = [fit_curve(drawn(levels, seed), TERMS) for seed in range(60)]
    error = np.array([[fit.values[name] for name in truth.names] for fit in fits]) - exact
    stated = np.array([np.sqrt(np.diag(fit.covariance)) for fit in fits])
    ratio = error.std(axis=0) / stated.mean(axis=0)
    assert ratio.min() > 0.75
    assert ratio.max() < 1.3
    assert 0.92 < np.mean(np.abs(error) < 1.96 * stated) < 0.975


def test_too_few_levels_are_refused_with_their_number() -> None:
    with pytest.raises(FitError, match=r"3 levels for 4 numbers of its law .* measure more speeds"):
        fit_curve(
            published_levels((1.0, 10.0, 100.0), (0.0,), (40.0,)),
            Terms(("coulomb", "excess", "viscous"), ("stribeck_velocity",), {"exponent": 2.0}),
        )
