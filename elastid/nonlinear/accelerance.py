r"""Acceleration per torque of a motor above the excited lines, where friction and the loop still move it.

Next to the excited lines a motor moves as these lines end, with one pair of poles that may lie above them, the inertia
beyond, and a spring for the poles below,

.. math:: A(s) = \frac{a s^2 + b s + c + e / s^2}{s^2 + \alpha s + \beta}, \qquad
          A s^2 = a s^2 + b s + c + e / s^2 - A (\alpha s + \beta)

which is linear in its six numbers. (Levy, IRE Trans. Autom. Control 4, 1959; weights by the denominator before,
Sanathanan and Koerner, IEEE Trans. Autom. Control 8, 1963.) Where a + c / s^2 describes these lines as well, it is an
inertia on a spring whose other end rests.

From 1.5 times the highest line, and these poles, on all images of its samples are known but for these numbers,

.. math:: y = \sum_{l=0}^{4} a_l \Big[\frac{\tau}{s^{2+l}}\Big]_{folded}, \qquad \tau = H u - \sum_i f_i \phi_i,
          \quad a_0 = 1 / J, \quad a_1 = -d / J^2, \quad a_2 = -k / J^2 + d^2 / J^3

of which the last two count where a resonance is near. A regression over these lines gives a_0 to some tenths of a
percent, unless noise hides them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.execution import Execution
from elastid.excitation.grids import line_frequencies
from elastid.nonlinear.moments import Moments
from elastid.nonlinear.motion import own_spectrum, whole_samples
from elastid.nonlinear.reconstruct import sharp_motion, shows_images
from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.shapes import friction_moments
from elastid.nonlinear.spectra import ConfigurationSpectra, taken
from elastid.record import MOTION_ORDER, Record
from elastid.record import Motion as Quantity

# The upper excited lines, from this part of the highest on, show how a motor moves above them, if that leaves at most
# this part of its response.
_UPPER, _UNEXPLAINED = 0.6, 0.1
# Poles of a robot have half a percent of damping, at least; those of noise may have none.
_LEAST_DAMPED = 0.01
# Further numbers, for a resonance near the band, must leave at most this part of the power that is left without.
_FURTHER_GAIN = 0.7
# Of the power of the lines that show the acceleration per torque, at most, what does not repeat: a is then off by a
# tenth of it, times the gain of the loop there, which is below one.
_NOISE_SHARE = 0.1


def upper_accelerance(
    data: Sequence[ConfigurationSpectra], levels: FloatArray, motor_of: IntArray, quantity: Quantity
) -> tuple[FloatArray, FloatArray]:
    """Accelerance (n_m,) and the numbers a, b, c, e, alpha, beta (C, n_m, 6) above the lines, friction being `levels`.

    Numbers are 0 where the upper lines do not show them; the accelerance is the median of a, or else of the highest
    lines, with which half the rate is to be exceeded.
    """
    numbers, tops = [], []
    for configuration in data:
        on = np.flatnonzero(configuration.excited)
        on = on[configuration.freq_hz[on] >= _UPPER * configuration.freq_hz[on[-1]]]
        friction = taken(levels, configuration.Phi[on], motor_of, configuration.U.shape[1])
        G = configuration.Y[on] @ np.linalg.pinv(configuration.U[on] - friction)
        s = 2j * np.pi * configuration.freq_hz[on]
        A = np.diagonal(G, axis1=1, axis2=2) * s[:, None] ** (2 - MOTION_ORDER[quantity])
        numbers.append([_continued(s, of_motor) for of_motor in A.T])
        # A motor moves as an inertia at the highest eighth of the excited lines.
        tops.append(A[-max(1, int(len(A) * (1 / 8) / (1 - _UPPER))) :].real)
    above = np.array(numbers)
    plain = np.maximum(np.median(np.concatenate(tops), axis=0), 0.0)
    of_motors = zip(above[..., 0].T, plain, strict=True)
    return np.array([np.median(a[a > 0]) if np.any(a > 0) else top for a, top in of_motors]), above


def _continued(s: ComplexArray, A: ComplexArray) -> FloatArray:
    """a, b, c, e, alpha, beta (6,) of an accelerance A (F,) at the upper lines; 0 where it is none of these."""
    if len(s) < 6:
        return np.zeros(6)
    top = abs(s[-1])
    x, size = s / top, float(np.sqrt(np.mean(np.abs(A) ** 2)))
    (a, c), left = _least(np.stack([np.ones_like(x), x**-2]), A, np.ones(len(x)))
    found = np.array([a, 0.0, c, 0.0, 0.0, 0.0])
    for has_spring in (False, True):
        longer, of_longer = _with_poles(x, A, has_spring)
        alpha, beta = longer[4:]
        is_damped = beta > 0 and alpha > _LEAST_DAMPED * np.sqrt(beta)
        if is_damped and longer[0] > 0 and of_longer**2 < _FURTHER_GAIN * left**2:
            found, left = longer, of_longer
    if found[0] <= 0 or left > _UNEXPLAINED * size:
        return np.zeros(6)
    return np.asarray(found * top ** np.array([0, 1, 2, 4, 1, 2]))


def _with_poles(x: ComplexArray, A: ComplexArray, has_spring: bool) -> tuple[FloatArray, float]:
    """a, b, c, e, alpha, beta (6,) of an accelerance A (F,) at s = x, and the RMS left; e is 0 without a spring."""
    weight = np.ones(len(x))
    numbers = np.array([0, 1, 2, 3, 4, 5] if has_spring else [0, 1, 2, 4, 5])
    columns = np.stack([x**2, x, np.ones_like(x), x**-2, -A * x, -A])[numbers]
    poles = np.zeros(6)
    for _ in range(4):
        poles[numbers], left = _least(columns, A * x**2, weight)
        weight = 1 / np.maximum(np.abs(x**2 + poles[4] * x + poles[5]), 1e-6)
    return poles, left


def _least(columns: ComplexArray, y: ComplexArray, weight: FloatArray) -> tuple[FloatArray, float]:
    """Real numbers (n,) for columns (n, F) of y (F,), and the RMS of what they leave."""
    X, e = columns * weight, y * weight
    solution = np.linalg.lstsq(np.hstack([X.real, X.imag]).T, np.concatenate([e.real, e.imag]), rcond=None)[0]
    return solution, float(np.sqrt(np.mean(np.abs(e - solution @ X) ** 2)))


def with_inertial_accelerance(
    friction: FrictionTakenOut, records: Sequence[Record], execution: Execution | None = None
) -> FrictionTakenOut:
    """The friction with the accelerance by the first of some records in place of that by the excited lines.

    Only of motors whose torque is held, with friction, where the regression is good.  execution: of the records.
    """
    accelerance, series, from_hz = (array.copy() for array in (friction.accelerance, friction.series, friction.from_hz))
    lowest = _lowest_hz(friction, records[0].rate_hz)
    held = [place for place in friction.places if shows_images(records[0], place)]
    if not set(held) & set(friction.taken_places()):
        return friction
    # Six records give it to less than a percent.
    of_records = (execution or Execution()).ordered(partial(_equations, held, friction), records[:6])
    X, Y, others = (np.concatenate(parts, axis=-1) for parts in zip(*of_records, strict=True))
    for i, place in enumerate(held):
        # The loop's torque answers noise as it answers motion: where y is noise, the regression finds -1 / C.
        is_noise = np.mean(np.abs(others[i]) ** 2) > _NOISE_SHARE * np.mean(np.abs(Y[i]) ** 2)
        m = friction.places.index(place)
        if is_noise or place not in friction.taken_places() or friction.above[-1, m, 5] > 0:
            continue
        short, longer = (_regression(X[i, :n], Y[i]) for n in (3, 5))
        solution, std, _ = longer if longer[2] < _FURTHER_GAIN * short[2] else short
        # One of a larger standard deviation is not better than the excited lines, if they show one.
        if std < (0.03 if accelerance[m] > 0 else 0.1) * solution[0]:
            accelerance[m], from_hz[m] = solution[0], lowest
            series[m] = 0.0
            series[m, : len(solution) - 1] = (
                solution[1:] / solution[0] * (2 * np.pi * lowest) ** np.arange(1, len(solution))
            )
    return replace(friction, accelerance=accelerance, series=series, from_hz=from_hz)


def _regression(X: ComplexArray, y: ComplexArray) -> tuple[FloatArray, float, float]:
    """Real numbers (n,) for columns (n, F) of y (F,), the deviation of the first, and the power that is left."""
    size = np.sqrt(np.sum(np.abs(X) ** 2, axis=1))
    inverse = np.linalg.pinv((X.conj() @ X.T).real / np.outer(size, size), hermitian=True)
    solution = inverse @ ((X.conj() @ y).real / size) / size
    left = float(np.mean(np.abs(y - solution @ X) ** 2))
    return solution, float(np.sqrt(left / 2 * inverse[0, 0]) / size[0]), left


def _lowest_hz(friction: FrictionTakenOut, rate_hz: float) -> float:
    """From where on the series holds, beyond the excited lines."""
    return float(min(1.5 * friction.highest_hz[-1], 1 / 4 * rate_hz))


def _equations(
    places: Sequence[str], friction: FrictionTakenOut, record: Record
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """The columns (n_m, 5, F) of a_0 to a_4 and y (n_m, F) at the lines of the period above the excited ones.

    With y (n_m, N) at lines that hold what does not repeat; of one period those of the highest eighth, barely moved.
    """
    n, rate_hz = whole_samples(record), record.rate_hz
    lowest, repeats = _lowest_hz(friction, rate_hz), n // record.period_samples
    every = np.arange(n // 2)
    above = line_frequencies(every, rate_hz, n) > lowest
    lines = every[above & (every % repeats == 0)]
    other = every[above & (every % repeats != 0)] if repeats > 1 else every[-len(every) // 8 :]
    columns, size = [], 2 * np.pi * lowest / rate_hz
    for place in places:
        motion = sharp_motion(record, place, friction)
        braking = friction_moments(record, motion, friction.taken_shapes(place))
        held = Moments.held(record.u[:n, record.inputs.index(place)])
        columns.append([(held.integral(p) - braking.integral(p))[lines] * size ** (p - 2) for p in range(2, 7)])
    Y = np.stack([own_spectrum(record, place)[0] for place in places])
    return np.array(columns, np.complex128) / rate_hz**2, Y[:, lines], Y[:, other]
