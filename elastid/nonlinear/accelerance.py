r"""Acceleration per torque of a motor above the excited lines, where friction and the loop still move it.

Next to the excited lines a motor moves as these lines end, with one pair of poles that may lie above them, the inertia
beyond, and a spring for the poles below,

.. math:: A(s) = \frac{a s^2 + b s + c + e / s^2}{s^2 + \alpha s + \beta}, \qquad
          A s^2 = a s^2 + b s + c + e / s^2 - A (\alpha s + \beta)

which is linear in its six numbers. (Levy, IRE Trans. Autom. Control 4, 1959; weights by the denominator before,
Sanathanan and Koerner, IEEE Trans. Autom. Control 8, 1963.) Where a + c / s^2 describes these lines as well, it is an
inertia on a spring whose other end rests.

From 1.5 times the highest line on all images of its samples are known but for these two,

.. math:: y = a \Big[\frac{\tau}{s^2}\Big]_{folded} + b \Big[\frac{\tau}{s^4}\Big]_{folded}, \qquad
          \tau = H u - \sum_i f_i \phi_i, \quad a = 1 / J, \quad b = -k / J^2

which a regression over these lines gives to some tenths of a percent, unless noise hides them.
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
# A pair of poles must leave at most this part of what an inertia on a spring leaves.
_POLES_GAIN = 0.5
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
    plain = np.array([a, 0.0, c, 0.0, 0.0, 0.0])
    weight = np.ones(len(x))
    for _ in range(4):
        columns = np.stack([x**2, x, np.ones_like(x), x**-2, -A * x, -A])
        poles, of_poles = _least(columns, A * x**2, weight)
        alpha, beta = poles[4:]
        weight = 1 / np.maximum(np.abs(x**2 + alpha * x + beta), 1e-6)
    is_stable = alpha > 0 and beta > 0
    found, left = (poles, of_poles) if is_stable and poles[0] > 0 and of_poles < _POLES_GAIN * left else (plain, left)
    if found[0] <= 0 or left > _UNEXPLAINED * size:
        return np.zeros(6)
    return np.asarray(found * top ** np.array([0, 1, 2, 4, 1, 2]))


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
    accelerance, stiffness, from_hz = (
        array.copy() for array in (friction.accelerance, friction.stiffness, friction.from_hz)
    )
    lowest = _lowest_hz(float(friction.highest_hz[-1]), records[0].rate_hz)
    taken_out = [place for place in friction.taken_places() if shows_images(records[0], place)]
    motors = [m for m, place in enumerate(friction.places) if place in taken_out]
    work = partial(_equations, [friction.places[m] for m in motors], friction)
    # Six records give it to less than a percent.
    of_records = (execution or Execution()).ordered(work, records[:6]) if motors else []
    for m, *parts in zip(motors, *of_records, strict=True):
        X, y, other = (np.concatenate(equations, axis=-1) for equations in zip(*parts, strict=True))
        # The loop's torque answers noise as it answers motion: where y is noise, the regression finds -1 / C.
        if np.mean(np.abs(other) ** 2) > _NOISE_SHARE * np.mean(np.abs(y) ** 2):
            continue
        A = (X.conj() @ X.T).real
        solution = np.linalg.solve(A, (X.conj() @ y).real)
        variance = np.mean(np.abs(y - solution @ X) ** 2) / 2 * np.linalg.inv(A)[0, 0]
        # One of a larger standard deviation is not better than the excited lines, if they show one.
        if np.sqrt(variance) < (0.03 if accelerance[m] > 0 else 0.1) * solution[0]:
            accelerance[m] = solution[0]
            stiffness[m] = -solution[1] / solution[0] * (2 * np.pi * lowest) ** 2
            from_hz[m] = lowest
    return replace(friction, accelerance=accelerance, stiffness=stiffness, from_hz=from_hz)


def _lowest_hz(highest_hz: float, rate_hz: float) -> float:
    """From where on a motor moves as an inertia on a spring, the excitation reaching up to `highest_hz`."""
    return min(1.5 * highest_hz, 1 / 4 * rate_hz)


def _equations(
    places: Sequence[str], friction: FrictionTakenOut, record: Record
) -> list[tuple[ComplexArray, ComplexArray, ComplexArray]]:
    """The columns of a and of b (2, F), and y (F,), of each place at the lines of the period above the excited ones.

    With y (N,) at lines that hold what does not repeat; of one period those of the highest eighth, barely moved.
    """
    n, rate_hz = whole_samples(record), record.rate_hz
    lowest, repeats = _lowest_hz(float(friction.highest_hz[-1]), rate_hz), n // record.period_samples
    every = np.arange(n // 2)
    above = line_frequencies(every, rate_hz, n) > lowest
    lines = every[above & (every % repeats == 0)]
    other = every[above & (every % repeats != 0)] if repeats > 1 else every[-len(every) // 8 :]
    equations = []
    for place in places:
        motion = sharp_motion(record, place, friction)
        braking = friction_moments(record, motion, friction.taken_shapes(place))
        held = Moments.held(record.u[:n, record.inputs.index(place)])
        inertia, spring = held.integral(2) - braking.integral(2), held.integral(4) - braking.integral(4)
        X = np.stack([inertia, spring * (2 * np.pi * lowest / rate_hz) ** 2])[:, lines]
        Y, _, _ = own_spectrum(record, place)
        equations.append((np.asarray(X / rate_hz**2), Y[lines], Y[other]))
    return equations
