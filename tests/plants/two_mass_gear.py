"""A motor and a link behind a gear with every effect that a gear has, by equations and steps of its own.

Link side: J_m q'' + f q' + (F_m + F_load |tau|) sgn q' + ripple sin(r q) + (1 + e') tau = u,
J_l l'' + F_l sgn l' = tau,  tau = n(x) + d x' + h,
n = k x + k_2s |x| x + k_3 x^3 in the ranges of a gear's sheet or behind a gap,  h of a spring that slides,
x = q + e(q) - l.  Runge-Kutta of fourth order.
"""

from dataclasses import astuple, dataclass

import numpy as np
from numba import njit

from elastid.base.arrays import FloatArray
from elastid.excitation.multisine import synthesise
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

    @property
    def numbers(self) -> tuple[float, ...]:
        """All but the ranges, in the order of the fields."""
        return tuple(value for value in astuple(self) if not isinstance(value, tuple))

    @property
    def ends(self) -> FloatArray:
        """Of the ranges (n, 2): deflection, and what the stiffness grows by there."""
        at, factor, torque, ends = 0.0, 1.0, 0.0, []
        for next_torque, next_factor in self.ranges:
            at, torque = at + (next_torque - torque) / (factor * self.k), next_torque
            ends.append((at, (next_factor - factor) * self.k))
            factor = next_factor
        return np.array(ends).reshape(-1, 2)

    def slopes(self, x: FloatArray, u: float) -> FloatArray:
        """d (q, l, q', l', z) / dt (5,) under a torque."""
        slopes = np.zeros(5)
        _slopes(x, u, self.numbers, self.ends, slopes)
        return slopes


@njit(cache=True)
def _slopes(x, u, numbers, ends, slopes):
    """d (q, l, q', l', z) / dt (5,) into slopes, z the bend of the spring that slides."""
    J_m, J_l, k, d, f, F_m, F_l, k_3, k_2s, gap, loose, error, load, ripple, hysteresis, bends = numbers
    q, link, v, w, z = x
    slope = error * RATIO * np.cos(RATIO * q)
    bent, rate = q + error * np.sin(RATIO * q) - link, v * (1 + slope) - w
    tau = k * bent + k_2s * abs(bent) * bent + k_3 * bent**3 - (1 - loose) * k * min(max(bent, -gap), gap)
    for at, more in ends:
        tau += more * np.sign(bent) * max(abs(bent) - at, 0.0)
    tau += d * rate + hysteresis * min(max(z / bends, -1.0), 1.0)
    # A sign that turns over 1e-3 rad/s, a hundredth of the speed, which a step can follow.
    friction = (F_m + load * abs(tau)) * np.tanh(v / 1e-3) + ripple * np.sin(RATIO * q)
    slopes[0], slopes[1] = v, w
    slopes[2] = (u - (1 + slope) * tau - friction - f * v) / J_m
    slopes[3] = (tau - F_l * np.tanh(w / 1e-3)) / J_l
    slopes[4] = rate if abs(z) < bends or z * rate < 0 else 0.0


@njit(cache=True)
def _simulated(torque, reference, rate, numbers, ends, substeps):
    """Torques and angles (2 SAMPLES,) of an experiment after a period that settles; given (2 SAMPLES substeps,)."""
    bends, h, start = numbers[-1], 1 / (RATE_HZ * substeps), SAMPLES * substeps
    u, q, x, moved = np.empty(2 * SAMPLES), np.empty(2 * SAMPLES), np.zeros(6), np.empty(6)
    slopes = np.zeros((5, 6))
    for step in range(3 * start):
        first = 2 * step % len(torque)
        for stage, part in enumerate((0.0, 0.5, 0.5, 1.0)):
            i = (first + int(2 * part)) % len(torque)
            moved[:] = x + part * h * slopes[stage]
            wanted = 2e3 * (reference[i] - moved[0]) + 300 * (rate[i] - moved[2])
            applied = torque[i] + moved[5]
            if stage == 0 and step % substeps == 0 and step >= start:
                u[(step - start) // substeps], q[(step - start) // substeps] = applied, x[0]
            _slopes(moved[:5], applied, numbers, ends, slopes[stage + 1])
            slopes[stage + 1, 5] = 200.0 * (wanted - moved[5])  # bandwidth in rad/s, far below half the rate
        x += h / 6 * (slopes[1] + 2 * slopes[2] + 2 * slopes[3] + slopes[4])
        x[4] = min(max(x[4], -bends), bends)  # a step goes on to where the spring has slid long since
    return u, q


def records(gear: Gear, *, experiments: int = 4, seed: int = 1, substeps: int = 6) -> tuple[Record, ...]:
    """Two settled periods of each experiment, on a slow carrier, with noise of 2e-7 rad and 0.2 Nm.

    substeps: of a sample; a step over a reversal of friction is a wrong one.
    """
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 2 * np.pi, (experiments, len(LINES)))
    n = SAMPLES * substeps * 2  # of half steps
    torque = synthesise(LINES, 200.0 * np.sqrt(2 / len(LINES)) * np.exp(1j * phases.T), n).T
    carrier = 0.02 * np.exp(1j * rng.uniform(0, 2 * np.pi, (1, experiments)))
    reference = synthesise(np.array([1]), carrier, n).T
    rate = np.gradient(reference, 1 / (RATE_HZ * substeps * 2), axis=1)
    signals = zip(torque, reference, rate, strict=True)
    logged, angle = np.array([_simulated(*each, gear.numbers, gear.ends, substeps) for each in signals]).transpose(
        1, 2, 0
    )
    logged = logged + 0.2 * rng.standard_normal(logged.shape)
    angle = angle + 2e-7 * rng.standard_normal(angle.shape)
    places = ("motor 1",)
    return tuple(
        Record(f"r{m}", POSTURE, m, 0, RATE_HZ, SAMPLES, places, places, ("position",), logged[:, m : m + 1],
               angle[:, m : m + 1])
        for m in range(experiments)
    )  # fmt: skip


def robot(gear: Gear) -> Robot:
    """The same as a robot without what is not linear, its numbers on the motor's side where they belong there."""
    motor = Motor(gear.J_m / RATIO**2, RATIO, gear.f / RATIO**2)
    joint = Joint("1", "z", Spring(gear.k, gear.d), motor)
    return Robot("two masses", (Body("link", joints=(joint,), inertia=gear.J_l),), gravity=(0.0, 0.0, 0.0))
