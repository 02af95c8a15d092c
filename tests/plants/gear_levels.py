"""The effects of gears as levels with the parameters beside them, from records and a fit."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from elastid.base.arrays import IntArray
from elastid.fit.result import Result
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import EXACT
from elastid.nonlinear.drives import without_arm
from elastid.nonlinear.gear_choice import choose_effects
from elastid.nonlinear.gear_levels import GearData, Levels
from elastid.nonlinear.spectra import gather_lines
from elastid.record import Record
from elastid.response import Response
from elastid.robot import Robot


def find_gear_effects(
    measured: Sequence[Iterable[Record]], responses: Sequence[Response], result: Result, robot: Robot,
    spec: EstimatorSpec, planned: IntArray | None = None,
) -> Levels:  # fmt: skip
    """Of the records of all configurations, friction still in both."""
    linearisation = Linearisation.of_robot(robot, EXACT, result.parameters.names)
    data = GearData([gather_lines(tuple(each), spec, planned) for each in measured], responses, linearisation)
    pairs = zip(data.lines, data.drives(result.parameters, result.x), strict=True)
    net = replace(data, lines=[without_arm(lines, drive, robot) for lines, drive in pairs])
    return choose_effects(net, result.parameters, result.x, (1.0, 2.0))
