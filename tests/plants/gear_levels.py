"""The effects of gears as levels with the parameters beside them, from records and a fit."""

from collections.abc import Iterable, Sequence

from elastid.base.arrays import IntArray
from elastid.fit.result import Result
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import EXACT
from elastid.nonlinear.gear_choice import ORDERS, bent_gears, choose_effects
from elastid.nonlinear.gear_levels import Levels
from elastid.nonlinear.gear_limits import drives_of
from elastid.nonlinear.period_lines import gather_lines
from elastid.nonlinear.rigid_arm import without_arm
from elastid.record import Record
from elastid.response import Response
from elastid.robot import Robot


def find_gear_effects(
    measured: Sequence[Iterable[Record]], responses: Sequence[Response], result: Result, robot: Robot,
    spec: EstimatorSpec, planned: IntArray | None = None,
) -> Levels:  # fmt: skip
    """Of the records of all configurations, friction still in both."""
    linearisation = Linearisation.of_robot(robot, EXACT, result.parameters.names)
    data = [gather_lines(tuple(records), spec, planned) for records in measured]
    drives = drives_of(data, responses, linearisation, result)
    net = [without_arm(lines, drive, robot) for lines, drive in zip(data, drives, strict=True)]
    bent = bent_gears(data, responses, robot)
    return choose_effects(net, responses, linearisation, result.parameters, result.x, bent, ORDERS)
