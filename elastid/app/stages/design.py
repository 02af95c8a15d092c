"""Stage design: a study -> plan.h5 with its forecast, and references/*.csv for a robot controller."""

import shutil
from functools import partial
from pathlib import Path

import numpy as np

from elastid.app.console import Console
from elastid.app.run import Artefacts, Work
from elastid.base.display import number, relative_std
from elastid.base.errors import StudyError
from elastid.design.design import design as design_experiments
from elastid.design.forecast import Forecast
from elastid.design.problem import DesignProblem
from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.reference_trajectory import Reference, reference
from elastid.experiment.simulated.plant import feed_forward_of, model_of
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.store.artefacts import Stamp
from elastid.store.plan import write_plan
from elastid.store.trajectory import write_references, write_run, write_torque
from elastid.study import Study


def design(study: Study, work: Work) -> Artefacts:
    """Design the experiments: plan.h5 with its forecast, and references/*.csv within the robot's limits.

    <experiment>.csv: one period of injected torque, with <configuration>-movement.csv for the whole run; or, for
    injected references, the references of the whole run.  Raises StudyError for a design without a solution.
    """
    problem = problem_of(study)
    robot = problem.robot
    carrier = study.experiment.as_simulated().carrier
    with work.execution() as execution:
        experiments = design_experiments(problem, execution)
        movement = partial(movement_of, experiments.plan, carrier, robot)
        movements = tuple(execution.ordered(movement, experiments.plan.configurations))
    plan, forecast, limit_use = experiments.plan, experiments.forecast, experiments.limit_use

    def report(console: Console) -> None:
        """Report limits, robot time, choice of configurations and forecast."""
        console.notes(limit_use.notes)
        length_s = plan.run_samples / plan.rate_hz
        console.say(
            f"design: {len(plan.experiments)} experiments of {length_s:g} s in {len(plan.configurations)} "
            f"configurations ({plan.robot_time_s:g} s of robot time); torque at {len(plan.lines)} DFT lines from "
            f"{plan.freq_hz[0]:g} to {plan.freq_hz[-1]:g} Hz"
        )
        signals = "one trajectory per experiment, one row per cycle"
        if plan.inject == "torque":
            signals = "one period of the torque signals per experiment. Add them to the controller's torques and play"
            signals += f" {plan.periods + plan.transient_periods} periods without a gap"
        # A run of all stages simulates the experiment and does not need the files.
        say = console.say if console.shows_tables else console.detail
        say(f"design: {limit_use.closest}")
        say(f"design: largest peaks in percent of the limits: {limit_use.by_quantity}")
        say(f"design: references/*.csv: {signals}")
        if forecast.choice:
            console.say(f"design: {forecast.choice}")
        # Relative standard deviations below 1e-9 are rounding.
        if np.nanmax(np.where(np.isfinite(forecast.relative), forecast.relative, 0.0)) < 1e-9:
            console.say("design: no predicted intervals, because experiment.simulated.noise is missing")
        else:
            console.table(forecast_table(forecast))
        console.notes(forecast.notes)

    def write(path: Path, stamp: Stamp) -> None:
        write_plan(path, plan, stamp, movements, limit_use, forecast)

    def write_files(folder: Path, stamp: Stamp) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        with work.execution() as execution:
            execution.ordered(partial(_write_configuration, folder, problem, plan), movements)

    return Artefacts({"references": write_files, "plan.h5": write}, report)


def problem_of(study: Study) -> DesignProblem:
    """Return the design problem of a study; StudyError for a study without an excitation."""
    if study.excitation is None:
        raise StudyError("study/stage", "this section is needed to design an experiment", "excitation")
    sections = study.excitation, study.experiment, study.fit, study.estimator.quantity, study.seed, study.design
    return DesignProblem(
        study.as_robot(), *sections, excluded_configurations=study.validation.configurations, model=study.model,
        friction=study.estimator.friction
    )  # fmt: skip


def movement_of(plan: Plan, carrier: CarrierSpec | None, robot: Robot, configuration: Configuration) -> Reference:
    """Plan the movement in one configuration. The equations are built here, because they do not pickle."""
    return reference(plan, carrier, feed_forward_of(model_of(robot.carrying(configuration.has_payload))), configuration)


def _write_configuration(folder: Path, problem: DesignProblem, plan: Plan, movement: Reference) -> None:
    configuration, is_torque = movement.configuration.name, plan.inject == "torque"
    if is_torque:
        write_run(folder / f"{configuration}-movement.csv", movement, plan.inputs, plan.sliding)
    for experiment in plan.experiments:
        path = folder / f"{experiment.name}.csv"
        if experiment.configuration.name == configuration and is_torque:
            write_torque(path, plan, experiment)
        elif experiment.configuration.name == configuration:
            write_references(path, plan, experiment, problem.simulated, problem.robot)


def forecast_table(forecast: Forecast) -> list[list[str]]:
    """Return headings and a row per parameter: predicted std with its contributions, largest correlation."""
    columns = {**forecast.std_contributions, "expected std": forecast.std}
    rows = [["parameter", "unit", "nominal", *columns, "most correlated with"]]
    for i, name in enumerate(forecast.parameters):
        partner, correlation = forecast.strongest(name)
        nominal = float(forecast.nominal[i])
        deviations = [relative_std(nominal, float(std[i])) for std in columns.values()]
        partner_text = f"{partner} {correlation:+.2f}" if partner else "–"
        rows.append([name, forecast.units[i], number(nominal), *deviations, partner_text])
    return rows
