"""The identified robot moved like the logs of a study: which record, which robot, which controller."""

from __future__ import annotations

from elastid.app.identified_robot import with_found_friction
from elastid.app.run import Run
from elastid.base.execution import Execution
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.fit.fitted_robot import robots_by_group
from elastid.linear.linear_model import DELAY
from elastid.store import read_configurations, read_fit, read_friction, read_plan, read_records, read_responses
from elastid.validation.elastic_twin_run import FittedTwin, elastic_runs
from elastid.validation.twin_run import TwinRun


def runs_of_fit(run: Run, execution: Execution) -> tuple[TwinRun, ...]:
    """Along the first record of the first configuration that was left out, or else of the first of all."""
    study, path = run.study, run.path("measure")
    names = read_configurations(path)
    chosen = next((name for name in study.validation.left_out if name in names), names[0])
    result = read_fit(run.path("fit"))
    responses = [each for each in read_responses(run.path("estimate")) if each.configuration.name == chosen]
    if not responses:
        return ()
    ((robot, _),) = robots_by_group(result, study.as_robot(), [chosen]).values()
    numbers = dict(zip(result.parameters.names, result.theta_of(chosen).tolist(), strict=True))
    moved = with_found_friction(robot, read_friction(run.path("estimate")))
    record = next(iter(read_records(path, chosen)))
    band_hz = float(responses[0].freq_hz[0]), float(responses[0].freq_hz[-1])
    return elastic_runs(record, FittedTwin(moved, numbers.get(DELAY, 0.0), study.model), band_hz, _rig(run), execution)


def _rig(run: Run) -> SimulatedRig | None:
    """The rig of a simulated experiment."""
    study = run.study
    if study.experiment.simulated is None:
        return None
    return SimulatedRig(study.as_robot(), study.experiment, read_plan(run.path("design")), study.seed)
