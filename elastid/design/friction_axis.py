"""One axis of a friction study: feasible passes, the law expected beforehand, and D-optimal speeds of its passes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, StudyError
from elastid.design.optimal import DesignCriterion, relaxed_design, whole
from elastid.experiment.plan.friction import RAMP_PEAK, PassLimits, fastest_speed
from elastid.experiment.simulated.plant import model_of
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.friction.robot_friction import frictions
from elastid.friction.static import Conditions, columns, slopes
from elastid.friction_study.spec import PassesSpec
from elastid.linear.equilibrium import equilibrium
from elastid.record import Configuration
from elastid.robot import Joint, Robot
from elastid.simulation.controller import feed_forward, tune

# Speeds that may be chosen, spaced logarithmically.
CANDIDATES = 200
LINEAR, SEARCHED = ("coulomb", "excess", "viscous"), ("stribeck_velocity", "exponent")


@dataclass(frozen=True)
class StribeckGuess:
    """A law as it may be: F_c, F_s, viscous friction, nu_s and the exponent, SI of one side."""

    coulomb: float
    stiction: float
    viscous: float
    stribeck_velocity: float
    exponent: float = 2.0


@dataclass(frozen=True)
class PassSpeeds:
    """speed (n,), lowest first, with the number of passes there and back at each, passes (n,).

    excess: max Tr(M^-1 H_i) / d - 1 of the shares before they were rounded: 0 at the optimum.  efficiency: of the whole
    passes against the best shares, (det M / det M*)^(1 / d).
    """

    speed: FloatArray
    passes: IntArray
    excess: float
    efficiency: float


def optimal_speeds(guesses: Sequence[StribeckGuess], lowest: float, highest: float, count: int) -> PassSpeeds:
    """`count` passes between two speeds that know all five numbers of a Stribeck curve best, over all guesses.

    Every level is known to the same torque.  Raises DataError for a range without room, or fewer passes than numbers.
    """
    d = len(LINEAR) + len(SEARCHED)
    if not 0 < lowest < highest / 4:
        raise DataError(
            f"passes from {lowest:.3g} to {highest:.3g} rad/s: a friction curve takes a range of four and more; lower "
            "the lowest speed, or raise the highest"
        )
    if count < d:
        raise DataError(f"{count} passes for the {d} numbers of a Stribeck curve; give {d} or more")
    speeds = np.geomspace(lowest, highest, CANDIDATES)
    H = np.stack([_information(guess, speeds) for guess in guesses])
    criterion = DesignCriterion("D", np.eye(d))
    relaxed = relaxed_design(H, criterion)
    numbers = whole(H, relaxed.weights, count, criterion)
    reached = criterion.value(np.einsum("q,sqij->sij", numbers / count, H))
    chosen = numbers > 0
    return PassSpeeds(speeds[chosen], numbers[chosen], relaxed.excess, float(np.exp(float(reached) - relaxed.value)))


def _information(guess: StribeckGuess, speeds: FloatArray) -> FloatArray:
    """J^T J (n, d, d) of one level at each speed, by the numbers relative to themselves."""
    zeros = np.zeros_like(speeds)
    at = Conditions(speeds, zeros, zeros, np.full_like(speeds, np.nan))
    linear = {"coulomb": guess.coulomb, "excess": guess.stiction - guess.coulomb, "viscous": guess.viscous}
    eta = {"stribeck_velocity": guess.stribeck_velocity, "exponent": guess.exponent}
    J = np.hstack([columns(at, LINEAR, eta, 0.0), slopes(at, linear, SEARCHED, eta, 0.0)])
    J = J * np.array([*linear.values(), *eta.values()]) / guess.coulomb
    return np.asarray(J[:, :, None] * J[:, None, :])


# Where the file has no friction: parts of the largest torque and of the highest speed (LiTH-ISY-R-2948 has F_c of 3 %
# of the rating and nu_s of 5 % of the speed; its viscous friction at full speed is three times F_c).
COULOMB_SHARE, VELOCITY_SHARE, STICTION_RATIO, VISCOUS_RATIO = 0.03, 0.05, 1.6, 2.0
# Stribeck velocities that a design serves, over the guessed one: it is the number that is known least.
VELOCITY_SPREAD = (0.4, 1.0, 2.5)
# Of a joint without limits: torque over its inertia times 1 rad/s^2, and speed.
FREE_TORQUE_RATE, FREE_SPEED = 10.0, 2.0


@dataclass(frozen=True)
class FrictionGuess:
    """law: link side.  is_from_file: whether the robot's file has it, or the defaults."""

    law: StribeckGuess
    is_from_file: bool

    @property
    def spread(self) -> tuple[StribeckGuess, ...]:
        """The laws that a design must serve."""
        nu_s = self.law.stribeck_velocity
        return tuple(replace(self.law, stribeck_velocity=factor * nu_s) for factor in VELOCITY_SPREAD)

    def torque(self, speed: float) -> float:
        """F(v), Nm: what braking takes at a speed."""
        law = self.law
        fall = math.exp(-float((speed / law.stribeck_velocity) ** law.exponent))
        return law.coulomb + (law.stiction - law.coulomb) * fall + law.viscous * speed

    def slope(self, speed: float) -> float:
        """dF / dv, Nms/rad: negative where friction falls with speed."""
        law = self.law
        x = float((speed / law.stribeck_velocity) ** law.exponent)
        return law.viscous - (law.stiction - law.coulomb) * law.exponent * x * math.exp(-x) / speed


