r"""Whether the misfit grows along frequency as that of a torque which acts later, or weaker, than its samples say.

.. math:: H(f; T) = e^{-j \pi f T} \frac{\sin \pi f T}{\pi f T}, \qquad D(f; T) = e^{-j \pi f T}

H: of a torque held for T between its samples.  D: of a delay T / 2.  Each is one number more in the fit: T follows with
the parameters by Gauss-Newton steps on responses divided by it. A negative T is a hold that was taken out where none
is. Both differ by the sinc alone, 1.6 % at f T = 0.1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note
from elastid.fit.diagnosis.read_again import roughly_solved, thinned, times
from elastid.fit.problem.elastic import ElasticFit

Factor: TypeAlias = Callable[[FloatArray, float], ComplexArray]

# A hold must explain this share of what V has beyond the noise, and lower V by so much more than one parameter does by
# chance (chi-squared of one degree of freedom, times V / dof).
MIN_REMOVED_SHARE = 0.8
MIN_DROP = 30.0
# f T at the upper edge: below it no hold is worth a word, and none is longer.
MIN_EDGE_PHASE = 0.01
MAX_EDGE_PHASE = 0.8
# A delay that leaves less than this more of V than the hold does cannot be told from it.
MAX_DELAY_DROP = 10.0
MAX_LINES = 200
ROUNDS = 3
# f T at the upper edge where the search starts: beside a free delay the sinc is flat at zero.
STARTS = (0.0, 0.2)
STEP = 1e-4


@dataclass(frozen=True)
class Late:
    """T in s with which the responses, divided by a factor, fit best, and V there."""

    time: float
    cost: float


def find_held_torque(fit: ElasticFit, x: FloatArray, cost: float, noise_cost: float) -> tuple[Note, ...]:
    """A note where a hold, or a delay, explains most of what V has beyond the noise.

    x (n_x,): the optimum, cost: V there.  noise_cost: V by the noise alone.
    """
    thin = thinned(fit, MAX_LINES)
    edge_hz = max((float(part.kernel.freq_hz.max()) for part in thin.parts if part.n_residuals), default=0.0)
    if edge_hz == 0:
        return ()
    before, _ = roughly_solved(thin, x)
    noise = noise_cost * thin.n_residuals / fit.n_residuals
    held = _latest(thin, x, hold, edge_hz)
    level = max(held.cost / max(thin.problem.dof, 1), 1e-300)
    removed = before - held.cost
    if abs(held.time) * edge_hz < MIN_EDGE_PHASE or removed < max(
        MIN_REMOVED_SHARE * (before - noise), MIN_DROP * level
    ):
        return ()
    fell = f"V falls from {before:.4g} to {held.cost:.4g} where the noise explains {noise:.4g}"
    if held.time < 0:
        return (
            Note(
                "held-torque",
                f"the misfit grows towards {edge_hz:.4g} Hz as if the torque acted {-held.time / 2e-3:.3g} ms earlier "
                f"than it was taken to ({fell}): leave hold: zero-order out where u was measured, and check the delay",
            ),
        )
    delayed = _latest(thin, x, delay, edge_hz)
    if held.cost - delayed.cost > MAX_DELAY_DROP * level:
        return (
            Note(
                "torque-delay",
                f"the misfit grows towards {edge_hz:.4g} Hz as that of a delay of {delayed.time / 2e-3:.3g} ms (V "
                f"falls from {before:.4g} to {delayed.cost:.4g} where the noise explains {noise:.4g}): free delay "
                "(fit.parameters: {delay: {}}), or give the robot's chain its lags",
            ),
        )
    says = (
        f"the misfit grows towards {edge_hz:.4g} Hz as that of a torque that acts {held.time / 2e-3:.3g} ms late "
        f"({fell}): where u is a command that the drive holds for {held.time / 1e-3:.3g} ms, a sample at "
        f"{1 / held.time:.4g} Hz, say hold: zero-order in experiment.recorded (with rate_hz in experiment.responses)"
    )
    if delayed.cost - held.cost < MAX_DELAY_DROP * level:
        says += "; where the torque loop or a log delays it, free delay (fit.parameters: {delay: {}})"
    return (Note("held-torque", says),)


def hold(freq_hz: FloatArray, T: float) -> ComplexArray:
    """H (F,) of a torque held for T, its inverse where T is negative."""
    H = np.exp(-1j * np.pi * freq_hz * abs(T)) * np.sinc(freq_hz * abs(T))
    return np.asarray(H if T >= 0 else 1 / H)


def delay(freq_hz: FloatArray, T: float) -> ComplexArray:
    """D (F,) of a torque that acts T / 2 late."""
    return np.asarray(np.exp(-1j * np.pi * freq_hz * T))


def _latest(fit: ElasticFit, x: FloatArray, factor: Factor, edge_hz: float) -> Late:
    """T, found in alternation of Gauss-Newton steps of T and x together with solves for x."""
    ends = (_latest_from(fit, x, factor, edge_hz, start / edge_hz) for start in STARTS)
    return min(ends, key=lambda end: end.cost)


def _latest_from(fit: ElasticFit, x: FloatArray, factor: Factor, edge_hz: float, T: float) -> Late:
    best = Late(T, np.inf)
    for _ in range(ROUNDS + 1):
        there = _divided(fit, factor, T)
        V, x = roughly_solved(there, x)
        if not best.cost > V:
            break
        best = Late(T, V)
        h = STEP / edge_hz
        r, J = there.residual(x)
        slope = (_divided(fit, factor, T + h).residual(x)[0] - r) / h
        size = np.append(np.linalg.norm(J, axis=0), np.linalg.norm(slope))
        size[size == 0] = 1.0
        step = np.linalg.lstsq(np.column_stack([J, slope]) / size, -r)[0] / size
        T = float(np.clip(T + step[-1], -MAX_EDGE_PHASE / edge_hz, MAX_EDGE_PHASE / edge_hz))
    return best


def _divided(fit: ElasticFit, factor: Factor, T: float) -> ElasticFit:
    return times(fit, [1 / factor(part.kernel.freq_hz, T)[:, None, None] for part in fit.parts])
