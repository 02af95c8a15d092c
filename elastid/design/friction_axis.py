"""One axis of a friction study: what its passes may do, and refusals of what it cannot, by name and with numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.design.friction_guess import FrictionGuess, guess_friction
from elastid.experiment.plan.passes import RAMP_PEAK, PassLimits, fastest_speed
from elastid.experiment.simulated.plant import model_of
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.friction_study.spec import PassesSpec
from elastid.linear.equilibrium import equilibrium
from elastid.record import Configuration
from elastid.robot import Joint, Robot
from elastid.simulation.controller import feed_forward, tune

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