def guess_friction(robot: Robot, joint: Joint, inertia: float) -> FrictionGuess:
    """The friction of a driven joint as far as the file tells it.

    inertia: of the joint in kg m^2, link side, from which that of a joint without limits follows.  Stiction and
    Stribeck velocity that the file does not have are those of common gears.
    """
    speed = joint.limits.velocity if math.isfinite(joint.limits.velocity) else FREE_SPEED
    torque = joint.limits.torque if math.isfinite(joint.limits.torque) else FREE_TORQUE_RATE * inertia
    viscous = joint.viscous + (0.0 if joint.motor is None else joint.motor.viscous * joint.motor.ratio**2)
    placed = [one for one in frictions(robot) if one.place in (f"motor {joint.name}", f"joint {joint.name}")]
    curves = [one.curve().tolist() for one in placed]
    coulomb = sum(curve[0] for curve in curves) or COULOMB_SHARE * torque
    excess = sum(curve[1] - curve[0] for curve in curves) or (STICTION_RATIO - 1) * coulomb
    nu_s = next((1 / curve[2] for curve in curves if curve[2] > 0), VELOCITY_SHARE * speed)
    exponent = next((one.spec.exponent for one in placed if one.spec.stribeck_velocity is not None), 2.0)
    viscous = viscous or VISCOUS_RATIO * coulomb / speed
    return FrictionGuess(StribeckGuess(coulomb, coulomb + excess, viscous, nu_s, exponent), bool(placed))


# Of the joint's limits, about their middle, unless a window is given; without limits, so far to either side.
WINDOW_SHARE, FREE_REACH = 0.5, {False: 1.0, True: 0.25}
# Time from rest to full speed unless the joint's acceleration is given; share of its torque that passes may take.
RAMP_S, TORQUE_SHARE = 0.4, 0.9
# Slowest pass over the guessed Stribeck velocity: slower ones would tell as much in more time.
SLOWEST_SHARE = 0.03
# Angles of the window at which the holding torque is looked at, and speeds that are tried.
WINDOW_POINTS, SPEEDS = 21, 200


@dataclass(frozen=True)
class Axis:
    """A driven joint in one posture, link side: limits of passes, largest |holding torque|, inertia, k_d, the guess.

    index: among the driven joints.
    """

    joint: Joint
    index: int
    limits: PassLimits
    holding: float
    inertia: float
    damping: float
    guess: FrictionGuess

    def peak_torque(self, speed: float) -> float:
        """|u| that a pass at a speed takes at most: gravity, ramps, friction."""
        friction = max(self.guess.torque(speed), self.guess.law.stiction)
        return self.holding + self.inertia * self.limits.acceleration + friction

    def sticks_at(self, speed: float) -> bool:
        """Whether friction falls faster with speed than the loop brakes: k_d + dF/dv < 0."""
        return self.damping + self.guess.slope(speed) <= 0

    @property
    def slowest(self) -> float:
        """The slowest speed worth a pass at which the joint slides steadily."""
        lowest = SLOWEST_SHARE * self.guess.law.stribeck_velocity
        sticking = [v for v in self._speeds(lowest).tolist() if self.sticks_at(v)]
        return 1.05 * max(sticking, default=lowest)

    @property
    def fastest(self) -> float:
        """The highest speed that fits into the window and whose torque is not clipped; 0 without room."""
        room = fastest_speed(self.limits)
        if room <= 0:
            return 0.0
        within = [
            v for v in self._speeds(1e-3 * room, room).tolist() if self.peak_torque(v) <= self.joint.limits.torque
        ]
        return max(within, default=0.0)

    def check_speeds(self, speeds: FloatArray, bandwidth_hz: float) -> None:
        """StudyError for the first speed that sticks and slips, or whose torque would be clipped."""
        place, unit, torque_unit = self.limits.place, f"{self.limits.unit}/s", "N" if self.joint.slides else "N*m"
        for speed in speeds.tolist():
            if self.sticks_at(speed):
                needed = bandwidth_hz * -self.guess.slope(speed) / self.damping
                raise StudyError(
                    f"friction.passes.speeds: {place} would stick and slip at {speed:.4g} {unit}: its friction falls "
                    f"by {-self.guess.slope(speed):.3g} with each {unit}, and the loop brakes with {self.damping:.3g}; "
                    f"measure above {self.slowest:.3g} {unit}, or raise experiment.simulated.controller.bandwidth_hz "
                    f"from {bandwidth_hz:.3g} to {1.2 * needed:.3g} Hz"
                )
            peak = self.peak_torque(speed)
            if peak > self.joint.limits.torque:
                raise StudyError(
                    f"friction.passes.speeds: a pass of {place} at {speed:.4g} {unit} takes {peak:.4g} {torque_unit} "
                    f"(gravity {self.holding:.3g}, ramps {self.inertia * self.limits.acceleration:.3g}, friction "
                    f"{self.guess.torque(speed):.3g}), and its drive gives {self.joint.limits.torque:.4g}: the torque "
                    "would be clipped; choose a posture with less gravity torque, lower limits.acceleration, or lower "
                    "the highest speed"
                )

    def _speeds(self, lowest: float, highest: float | None = None) -> FloatArray:
        top = highest or max(lowest * 2, 20 * self.guess.law.stribeck_velocity)
        return np.geomspace(lowest, top, SPEEDS)


