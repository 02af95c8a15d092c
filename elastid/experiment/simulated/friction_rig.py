"""The simulated rig of a friction study: one joint of the true robot moves in closed loop, the others are held.

Passes follow their reference; loops and multisines at rest are torques under a loop so slow that friction alone holds
the joint. Motions can be measured in any order and in any process: `heating_history` has all that a joint did before.
"""

import math
from dataclasses import dataclass, replace
from itertools import starmap
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.experiment.plan.friction import (
    FrictionPlan,
    PassLimits,
    PassReference,
    PlannedMotion,
    PlannedPass,
    PlannedWarmUp,
    pass_reference,
    pass_time,
    planned_pass,
)
from elastid.experiment.simulated.hardware import Noise, draw_noise, loads_of
from elastid.experiment.simulated.plant import Plant, holding_torque, limit_notes, model_of, true_plant, true_robot
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import HeatSpec, SimulatedSpec
from elastid.friction.robot_friction import joint_laws
from elastid.friction_record import FrictionRecord, WarmUpLog
from elastid.linear.equilibrium import equilibrium
from elastid.robot import Robot
from elastid.robot.simplified import with_point_mass
from elastid.simulation.closed_loop import Commands, Trajectory, simulate
from elastid.simulation.controller import feed_forward, tune
from elastid.simulation.spec import ControllerSpec


@dataclass(frozen=True)
class FrictionRun:
    """A motion on the true robot: from its rest, joint `index` along `path`, at temperature (n,) or at none."""

    motion: PlannedMotion
    plant: Plant
    index: int
    path: PassReference
    temperature: FloatArray | None

    def simulated(self, controller: ControllerSpec, rate_hz: float, noise: Noise) -> Trajectory:
        """Simulate the motion in closed loop; DataError where the joint is lost."""
        model, point, n = self.plant.model, self.plant.point, len(self.path.position)
        offset, velocity, acceleration, injected = (np.zeros((n, model.n_u)) for _ in range(4))
        injected[:, self.index] = 0.0 if self.motion.torque is None else self.motion.torque
        offset[:, self.index] = self.path.position - point.configuration.angles[self.index]
        velocity[:, self.index], acceleration[:, self.index] = self.path.velocity, self.path.acceleration
        torque = injected + feed_forward(model, point.q, offset, velocity, acceleration)
        position = point.configuration.angles + offset
        position[:, self.index] = self.path.position  # to the last bit
        commands = Commands(position, velocity, torque, noise.disturbance, noise.reading)
        bandwidth_hz = controller.bandwidth_hz
        if self.motion.planned is None and self.motion.period_samples is not None:
            # Ten times slower than the torque, so that the loop does not hold the joint against it.
            bandwidth_hz = min(bandwidth_hz, 0.1 * rate_hz / self.motion.period_samples)
        gains = tune(
            model, point.q, bandwidth_hz, controller.damping_ratio,
            controller.velocity_integral_time if bandwidth_hz == controller.bandwidth_hz else None
        )  # fmt: skip
        try:
            return simulate(self.plant.loop, gains, commands, point.q, self._friction())
        except DataError as error:
            raise DataError(
                "experiment/diverged",
                f"{error}. Raise the controller's bandwidth, or lower speed or torque of this motion",
                self.motion.name,
            ) from None

    def _friction(self) -> FloatArray:
        """Return friction parameters (n, 9 n_f) along the path, at the temperature of the moving joint."""
        contacts, sides = self.plant.loop.contacts, (f"motor {self.motion.joint}", f"joint {self.motion.joint}")

        n = len(self.path.position)
        # It changes slowly: straight lines between those of a hundred samples.
        moments = np.unique(np.linspace(0, n - 1, 100).astype(int))
        holding = holding_torque(self.plant.model, self.plant.point, self.index, self.path.position[moments])

        def curves(moment: int, u: FloatArray) -> FloatArray:
            loads = loads_of(contacts, self.plant.model.robot, replace(self.plant.point, u=u))
            T = None if self.temperature is None else float(self.temperature[moment])
            pairs = zip(contacts.laws, loads, strict=True)
            return np.concatenate([np.zeros(0), *(law.curve(x, T if law.place in sides else None) for law, x in pairs)])

        try:
            table = np.array(list(starmap(curves, zip(moments.tolist(), holding, strict=True))))
            return np.array([np.interp(np.arange(n), moments, column) for column in table.T]).reshape(-1, n).T
        except ValueError as error:
            raise StudyError("experiment/simulated", str(error), self.motion.name) from None


# Motion of a joint from a time to another, in s; its speeds (m,), equally likely ones, none at rest.
_Activity: TypeAlias = tuple[float, float, FloatArray]


