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

from elastid.arrays import FloatArray
from elastid.errors import DataError, StudyError
from elastid.experiment.movement import check_movement
from elastid.experiment.plan import Experiment, Plan
from elastid.experiment.references import Reference, reference
from elastid.experiment.spec import ExperimentSpec, NoiseSpec, SimulatedSpec
from elastid.linear.equilibrium import equilibrium
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Motion, Record
from elastid.robot import Robot
from elastid.simulation.closed_loop import ClosedLoop, Commands, Trajectory, closed_loop, simulate
from elastid.simulation.controller import Gains, rigid_motion, tuned
from elastid.simulation.dynamics import STABLE_STEP, fastest_rate
from elastid.units import Quantity, to_si


@dataclass(frozen=True)
class SimulatedRig:
    """The plan of a study, carried out on a model of its robot; `seed` draws all noise.

    A record holds plan.periods periods; the ramp and the transient periods before them are simulated and dropped.
    u: what the controller commands and the log sees, held from sample to sample.  y: positions, of a motor as its
    encoder reads it, of a body as its angle from the equilibrium, small.  Under a carrier of constant velocity both are
    about the planned movement, which does not repeat: its angles and its torque are taken out of the log.

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
        plant, q0, given = self._prepared(experiment)
        noise = _draw(self.simulated.noise, plan, len(self.outputs), (self.seed, *_indices(plan, experiment)))
        end = plan.run_samples - plan.first_sample  # the way out is not measured
        trajectory = self._moved(plant, q0, given, experiment, noise, 1.0, end)
        measured = slice(end - plan.periods * plan.period_samples, end)
        u, y = trajectory.u + noise.torque[:end], _sensed(trajectory, plant.model, q0, self.outputs, noise)
        if self.simulated.carrier is not None and self.simulated.carrier.kind == "offset":
            C = plant.model.output_jacobian(q0, self.outputs) @ rigid_motion(plant.model)
            u, y = u - given.feed_forward[:end], y - (given.position[:end] - experiment.configuration.angles) @ C.T
        position: Motion = "position"
        return Record(
            name=experiment.name,
            configuration=experiment.configuration,
            realisation=experiment.realisation,
            experiment=experiment.experiment,
            rate_hz=plan.rate_hz,
            period_samples=plan.period_samples,
            inputs=plan.inputs,
            outputs=self.outputs,
            quantities=(position,) * len(self.outputs),
            u=u[measured],
            y=y[measured],
            r=np.tile(plan.torque(experiment), (plan.periods, 1)),
            notes=_exceeded(plant.model.robot, trajectory, plant.model.B, plan.rate_hz),
            hold="zero-order",
        )

    def rehearse(self, experiment: Experiment, factor: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Motor angles and torques (n, n_u) of a whole run, ramps and holds included, the multisine times `factor`.

        DataError where a motor is lost, StudyError where the steps are too long for the robot.
        """
        plant, q0, given = self._prepared(experiment)
        noise = _draw(self.simulated.noise, self.plan, len(self.outputs), (self.seed, *_indices(self.plan, experiment)))
        trajectory = self._moved(plant, q0, given, experiment, noise, factor, self.plan.run_samples)
        return trajectory.q @ plant.model.B, trajectory.u

    def _prepared(self, experiment: Experiment) -> tuple[_Plant, FloatArray, Reference]:
        """The true robot, its equilibrium, and what its controller is given."""
        spec, rate_hz = self.simulated, self.plan.rate_hz
        plant = _plant(
            true_robot(self.robot, spec.truth), spec.model, rate_hz, spec.substeps, spec.noise.encoder_counts
        )
        q0 = equilibrium(plant.model, plant.model.theta, experiment.configuration).q
        _check_steps(plant, q0, experiment, spec.substeps, rate_hz)
        return plant, q0, reference(self.plan, spec.carrier, plant.model, q0, experiment.configuration)

    def _moved(
        self,
        plant: _Plant,
        q0: FloatArray,
        given: Reference,
        experiment: Experiment,
        noise: _Noise,
        factor: float,
        n: int,
    ) -> Trajectory:
        """The first n samples of a run, from rest where the reference begins."""
        spec = self.simulated
        gains = tuned(plant.model, q0, spec.controller.bandwidth_hz, spec.controller.damping_ratio)
        torque = given.feed_forward + given.injected(factor * self.plan.torque(experiment))
        commands = Commands(
            given.position[:n], given.velocity[:n], torque[:n], noise.disturbance[:n], noise.reading[:n]
        )
        start = q0 + rigid_motion(plant.model) @ (given.position[0] - experiment.configuration.angles)
        return _run(plant.loop, gains, commands, start, experiment)


