r"""The motion of a motor with its part at high frequencies, which turns it back earlier than its samples say.

At a reversal friction jumps by 2 F_c, and at each sample the held torque jumps. The velocity has a kink there, which
interpolation of the samples rounds: reversals come out late, by some 2 % of a sample. Above half the rate a motor moves
as an inertia, by the torque that is known,

.. math:: q_{high} = \frac{a}{s^2} (H u - \sum_i f_i \phi_i)_{high}, \qquad a = -\omega^2 G \text{ at high frequencies}

So it does above the excited lines, on the spring behind it (below). Noise of the angle is a velocity that grows with
frequency, and hides there where a motor turns back, while the torque is known as well as anywhere; so the motion above
the excited lines is by the torque, too, and what the angle says beyond it is added as far as it is more than noise.
(3e-6 rad at 500 Hz with Coulomb friction of 0.3 of the rms torque: k known four times as well.)

Its samples are images in the record's y; they are taken out, and the part itself is added between the samples. phi_i
depend on the motion; so q_high is a fixed point, which repetition alone reaches slowly, and not at all where friction
is 0.3 of the torque. An error of a leaves as large a part of what is mended.

The fixed point is found by Anderson's method: the next x is that combination of the last ones whose residuals F(x) - x
nearly cancel,

.. math:: x_{k+1} = F(x_k) - \sum_i \gamma_i\, [F(x_{i+1}) - F(x_i)], \qquad
          \gamma = \arg\min \Big| r_k - \sum_i \gamma_i (r_{i+1} - r_i) \Big|, \quad r = F(x) - x

(Anderson, J. ACM 12, 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011.)

The acceleration per torque a is that of lines above the excited ones. Friction and the loop move a motor at all lines,
and above the resonances as an inertia on a spring whose other end rests. Of its samples all images are known but for
two numbers,

.. math:: y = a \Big[\frac{\tau}{s^2}\Big]_{folded} + b \Big[\frac{\tau}{s^4}\Big]_{folded}, \qquad
          \tau = H u - \sum_i f_i \phi_i, \quad a = 1 / J, \quad b = -k / J^2

which a regression over these lines gives to some tenths of a percent; where noise hides them, the upper excited lines
show the same two numbers.

A net torque is u without the friction that was found. The torque of a record is held between its samples, friction is
not; so friction is divided by the hold as samples:

.. math:: u_{net} = u - u_\phi, \qquad u_\phi = IDFT\{ H^{-1}\, DFT\{ \textstyle\sum_i f_i \phi_i \} \}

Sampled angles contain images of a held torque, and friction's are others than those of u_phi, which a model of held
torques adds. Above half the rate a motor moves as an inertia, so that its samples become those of the net torque by

.. math:: y_{net} = y + \Big[\frac{a}{s^2} \big(\textstyle\sum_i f_i \phi_i - H u_\phi\big)_{high}\Big]_{folded}
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.fft import fft, irfft

from elastid.base.arrays import ComplexArray, FloatArray, frozen
from elastid.base.execution import Execution
from elastid.excitation.grids import line_frequencies
from elastid.nonlinear.motion import Motion, folded, integrated, laplace, motion_of, own_spectrum, whole_samples
from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.shapes import spectrum
from elastid.record import Record

# Cells in a sample: with 8 of them k and d are off by up to 2.5 standard deviations of a good measurement.
SHARP_CELLS = 32
# Steps on the finer cells from there: one leaves friction several times as far from where repetition ends.
_SHARP_STEPS = 2
# Of the power of the lines that show the acceleration per torque, at most, what does not repeat: a is then off by a
# tenth of it, times the gain of the loop there, which is below one.
_NOISE_SHARE = 0.1


def sharp_motion(record: Record, place: str, friction: FrictionTakenOut) -> Motion:
    """The motion of a motor under the friction that was found; as `motion_of` where its samples show no images."""
    m = friction.places.index(place)
    motion = motion_of(record, place)
    if not shows_images(record, place) or friction.accelerance[m] == 0:
        return motion
    n = whole_samples(record)
    held = held_spectrum(record.u[:n, record.inputs.index(place)])
    above = _receptance_above(friction, m, n, record.rate_hz)

    def part_above(motion: Motion) -> ComplexArray:
        torque = spectrum(record, motion, friction.taken_shapes(place))
        np.subtract(held[: len(torque)], torque, out=torque)
        torque *= above[: len(torque)]
        return torque

    def repeated(high: ComplexArray) -> ComplexArray:
        return part_above(motion_of(record, place, high))

    # To a tenth of the first error of the part above half the rate; most motions need 5 repetitions.
    high = fixed_point(repeated, part_above(motion), 0.1, 12)
    coarse = np.zeros(n * SHARP_CELLS // 2 + 1, complex)
    coarse[: len(high)] = high
    return motion_of(record, place, fixed_point(repeated, coarse, 0.0, _SHARP_STEPS))


def shows_images(record: Record, place: str) -> bool:
    """True if the samples of a motor's motion contain the images of its own held torque."""
    images = record.images
    if images is None:
        return False
    return images.rates_hz[record.inputs.index(place)] > 0 and images.sampled[record.outputs.index(place)]


