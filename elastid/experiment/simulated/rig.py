"""The rig that is a model: the one place where the model wing feeds the measured wing.

The robot of the study, some of its numbers replaced by a truth that the fit must find, is simulated in closed loop with
friction, encoders and noise. What it logs goes the way of every measured record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.units import Quantity, of_translation, to_si
from elastid.experiment.plan.movement import check_movement
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.plan.references import Reference, reference
from elastid.experiment.simulated.hardware import Noise, drawn, drives, filtered, friction_of_a_run
from elastid.experiment.simulated.sensors import logged_quantity, planned, sensed
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import EncoderRippleSpec, SimulatedSpec, TorqueRippleSpec
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Record
from elastid.robot import Robot
from elastid.simulation.baumgarte import violation
from elastid.simulation.closed_loop import ClosedLoop, Commands, Trajectory, closed_loop, simulate
from elastid.simulation.controller import Gains, rigid_path, tuned
from elastid.simulation.dynamics import STABLE_STEP, fastest_rate
from elastid.simulation.friction_states import contacts
from elastid.simulation.spec import StabilisationSpec

# m between the ends of a loop that a simulation may leave without a word.
OPEN = 1e-6
# Part of the measured samples in which a motor may be at its torque limit.
MOSTLY_CLIPPED = 0.5


@dataclass(frozen=True)
class SimulatedRig:
    """The plan of a study, carried out on a model of its robot; `seed` draws all noise.

    A record holds plan.periods periods; the ramp and the transient periods before them are simulated and dropped.
    u: what the controller commands and the log sees, held from sample to sample.  y: positions, of a motor as its
    encoder reads it, of a body as its angle from the equilibrium, small; of points accelerations (`sensors`).  Under a
    carrier of constant velocity both are about the planned movement, which does not repeat: its angles, accelerations
    and torque are taken out of the log.

    Raises StudyError where the robot has other motors than the plan, or the carrier meets the excitation or
    leaves the joints' limits.
    """

    robot: Robot
    spec: ExperimentSpec
    plan: Plan
    seed: int

    def __post_init__(self) -> None:
        """Look before the robot moves."""
        true_robot(self.robot, self.simulated.truth)
        if self.plan.inputs != self.robot.motor_locations:
            raise StudyError(
                f"the plan excites {', '.join(self.plan.inputs)}, robot {self.robot.name} has "
                f"{', '.join(self.robot.motor_locations)}; design the plan for this robot"
            )
        for place in self.outputs:
            self.robot.check_location(place)
        if self.robot.chain.differentiator is not None:
            raise StudyError(
                f"robot {self.robot.name}: chain.differentiator: the simulated rig logs positions, which nothing "
                "differentiates; leave it out of the robot's chain"
            )
        if self.simulated.carrier is not None:
            check_movement(self.simulated.carrier, self.plan, self.robot)

    @property
    def simulated(self) -> SimulatedSpec:
        """The study's section `experiment.simulated`."""
        if self.spec.simulated is None:
            raise StudyError("experiment: the rig of this study is recorded; there is nothing to simulate")
        return self.spec.simulated

    @property
    def outputs(self) -> tuple[str, ...]:
        """The places that are logged."""
        return self.simulated.outputs or self.robot.motor_locations

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """All runs of the plan."""
        return self.plan.experiments

    def measure(self, experiment: Experiment) -> Record:
        """Simulate one run. DataError where a motor is lost, StudyError where the steps are too long for the robot."""
        plan = self.plan
        plant, point, given = self._prepared(experiment)
        q0 = point.q
        noise = self._noise(experiment)
        end = plan.run_samples - plan.first_sample  # the way out is not measured
        trajectory = self._moved(plant, point, given, experiment, noise, 1.0, end)
        measured = slice(end - plan.periods * plan.period_samples, end)
        told = (plant.model, q0, self.outputs, plan.rate_hz, plan.period_samples)
        u = trajectory.u + noise.torque[:end]
        y = sensed(trajectory.q, trajectory.reading, *told) + noise.outputs[:end]
        y = filtered(plant.model.robot, y, plan.rate_hz)
        if self.simulated.carrier is not None and self.simulated.carrier.kind == "offset":
            moved = given.position[:end] - experiment.configuration.angles
            u, y = u - given.feed_forward[:end], y - planned(moved, *told)
        return Record(
            name=experiment.name,
            configuration=experiment.configuration,
            realisation=experiment.realisation,
            experiment=experiment.experiment,
            rate_hz=plan.rate_hz,
            period_samples=plan.period_samples,
            inputs=plan.inputs,
            outputs=self.outputs,
            quantities=tuple(logged_quantity(place) for place in self.outputs),
            u=u[measured],
            y=y[measured],
            r=np.tile(plan.torque(experiment), (plan.periods, 1)),
            notes=(
                *_clipped(trajectory.u[measured], plant, experiment),
                *_exceeded(plant.model.robot, trajectory, plant.model.B, plan.rate_hz),
                *_opened(plant.model, trajectory),
            ),
            hold="zero-order",
            sliding=self.robot.sliding((*plan.inputs, *self.outputs)),
        )

    def rehearse(self, experiment: Experiment, factor: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Motor angles and torques (n, n_u) of a whole run, ramps and holds included, the multisine times `factor`.

        DataError where a motor is lost, StudyError where the steps are too long for the robot.
        """
        plant, point, given = self._prepared(experiment)
        noise = self._noise(experiment)
        trajectory = self._moved(plant, point, given, experiment, noise, factor, self.plan.run_samples)
        return trajectory.q @ plant.model.B, trajectory.u

    def _noise(self, experiment: Experiment) -> Noise:
        plan = self.plan
        return drawn(self.simulated.noise, plan, self.outputs, (self.seed, *_indices(plan, experiment)))

    def _prepared(self, experiment: Experiment) -> tuple[_Plant, OperatingPoint, Reference]:
        """The true robot, its equilibrium, and what its controller is given."""
        spec, rate_hz = self.simulated, self.plan.rate_hz
        hardware = spec.noise.encoder_counts, spec.encoder_ripple, spec.torque_ripple, spec.saturation
        plant = _plant(true_robot(self.robot, spec.truth), spec.model, spec.loops, rate_hz, spec.substeps, *hardware)
        point = equilibrium(plant.model, plant.model.theta, experiment.configuration)
        _check_steps(plant, point.q, experiment, spec.substeps, rate_hz)
        return plant, point, reference(self.plan, spec.carrier, plant.model, point.q, experiment.configuration)

    def _moved(
        self,
        plant: _Plant,
        point: OperatingPoint,
        given: Reference,
        experiment: Experiment,
        noise: Noise,
        factor: float,
        n: int,
    ) -> Trajectory:
        """The first n samples of a run, from rest where the reference begins."""
        spec, q0 = self.simulated, point.q
        controller, sliding = spec.controller, plant.loop.contacts
        integral_time = controller.velocity_integral_time
        gains = tuned(plant.model, q0, controller.bandwidth_hz, controller.damping_ratio, integral_time)
        curves = friction_of_a_run(sliding, plant.model.robot, point, spec.warming, self.plan, experiment, self.seed)
        torque = given.feed_forward + given.injected(factor * self.plan.torque(experiment))
        commands = Commands(
            given.position[:n], given.velocity[:n], torque[:n], noise.disturbance[:n], noise.reading[:n]
        )
        (start,) = rigid_path(plant.model, q0, experiment.configuration.angles, given.position[:1])
        return _run(plant.loop, gains, commands, start, curves[:n] if curves.ndim > 1 else curves, experiment)


@dataclass(frozen=True, eq=False)
class _Plant:
    """The true robot as equations, alone and in its loop."""

    model: ElasticModel
    loop: ClosedLoop


def true_robot(robot: Robot, truth: Mapping[str, Quantity]) -> Robot:
    """The robot with the numbers that the identification must find; StudyError for a name that it does not have."""
    unit = {name: unit for name, (_, unit) in robot.parameters(robot.geometry).items()}
    try:
        # A name that the robot does not have gets any number; with_parameters refuses it and says which there are.
        return robot.with_parameters(
            {name: to_si(value, unit[name]) if name in unit else 0.0 for name, value in truth.items()}
        )
    except ValueError as error:
        raise StudyError(f"experiment.simulated.truth: {error}") from None


@lru_cache(maxsize=4)
def _plant(
    robot: Robot,
    equations: ModelSpec,
    loops: StabilisationSpec,
    rate_hz: float,
    substeps: int,
    encoder_counts: int,
    encoder_ripple: tuple[EncoderRippleSpec, ...],
    torque_ripple: tuple[TorqueRippleSpec, ...],
    saturation: bool,
) -> _Plant:
    """Built once in a process: CasADi expressions do not pickle."""
    model = formulate(robot, equations)
    limits = np.array([joint.limits.angle for joint in robot.driven])
    hardware = drives(robot, encoder_counts, encoder_ripple, torque_ripple, saturation)
    sliding = contacts(model, frictions(robot))
    return _Plant(model, closed_loop(model, sliding, limits, rate_hz, substeps, hardware, loops))


def _indices(plan: Plan, experiment: Experiment) -> tuple[int, int, int]:
    names = [configuration.name for configuration in plan.configurations]
    return names.index(experiment.configuration.name), experiment.realisation, experiment.experiment


def _run(
    loop: ClosedLoop, gains: Gains, commands: Commands, q0: FloatArray, curves: FloatArray, experiment: Experiment
) -> Trajectory:
    try:
        return simulate(loop, gains, commands, q0, curves)
    except DataError as error:
        raise DataError(
            f"configuration {experiment.configuration.name}, realisation {experiment.realisation}, experiment "
            f"{experiment.experiment}: {error}. Lower excitation.torque_rms, raise "
            "experiment.simulated.controller.bandwidth_hz, or move the configuration away from its limits"
        ) from None


def _check_steps(plant: _Plant, q0: FloatArray, experiment: Experiment, substeps: int, rate_hz: float) -> None:
    rate = fastest_rate(plant.model, plant.loop.contacts, q0)
    needed = math.ceil(rate / rate_hz / STABLE_STEP)
    if substeps < needed:
        raise StudyError(
            f"experiment.simulated.substeps: {substeps} steps a sample cannot follow the fastest motion of robot "
            f"{plant.model.robot.name} in configuration {experiment.configuration.name} (a pole of {rate:.4g} 1/s: its "
            f"stiffest mode, or friction at standstill); take at least {needed}, or raise excitation.rate_hz"
        )


def _clipped(u: FloatArray, plant: _Plant, experiment: Experiment) -> tuple[str, ...]:
    """A word for every motor whose measured torque u (n, n_u) was clipped; DataError where it mostly was."""
    part = np.mean(np.abs(u) >= plant.loop.drives.torque, axis=0)
    words = []
    for name, share, limit in zip(plant.model.inputs, part.tolist(), plant.loop.drives.torque.tolist(), strict=True):
        unit = "N" if plant.model.robot.slides(name) else "N*m"
        if share > MOSTLY_CLIPPED:
            raise DataError(
                f"configuration {experiment.configuration.name}, realisation {experiment.realisation}, experiment "
                f"{experiment.experiment}: {name} is at its torque limit of {limit:.4g} {unit} in {share:.0%} of the "
                "measured samples, so that nothing is controlled; lower excitation.torque_rms, move the configuration "
                "to where gravity takes less, or correct limits.torque"
            )
        if share > 0:
            words.append(
                f"{name} was clipped at its torque limit of {limit:.4g} {unit} in {max(share, 1e-4):.2%} of the "
                f"measured samples of configuration {experiment.configuration.name}, realisation "
                f"{experiment.realisation}, experiment {experiment.experiment}: the response is no longer linear; "
                "lower excitation.torque_rms"
            )
    return tuple(words)


def _opened(model: ElasticModel, trajectory: Trajectory) -> tuple[str, ...]:
    """A word where the loops did not stay closed."""
    left = violation(model, trajectory.q)
    if left <= OPEN:
        return ()
    return (
        f"the loops of robot {model.robot.name} opened by up to {left:.2g} m in the simulation; set "
        "experiment.simulated.loops.project: true, or take more substeps",
    )


def _exceeded(robot: Robot, trajectory: Trajectory, B: FloatArray, rate_hz: float) -> tuple[str, ...]:
    """A word for every motor that went beyond its limits; the simulation does not clip."""
    torque = np.abs(trajectory.u).max(axis=0)
    velocity = np.diff(trajectory.q @ B, axis=0) * rate_hz
    speed = np.abs(velocity).max(axis=0)
    acceleration = np.abs(np.diff(velocity, axis=0)).max(axis=0) * rate_hz
    notes = []
    for i, joint in enumerate(robot.driven):
        for peak, limit, unit in (
            (torque[i], joint.limits.torque, "N*m"),
            (speed[i], joint.limits.velocity, "rad/s"),
            (acceleration[i], joint.limits.acceleration, "rad/s^2"),
        ):
            unit = of_translation(unit) if joint.slides else unit
            if peak > limit:
                notes.append(
                    f"motor {joint.name} went to {peak:.4g} {unit}, beyond its limit of {limit:.4g} {unit}; "
                    "lower excitation.torque_rms"
                )
    return tuple(notes)
