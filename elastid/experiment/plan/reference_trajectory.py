r"""Superimposed slow motion, reference trajectories of a complete run, and their simulation.

.. math:: q(t) = s(t)\, p(t), \quad s(\tau) = 10 \tau^3 - 15 \tau^4 + 6 \tau^5

p: periodic movement, s: ramp from 0 to 1 and back, with continuous acceleration; a constant velocity is ramped as a
velocity. Without sliding, friction looks like a spring to ground (LuGre's bristles); at a steady speed above the
Stribeck region a small multisine sees viscous friction alone. A periodic carrier must have its lines outside the
analysed ones, and below them, since friction makes harmonics of it.

.. math:: u_{ff} = T^T [M(q) T \ddot q_{ref} + f(q, T \dot q_{ref})], \qquad r(t) = s(t)\, r_{period}(t \bmod T)

The feed-forward torque is that of the rigid nominal robot on the reference and is an argument here; the injected torque
is the experiment's period, repeated, under the ramp s.
"""

import math
from collections.abc import Callable
from dataclasses import field
from typing import TypeAlias

import numpy as np
from numpy.polynomial import Polynomial

from elastid.base.arrays import FloatArray, IntArray, frozen_value, labelled
from elastid.base.errors import StudyError
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.record import Configuration
from elastid.robot import Robot

# Of the filter of a square carrier; used on a real axis that turned its motor at 20 rad/s.
SQUARE_CUTOFF_HZ = 1.0


@frozen_value
class Movement:
    """One whole run: position, velocity, acceleration (n, n_u) about the configuration; rad or m, link side.

    scale (n,): by which the injected torque is multiplied, 0 at rest and 1 in all periods.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    scale: FloatArray


def movement(carrier: CarrierSpec | None, plan: Plan) -> Movement:
    """Return motion of every run of a plan, from and to zero velocity, at the controller's rate."""
    n_u = len(plan.inputs)
    s, ds, dds = _ramps(plan)
    if carrier is None:
        still = np.zeros((plan.run_samples, n_u))
        return Movement(still, still, still, s)
    if carrier.kind == "offset":
        return _constant_velocity(carrier.velocities(n_u), s, ds, plan)
    p, dp, ddp = _sine(carrier, plan) if carrier.kind == "sine" else _square(carrier, plan)
    s, ds, dds = s[:, None], ds[:, None], dds[:, None]
    return Movement(s * p, ds * p + s * dp, dds * p + 2 * ds * dp + s * ddp, s[:, 0])


def max_excursion(carrier: CarrierSpec, n_u: int, period_s: float, before_s: float) -> FloatArray:
    """Return largest excursion (n_u,) of each joint to either side, rad or m.

    before_s: at full velocity from the start of a run to the middle of its measured periods.
    """
    v = np.abs(carrier.velocities(n_u))
    return (v * before_s if carrier.kind == "offset" else v * period_s / (4 * carrier.cycles)) + carrier.amplitudes(n_u)


def check_movement(carrier: CarrierSpec, plan: Plan, robot: Robot) -> None:
    """Raise StudyError for a carrier of other motors, on analysed lines, or beyond joint limits, with ramps."""
    if refusal := carrier.refusal(len(plan.inputs), int(min(*plan.lines, *plan.detection))):
        raise StudyError("experiment/simulated", refusal, "experiment.simulated.carrier")
    low, high = np.array([end(movement(carrier, plan).position, axis=0) for end in (np.min, np.max)])
    for configuration in plan.configurations:
        middle, swings = (configuration.angles + (low + high) / 2).tolist(), ((high - low) / 2).tolist()
        for joint, at, swing in zip(robot.driven, middle, swings, strict=True):
            if refusal := joint.position_refusal(at, swing):
                raise StudyError(
                    "experiment/simulated",
                    f"{refusal}. Reduce the carrier, or move configuration {configuration.name}",
                    "experiment.simulated.carrier",
                )


