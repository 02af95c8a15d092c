"""find_gear_effects: records, their responses and a fit -> what the gears do besides being springs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from elastid.base.arrays import IntArray
from elastid.base.errors import DataError
from elastid.fit.result import Result
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.nonlinear.gear.choice import ORDERS, choose_effects
from elastid.nonlinear.gear.drive_lines import drive_lines, elastic_joints
from elastid.nonlinear.gear.geometry import without_arm
from elastid.nonlinear.gear.levels import Levels
from elastid.nonlinear.gear.period_lines import PeriodLines, gather_lines
from elastid.nonlinear.gear.straightness import find_bends
from elastid.record import Record
from elastid.response import Response
from elastid.robot import Robot


def find_gear_effects(
    measured: Sequence[Iterable[Record]],
    responses: Sequence[Response],
    result: Result,
    robot: Robot,
    spec: EstimatorSpec,
    *,
    model: ModelSpec = EXACT,
    planned: IntArray | None = None,
    orders: Sequence[float] = ORDERS,
) -> Levels:
    """Effects that the records of all configurations show, with their levels and the parameters beside them.

    measured, responses: of each configuration in one order, friction still in both.  result: the fit of these
    responses.  The parameters of the fit move with the levels, from its optimum on; stiffnesses are those at zero
    torque.  orders: of transmission errors and ripples, in turns of the motor.
    Raises DataError for records without a period, without the angle of an excited motor, and of a robot without elastic
    gears; StudyError as `analysed_lines` does.
    """
    linearisation = Linearisation.of_robot(robot, model, result.parameters.names)
    if not elastic_joints(linearisation):
        raise DataError(
            "robot/no-spring",
            f"robot {robot.name} has no driven joint with a spring in its gear: what gears do is found by "
            "their springs",
        )
    data = [gather_lines(tuple(records), spec, planned) for records in measured]
    drives = [
        drive_lines(lines, linearisation, G, result.parameters, result.x)
        for lines, G in zip(data, responses, strict=True)
    ]
    net = [without_arm(lines, drive, robot) for lines, drive in zip(data, drives, strict=True)]
    bent = bent_gears(data, responses, robot)
    return choose_effects(net, responses, linearisation, result.parameters, result.x, bent, orders)


def bent_gears(data: Sequence[PeriodLines], responses: Sequence[Response], robot: Robot) -> set[str]:
    """Joints with gears that are no straight springs, in any configuration."""
    pairs = zip(data, responses, strict=True)
    return {bend.joint for lines, G in pairs for bend in find_bends(lines, G.inputs, robot)}
