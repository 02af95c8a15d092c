"""Parameters and levels of a gear of another simulator, from the fit of a linear model."""

from dataclasses import replace

import numpy as np
import pytest

from elastid.fit.identify import identify
from elastid.fit.result import FitResult
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.nonlinear.gear.effects import GearEffect
from elastid.nonlinear.gear.levels import find_levels
from elastid.nonlinear.gear.period_lines import gather_lines
from elastid.record import Record
from elastid.response import FrequencyResponse
from tests.plants.two_mass_gear import LINES, Gear, records, robot

SPEC = EstimatorSpec(friction="none", transient_periods=0)


def linear_fit(gear: Gear, measured: tuple[Record, ...]) -> tuple[FrequencyResponse, FitResult]:
    """The fit of a linear model from numbers a quarter off."""
    response = estimate(measured, SPEC, LINES)
    wanted = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
    spec = FitSpec(parameters=wanted, weights=WeightSpec(floor=0.0), starts=1)
    return response, identify([response], robot(replace(gear, k=1.5e5, d=80.0, f=20.0)), spec)


def test_a_hardening_gear_is_found_where_a_linear_fit_is_seven_percent_off() -> None:
    """k at zero torque within 0.02 %, k_3 within 0.1 %, d within 0.2 %; k + 30 % at the peak of the torque."""
    gear = Gear(k_3=4e9)
    measured = records(gear, experiments=2)
    response, linear = linear_fit(gear, measured)
    assert linear.values["k_1"] > 1.05 * gear.k
    linearisation = Linearisation.of_robot(robot(gear), geometry=linear.parameters.names)
    data = [gather_lines(measured, SPEC, LINES)]
    found = find_levels(data, [response], linearisation, linear.parameters, linear.x, [GearEffect("cubic", "1")])
    numbers = linear.parameters.as_dict(found.x)
    assert numbers["k_1"] == pytest.approx(gear.k, rel=2e-4)
    assert numbers["d_1"] == pytest.approx(gear.d, rel=2e-3)
    assert found.levels[0] == pytest.approx(gear.k_3, rel=1e-3)
    assert found.move < 0.05
    assert np.all(found.std > 0)