def _ramps(plan: Plan) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute s (n,) and its first two derivatives in 1/s, 1/s^2: hold, ramp, periods, ramp, hold."""
    ramp = plan.ramp_samples
    tau = np.arange(ramp) / max(ramp, 1)
    rate, rise = plan.rate_hz / max(ramp, 1), Polynomial([0, 0, 0, 10, -15, 6])
    rising = [rise.deriv(order)(tau) * rate**order for order in range(3)]
    still = np.zeros(plan.hold_samples)
    n = plan.run_samples - 2 * plan.first_sample
    # Downwards the first sample is that of s = 1, the last one before s = 0.
    s, ds, dds = (
        np.concatenate([still, up, np.full(n, full), [full][:ramp], sign * up[:0:-1], still])
        for up, full, sign in zip(rising, (1.0, 0.0, 0.0), (1, -1, 1), strict=True)
    )
    return s, ds, dds


def _sine(carrier: CarrierSpec, plan: Plan) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute p, p', p'' (n, n_u)."""
    omega = 2 * np.pi * carrier.cycles * plan.rate_hz / plan.period_samples
    phase, a = (omega * _time(plan))[:, None], carrier.amplitudes(len(plan.inputs))
    sine, cosine = np.sin(phase), np.cos(phase)  # of all motors
    return a * sine, a * omega * cosine, -a * omega**2 * sine


