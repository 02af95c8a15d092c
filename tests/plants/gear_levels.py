"""The linear fit of the plant of two masses, and effects of gears as magnitudes beside its parameters."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from elastid.fit.identify import fit_parameters
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import EXACT
from elastid.nonlinear.gear_estimation import GearData, GearEstimate
from elastid.nonlinear.gear_model_selection import choose_effects
from elastid.nonlinear.period_lines import gather_lines
from elastid.nonlinear.period_model import without_arm
from elastid.record import Record
from elastid.response import Response
from elastid.robot import Robot
from plants.two_mass_gear import LINES, Gear, robot

SPEC = EstimatorSpec(friction="none", transient_periods=0)


def linear_fit(gear: Gear, measured: Sequence[Record]) -> tuple[Response, Result]:
    """The response, and the fit of a linear model from numbers a quarter off."""
    response = estimate(measured, SPEC, LINES)
    wanted = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
    spec = FitSpec(parameters=wanted, weights=WeightSpec(model_error=0.0), starts=1)
    return response, fit_parameters([response], robot(replace(gear, k=1.5e5, d=80.0, f=20.0)), spec)


def find_gear_effects(
    measured: Sequence[Iterable[Record]], responses: Sequence[Response], result: Result, robot: Robot
) -> GearEstimate:
    """Of the records of all configurations, friction still in both."""
    linearisation = Linearisation.of_robot(robot, EXACT, result.parameters.names)
    data = GearData([gather_lines(tuple(each), SPEC, LINES) for each in measured], responses, linearisation)
    pairs = zip(data.lines, data.drives(result.parameters, result.x), strict=True)
    net = replace(data, lines=[without_arm(lines, drive, robot) for lines, drive in pairs])
    return choose_effects(net, result.parameters, result.x, (1.0, 2.0))