def held_spectrum(samples: FloatArray) -> ComplexArray:
    """DFT (n SHARP_CELLS // 2 + 1,), as of n samples, of a torque held for one sample each; samples (n,) repeat."""
    hold = _hold(len(samples))
    return np.asarray(np.resize(fft(samples), len(hold)) * hold)


@lru_cache(maxsize=4)
def _hold(n: int) -> ComplexArray:
    """H = (1 - e^{-j theta}) / (j theta), theta = 2 pi k / n, of lines k = 0 ... n SHARP_CELLS / 2.

    Its numerator repeats with the DFT, so that it is exactly 0 at multiples of the rate.
    """
    H = np.resize(1 - np.exp(-2j * np.pi * np.arange(n) / n), n * SHARP_CELLS // 2 + 1)
    H[1:] *= -1j * n / (2 * np.pi) / np.arange(1, len(H))
    H[0] = 1
    return frozen(H, np.complex128)


def _receptance_above(friction: FrictionTakenOut, motor: int, n: int, rate_hz: float) -> FloatArray:
    """Angle per torque (n SHARP_CELLS // 2 + 1,) at lines of n samples; 0 at those where it is not known."""
    from_hz = friction.from_hz[motor]
    first = int(np.ceil(from_hz * n / rate_hz)) if from_hz > 0 else n // 2 + 1
    values = np.zeros(n * SHARP_CELLS // 2 + 1)
    omega_squared = laplace(len(values), n, rate_hz)[first:].imag ** 2
    values[first:] = -friction.accelerance[motor] / omega_squared * (1 + friction.stiffness[motor] / omega_squared)
    return values


@lru_cache(maxsize=4)
def twice_above(lines: int, n: int, rate_hz: float) -> FloatArray:
    """1 / s^2 (lines,) of lines of n samples, above half the rate, 0 at all lower ones."""
    values = np.zeros(lines)
    values[n // 2 + 1 :] = 1 / (laplace(lines, n, rate_hz)[n // 2 + 1 :] ** 2).real
    return frozen(values)


def fixed_point(
    F: Callable[[ComplexArray], ComplexArray], x: ComplexArray, tolerance: float, limit: int
) -> ComplexArray:
    """x (n,) one step beyond that whose |F(x) - x| is below `tolerance` of the first one, or after `limit` steps."""
    mapped = F(x)
    residual = mapped - x
    first = float(np.linalg.norm(residual))
    of_mapped, of_residual = list[ComplexArray](), list[ComplexArray]()
    for _ in range(limit - 1):
        if np.linalg.norm(residual) <= tolerance * first:
            break
        before, last = mapped, residual
        x = _combined(mapped, residual, of_mapped, of_residual)
        mapped = F(x)
        residual = mapped - x
        # The last five differences are combined.
        of_mapped, of_residual = [*of_mapped[-4:], mapped - before], [*of_residual[-4:], residual - last]
    return _combined(mapped, residual, of_mapped, of_residual)


def _combined(
    mapped: ComplexArray, residual: ComplexArray, of_mapped: list[ComplexArray], of_residual: list[ComplexArray]
) -> ComplexArray:
    """The next x (n,) from the last F(x) and its residual, and the steps of both before, oldest first."""
    if not of_residual:
        return mapped
    A = np.array([[np.vdot(a, b).real for b in of_residual] for a in of_residual])
    pull = np.array([np.vdot(a, residual).real for a in of_residual])
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    gamma = np.linalg.lstsq(A / np.outer(size, size), pull / size, rcond=1e-12)[0] / size
    return np.asarray(mapped - sum(g * step for g, step in zip(gamma, of_mapped, strict=True)))


def with_inertial_accelerance(
    friction: FrictionTakenOut, records: Sequence[Record], highest_hz: float, execution: Execution | None = None
) -> FrictionTakenOut:
    """The friction with the accelerance by the first of some records in place of that at lines up to `highest_hz`.

    Only of motors whose torque is held, with friction, where the regression is good.  execution: of the records.
    """
    accelerance, stiffness, from_hz = (
        array.copy() for array in (friction.accelerance, friction.stiffness, friction.from_hz)
    )
    lowest = _lowest_hz(highest_hz, records[0].rate_hz)
    taken = [place for place in friction.taken_places() if shows_images(records[0], place)]
    motors = [m for m, place in enumerate(friction.places) if place in taken and accelerance[m] != 0]
    work = partial(_equations, [friction.places[m] for m in motors], friction, highest_hz)
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
        # One of a larger standard deviation is not better than the excited lines.
        if np.sqrt(variance) < 0.03 * solution[0]:
            accelerance[m] = solution[0]
            stiffness[m] = -solution[1] / solution[0] * (2 * np.pi * lowest) ** 2
            from_hz[m] = lowest
    return replace(friction, accelerance=accelerance, stiffness=stiffness, from_hz=from_hz)


def _lowest_hz(highest_hz: float, rate_hz: float) -> float:
    """From where on a motor moves as an inertia on a spring, the excitation reaching up to `highest_hz`."""
    return min(1.5 * highest_hz, 1 / 4 * rate_hz)


def _equations(
    places: Sequence[str], friction: FrictionTakenOut, highest_hz: float, record: Record
) -> list[tuple[ComplexArray, ComplexArray, ComplexArray]]:
    """The columns of a and of b (2, F), and y (F,), of each place at the lines of the period above `highest_hz`.

    With y (N,) at lines that hold what does not repeat; of one period those of the highest eighth, barely moved.
    """
    n, rate_hz = whole_samples(record), record.rate_hz
    lowest, repeats = _lowest_hz(highest_hz, rate_hz), n // record.period_samples
    every = np.arange(n // 2)
    above = line_frequencies(every, rate_hz, n) > lowest
    lines = every[above & (every % repeats == 0)]
    other = every[above & (every % repeats != 0)] if repeats > 1 else every[-len(every) // 8 :]
    equations = []
    for place in places:
        torque = held_spectrum(record.u[:n, record.inputs.index(place)])
        torque -= spectrum(record, sharp_motion(record, place, friction), friction.taken_shapes(place))
        s = laplace(len(torque), n, rate_hz)
        inertia = integrated(torque, s, 2)
        spring = integrated(inertia, s / (2 * np.pi * lowest), 2)
        Y, _, _ = own_spectrum(record, place)
        equations.append((np.array([folded(inertia, n)[lines], folded(spring, n)[lines]]), Y[lines], Y[other]))
    return equations


def over_whole_periods(record: Record) -> Record:
    """The record without the samples after its last whole period."""
    n = whole_samples(record)
    return replace(record, u=record.u[:n], y=record.y[:n], r=None if record.r is None else record.r[:n])


def other_images(record: Record, place: str, torque: ComplexArray, friction: FrictionTakenOut) -> FloatArray:
    """Addition to a motor's samples (n,) that makes their images those of its net torque, 0 where it has none.

    torque (n cells // 2 + 1,): DFT, as of n samples, of its friction along the sharp motion.
    """
    n = whole_samples(record)
    accelerance = friction.accelerance[friction.places.index(place)]
    if accelerance == 0 or not shows_images(record, place):
        return np.zeros(n)
    above = (torque - held_spectrum(as_held(torque, record, place))) * twice_above(len(torque), n, record.rate_hz)
    return np.asarray(irfft(folded(accelerance * above, n), n))


def as_held(torque: ComplexArray, record: Record, place: str) -> FloatArray:
    """Samples (n,) of a torque that is held as u is, of the spectrum that `torque` has below half the rate."""
    n = whole_samples(record)
    lines = np.arange(n // 2 + 1)
    H = record.hold_response(line_frequencies(lines, record.rate_hz, n))[:, record.inputs.index(place)]
    low = torque[: len(lines)]
    # Near a zero of the hold the torque's samples do not determine the torque.
    return np.asarray(irfft(np.divide(low, H, out=np.zeros_like(low), where=np.abs(H) > 0.1), n))