def _square(carrier: CarrierSpec, plan: Plan) -> tuple[FloatArray, FloatArray, FloatArray]:
    r"""Compute p, p', p'' (n, n_u) with p' = (4 v / pi) sum_h sin(h omega t) / h / (1 + (h f / f_c)^4)^(1/2), h odd.

    The second-order filter has no phase; harmonics on analysed lines, those of detection too, are left out.
    """
    f = carrier.cycles * plan.rate_hz / plan.period_samples
    h = np.arange(1, (plan.period_samples - 1) // (2 * carrier.cycles) + 1, 2)
    amplitude = 1 / (h * np.sqrt(1 + (h * f / SQUARE_CUTOFF_HZ) ** 4))
    is_measured = np.isin(h * carrier.cycles, np.concatenate([plan.lines, plan.detection]))
    is_free = ~is_measured & (amplitude > 1e-4 * amplitude[0])
    omega = 2 * np.pi * f * h[is_free]
    c = 4 / np.pi * amplitude[is_free]
    phase = np.outer(_time(plan), omega)
    v = carrier.velocities(len(plan.inputs))
    shapes = (-np.cos(phase) @ (c / omega), np.sin(phase) @ c, np.cos(phase) @ (c * omega))
    p, dp, ddp = (np.outer(shape, v) for shape in shapes)
    return p, dp, ddp


def _constant_velocity(v: FloatArray, s: FloatArray, ds: FloatArray, plan: Plan) -> Movement:
    distance = np.concatenate([[0.0], np.cumsum((s[1:] + s[:-1]) / 2)]) / plan.rate_hz
    middle = (plan.measured.start + plan.measured.stop) // 2
    return Movement(np.outer(distance - distance[middle], v), np.outer(s, v), np.outer(ds, v), s)


def _time(plan: Plan) -> FloatArray:
    return (np.arange(plan.run_samples) - plan.first_sample) / plan.rate_hz


# Torque (n, n_u) of the rigid robot on a movement of n samples about a configuration.
FeedForward: TypeAlias = Callable[[Configuration, Movement], FloatArray]


@frozen_value
class Reference:
    """One whole run in one configuration, each (n, n_u): rad, rad/s, rad/s^2, Nm, link side; scale (n,), 0 to 1.

    The injected torque at sample i is scale[i] times the experiment's period at (i - first_sample) mod N.
    """

    configuration: Configuration
    rate_hz: float
    first_sample: int
    position: FloatArray = labelled("position of each motor, link side", "rad", "time_s inputs")
    velocity: FloatArray = labelled("velocity of each motor, link side", "rad/s", "time_s inputs")
    acceleration: FloatArray = labelled("acceleration of each motor, link side", "rad/s^2", "time_s inputs")
    feed_forward: FloatArray = labelled("feed-forward torque of each motor, link side", "N*m", "time_s inputs")
    scale: FloatArray = labelled("factor on the torque of the experiment, 0 at rest", "", "time_s")

    def injected(self, period: FloatArray) -> FloatArray:
        """Return r (n, n_u) of a whole run from one period (N, n_u) of torque."""
        return _repeat(period, self.scale, self.first_sample)


def _repeat(period: FloatArray, scale: FloatArray, first_sample: int) -> FloatArray:
    return scale[:, None] * period[np.arange(-first_sample, len(scale) - first_sample) % len(period)]


def references(plan: Plan, carrier: CarrierSpec | None, experiment: Experiment, factor: float = 1.0) -> FloatArray:
    """Compute all references (m, n_u) of a run, one a cycle: rad, or rad/s if velocities are injected, link side.

    Movement and multisine (times factor) together, the first two and the last two rows at rest.  No rows for torques.
    """
    if plan.inject == "torque":
        return np.zeros((0, len(plan.inputs)))
    path = movement(carrier, plan)
    signal = experiment.configuration.angles + path.position if plan.inject == "position" else path.velocity
    return (signal + _repeat(factor * plan.reference(experiment), path.scale, plan.first_sample))[:: plan.cycle_samples]


def reference(
    plan: Plan, carrier: CarrierSpec | None, feed_forward: FeedForward, configuration: Configuration
) -> Reference:
    """Return the reference of one configuration."""
    path = movement(carrier, plan)
    signals = path.position, path.velocity, path.acceleration, path.scale
    configurations, index = np.unique(_first_of_its_kind(plan, carrier), return_inverse=True)
    torque = feed_forward(configuration, Movement(*(x[configurations] for x in signals)))[index]
    position = configuration.angles + path.position
    timing = plan.rate_hz, plan.first_sample
    return Reference(configuration, *timing, position, path.velocity, path.acceleration, torque, path.scale)


def _first_of_its_kind(plan: Plan, carrier: CarrierSpec | None) -> IntArray:
    """Find the first sample (n,) of the same movement: at rest one for all, in the periods one of a cycle."""
    sample, first = np.arange(plan.run_samples), plan.first_sample
    if carrier is None:
        return np.zeros_like(sample)
    if carrier.kind == "offset":
        return sample
    cycle = plan.period_samples // math.gcd(plan.period_samples, carrier.cycles)
    return np.where((sample >= first) & (sample < plan.run_samples - first), first + (sample - first) % cycle, sample)


@frozen_value
class Rehearsal:
    """Motor angles and torques (n, n_u) of a whole run, rad and Nm, link side; its periods begin at first_sample.

    references (m, n_u): injected ones, as `references`.
    """

    experiment: Experiment
    rate_hz: float
    first_sample: int
    position: FloatArray = labelled("angle of each motor, link side", "rad", "time_s inputs")
    torque: FloatArray = labelled("torque of each motor, link side", "N*m", "time_s inputs")
    references: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def time_s(self) -> FloatArray:
        """Time (n,), 0 where the periods begin."""
        return (np.arange(len(self.torque)) - self.first_sample) / self.rate_hz

    @property
    def signals(self) -> FloatArray:
        """(4, n, n_u): torque, position about the configuration, velocity, acceleration, in the order of the limits."""
        motion = self.position - self.experiment.configuration.angles, *derivatives(self.position, self.rate_hz)
        return np.array([self.torque, *motion])


def derivatives(x: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Compute first and second derivative (n, c) of x (n, c), of sixth order; the run begins and ends at rest."""
    extended = np.pad(x, ((3, 3), (0, 0)), mode="edge")
    f = [extended[i : i + len(x)] for i in range(7)]
    first = (45 * (f[4] - f[2]) - 9 * (f[5] - f[1]) + f[6] - f[0]) * (rate_hz / 60)
    return first, (2 * (f[6] + f[0]) - 27 * (f[5] + f[1]) + 270 * (f[4] + f[2]) - 490 * f[3]) * (rate_hz**2 / 180)