def axis_of(robot: Robot, joint: Joint, posture: Configuration, passes: PassesSpec, controller: ControllerSpec) -> Axis:
    """A joint of the nominal robot in a posture; StudyError where the posture has no rest or gravity no room."""
    index = [one.name for one in robot.driven].index(joint.name)
    window = passes.window or default_window(joint)
    holding, inertia, damping = _dynamics(robot, index, posture, window, controller)
    guess = guess_friction(robot, joint, inertia)
    acceleration = _acceleration(joint, holding, inertia, guess)
    stiffness = inertia * (2 * math.pi * controller.bandwidth_hz) ** 2
    motor = joint.motor
    turn = 2 * math.pi / abs(motor.ratio) if motor is not None else 0.0
    speed = joint.limits.velocity if math.isfinite(joint.limits.velocity) else window[1] - window[0]
    limits = PassLimits(
        f"joint {joint.name}", window, speed, acceleration, min(turn, 0.5 * (window[1] - window[0])),
        controller.bandwidth_hz, 2 * guess.law.stiction / stiffness, joint.slides,
    )  # fmt: skip
    return Axis(joint, index, limits, holding, inertia, damping, guess)


def default_window(joint: Joint) -> tuple[float, float]:
    """The middle half of the joint's limits."""
    low, high = joint.limits.angle
    if not (math.isfinite(low) and math.isfinite(high)):
        reach = FREE_REACH[joint.slides]
        low, high = max(low, -reach / WINDOW_SHARE), min(high, reach / WINDOW_SHARE)
    middle, half = (low + high) / 2, WINDOW_SHARE * (high - low) / 2
    return middle - half, middle + half


@lru_cache(maxsize=16)
def _middle(robot: Robot, index: int, name: str, angles: tuple[float, ...], angle: float) -> FloatArray:
    model = model_of(robot)
    there = Configuration(name, np.array(angles)).moved(index, angle)
    return equilibrium(model, model.theta, there).q


def _dynamics(
    robot: Robot, index: int, posture: Configuration, window: tuple[float, float], controller: ControllerSpec
) -> tuple[float, float, float]:
    """Largest |holding torque| over the window, inertia, and damping k_d of the loop."""
    model = model_of(robot)
    q0 = _middle(robot, index, posture.name, tuple(posture.angles.tolist()), sum(window) / 2)
    moved = np.zeros((WINDOW_POINTS, model.n_u))
    moved[:, index] = np.linspace(*window, WINDOW_POINTS) - sum(window) / 2
    still = np.zeros_like(moved)
    holding = feed_forward(model, q0, moved, still, still)[:, index]
    gains = tune(model, q0, controller.bandwidth_hz, controller.damping_ratio)
    inertia = gains.kp[index] / (2 * math.pi * controller.bandwidth_hz) ** 2
    return float(np.abs(holding).max()), float(inertia), float(gains.kd[index])


def _acceleration(joint: Joint, holding: float, inertia: float, guess: FrictionGuess) -> float:
    """Of the ramps: within the joint's limit, and within the torque that gravity and friction leave."""
    limits = joint.limits
    speed = limits.velocity if math.isfinite(limits.velocity) else 1.0
    given = min(limits.acceleration, RAMP_PEAK * speed / RAMP_S)
    if not math.isfinite(limits.torque):
        return given
    room = TORQUE_SHARE * limits.torque - holding - guess.law.stiction
    if room <= 0:
        unit = "N" if joint.slides else "N*m"
        raise StudyError(
            f"friction.passes: gravity takes {holding:.4g} {unit} of the {limits.torque:.4g} that the drive of joint "
            f"{joint.name} gives, and break-away about {guess.law.stiction:.3g}: nothing is left to move it; choose a "
            "posture or window with less gravity torque, or correct limits.torque"
        )
    # Viscous friction at full speed takes its part while the ramp ends.
    return min(given, max(0.2 * room, room - guess.law.viscous * speed) / inertia)