def heating_history(
    plan: FrictionPlan, robot: Robot, spec: HeatSpec, joint: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    r"""Simulate times (n + 1,), temperature (n + 1,) in degC of a joint of the true robot, and power (n,) in W.

    .. math:: C \dot T = P - h (T - T_a), \qquad
              T_{k+1} = T_a + (T_k - T_a) e^{-x} + \frac{P_k}{h} (1 - e^{-x}), \quad x = h \Delta t / C

    exact over a step of constant power. Hours are not simulated sample by sample: P of a pass, or of a warm-up between
    its tests, is the mean of tau_f v at the law's torque and the temperature at the beginning of the step.
    """
    viscous = robot.driven[robot.driven_names.index(joint)].all_viscous
    laws = joint_laws(robot, joint)
    times, temperatures, powers = [0.0], [spec.start_degc], list[float]()
    for start, end, speed in _activities(plan, joint):
        steps = max(1, math.ceil((end - start) / 30.0))  # s of constant power
        for end_s in np.linspace(start, end, steps + 1)[1:].tolist():
            T = temperatures[-1]
            watts = [v * (viscous * v + sum(law.sliding(v, temperature=T) for law in laws)) for v in speed]
            power = sum(watts) / max(1, len(watts))
            fade = math.exp(-(end_s - times[-1]) / spec.time_constant)
            times.append(end_s)
            powers.append(power)
            temperatures.append(spec.ambient + (T - spec.ambient) * fade + power / spec.conductance * (1 - fade))
    return np.array(times), np.array(temperatures), np.array(powers)


def _activities(plan: FrictionPlan, joint: str) -> list[_Activity]:
    limits = next(design.limits for design in plan.designs if design.joint == joint)
    passes = [(m.start_s, m.planned) for m in plan.motions if m.joint == joint and m.planned is not None]
    warm_up = next((warm_up for warm_up in plan.warm_ups if warm_up.joint == joint), None)
    activities, clock = list[_Activity](), 0.0
    for start_s, planned in passes:
        activities += _between(clock, start_s, warm_up, limits)
        clock = start_s + pass_time(planned, limits)
        activities.append((start_s, clock, _speeds(planned, limits)))
    activities += _between(clock, plan.robot_time_s, warm_up, limits)
    return [(start, end, speed) for start, end, speed in activities if end > start]


def _between(start_s: float, end_s: float, warm_up: PlannedWarmUp | None, limits: PassLimits) -> list[_Activity]:
    torque = np.zeros(0)
    if warm_up is None:
        return [(start_s, end_s, torque)]
    low = min(max(warm_up.start_s, start_s), end_s)
    high = max(min(warm_up.start_s + warm_up.time_s, end_s), low)
    speeds = _speeds(planned_pass(warm_up.speed, 0, limits), limits)
    return [(start_s, low, torque), (low, high, speeds[speeds > 0]), (high, end_s, torque)]


def _speeds(plan: PlannedPass, limits: PassLimits) -> FloatArray:
    return np.quantile(np.abs(pass_reference(plan, limits, 100.0).velocity), (np.arange(16) + 0.5) / 16)


@dataclass(frozen=True)
class SimulatedFrictionRig:
    """The plan of a friction study, carried out on a model of its robot; `seed` draws all noise.

    Records hold the readings of the joint's encoder and the torque that its controller commands, with noise.
    Raises StudyError for a truth that the robot does not have, and for a warm-up without heat.
    """

    robot: Robot
    spec: ExperimentSpec
    plan: FrictionPlan
    seed: int

    def __post_init__(self) -> None:
        true_robot(self.robot, self.simulated.truth)
        if self.plan.warm_ups and self.simulated.heat is None:
            raise StudyError(
                "experiment/simulated",
                "a warm-up needs a thermal model of the joint. Give, for example, "
                "`heat: {conductance: 8 W/K, time_constant: 45 min}`, or remove friction.warm_up",
                "experiment.simulated.heat",
            )

    @property
    def simulated(self) -> SimulatedSpec:
        """The study's section `experiment.simulated`."""
        return self.spec.as_simulated()

    def measure(self, motion: PlannedMotion) -> FrictionRecord:
        """Simulate one motion. DataError where the joint is lost, StudyError where the steps are too long for it."""
        run, number = self._run(motion), [plan.name for plan in self.plan.motions].index(motion.name)
        model, i, rate_hz, seed = run.plant.model, run.index, self.plan.rate_hz, (self.seed, number)
        noise = draw_noise(self.simulated.noise, len(run.path.position), rate_hz, model.n_u, model.inputs, seed)
        trajectory = run.simulated(self.simulated.controller, rate_hz, noise)
        first = motion.period_samples or 0 if motion.purpose == "presliding_test" else 0
        temperature, plan, E = self._thermometer(run, number), motion.planned, self.robot.mixing
        return FrictionRecord(
            motion.name, motion.joint, motion.purpose, rate_hz, (trajectory.reading @ E.T + noise.outputs)[first:, i],
            (trajectory.u @ np.linalg.inv(E) + noise.torque)[first:, i],
            temperature=None if temperature is None else temperature[first:], there=run.path.there,
            back=run.path.back, speed=None if plan is None else plan.speed, load=motion.load,
            load_torque=self._load_torque(run), torque_delay_s=0.5 / rate_hz,
            resolution=float(run.plant.loop.drives.resolution[i]), start_s=motion.start_s + first / rate_hz,
            period_samples=motion.period_samples, hold="zero-order", configuration=run.plant.point.configuration,
            is_reference=plan is not None and plan.is_reference, is_warm_up=motion.is_warm_up,
            place=motion.name, slides=self.robot.driven[i].slides,
            notes=tuple(limit_notes(run.plant, motion.name, trajectory.u, [i])),
        )  # fmt: skip

    def warm_ups(self) -> tuple[WarmUpLog, ...]:
        """Return the heat of each joint that was warmed, from the start of its warm-up to its last test."""
        return tuple(self._warm_up(warm_up) for warm_up in self.plan.warm_ups)

    def _run(self, motion: PlannedMotion) -> FrictionRun:
        index = self.robot.driven_names.index(motion.joint)
        limits = next(design.limits for design in self.plan.designs if design.joint == motion.joint)
        if motion.planned is not None:
            path = pass_reference(motion.planned, limits, self.plan.rate_hz)
        else:
            still = np.zeros(1 if motion.torque is None else len(motion.torque))
            path = PassReference(self.plan.rate_hz, still + motion.configuration.angles[index], still, still)
        robot, samples = with_point_mass(self.robot, motion.payload), round(self.plan.robot_time_s * self.plan.rate_hz)
        start = motion.configuration.with_angle(index, float(path.position[0]))
        plant = true_plant(robot, self.simulated, self.plan.rate_hz, start, samples=samples)
        temperature = None
        if self.simulated.heat is not None:
            time_s, T, _ = heating_history(self.plan, plant.model.robot, self.simulated.heat, motion.joint)
            temperature = np.interp(motion.start_s + np.arange(len(path.position)) / self.plan.rate_hz, time_s, T)
        return FrictionRun(motion, plant, index, path, temperature)

    def _load_torque(self, run: FrictionRun) -> float:
        model = model_of(with_point_mass(self.robot, run.motion.payload))
        windows = [window for window in (run.path.there, run.path.back) if window is not None]
        sliding = np.concatenate(list(starmap(np.arange, windows))) if windows else np.zeros(1, int)
        samples = np.linspace(0, len(sliding) - 1, min(20, len(sliding))).astype(int)
        point = equilibrium(model, model.theta, run.plant.point.configuration)
        torque = holding_torque(model, point, run.index, run.path.position[sliding[samples]])
        return float(np.abs(torque @ np.linalg.inv(self.robot.mixing)[:, run.index]).mean())

    def _thermometer(self, run: FrictionRun, number: int) -> FloatArray | None:
        """Return temperatures as they are logged (n,), with one error for the motion."""
        heat = self.simulated.heat
        if heat is None or run.temperature is None or heat.thermometer_std is None:
            return None
        error = np.random.default_rng((self.seed, number, 1)).standard_normal()
        return run.temperature + heat.thermometer_std * error

    def _warm_up(self, warm_up: PlannedWarmUp) -> WarmUpLog:
        spec = self.simulated.heat
        assert spec is not None  # refused at the beginning
        time_s, T, power = heating_history(self.plan, true_robot(self.robot, self.simulated.truth), spec, warm_up.joint)
        tests = [test.start_s for test in self.plan.motions if test.joint == warm_up.joint and test.is_warm_up]
        end_s = max(warm_up.start_s + warm_up.time_s, *tests)
        samples = np.flatnonzero((time_s > warm_up.start_s - 1e-6) & (time_s < end_s + 1e-6))
        rng = np.random.default_rng((self.seed, self.robot.driven_names.index(warm_up.joint), 2))
        std = np.nan if spec.thermometer_std is None else spec.thermometer_std
        signals = time_s[samples], power[samples[:-1]], T[samples] + std * rng.standard_normal(len(samples))
        return WarmUpLog(warm_up.joint, *signals, spec.thermometer_std or 0.0, spec.ambient, float(T[samples[0]]))
