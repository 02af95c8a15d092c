"""Peaks of rehearsed runs: torque, position, velocity, acceleration and turning back of the nominal robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.execution import Execution
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.plan.rehearsal import Rehearsal, derivatives
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.record import Configuration
from elastid.robot import Robot


def nominal_rig(plan: Plan, experiment: ExperimentSpec, robot: Robot, seed: int) -> SimulatedRig:
    """The rig that rehearses a plan: the simulated one without its truth."""
    return SimulatedRig(robot, experiment.with_truth({}), plan, seed)


def nearest_run(plan: Plan, name: str, experiment: ExperimentSpec, robot: Robot, seed: int) -> Rehearsal:
    """The rehearsal of the run `name`, the one nearest to a limit, repeated for its signals."""
    run = next(run for run in plan.experiments if run.name == name)
    position, torque = nominal_rig(plan, experiment, robot, seed).rehearse(run)
    return Rehearsal(run, plan.rate_hz, plan.first_sample, position, torque)


def limits_of(robot: Robot, configuration: Configuration, carrier: CarrierSpec | None, plan: Plan) -> FloatArray:
    """Limits (5, n_u) in a configuration, in the order of QUANTITIES."""
    limits = [joint.limits for joint in robot.driven]
    angles = configuration.angles
    room = [min(one.angle[1] - angle, angle - one.angle[0]) for one, angle in zip(limits, angles, strict=True)]
    is_offset = carrier is not None and carrier.kind == "offset"
    v = np.abs(carrier.velocities(len(plan.inputs))) if carrier is not None and is_offset else np.inf
    rows = ([x.torque for x in limits], room, [x.velocity for x in limits], [x.acceleration for x in limits])
    return np.array([*rows, np.broadcast_to(v, len(limits))], dtype=np.float64)


def rehearsed_peaks(
    rig: SimulatedRig, factor: FloatArray, wanted: BoolArray, execution: Execution
) -> dict[str, FloatArray]:
    """Peaks (5, n_u) of every run of the wanted configurations (Q,), by its name; amplitudes times factor (Q, n_u)."""
    plan = replace(rig.plan, R=rig.plan.R * factor[:, None, None, None, :])
    names = {c.name for c, is_wanted in zip(plan.configurations, wanted, strict=True) if is_wanted}
    todo = [e for e in plan.experiments if e.configuration.name in names]
    found = execution.ordered(partial(_peaks_of, replace(rig, plan=plan)), todo)
    return {experiment.name: one for experiment, one in zip(todo, found, strict=True)}


def largest_peaks(plan: Plan, runs: Mapping[str, FloatArray]) -> FloatArray:
    """Largest peaks (Q, 5, n_u) of the runs in each configuration."""
    of = {
        c.name: [runs[e.name] for e in plan.experiments if e.configuration.name == c.name] for c in plan.configurations
    }
    return np.array([np.max(of[c.name], axis=0) for c in plan.configurations])


def nearest_to_limits(plan: Plan, runs: Mapping[str, FloatArray], limit: FloatArray) -> str:
    """The name of the run that comes closest to a limit (Q, 5, n_u)."""
    index = {c.name: q for q, c in enumerate(plan.configurations)}
    return max(plan.experiments, key=lambda e: float((runs[e.name] / limit[index[e.configuration.name]]).max())).name


def peaks_of_movement(rig: SimulatedRig, experiment: Experiment) -> FloatArray:
    """Peaks (5, n_u) without multisine; StudyError where even so a motor is lost."""
    try:
        return peaks_of_run(rig, experiment, *rig.rehearse(experiment, 0.0))
    except DataError as error:
        raise StudyError(f"the robot leaves its configuration without any excitation: {error}") from None


def peaks_of_run(rig: SimulatedRig, experiment: Experiment, position: FloatArray, torque: FloatArray) -> FloatArray:
    """Peaks (5, n_u) of motor angles and torques (n, n_u) of a whole run."""
    plan = rig.plan
    velocity, acceleration = derivatives(position, plan.rate_hz)
    rows = [torque, position - experiment.configuration.angles, velocity, acceleration]
    largest = [np.abs(row).max(axis=0) for row in rows]
    carrier = rig.simulated.carrier
    back = np.zeros(len(plan.inputs))
    if carrier is not None and carrier.kind == "offset":
        v = carrier.velocities(len(plan.inputs))
        end = plan.run_samples - plan.first_sample
        measured = velocity[end - plan.periods * plan.period_samples : end]
        back = np.maximum(0.0, np.abs(v) - (np.sign(v) * measured).min(axis=0))
    return np.array([*largest, back])


def _peaks_of(rig: SimulatedRig, experiment: Experiment) -> FloatArray:
    """Peaks (5, n_u) of one run, twice the limits where a motor is lost."""
    try:
        position, torque = rig.rehearse(experiment)
    except DataError:
        limit = limits_of(rig.robot, experiment.configuration, rig.simulated.carrier, rig.plan)
        return np.where(np.isfinite(limit), 2 * limit, 0.0)
    return peaks_of_run(rig, experiment, position, torque)
