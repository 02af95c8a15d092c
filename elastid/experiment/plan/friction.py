r"""The plan of a friction study: passes there and back, one joint at a time.

A pass moves from q_a to q_b at a constant speed v and back. Between the ramps it needs the time in which the joint
breaks away and the loop settles, and a plateau that covers a turn of the motor, whose ripple would else be taken for
friction:

.. math:: |q_b - q_a| \ge v\, (t_{ramp} + t_{settle}) + \Delta q_{turn}, \quad t_{ramp} = \tfrac{15}{8} v / a, \quad
          t_{settle} = 3 / (2 \pi f_{bandwidth}) + \Delta q_{lag} / v

A loop without integral drags the joint along by an error k_p Delta q of position, which is F_s before it slides and
has the other sign on the way back: Delta q_lag = 2 F_s / k_p.

The order of the passes is random, since a joint warms up as it moves; one reference speed comes back at intervals, and
its drift is the warm-up.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import StudyError
from elastid.friction_record import Purpose
from elastid.record import Configuration

SHORTEST_S = 0.3  # of a plateau
PAUSE_S = 0.5  # at rest between there and back
# Peak over mean acceleration of a ramp of velocity with continuous acceleration, 10 x^3 - 15 x^4 + 6 x^5.
RAMP_PEAK = 15 / 8


@dataclass(frozen=True)
class PassLimits:
    """Limits of a joint: angle window (2,), velocity, acceleration, angle per motor revolution, bandwidth of its loop.

    lag: by which the reference is ahead before the joint breaks away.  Link side: rad (m), rad/s, rad/s^2, rad, Hz.
    """

    place: str
    window: tuple[float, float]
    velocity: float
    acceleration: float
    turn: float
    bandwidth_hz: float
    lag: float = 0.0
    slides: bool = False

    @property
    def unit(self) -> str:
        """Unit of a position: rad or m."""
        return "m" if self.slides else "rad"

    @property
    def loop_settling_s(self) -> float:
        """Time in which the loop settles: three time constants."""
        return 3.0 / (2 * math.pi * self.bandwidth_hz)

    def settling_s(self, speed: float) -> float:
        """Return time after a ramp to a speed before the joint slides steadily."""
        return self.loop_settling_s + self.lag / speed


@dataclass(frozen=True)
class PlannedPass:
    """Motion from start to stop > start and back at `speed`. plateau_s: time at constant velocity per direction."""

    name: str
    speed: float
    start: float
    stop: float
    plateau_s: float
    is_reference: bool = False


@frozen_value
class PassReference:
    """One pass there and back at rate_hz, or a joint at rest: position, velocity, acceleration (n,).

    there, back: first sample of each plateau of a pass, and the one after its last.
    """

    rate_hz: float
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    there: tuple[int, int] | None = None
    back: tuple[int, int] | None = None


def plan_passes(
    speeds: Sequence[float], repeat: int, limits: PassLimits, seed: int, reference_every_s: float = 300.0
) -> tuple[PlannedPass, ...]:
    """Plan each speed `repeat` times in random order, the middle speed first, last and every reference_every_s.

    A speed that is given several times has as many passes.  Raises StudyError that names the speed for one that is too
    fast for the joint or its window.
    """
    passes = Counter(speeds)
    plans = [planned_pass(speed, number, limits) for speed in passes for number in range(passes[speed] * repeat)]
    order = np.random.default_rng(seed).permutation(len(plans))
    middle = sorted(speeds)[len(speeds) // 2]
    references, since, count = [_reference(middle, 0, limits)], 0.0, 1
    for i in order:
        references.append(plans[i])
        since += pass_time(plans[i], limits)
        if since > reference_every_s:
            references.append(_reference(middle, count, limits))
            since, count = 0.0, count + 1
    return (*references, _reference(middle, count, limits))


def ramp_time(speed: float, limits: PassLimits) -> float:
    """Return seconds from rest to a speed."""
    return RAMP_PEAK * speed / limits.acceleration


def pass_time(plan: PlannedPass, limits: PassLimits) -> float:
    """Return seconds of one pass there and back."""
    return 2 * (plan.plateau_s + limits.settling_s(plan.speed) + 2 * ramp_time(plan.speed, limits) + PAUSE_S)


def pass_reference(plan: PlannedPass, limits: PassLimits, rate_hz: float) -> PassReference:
    """Compute trapezoids of velocity with smooth ramps, there and back, at rest at both ends."""
    ramp_s = ramp_time(plan.speed, limits)
    settling_s = limits.settling_s(plan.speed)
    n_ramp, n_steady, n_pause = (max(2, round(t * rate_hz)) for t in (ramp_s, plan.plateau_s + settling_s, PAUSE_S))
    x = (np.arange(n_ramp) + 0.5) / n_ramp
    rise = x**3 * (10 - 15 * x + 6 * x**2)
    profile = np.concatenate([rise, np.ones(n_steady), rise[::-1], np.zeros(n_pause)])
    velocity = plan.speed * np.concatenate([profile, -profile])
    position = plan.start + np.cumsum(velocity) / rate_hz
    acceleration = np.gradient(velocity) * rate_hz
    first, last, n = n_ramp + round(settling_s * rate_hz), n_ramp + n_steady, len(profile)
    return PassReference(rate_hz, position, velocity, acceleration, (first, last), (first + n, last + n))


def fastest_speed(limits: PassLimits) -> float:
    """Find the highest speed whose pass fits into the window, within the joint's velocity."""
    travel = limits.window[1] - limits.window[0] - limits.turn - limits.lag
    a, t = limits.acceleration / RAMP_PEAK, limits.loop_settling_s + SHORTEST_S
    if travel <= 0:
        return 0.0
    # travel = v^2 / a + v t.
    return float(min(limits.velocity, a / 2 * (math.sqrt(t**2 + 4 * travel / a) - t)))


