"""The robot with identified friction moved like the logs of a friction study."""

from __future__ import annotations

from elastid.app.identified_robot import with_identified_friction
from elastid.base.execution import Execution
from elastid.friction_record import FrictionRecords
from elastid.friction_study.result import FrictionResult
from elastid.study import Study
from elastid.validation.friction_twin_run import friction_runs
from elastid.validation.twin_run import TwinRun


def runs_of_friction(
    study: Study, result: FrictionResult, measured: FrictionRecords, execution: Execution
) -> tuple[TwinRun, ...]:
    """Along the first log of each group of joints that moved together."""
    recorded = study.experiment.recorded
    robot = with_identified_friction(study, result)
    return friction_runs(robot, result.joints, measured, None if recorded is None else recorded.controller, execution)