@dataclass(frozen=True, eq=False)
class _Plant:
    """The true robot as equations, alone and in its loop; coulomb (n_u,) in Nm, link side."""

    model: ElasticModel
    loop: ClosedLoop
    coulomb: FloatArray


@dataclass(frozen=True)
class _Noise:
    """White noise over the whole run: Nm (n, n_u), rad (n, n_u), Nm (n, n_u), rad (n, n_y)."""

    torque: FloatArray
    reading: FloatArray
    disturbance: FloatArray
    outputs: FloatArray


def true_robot(robot: Robot, truth: Mapping[str, Quantity]) -> Robot:
    """The robot with the numbers that the identification must find; StudyError for a name that it does not have."""
    unit = {name: unit for name, (_, unit) in robot.parameters().items()}
    try:
        # A name that the robot does not have gets any number; with_parameters refuses it and says which there are.
        return robot.with_parameters(
            {name: to_si(value, unit[name]) if name in unit else 0.0 for name, value in truth.items()}
        )
    except ValueError as error:
        raise StudyError(f"experiment.simulated.truth: {error}") from None


@lru_cache(maxsize=4)
def _plant(robot: Robot, equations: ModelSpec, rate_hz: float, substeps: int, encoder_counts: int) -> _Plant:
    """Built once in a process: CasADi expressions do not pickle."""
    model = formulate(robot, equations)
    motors = [(joint.motor, joint.limits) for joint in robot.driven if joint.motor is not None]
    coulomb = np.array([abs(motor.ratio) * motor.coulomb for motor, _ in motors])
    per_turn = [encoder_counts * abs(motor.ratio) for motor, _ in motors]
    resolution = np.array([2 * math.pi / counts if counts else 0.0 for counts in per_turn])
    limits = np.array([limits.angle for _, limits in motors])
    return _Plant(model, closed_loop(model, coulomb, limits, rate_hz, substeps, resolution), coulomb)


def _indices(plan: Plan, experiment: Experiment) -> tuple[int, int, int]:
    names = [configuration.name for configuration in plan.configurations]
    return names.index(experiment.configuration.name), experiment.realisation, experiment.experiment


def _draw(spec: NoiseSpec, plan: Plan, n_y: int, seed: tuple[int, ...]) -> _Noise:
    n = plan.run_samples
    random = np.random.default_rng(np.random.SeedSequence(seed))
    n_u = len(plan.inputs)
    return _Noise(
        torque=spec.torque_std * random.standard_normal((n, n_u)),
        reading=spec.angle_std * random.standard_normal((n, n_u)),
        disturbance=spec.disturbance_std * random.standard_normal((n, n_u)),
        outputs=spec.angle_std * random.standard_normal((n, n_y)),
    )


def _run(loop: ClosedLoop, gains: Gains, commands: Commands, q0: FloatArray, experiment: Experiment) -> Trajectory:
    try:
        return simulate(loop, gains, commands, q0)
    except DataError as error:
        raise DataError(
            f"configuration {experiment.configuration.name}, realisation {experiment.realisation}, experiment "
            f"{experiment.experiment}: {error}. Lower excitation.torque_rms, raise "
            "experiment.simulated.controller.bandwidth_hz, or move the configuration away from its limits"
        ) from None


def _check_steps(plant: _Plant, q0: FloatArray, experiment: Experiment, substeps: int, rate_hz: float) -> None:
    rate = fastest_rate(plant.model, plant.coulomb, q0)
    needed = math.ceil(rate / rate_hz / STABLE_STEP)
    if substeps < needed:
        raise StudyError(
            f"experiment.simulated.substeps: {substeps} steps a sample cannot follow the fastest motion of robot "
            f"{plant.model.robot.name} in configuration {experiment.configuration.name} (a pole of {rate:.4g} 1/s: its "
            f"stiffest mode, or Coulomb friction at standstill); take at least {needed}"
        )


def _sensed(
    trajectory: Trajectory, model: ElasticModel, q0: FloatArray, outputs: tuple[str, ...], noise: _Noise
) -> FloatArray:
    """What the log reads (n, n_y): encoders, joint angles, and C (q - q0) for a body, to first order."""
    C = model.output_jacobian(q0, outputs)
    y = trajectory.q @ C.T + noise.outputs[: len(trajectory.q)]
    for column, place in enumerate(outputs):
        if place in model.inputs:
            y[:, column] = trajectory.reading[:, model.inputs.index(place)]
        elif place.startswith("body "):
            y[:, column] -= C[column] @ q0
    return y


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
            if peak > limit:
                notes.append(
                    f"motor {joint.name} went to {peak:.4g} {unit}, beyond its limit of {limit:.4g} {unit}; "
                    "lower excitation.torque_rms"
                )
    return tuple(notes)
