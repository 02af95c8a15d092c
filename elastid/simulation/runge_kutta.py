"""Explicit Runge-Kutta methods, one step of a robot with friction states, and the number of stable steps."""

import math
from collections.abc import Callable, Sequence
from functools import reduce
from operator import add
from typing import TypeVar

import casadi as ca
import numpy as np

from elastid.base.arrays import ComplexArray, frozen_value

Symbol = TypeVar("Symbol", ca.SX, ca.MX)

# |h lambda| of a step; classical ones are stable to 2.785 on the negative real axis and 2.828 on the imaginary one.
MAX_STEP_RATE = 2.5
# Simulations along a log unroll all substeps of a sample in one expression: more take seconds to build.
MAX_SUBSTEPS = 80


@frozen_value
class Tableau:
    """Explicit Runge-Kutta method: a_ij by rows, b_i and the nodes c_i of its stages."""

    rows: tuple[tuple[float, ...], ...]
    weights: tuple[float, ...]

    @property
    def nodes(self) -> tuple[float, ...]:
        """c_i = sum of a_ij."""
        return tuple(sum(row) for row in self.rows)

    def amplification(self, z: ComplexArray) -> ComplexArray:
        """Evaluate stability function R(z) (...,): a step h multiplies exp(lambda t) by it, at z = h lambda (...,)."""
        stages = list[ComplexArray]()
        for row in self.rows:
            stages.append(1 + z * sum((a * k for a, k in zip(row, stages, strict=True)), np.zeros_like(z)))
        return 1 + z * sum((b * k for b, k in zip(self.weights, stages, strict=True)), np.zeros_like(z))


CLASSICAL = Tableau(((), (1 / 2,), (0, 1 / 2), (0, 0, 1)), (1 / 6, 1 / 3, 1 / 3, 1 / 6))
# Of fifth order in six stages (Butcher, Journal of the Australian Mathematical Society 4, 1964). An oscillation at
# omega comes out with a relative frequency error of 3.7e-4 (omega h)^6 and a damping ratio more by 1.7e-4 (omega h)^5.
FIFTH_ORDER = Tableau(
    ((), (1 / 4,), (1 / 8, 1 / 8), (0, -1 / 2, 1), (3 / 16, 0, 0, 9 / 16), (-3 / 7, 2 / 7, 12 / 7, -12 / 7, 8 / 7)),
    (7 / 90, 0, 32 / 90, 12 / 90, 32 / 90, 7 / 90),
)


def runge_kutta_step(
    acceleration: Callable[[Symbol, Symbol, Symbol, Symbol], Symbol],
    advanced: Callable[[Symbol, Symbol, float], Symbol], q: Symbol, v: Symbol, z: Symbol, u: Sequence[Symbol],
    step: float, method: Tableau = CLASSICAL
) -> tuple[Symbol, Symbol, Symbol]:  # fmt: skip
    """Build (q, v, z) after one Runge-Kutta step, u the torque at each stage of the method.

    The error of the classical one is of order step^4: an oscillation at omega comes out with a relative frequency error
    of (omega step)^4 / 120 and an added damping ratio of (omega step)^5 / 144.
    acceleration(q, v, z, u).  advanced(z, v, step): z after `step` at constant v. Friction states
    advance with the velocities of q, stage by stage: bristles that stick are integrated as any other spring, and
    bristles that slip, however fast their rate sigma_0 |v| / g, by the exact update, which has no limit of stability.
    """
    velocities, accelerations, states = [v], [acceleration(q, v, z, u[0])], z
    for row, node, torque in zip(method.rows[1:], method.nodes[1:], u[1:], strict=True):
        mean = _weighted_sum(row, velocities) / node
        states = advanced(z, mean, node * step)
        v_i = v + step * _weighted_sum(row, accelerations)
        accelerations.append(acceleration(q + node * step * mean, v_i, states, torque))
        velocities.append(v_i)
    mean = _weighted_sum(method.weights, velocities)
    return q + step * mean, v + step * _weighted_sum(method.weights, accelerations), advanced(z, mean, step)


def _weighted_sum(weights: Sequence[float], values: Sequence[Symbol]) -> Symbol:
    return reduce(add, (weight * value for weight, value in zip(weights, values, strict=True) if weight))


def least_steps(poles: ComplexArray, duration: float) -> int:
    """Find the steps of FIFTH_ORDER in a duration, s, for poles (n,), rad/s: |R(z)| <= max(|exp z|, 1), |z| <= 2.5."""
    n = max(1, math.ceil(np.abs(poles).max() * duration / MAX_STEP_RATE))
    while True:
        z = poles * (duration / n)
        if np.all(np.abs(FIFTH_ORDER.amplification(z)) <= (1 + 1e-9) * np.exp(np.maximum(z.real, 0.0))):
            return int(n)
        n += 1