def planned_pass(speed: float, number: int, limits: PassLimits) -> PlannedPass:
    """Plan one pass about the middle of the window; StudyError where it has no room."""
    if speed > limits.velocity:
        raise StudyError(
            "friction/plan",
            f"{limits.place} is limited to {limits.velocity:.4g} {limits.unit}/s; the run needs {speed:.4g}. Lower "
            "the highest speed, or correct limits.velocity",
            "friction.constant_velocity.speeds",
        )
    # Both ramps of smooth shape cover half of what their time would at full speed.
    ramps, low, high = speed * ramp_time(speed, limits), *limits.window
    settling = speed * limits.settling_s(speed)
    # Slow passes cover a turn of the motor, but take no longer than 20 s; others dwell for 1 s where there is room.
    least_s = float(np.clip(limits.turn / speed, SHORTEST_S, 20.0))
    plateau_s = max(least_s, min(1.0, (high - low - ramps - settling) / speed))
    travel = ramps + settling + speed * plateau_s
    if travel > (high - low) * (1 + 1e-9):
        raise StudyError(
            "friction/plan",
            f"a constant-velocity run of {limits.place} at {speed:.4g} {limits.unit}/s needs {travel:.4g} "
            f"{limits.unit}; the window is {high - low:.4g}. Widen it, or measure up to {fastest_speed(limits):.3g} "
            f"{limits.unit}/s",
            "friction.constant_velocity.window",
        )
    middle = (low + high) / 2
    return PlannedPass(f"{speed:.4g}-{number}", speed, middle - travel / 2, middle + travel / 2, plateau_s)


def _reference(speed: float, number: int, limits: PassLimits) -> PlannedPass:
    return replace(planned_pass(speed, number, limits), name=f"reference-{number}", is_reference=True)


@frozen_value
class PlannedMotion:
    """Motion of one joint; its name is unique in the plan and names the record.

    configuration: posture in which the others are held.  load, payload: name, and kg at the last frame.
    start_s: from the start of the study.  planned: of a pass.  torque (n,): injected, of loops and at rest, Nm link
    side.  period_samples: of a periodic torque.  is_warm_up: a test pass within a warm-up.
    """

    name: str
    joint: str
    purpose: Purpose
    configuration: Configuration
    load: str = ""
    payload: float = 0.0
    start_s: float = 0.0
    planned: PlannedPass | None = None
    torque: FloatArray | None = None
    period_samples: int | None = None
    is_warm_up: bool = False


@frozen_value
class JointPassDesign:
    """The passes of one joint: limits, speed (n,) with passes (n,) at each, and the certificate of the speeds.

    efficiency: of whole passes against the best shares.
    """

    joint: str
    limits: PassLimits
    speed: FloatArray
    passes: FloatArray
    efficiency: float


@dataclass(frozen=True)
class PlannedWarmUp:
    """A joint that moves to and fro between start and stop at `speed`, from start_s for time_s; tests are motions.

    Link side: rad (m), rad/s; s.
    """

    joint: str
    configuration: Configuration
    start: float
    stop: float
    speed: float
    start_s: float
    time_s: float


@dataclass(frozen=True)
class FrictionPlan:
    """All motions in their order, sampled at rate_hz, and the warm-ups between them.

    robot_time_s: of all of them.  assumed_friction: sentences on the levels of each joint.
    """

    rate_hz: float
    motions: tuple[PlannedMotion, ...]
    designs: tuple[JointPassDesign, ...]
    robot_time_s: float
    warm_ups: tuple[PlannedWarmUp, ...] = ()
    assumed_friction: tuple[str, ...] = ()
