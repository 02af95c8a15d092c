"""Parameters and magnitudes of a gear of another simulator, from the fit of a linear model."""

from functools import cache

import numpy as np
import pytest
from plants.gear_levels import SPEC, linear_fit
from plants.two_mass_gear import LINES, Gear, records, robot

from elastid.fit.parameter_selection import choose
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec, PriorSpec
from elastid.linear.linearise import Linearisation
from elastid.nonlinear.basis_functions import GearEffect
from elastid.nonlinear.gear_estimation import (
    GearData,
    GearEstimate,
    estimate_gear_parameters,
    initial_estimate,
    priors,
    scale_priors,
    scales_of,
)
from elastid.nonlinear.period_lines import gather_lines
from elastid.record import Record
from elastid.response import Response


@cache
def hardening() -> tuple[tuple[Record, ...], Response, Result]:
    """Records of two experiments, k + 30 % at the peak of the torque, and the linear fit."""
    measured = records(Gear(k_3=4e9), experiments=2)
    return measured, *linear_fit(Gear(k_3=4e9), measured)


@cache
def with_effects(*effects: GearEffect) -> GearEstimate:
    """Parameters and magnitudes of these effects in the hardening gear's records."""
    measured, response, linear = hardening()
    linearisation = Linearisation.of_robot(robot(Gear()), geometry=linear.parameters.names)
    data = GearData([gather_lines(measured, SPEC, LINES)], [response], linearisation)
    return estimate_gear_parameters(data, initial_estimate(data, linear.parameters, linear.x), effects)


def test_hardening_gear_is_identified_where_linear_fit_errs() -> None:
    """k at zero torque within 0.02 %, k_3 within 0.1 %, d within 0.2 %."""
    gear, linear = Gear(k_3=4e9), hardening()[2]
    assert linear.values["k_1"] > 1.05 * gear.k
    found = with_effects(GearEffect("cubic", "1"))
    numbers = linear.parameters.as_dict(found.x)
    assert numbers["k_1"] == pytest.approx(gear.k, rel=2e-4)
    assert numbers["d_1"] == pytest.approx(gear.d, rel=2e-3)
    assert found.magnitudes[0] == pytest.approx(gear.k_3, rel=1e-3)
    assert np.all(found.std > 0)


def test_priors_pull_each_parameter_to_its_mean() -> None:
    """Half the gradient and half the curvature of the sum of ((x - mean) / std)^2; magnitudes have none."""
    spec = FitSpec(parameters={"k_1": ParameterSpec(prior=PriorSpec(0.1, 1.8e5)), "d_1": ParameterSpec()})
    parameters = choose(spec, robot(Gear()))
    A, b = priors(parameters, parameters.x, 3)
    (std,) = [p.prior.std for p in parameters.free if p.prior is not None]
    np.testing.assert_allclose(A, np.diag([1 / std**2, 0, 0]))
    np.testing.assert_allclose(b, [np.log(1.8e5 / Gear().k) / std**2, 0, 0])


def test_the_scale_of_a_level_that_is_not_seen_stays() -> None:
    """A gear without hysteresis: next to no magnitude may have any scale, and k must not pay for the search."""
    found = with_effects(GearEffect("cubic", "1"), GearEffect("stop", "1", 3e-4))
    assert abs(found.magnitudes[1]) < 3 * found.std[1]
    assert found.effects[1].scale == pytest.approx(3e-4, rel=1e-6)
    assert found.scale_std[1] < 2e-6 * 3e-4
    assert hardening()[2].parameters.as_dict(found.x)["k_1"] == pytest.approx(2e5, rel=2e-4)


def test_load_friction_shares_velocity_scale_of_motor_friction() -> None:
    """One logarithm of a scale for both, which either magnitude that is seen moves; that of a hysteresis is its own."""
    effects = [GearEffect("friction", "1", 1e-3), GearEffect("stop", "1", 1e-4), GearEffect("load", "1", 2e-3)]
    scales = scales_of([*effects, GearEffect("load", "2", 2e-3)])
    assert scales == [[0, 2], [1], [3]]
    magnitudes, std, A = np.array([0.0, 1.0, 5.0, 1.0]), np.ones(7), np.diag(np.full(7, 50.0))
    fixed = scale_priors(A, magnitudes, std, scales, 0) > 1e9
    assert fixed.tolist() == [False, True, True]
    assert not np.any(scale_priors(A, magnitudes, 0 * std, scales, 0) > 1.0)
