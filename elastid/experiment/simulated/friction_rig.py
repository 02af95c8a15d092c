"""The simulated rig of a friction study: one joint of the true robot moves in closed loop, the others are held.

Passes follow their reference; loops and multisines at rest are torques under a loop so slow that friction alone holds
the joint. Load and temperature change the friction along a motion; the temperature of a joint follows from all that it
did before (`heating`), so that motions can be measured in any order and in any process.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.note import Note
from elastid.experiment.plan.friction import FrictionPlan, PlannedMotion, PlannedWarmUp
from elastid.experiment.simulated.friction_run import FrictionRun, heat_of, holding_torque, path_of
from elastid.experiment.simulated.hardware import Noise, draw_noise, loads_of
from elastid.experiment.simulated.plant import Plant, check_steps, model_of, plant_of, true_robot
from elastid.experiment.simulated.run_notes import extrapolated, torque_notes
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.linear.equilibrium import equilibrium
from elastid.record import FrictionRecord, WarmUpLog
from elastid.robot import Robot
from elastid.robot.simplified import with_point_mass
from elastid.simulation.closed_loop import Trajectory


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
        """Check truth and heat."""
        true_robot(self.robot, self.simulated.truth)
        if self.plan.warm_ups and self.simulated.heat is None:
            raise StudyError(
                "experiment.simulated.heat: a warm-up takes a joint that gets warm; give it, such as "
                "heat: {conductance: 8 W/K, time_constant: 45 min}, or leave out friction.warm_up"
            )

    @property
    def simulated(self) -> SimulatedSpec:
        """The study's section `experiment.simulated`."""
        return self.spec.as_simulated()

    @property
    def motions(self) -> tuple[PlannedMotion, ...]:
        """All motions of the plan."""
        return self.plan.motions

    def measure(self, motion: PlannedMotion) -> FrictionRecord:
        """Simulate one motion. DataError where the joint is lost, StudyError where the steps are too long for it."""
        run, number = self._run(motion), [planned.name for planned in self.motions].index(motion.name)
        model = run.plant.model
        noise = draw_noise(
            self.simulated.noise, run.path.n_samples, self.plan.rate_hz, model.n_u, model.inputs, (self.seed, number)
        )
        trajectory = run.simulated(self.simulated.controller, self.plan.rate_hz, noise)
        return self._record(run, trajectory, noise, self._thermometer(run, number))

    def warm_ups(self) -> tuple[WarmUpLog, ...]:
        """The heat of each joint that was warmed, from the start of its warm-up to its last test."""
        return tuple(self._warm_up(warm_up) for warm_up in self.plan.warm_ups)

    def _run(self, motion: PlannedMotion) -> FrictionRun:
        index = [joint.name for joint in self.robot.driven].index(motion.joint)
        limits = next(design.limits for design in self.plan.designs if design.joint == motion.joint)
        path = path_of(motion, limits, float(motion.configuration.angles[index]), self.plan.rate_hz)
        plant = self._plant(motion.payload)
        start = motion.configuration.moved(index, float(path.position[0]))
        point = equilibrium(plant.model, plant.model.theta, start)
        check_steps(plant, point, self.simulated.substeps, self.plan.rate_hz, "friction.rate_hz")
        temperature = None
        if self.simulated.heat is not None:
            heat = heat_of(self.plan, plant.model.robot, self.simulated.heat, motion.joint)
            temperature = heat.temperature_at(motion.start_s + np.arange(path.n_samples) / self.plan.rate_hz)
        return FrictionRun(motion, plant, point, index, path, temperature)

    def _plant(self, payload: float) -> Plant:
        spec = self.simulated
        robot = true_robot(with_point_mass(self.robot, payload), spec.truth)
        hardware = spec.noise.encoder_counts, spec.encoder_ripple, spec.torque_ripple, spec.saturation
        samples = round(self.plan.robot_time_s * self.plan.rate_hz) if spec.compiled else 0
        return plant_of(robot, spec.model, self.plan.rate_hz, spec.substeps, *hardware, samples)

    def _record(
        self, run: FrictionRun, trajectory: Trajectory, noise: Noise, temperature: FloatArray | None
    ) -> FrictionRecord:
        """The log; of a periodic torque without its first period, in which it settles."""
        motion, path, i = run.motion, run.path, run.index
        first = motion.period_samples or 0 if motion.purpose == "at_rest" else 0
        planned = motion.planned
        return FrictionRecord(
            motion.name,
            motion.joint,
            motion.purpose,
            self.plan.rate_hz,
            (trajectory.reading + noise.outputs)[first:, i],
            (trajectory.u + noise.torque)[first:, i],
            temperature=None if temperature is None else temperature[first:],
            there=path.there,
            back=path.back,
            speed=None if planned is None else planned.speed,
            load=motion.load,
            load_torque=self._load_torque(run),
            torque_delay_s=0.5 / self.plan.rate_hz,
            resolution=float(run.plant.loop.drives.resolution[i]),
            start_s=motion.start_s + first / self.plan.rate_hz,
            period_samples=motion.period_samples,
            hold="zero-order",
            configuration=run.point.configuration,
            is_reference=planned is not None and planned.is_reference,
            is_warm_up=motion.is_warm_up,
            place=motion.name,
            slides=self.robot.driven[i].slides,
            notes=self._notes(run, trajectory),
        )

    def _notes(self, run: FrictionRun, trajectory: Trajectory) -> tuple[Note, ...]:
        contacts, T = run.plant.loop.contacts, run.temperature
        loads = loads_of(contacts, run.plant.model.robot, run.point)
        temperatures = () if T is None else (float(T.min()), float(T.max()))
        return (
            *torque_notes(trajectory.u[:, run.index], run.plant, run.index, run.motion.name),
            *extrapolated(contacts, trajectory.q, self.plan.rate_hz, loads, temperatures),
        )

    def _load_torque(self, run: FrictionRun) -> float:
        """Mean |holding torque| of the nominal robot over the plateaus: what is known, not what is true."""
        model = model_of(with_point_mass(self.robot, run.motion.payload))
        sliding = run.path.sliding
        places = np.linspace(0, len(sliding) - 1, min(20, len(sliding))).astype(int)
        point = equilibrium(model, model.theta, run.point.configuration)
        torque = holding_torque(model, point, run.index, run.path.position[sliding[places]])
        return float(np.abs(torque[:, run.index]).mean())

    def _thermometer(self, run: FrictionRun, number: int) -> FloatArray | None:
        """Temperatures as they are logged (n,), with one error for the motion."""
        heat = self.simulated.heat
        if heat is None or run.temperature is None or heat.thermometer_std is None:
            return None
        error = np.random.default_rng(np.random.SeedSequence((self.seed, number, 1))).standard_normal()
        return np.asarray(run.temperature + heat.thermometer_std * error)

    def _warm_up(self, warm_up: PlannedWarmUp) -> WarmUpLog:
        spec = self.simulated.heat
        assert spec is not None  # refused at the beginning
        heat = heat_of(self.plan, true_robot(self.robot, self.simulated.truth), spec, warm_up.joint)
        tests = [test.start_s for test in self.motions if test.joint == warm_up.joint and test.is_warm_up]
        end_s = max(warm_up.start_s + warm_up.time_s, *tests)
        chosen = (heat.time_s > warm_up.start_s - 1e-6) & (heat.time_s < end_s + 1e-6)
        places = np.flatnonzero(chosen)
        joint = [driven.name for driven in self.robot.driven].index(warm_up.joint)
        rng = np.random.default_rng(np.random.SeedSequence((self.seed, joint, 2)))
        std = np.nan if spec.thermometer_std is None else spec.thermometer_std
        readings = heat.temperature[places] + std * rng.standard_normal(len(places))
        return WarmUpLog(
            warm_up.joint,
            heat.time_s[places],
            heat.power[places[:-1]],
            readings,
            spec.thermometer_std or 0.0,
            spec.ambient,
            float(heat.temperature[places[0]]),
        )
