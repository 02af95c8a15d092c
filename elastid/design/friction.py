"""Plan of a friction study: speeds and order of constant-velocity runs, presliding torques, and warm-ups.

Speeds are D-optimal over the plausible friction models of a joint, with a bound on their efficiency.  Windows and ramps
are within the joint's limits; a StudyError names impossible motions.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import number as printed
from elastid.base.errors import StudyError
from elastid.design.optimal import DesignCriterion, best_experiments
from elastid.excitation.multisine import growing_loops, small_multisine
from elastid.experiment.plan.friction import (
    RAMP_PEAK,
    FrictionPlan,
    JointPassDesign,
    PassLimits,
    PlannedMotion,
    PlannedWarmUp,
    fastest_speed,
    pass_time,
    plan_passes,
    planned_pass,
)
from elastid.experiment.simulated.plant import holding_torque, model_of
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.friction.robot_friction import joint_laws
from elastid.friction.static import Conditions, columns, slopes
from elastid.friction_study.spec import ConstantVelocitySpec, FrictionSpec, LoadSpec, WarmUpSpec
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.record import Configuration, drive_unit
from elastid.robot import Joint, Robot
from elastid.robot.simplified import with_point_mass
from elastid.simulation.controller import tune
from elastid.simulation.spec import ControllerSpec

LINEAR, SEARCHED = ("coulomb", "stiction", "viscous"), ("stribeck_velocity", "exponent")


@dataclass(frozen=True)
class StribeckGuess:
    """Prior estimate of a friction model: F_c, F_s, viscous friction, nu_s and exponent, SI units of one side.

    is_from_file: from the robot model, not from common gears.
    """

    coulomb: float
    stiction: float
    viscous: float
    stribeck_velocity: float
    exponent: float = 2.0
    is_from_file: bool = False

    @property
    def spread(self) -> "tuple[StribeckGuess, ...]":
        """Models for which a design must be good: the Stribeck velocity is the least known number."""
        nu_s = self.stribeck_velocity
        return tuple(replace(self, stribeck_velocity=factor * nu_s) for factor in (0.4, 1.0, 2.5))

    def torque(self, speed: float) -> float:
        """Return the friction torque F(v), Nm (N), at a speed."""
        decay = math.exp(-float((speed / self.stribeck_velocity) ** self.exponent))
        return self.coulomb + (self.stiction - self.coulomb) * decay + self.viscous * speed

    def slope(self, speed: float) -> float:
        """Return the slope dF / dv, Nms/rad (Ns/m); it is negative if friction decreases with speed."""
        x = float((speed / self.stribeck_velocity) ** self.exponent)
        return self.viscous - (self.stiction - self.coulomb) * self.exponent * x * math.exp(-x) / speed


def optimal_speeds(
    guesses: Sequence[StribeckGuess], lowest: float, highest: float, count: int
) -> tuple[FloatArray, FloatArray, float]:
    """Return D-optimal speeds (n,), ascending, passes (n,) at each, and their efficiency (det M / det M*)^(1 / d).

    `count` passes identify the five numbers of a Stribeck curve, averaged over the guesses, if all friction torques
    have the same std.
    """
    speeds, d = np.geomspace(lowest, highest, 200), len(LINEAR) + len(SEARCHED)
    H = np.stack([_information(guess, speeds) for guess in guesses])
    numbers, efficiency = best_experiments(H, count, DesignCriterion(np.eye(d)), np.zeros((len(H), d, d)))
    has_passes = numbers > 0
    return speeds[has_passes], numbers[has_passes].astype(float), efficiency


def _information(guess: StribeckGuess, speeds: FloatArray) -> FloatArray:
    """Return J^T J (n, d, d) of one friction torque at each speed (n,), by relative changes of the numbers."""
    zeros = np.zeros_like(speeds)
    conditions = Conditions(speeds, zeros, zeros, np.full_like(speeds, np.nan))
    linear = {"coulomb": guess.coulomb, "stiction": guess.stiction, "viscous": guess.viscous}
    eta = {"stribeck_velocity": guess.stribeck_velocity, "exponent": guess.exponent}
    J = np.hstack([columns(conditions, LINEAR, eta, 0.0), slopes(conditions, linear, SEARCHED, eta, 0.0)])
    J = J * np.array([*linear.values(), *eta.values()]) / guess.coulomb
    return np.asarray(J[:, :, None] * J[:, None, :])


@dataclass(frozen=True)
class CommonGear:
    """Typical friction and limits of gears, for robot models without them.

    LiTH-ISY-R-2948 has F_c of 3 % of the rated torque, nu_s of 5 % of the speed, and viscous friction of 3 F_c at full
    speed.
    """

    coulomb: float = 0.03  # of the largest torque
    stiction: float = 1.6  # over F_c
    viscous: float = 2.0  # at the highest speed, over F_c
    stribeck_velocity: float = 0.05  # of the highest speed
    torque_rate: float = 10.0  # largest torque over inertia, rad/s^2
    speed: float = 2.0  # highest, rad/s


GEAR = CommonGear()


def guess_friction(robot: Robot, joint: Joint, inertia: float) -> StribeckGuess:
    """Return the friction of a driven joint, link side, with values of `CommonGear` if the robot model lacks them.

    inertia: of the joint, kg m^2 (kg), link side; gives the friction of a joint without limits.
    """
    speed = joint.limits.velocity if math.isfinite(joint.limits.velocity) else GEAR.speed
    torque = joint.limits.torque if math.isfinite(joint.limits.torque) else GEAR.torque_rate * inertia
    laws = joint_laws(robot, joint.name)
    curves = [law.curve().tolist() for law in laws]
    coulomb = sum(curve[0] for curve in curves) or GEAR.coulomb * torque
    stribeck_rise = sum(curve[1] - curve[0] for curve in curves) or (GEAR.stiction - 1) * coulomb
    nu_s = next((1 / curve[2] for curve in curves if curve[2] > 0), GEAR.stribeck_velocity * speed)
    exponent = next((law.spec.exponent for law in laws if law.spec.stribeck_velocity is not None), 2.0)
    viscous = joint.all_viscous or GEAR.viscous * coulomb / speed
    return StribeckGuess(coulomb, coulomb + stribeck_rise, viscous, nu_s, exponent, bool(laws))


@dataclass(frozen=True)
class Axis:
    """Driven joint in one posture, link side.

    index: among the driven joints.  holding: largest |holding torque| in the window.  damping: k_d of the loop.
    """

    joint: Joint
    index: int
    limits: PassLimits
    holding: float
    inertia: float
    damping: float
    guess: StribeckGuess

    def peak_torque(self, speed: float) -> float:
        """Return the largest |u| of a pass at a speed: gravity, ramps, friction."""
        friction = max(self.guess.torque(speed), self.guess.stiction)
        return self.holding + self.inertia * self.limits.acceleration + friction

    def sticks_at(self, speed: float) -> bool:
        """Return whether friction decreases faster with speed than the loop damps: k_d + dF/dv < 0."""
        return self.damping + self.guess.slope(speed) <= 0

    @property
    def slowest(self) -> float:
        """Slowest speed at which the joint slides steadily, at least 0.03 nu_s: lower speeds only take more time."""
        lowest, highest = (factor * self.guess.stribeck_velocity for factor in (0.03, 20.0))
        return 1.05 * max([v for v in np.geomspace(lowest, highest, 200).tolist() if self.sticks_at(v)], default=lowest)

    @property
    def fastest(self) -> float:
        """Highest speed that is possible in the window without clipping the torque; 0 without one."""
        max_speed = fastest_speed(self.limits)
        if max_speed <= 0:
            return 0.0
        speeds = np.geomspace(1e-3 * max_speed, max_speed, 200).tolist()
        return max([v for v in speeds if self.peak_torque(v) <= self.joint.limits.torque], default=0.0)

    def check_speeds(self, speeds: FloatArray) -> None:
        """Raise StudyError for the first speed with stick-slip or clipped torque."""
        unit, largest = f"{self.limits.unit}/s", self.joint.limits.torque
        for speed in speeds.tolist():
            if self.sticks_at(speed) or self.peak_torque(speed) > largest:
                raise StudyError(
                    "friction/plan",
                    f"{self.limits.place} would stick and slip at {speed:.4g} {unit}, or saturate. Choose speeds from "
                    f"{self.slowest:.3g} to {self.fastest:.3g} {unit}, raise "
                    "experiment.simulated.controller.bandwidth_hz, or choose a posture with less gravity torque",
                    "friction.constant_velocity.speeds",
                )


def axis_of(
    robot: Robot, joint: Joint, posture: Configuration, passes: ConstantVelocitySpec, controller: ControllerSpec
) -> Axis:
    """Return a joint of the nominal robot in a posture; StudyError without an equilibrium or a torque margin."""
    index = robot.driven_names.index(joint.name)
    window = passes.window or default_window(joint)
    middle = _middle(robot, index, posture.name, tuple(posture.angles.tolist()), sum(window) / 2)
    model = model_of(robot)
    holding = float(np.abs(holding_torque(model, middle, index, np.linspace(*window, 21))[:, index]).max())
    gains = tune(model, middle.q, controller.bandwidth_hz, controller.damping_ratio)
    stiffness = float(gains.kp[index])
    inertia = stiffness / (2 * math.pi * controller.bandwidth_hz) ** 2
    guess = guess_friction(robot, joint, inertia)
    acceleration = _acceleration(joint, holding, inertia, guess)
    turn = 0.0 if joint.motor is None else 2 * math.pi / abs(joint.motor.ratio)
    speed = joint.limits.velocity if math.isfinite(joint.limits.velocity) else window[1] - window[0]
    limits = PassLimits(
        f"joint {joint.name}", window, speed, acceleration, min(turn, 0.5 * (window[1] - window[0])),
        controller.bandwidth_hz, 2 * guess.stiction / stiffness, joint.slides,
    )  # fmt: skip
    return Axis(joint, index, limits, holding, inertia, float(gains.kd[index]), guess)


def default_window(joint: Joint) -> tuple[float, float]:
    """Return the middle half of the range of a joint; without limits 1 rad or 0.25 m to either side of zero."""
    low, high = joint.limits.angle
    if not (math.isfinite(low) and math.isfinite(high)):
        half_width = 0.5 if joint.slides else 2.0
        low, high = max(low, -half_width), min(high, half_width)
    middle, half = (low + high) / 2, 0.5 * (high - low) / 2
    return middle - half, middle + half


@lru_cache(maxsize=16)
def _middle(robot: Robot, index: int, name: str, angles: tuple[float, ...], angle: float) -> OperatingPoint:
    model = model_of(robot)
    return equilibrium(model, model.theta, Configuration(name, np.array(angles)).with_angle(index, angle))


def _acceleration(joint: Joint, holding: float, inertia: float, guess: StribeckGuess) -> float:
    """Return the ramp acceleration by the joint limit, 0.4 s to full speed, and 90 % of the available torque."""
    limits = joint.limits
    speed = limits.velocity if math.isfinite(limits.velocity) else 1.0
    limit = min(limits.acceleration, RAMP_PEAK * speed / 0.4)
    if not math.isfinite(limits.torque):
        return limit
    available = 0.9 * limits.torque - holding - guess.stiction
    if available <= 0:
        unit = drive_unit(joint.slides)
        raise StudyError(
            "friction/plan",
            f"gravity needs {holding:.4g} {unit} and break-away about {guess.stiction:.3g} of the {limits.torque:.4g} "
            f"of joint {joint.name}, so that no torque remains for motion. Choose a posture or window with less "
            "gravity torque, or correct limits.torque",
            "friction.constant_velocity",
        )
    # At the end of a ramp viscous friction needs some of the torque.
    return min(limit, max(0.2 * available, available - guess.viscous * speed) / inertia)


def passes_of(
    spec: ConstantVelocitySpec, loads: Sequence[LoadSpec], postures: Sequence[Configuration], design: JointPassDesign,
    seed: int,
) -> tuple[PlannedMotion, ...]:  # fmt: skip
    """Plan the passes under every load, in its posture, each load with another random order."""
    speeds, joint = np.repeat(design.speed, design.passes.astype(int)).tolist(), design.joint
    return tuple(
        PlannedMotion(
            "-".join(filter(None, (f"j{joint}", load.name, plan.name))),
            joint, "constant_velocity", posture, load.name, load.payload, planned=plan,
        )
        for i, (load, posture) in enumerate(zip(loads, postures, strict=True))
        for plan in plan_passes(speeds, spec.repeat, design.limits, seed + i, spec.reference_every)
    )  # fmt: skip


def presliding_of(
    spec: FrictionSpec, axis: Axis, posture: Configuration, rng: np.random.Generator
) -> tuple[PlannedMotion, ...]:
    """Plan presliding loops of growing torque and small multisines in the middle of the window."""
    joint, law = axis.joint.name, axis.guess
    middle, motions = posture.with_angle(axis.index, sum(axis.limits.window) / 2), list[PlannedMotion]()
    if (loops := spec.presliding_loops) is not None:
        low, high = (fraction * law.stiction for fraction in loops.torque)
        torque = growing_loops(low, high, loops.loops, loops.frequency_hz, spec.rate_hz)
        period = round(spec.rate_hz / loops.frequency_hz)
        motions.append(
            PlannedMotion(f"j{joint}-loops", joint, "presliding_loops", middle, torque=torque, period_samples=period)
        )
    if spec.presliding_test is not None:
        n = round(1.0 * spec.rate_hz)  # a period of 1 s
        for fraction in spec.presliding_test.torque:
            for draw in range(2):
                amplitude, name = fraction * law.coulomb, f"j{joint}-rest-{fraction:g}-{draw}"
                period_torque = small_multisine(amplitude, spec.presliding_test.band_hz, n, spec.rate_hz, rng)
                torque = np.tile(period_torque, 33)  # the first period is the transient
                motions.append(PlannedMotion(name, joint, "presliding_test", middle, torque=torque, period_samples=n))
    return tuple(motions)


def schedule(
    motions: Iterable[PlannedMotion], limits: PassLimits, start_s: float, rate_hz: float
) -> tuple[tuple[PlannedMotion, ...], float]:
    """Return the motions in sequence from start_s, and the end of the last one, s."""
    started, clock = list[PlannedMotion](), start_s
    for motion in motions:
        started.append(replace(motion, start_s=clock))
        if motion.planned is not None:
            clock += pass_time(motion.planned, limits)
        elif motion.torque is not None:
            clock += len(motion.torque) / rate_hz
    return tuple(started), clock


def warm_up_of(
    spec: WarmUpSpec, axis: Axis, design: JointPassDesign, posture: Configuration, start_s: float
) -> tuple[PlannedWarmUp, tuple[PlannedMotion, ...], float]:
    """Plan back-and-forth motion over the window with groups of test passes; return these and the end, s."""
    joint, limits = axis.joint.name, axis.limits
    speed_pass = planned_pass(spec.speed, 0, limits)
    warm_up = PlannedWarmUp(joint, posture, speed_pass.start, speed_pass.stop, spec.speed, start_s, spec.time)
    # A low, a medium and the highest speed of the passes.
    indices = sorted({round(quantile * (len(design.speed) - 1)) for quantile in (0.3, 0.65, 1.0)})
    tests = list[PlannedMotion]()
    for number in range(int(spec.time / spec.test_every) + 1):
        passes = [planned_pass(design.speed[i], number, limits) for i in indices]
        motions = (
            PlannedMotion(f"j{joint}-test-{p.name}", joint, "constant_velocity", posture, planned=p, is_warm_up=True)
            for p in passes
        )
        tests += schedule(motions, limits, start_s + number * spec.test_every, 1.0)[0]
    return warm_up, tuple(tests), start_s + spec.time


def design_friction(
    spec: FrictionSpec, joints: Sequence[Joint], experiment: ExperimentSpec, robot: Robot, seed: int
) -> FrictionPlan:
    """Plan a friction study of `joints` in sequence; StudyError if limits, window or loop do not allow a pass."""
    plans, end_s = list[FrictionPlan](), 0.0
    for number, joint in enumerate(joints):
        plans.append(_planned_motion(spec, joint, experiment, robot, (seed, number), end_s))
        end_s = plans[-1].robot_time_s
    return FrictionPlan(
        spec.rate_hz,
        tuple(motion for plan in plans for motion in plan.motions),
        tuple(design for plan in plans for design in plan.designs),
        end_s,
        tuple(warm_up for plan in plans for warm_up in plan.warm_ups),
        tuple(sentence for plan in plans for sentence in plan.assumed_friction),
    )


def _planned_motion(
    spec: FrictionSpec, joint: Joint, experiment: ExperimentSpec, robot: Robot, seed: tuple[int, int], start_s: float
) -> FrictionPlan:
    controller, passes = experiment.as_simulated().controller, spec.designed_passes
    loads = spec.loads or (LoadSpec(""),)
    postures = [_posture(experiment, robot, load.configuration) for load in loads]
    axes = [
        axis_of(with_point_mass(robot, load.payload), joint, posture, passes, controller)
        for load, posture in zip(loads, postures, strict=True)
    ]
    # The load with the largest holding torque determines ramps and speeds of all loads.
    axis = max(axes, key=lambda axis: axis.holding)
    design = JointPassDesign(joint.name, axis.limits, *_speeds(passes, axis))
    axis.check_speeds(design.speed)
    draws = np.random.SeedSequence(seed).spawn(2)
    trajectory = (
        *passes_of(passes, loads, postures, design, int(draws[0].generate_state(1)[0])),
        *presliding_of(spec, axis, postures[0], np.random.default_rng(draws[1])),
    )
    motions, end_s = schedule(trajectory, axis.limits, start_s, spec.rate_hz)
    warm_ups: tuple[PlannedWarmUp, ...] = ()
    if spec.warm_up is not None:
        warm_up, tests, end_s = warm_up_of(spec.warm_up, axis, design, postures[0], end_s)
        motions, warm_ups = (*motions, *tests), (warm_up,)
    return FrictionPlan(spec.rate_hz, motions, (design,), end_s, warm_ups, (_runs_note(axis, design),))


def _posture(experiment: ExperimentSpec, robot: Robot, name: str | None) -> Configuration:
    """Return a configuration by name, default the first; without any, all joints at zero or the nearest limit."""
    configurations = experiment.configurations
    if configurations:
        configuration = name or next(iter(configurations))
        return Configuration(configuration, np.array(configurations[configuration]))
    return Configuration("zero", np.array([float(np.clip(0.0, *joint.limits.angle)) for joint in robot.driven]))


def _speeds(passes: ConstantVelocitySpec, axis: Axis) -> tuple[FloatArray, FloatArray, float]:
    """Return speeds (n,), passes (n,) and efficiency; StudyError for too narrow a range."""
    (lowest, highest), unit = passes.speeds or (axis.slowest, axis.fastest), axis.limits.unit
    min_count = 4 if passes.spacing == "optimal" else 1
    if not 0 < lowest < highest / min_count:
        raise StudyError(
            "friction/plan",
            f"{axis.limits.place}: the range of speeds, {lowest:.3g} to {highest:.3g} {unit}/s, must cover more than a "
            f"factor of {min_count}. Choose speeds from {axis.slowest:.3g} to {axis.fastest:.3g} {unit}/s",
            "friction.constant_velocity.speeds",
        )
    if passes.spacing == "optimal":
        return optimal_speeds(axis.guess.spread, lowest, highest, passes.count)
    return np.geomspace(lowest, highest, passes.count), np.ones(passes.count), math.nan


def _runs_note(axis: Axis, design: JointPassDesign) -> str:
    source = "the robot's file" if axis.guess.is_from_file else "common gears"
    certificate = "" if np.isnan(design.efficiency) else f", {design.efficiency:.0%} of the best information"
    return (
        f"{axis.limits.place}: {design.passes.sum():.0f} constant-velocity runs from {design.speed[0]:.3g} to "
        f"{design.speed[-1]:.3g} {axis.limits.unit}/s{certificate} for the friction of {source} (F_c "
        f"{printed(axis.guess.coulomb, 3)} {drive_unit(axis.joint.slides)}, nu_s "
        f"{printed(axis.guess.stribeck_velocity, 3)})"
    )
