"""design: a study and earlier results -> plan.h5 with its forecast, and references/*.csv."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from elastid.app.run import Run
from elastid.app.tables import forecast_table
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.base.files import clear_folder
from elastid.design.design import design as design_experiments
from elastid.design.problem import DesignProblem
from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.references import Reference, reference
from elastid.experiment.simulated.closed_loop import feed_forward_of
from elastid.experiment.simulated.plant import model_of
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.record import Configuration
from elastid.response import FrequencyResponse
from elastid.robot import Robot
from elastid.store import read_fit, read_responses, write_movement, write_plan, write_torque
from elastid.study import LoadedStudy
from elastid.study.checks.design import responses_file


def design(run: Run) -> None:
    """plan.h5 with its forecast, and references/*.csv for a robot controller, within the robot's limits.

    <configuration>-movement.csv: a whole run with its ramps.  <experiment>.csv: one period of torque to inject.
    """
    with run.execution("design") as execution:
        found = design_experiments(design_problem(run.loaded), execution)
        movements = _write_references(run, found.plan, execution)
    plan, forecast, limit_use = found.plan, found.forecast, found.limit_use
    write_plan(run.path("design"), plan, run.stamps["design"], movements, limit_use, forecast, found.nearest)
    run.console.notes(limit_use.notes)
    run.console.say(f"design: {limit_use.closest}")
    run.console.say(
        f"design: {len(plan.experiments)} experiments in {len(plan.configurations)} configurations, {len(plan.lines)} "
        f"lines from {plan.freq_hz[0]:g} to {plan.freq_hz[-1]:g} Hz, {plan.robot_time_s:g} s of the robot's time"
    )
    if forecast.choice:
        run.console.say(f"design: {forecast.choice}")
    run.console.table(forecast_table(forecast))
    run.console.notes(forecast.notes)


def _write_references(run: Run, plan: Plan, execution: Execution) -> tuple[Reference, ...]:
    """references/*.csv; the movement in each configuration."""
    folder = clear_folder(run.folder, "references")
    carrier = run.study.experiment.as_simulated().carrier
    write = partial(_write_configuration, folder, plan, carrier, run.study.as_robot())
    return tuple(execution.ordered(write, plan.configurations))


def _write_configuration(
    folder: Path, plan: Plan, carrier: CarrierSpec | None, robot: Robot, configuration: Configuration
) -> Reference:
    """The files of one configuration; the movement in it."""
    movement = reference(plan, carrier, feed_forward_of(model_of(robot)), configuration)
    write_movement(folder / f"{configuration.name}-movement.csv", movement, plan.inputs, plan.sliding)
    for experiment in plan.experiments:
        if experiment.configuration.name == configuration.name:
            write_torque(folder / f"{experiment.name}.csv", plan, experiment)
    return movement


def design_problem(loaded: LoadedStudy) -> DesignProblem:
    """The study's sections, with the responses and the estimates of the earlier measurements that it names.

    Where several measurements were fitted, the last one's estimate counts.  DataError for a file that cannot be read.
    """
    study = loaded.study
    if study.excitation is None:
        raise StudyError(f"{loaded.path}: excitation: this section is needed to design an experiment")
    measured: list[FrequencyResponse] = []
    found: dict[str, float] = {}
    like: tuple[FrequencyResponse, ...] = ()
    if study.design is not None:
        for path in study.design.measured:
            file = responses_file(loaded.base, path)
            measured += read_responses(file)
            estimate = file.with_name("fit.h5")
            if estimate.is_file():
                result = read_fit(estimate)
                found |= {name: result.values[name] for name in result.parameters.free_names}
        if study.design.noise.frf:
            like = read_responses(responses_file(loaded.base, study.design.noise.frf))
    return DesignProblem(
        robot=study.as_robot(),
        excitation=study.excitation,
        experiment=study.experiment,
        fit=study.fit,
        quantity=study.estimator.quantity,
        seed=study.seed,
        design=study.design,
        left_out=study.validation.left_out,
        measured=tuple(measured),
        found=tuple(found.items()),
        like=like,
        model=study.model,
        friction=study.estimator.friction,
    )
