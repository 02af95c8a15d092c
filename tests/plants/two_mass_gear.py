"""A motor and a link behind a gear with every effect that a gear has, by equations and steps of its own.

Link side: J_m q'' + f q' + (F_m + F_load |tau|) sgn q' + ripple sin(r q) + (1 + e') tau = u,
J_l l'' + F_l sgn l' = tau,  tau = n(x) + d x' + h,
n = k x + k_2s |x| x + k_3 x^3 in the ranges of a gear's sheet or behind a gap,  h of a spring that slides,
x = q + e(q) - l.  Runge-Kutta of fourth order, experiments side by side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.record import Configuration, Record
from elastid.robot import Body, Joint, Motor, Robot, Spring

RATE_HZ, SAMPLES, RATIO = 500.0, 1000, 100.0
LINES = np.arange(5, 161, 4)
POSTURE = Configuration("rest", (0.0,))


@dataclass(frozen=True)
class Gear:
    """Numbers on the link side; error: of the transmission, rad, once in a turn of the motor.

    gap: half of it, rad, in which the spring has `loose` of its stiffness, as lost motion has.  ranges: torques, Nm,
    from which on the stiffness is so many times k.  load: friction for each Nm of the gear.  ripple: Nm, once in a turn
    of the motor.  hysteresis: Nm at which a spring beside the gear's slides, after `bends` rad.
    """

    J_m: float = 10.0
    J_l: float = 20.0
    k: float = 2e5
    d: float = 60.0
    f: float = 15.0
    F_m: float = 0.0
    F_l: float = 0.0
    k_3: float = 0.0
    k_2s: float = 0.0
    gap: float = 0.0
    loose: float = 0.0
    ranges: tuple[tuple[float, float], ...] = ()
    error: float = 0.0
    load: float = 0.0
    ripple: float = 0.0
    hysteresis: float = 0.0
    bends: float = 2e-4

    def spring(self, x: FloatArray) -> FloatArray:
        """n(x), Nm."""
        tau = self.k * x + self.k_2s * np.abs(x) * x + self.k_3 * x**3
        tau = tau - (1 - self.loose) * self.k * np.clip(x, -self.gap, self.gap)
        at, factor, torque = 0.0, 1.0, 0.0
        for next_torque, next_factor in self.ranges:
            at, torque = at + (next_torque - torque) / (factor * self.k), next_torque
            tau = tau + (next_factor - factor) * self.k * np.sign(x) * np.maximum(np.abs(x) - at, 0.0)
            factor = next_factor
        return np.asarray(tau)

    def slopes(self, x: FloatArray, u: FloatArray) -> FloatArray:
        """d (q, l, q', l', z) / dt, (5, M), z the bend of the spring that slides."""
        q, link, v, w, z = x
        e, slope = self.error * np.sin(RATIO * q), self.error * RATIO * np.cos(RATIO * q)
        bent = q + e - link
        rate = v * (1 + slope) - w
        tau = self.spring(bent) + self.d * rate + self.hysteresis * np.clip(z / self.bends, -1, 1)
        # A sign that turns over 1e-3 rad/s, a hundredth of the speed, which a step can follow.
        friction = (self.F_m + self.load * np.abs(tau)) * np.tanh(v / 1e-3) + self.ripple * np.sin(RATIO * q)
        behind = self.F_l * np.tanh(w / 1e-3)
        sticks = (np.abs(z) < self.bends) | (z * rate < 0)
        at_motor, at_link = u - (1 + slope) * tau - friction - self.f * v, tau - behind
        return np.stack([v, w, at_motor / self.J_m, at_link / self.J_l, np.where(sticks, rate, 0.0)])


def records(
    gear: Gear, *, experiments: int = 4, rms: float = 200.0, seed: int = 1, substeps: int = 6
) -> tuple[Record, ...]:
    """Two settled periods of each experiment, on a slow carrier, with noise of 2e-7 rad and 0.2 Nm.

    substeps: of a sample; a step over a reversal of friction is a wrong one.
    """
    rng, settling = np.random.default_rng(seed), 1
    spectrum = np.zeros((experiments, LINES[-1] + 1), complex)
    phases = rng.uniform(0, 2 * np.pi, (experiments, len(LINES)))
    spectrum[:, LINES] = rms * np.sqrt(2 / len(LINES)) * np.exp(1j * phases)
    n = SAMPLES * substeps * 2  # of half steps
    torque = _periodic(spectrum, n)
    carrier = np.zeros((experiments, 2), complex)
    carrier[:, 1] = 0.02 * np.exp(1j * rng.uniform(0, 2 * np.pi, experiments))
    reference = _periodic(carrier, n)
    rate = np.gradient(reference, 1 / (RATE_HZ * substeps * 2), axis=1)
    x, h = np.zeros((5, experiments)), 1 / (RATE_HZ * substeps)
    u, q = [], []
    for step in range((settling + 2) * SAMPLES * substeps):

        def applied(x: FloatArray, i: int) -> FloatArray:
            return np.asarray(torque[:, i] + 2e3 * (reference[:, i] - x[0]) + 300 * (rate[:, i] - x[2]))

        i = 2 * step % n
        if step % substeps == 0 and step >= settling * SAMPLES * substeps:
            u.append(applied(x, i))
            q.append(x[0])
        a = gear.slopes(x, applied(x, i))
        b = gear.slopes(x + h / 2 * a, applied(x + h / 2 * a, i + 1))
        c = gear.slopes(x + h / 2 * b, applied(x + h / 2 * b, i + 1))
        last = gear.slopes(x + h * c, applied(x + h * c, (i + 2) % n))
        x = x + h / 6 * (a + 2 * b + 2 * c + last)
        x[4] = np.clip(x[4], -gear.bends, gear.bends)  # a step goes on to where the spring has slid long since
    logged, angle = np.array(u), np.array(q)
    logged = logged + 0.2 * rng.standard_normal(logged.shape)
    angle = angle + 2e-7 * rng.standard_normal(angle.shape)
    places = ("motor 1",)
    return tuple(
        Record(f"r{m}", POSTURE, m, 0, RATE_HZ, SAMPLES, places, places, ("position",), logged[:, m : m + 1],
               angle[:, m : m + 1])
        for m in range(experiments)
    )  # fmt: skip


def _periodic(amplitudes: ComplexArray, n: int) -> FloatArray:
    """Signals (M, n) of a period."""
    padded = np.zeros((len(amplitudes), n // 2 + 1), complex)
    padded[:, : amplitudes.shape[1]] = amplitudes
    return np.asarray(np.fft.irfft(padded, n, axis=1) * (n / 2))


def robot(gear: Gear) -> Robot:
    """The same as a robot without what is not linear, its numbers on the motor's side where they belong there."""
    motor = Motor(gear.J_m / RATIO**2, RATIO, gear.f / RATIO**2)
    joint = Joint("1", "z", Spring(gear.k, gear.d), motor)
    return Robot("two masses", (Body("link", joints=(joint,), inertia=gear.J_l),), gravity=(0.0, 0.0, 0.0))
