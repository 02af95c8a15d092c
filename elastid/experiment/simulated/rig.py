"""The simulated rig: the one place where the model wing feeds the measured wing.

The robot of the study, some of its numbers replaced by a truth that the fit must find, is simulated in closed loop with
friction, encoders and noise. Its records are treated like measured ones.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, Note, StudyError
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.plan.reference_trajectory import Reference, Rehearsal, check_movement, reference, references
from elastid.experiment.simulated.hardware import (
    Noise,
    draw_noise,
    filter_motions,
    friction_coefficients,
    logged_quantity,
    sense,
    sense_movement,
)
from elastid.experiment.simulated.plant import Plant, feed_forward_of, limit_note, limit_notes, true_plant, true_robot
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.record import JointLoop, Motion, Record, motion_unit
from elastid.robot import Robot, log_signal
from elastid.simulation.closed_loop import Commands, Trajectory, simulate
from elastid.simulation.controller import feedback_of, gains_of, rigid_path
from elastid.simulation.reference_path import ReferencePath


@dataclass(frozen=True)
class _Run:
    """An experiment on a robot: the reference and the gains of its controller, and all noise."""

    experiment: Experiment
    plant: Plant
    reference: Reference
    gains: JointLoop
    noise: Noise


@dataclass(frozen=True, eq=False)
class SimulatedRig:
    """The plan of a study, carried out on a model of its robot; `seed` draws all noise.

    A record holds plan.periods periods; the ramp and the transient periods before them are simulated and dropped.
    u: commanded torques as logged, held from sample to sample.  y: positions, of a motor as its encoder reads it, of a
    body as its (small) angle from the equilibrium; accelerations of points.  Under a carrier of constant velocity both
    are about the planned movement, which does not repeat: its angles, accelerations and torque are taken out.
    StudyError where the robot has other motors than the plan, or the carrier meets the excitation or leaves the limits.
    """

    robot: Robot
    spec: ExperimentSpec
    plan: Plan
    seed: int

    def __post_init__(self) -> None:
        true_robot(self.robot, self.simulated.truth)
        if self.plan.inputs != self.robot.motor_locations:
            raise StudyError(
                "experiment/simulated",
                f"the plan excites {', '.join(self.plan.inputs)}, robot {self.robot.name} has "
                f"{', '.join(self.robot.motor_locations)}; design the plan for this robot",
            )
        for location in self.outputs:
            self.robot.check_location(location)
        if self.robot.chain.differentiator is not None:
            raise StudyError(
                "experiment/simulated",
                f"robot {self.robot.name}: chain.differentiator has no effect on the simulated rig, which logs "
                "positions. Remove it from the robot's chain",
            )
        if self.simulated.carrier is not None:
            check_movement(self.simulated.carrier, self.plan, self.robot)

    @property
    def simulated(self) -> SimulatedSpec:
        """The study's section `experiment.simulated`."""
        return self.spec.as_simulated()

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
        run = self._prepare(experiment)
        plant, trajectory = run.plant, self._trajectory(run, 1.0, self.plan.measured.stop)
        notes = (
            *limit_notes(plant, experiment.name, trajectory.u[self.plan.measured], range(plant.model.n_u)),
            *_too_fast(plant.model.robot, trajectory, plant.model.B, self.plan.rate_hz),
        )
        return self._record(run, trajectory, notes)

    def log(self, experiment: Experiment) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Simulate the injected torque and the sensors' torques (n, n_u) and outputs (n, n_y) of a whole run."""
        run = self._prepare(experiment)
        injected = run.reference.injected(self.plan.torque(experiment))
        return injected, *self._sense(run, self._trajectory(run, 1.0, self.plan.run_samples))

    def _sense(self, run: _Run, trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
        """Compute u (n, n_u) and y (n, n_y) of a trajectory, with noise, filters and gains of the sensors."""
        plan, end = self.plan, len(trajectory.u)
        noise, reference, robot = run.noise, run.reference, run.plant.model.robot
        setup = (run.plant.model, run.plant.point.q, self.outputs, plan.rate_hz, plan.period_samples)
        u = trajectory.u + noise.torque[:end]
        y = sense(trajectory.q, trajectory.reading, *setup) + noise.outputs[:end]
        y = filter_motions(robot, y, plan.rate_hz)
        if self.simulated.carrier is not None and self.simulated.carrier.kind == "offset":
            offset = reference.position[:end] - run.experiment.configuration.angles
            u, y = u - reference.feed_forward[:end], y - sense_movement(offset, *setup)
        u_channels, y_channels = robot.chain.at("u", plan.inputs), robot.chain.at("y", self.outputs)
        return log_signal(u, plan.rate_hz, u_channels), log_signal(y, plan.rate_hz, y_channels)

    def _record(self, run: _Run, trajectory: Trajectory, notes: tuple[Note, ...]) -> Record:
        plan, experiment = self.plan, run.experiment
        u, y = (signal[plan.measured] for signal in self._sense(run, trajectory))
        r = np.tile(plan.torque(experiment), (plan.periods, 1))
        names = experiment.name, experiment.configuration, experiment.realisation, experiment.experiment
        timing, locations = (plan.rate_hz, plan.period_samples), (plan.inputs, self.outputs)
        quantities = tuple(logged_quantity(location) for location in self.outputs)
        return Record(
            *names, *timing, *locations, quantities, u, y, r, notes=notes, hold="zero-order",
            sliding=self.robot.sliding((*plan.inputs, *self.outputs)),
            sampled=(True,) * len(self.outputs),  # also accelerations, which are those of sampled motions
        )  # fmt: skip

    def rehearse(self, experiment: Experiment, factor: float = 1.0) -> Rehearsal:
        """Simulate a run without the errors of its sensors, ramps and holds included, the multisine times `factor`.

        DataError where a motor is lost, StudyError where the steps are too long for the robot.
        """
        run = self._prepare(experiment)
        trajectory = self._trajectory(run, factor, self.plan.run_samples)
        position, plan = trajectory.q @ run.plant.model.B, self.plan
        rows = references(plan, self.simulated.carrier, experiment, factor)
        return Rehearsal(experiment, plan.rate_hz, plan.first_sample, position, trajectory.u, rows)

    def with_gains(self, position: float, velocity: float) -> "SimulatedRig":
        """Return rig whose controller has K_p times `position` and K_v times `velocity`."""
        controller = self.simulated.controller.scaled(position, velocity)
        return replace(self, spec=replace(self.spec, simulated=replace(self.simulated, controller=controller)))

    def _prepare(self, experiment: Experiment) -> _Run:
        plan = self.plan
        q = [c.name for c in plan.configurations].index(experiment.configuration.name)
        seed = (self.seed, q, experiment.realisation, experiment.experiment)
        noise = draw_noise(self.simulated.noise, plan.run_samples, plan.rate_hz, len(plan.inputs), self.outputs, seed)
        return _Run(experiment, *_in_configuration(self, q), noise)

    def _commands(self, run: _Run, factor: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position, velocity and torque (n, n_u) that enter the loop, the multisine times `factor`.

        A controller that follows references has no other feed-forward than the torque that holds its start.
        """
        plan, path, experiment = self.plan, run.reference, run.experiment
        if plan.inject == "torque":
            return path.position, path.velocity, path.feed_forward + path.injected(factor * plan.torque(experiment))
        spec = self.simulated.controller.reference
        assert spec is not None  # refused by the plan
        x = ReferencePath(spec, plan.rate_hz).played(references(plan, self.simulated.carrier, experiment, factor))
        holding = np.broadcast_to(path.feed_forward[0], x.shape)
        if plan.inject == "velocity":
            return path.position[0] + np.cumsum(x, axis=0) / plan.rate_hz, x, holding
        return x, spec.velocity_feedforward * (np.diff(x, axis=0, prepend=x[:1]) * plan.rate_hz), holding

    def _trajectory(self, run: _Run, factor: float, n: int) -> Trajectory:
        """Simulate n samples of a run, the multisine times `factor`, from rest where the reference begins."""
        plant, noise, experiment = run.plant, run.noise, run.experiment
        curves = friction_coefficients(plant.loop.contacts, plant.model.robot, plant.point)
        position, velocity, torque = self._commands(run, factor)
        commands = Commands(position[:n], velocity[:n], torque[:n], noise.disturbance[:n], noise.reading[:n])
        (start,) = rigid_path(plant.model, plant.point.q, experiment.configuration.angles, run.reference.position[:1])
        try:
            return simulate(plant.loop, run.gains, commands, start, curves)
        except DataError as error:
            raise DataError(
                "experiment/diverged",
                f"{error}. Lower excitation.torque_rms, move the configuration away from its limits, or leave out "
                "experiment.simulated.controller.gains (`elastid loops` designs others from a run without)",
                experiment.name,
            ) from None


@lru_cache(maxsize=1)
def _in_configuration(rig: SimulatedRig, q: int) -> tuple[Plant, Reference, JointLoop]:
    """Return plant, reference and gains of all runs of the q-th configuration."""
    plan, spec, configuration = rig.plan, rig.simulated, rig.plan.configurations[q]
    plant = true_plant(
        rig.robot, spec, plan.rate_hz, configuration, float(plan.freq_hz[-1]), len(plan.experiments) * plan.run_samples
    )
    gains = feedback_of(gains_of(plant.model, plant.point.q, spec.controller), plan.inject)
    return plant, reference(plan, spec.carrier, feed_forward_of(plant.model), configuration), gains


def _too_fast(robot: Robot, trajectory: Trajectory, B: FloatArray, rate_hz: float) -> Iterator[Note]:
    velocity = np.diff(trajectory.q @ B, axis=0) * rate_hz
    speed, acceleration = np.abs(velocity).max(axis=0), np.abs(np.diff(velocity, axis=0)).max(axis=0) * rate_hz
    for joint, *peaks in zip(robot.driven, speed, acceleration, strict=True):
        quantities: tuple[Motion, ...] = ("velocity", "acceleration")
        for peak, quantity in zip(peaks, quantities, strict=True):
            if peak > (limit := getattr(joint.limits, quantity)):
                yield limit_note(f"motor {joint.name}", peak, limit, motion_unit(quantity, joint.slides))
