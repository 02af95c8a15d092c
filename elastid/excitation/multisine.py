r"""Multisines: amplitudes of their lines, sets of n_u experiments (random phases, chirp, PRBS), signals over time.

.. math:: u(t) = \mathrm{Re} \sum_k U_k\, e^{2\pi j k t / T}, \qquad \sum_k |U_{k}|^2 / 2 = u_{rms}^2
"""

import math
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.grids import Orthogonal, grid_lines
from elastid.excitation.phases import (
    Signals,
    minimise_peaks,
    newman,
    orthogonal_basis,
    random_phases,
    schroeder,
    with_phases,
)
from elastid.excitation.spec import Phases

Sweep: TypeAlias = Literal["linear-sweep", "log-sweep", "prbs"]

# Longest shift register of a binary signal.
_MAX_BITS = 18


def sweep_spectrum(kind: Sweep, lines: IntArray) -> ComplexArray:
    """Return relative spectrum (F,) of one input at the lines, which are all lines or all odd lines of a band."""
    odd = bool(np.all(lines % 2))
    n = 2 * 64 * int(lines[-1])  # samples of a cycle of the highest line: little above half the rate folds back
    length = n // 2 if odd else n
    signal = _binary(length, int(lines[-1])) if kind == "prbs" else _sweep(kind, length, lines, odd)
    return np.fft.rfft(np.concatenate([signal, -signal]) if odd else signal)[lines]


def _sweep(kind: Sweep, n: int, lines: IntArray, odd: bool) -> FloatArray:
    from scipy.signal import chirp  # slow to load, and seldom needed

    first, last = lines[[0, -1]] / (2 if odd else 1)  # cycles in the sweep's length
    method = "linear" if kind == "linear-sweep" else "logarithmic"
    return np.asarray(chirp(np.arange(n) / n, first, 1.0, last, method, phi=-90))


def _binary(n: int, last: int) -> FloatArray:
    """Return +-1 of a maximum-length sequence, its clock 2.5 times the highest line or more, stretched to n samples."""
    from scipy.signal import max_len_seq  # slow to load, and seldom needed

    sequence = 2.0 * max_len_seq(min(math.ceil(math.log2(2.5 * last + 1)), _MAX_BITS))[0] - 1
    return np.asarray(sequence[np.arange(n) * len(sequence) // n])


def relative_amplitudes(freq_hz: FloatArray, power: float, table: Sequence[tuple[float, float]]) -> FloatArray:
    """Return relative amplitude (F,): f^power, times the table of (frequency, amplitude) points where there is one.

    The table is straight lines on log-log axes and constant beyond its ends.
    """
    relative = np.asarray((freq_hz / freq_hz[0]) ** power)
    if table:
        frequency, amplitude = np.log(np.array(sorted(table))).T
        relative = relative * np.exp(np.interp(np.log(freq_hz), frequency, amplitude))
    return relative


def amplitudes(relative: FloatArray, rms: FloatArray) -> FloatArray:
    """Return A (F, n_u) of the given relative amplitude, (F,) or (F, n_u), with sum_k A_ki^2 / 2 = rms_i^2.

    rms (n_u,): of each input over a period.
    """
    columns = relative if relative.ndim == 2 else relative[:, None]
    return np.asarray(columns * np.sqrt(2 / np.sum(columns**2, axis=0)) * rms)


def experiments(
    phases: Phases, orthogonal: Orthogonal, lines: IntArray, amplitude: FloatArray, rng: np.random.Generator,
    responses: ComplexArray, is_alone: bool = True,
) -> ComplexArray:  # fmt: skip
    """Return U (n_u experiments, F, n_u inputs) of one realisation, with amplitudes A (F, n_u) at lines (F,).

    responses (F, n_o, n_u): from the inputs to the signals whose crest factors `optimised` phases lower, all weighted
    alike.  A sweep and a binary signal have a spectrum of their own: A multiplies it and sets the power.  is_alone: no
    other realisation must differ from this one.
    """
    F, n_u = amplitude.shape
    basis = orthogonal_basis(orthogonal, F, n_u)
    between = np.zeros((F, n_u))
    if phases == "optimised":
        base = with_phases(basis, amplitude, between, between)
        scale = np.sqrt(np.mean(np.sum(np.abs(np.einsum("foi,efi->eof", responses, base)) ** 2, axis=2), axis=0) / 2)
        inside, between = minimise_peaks(Signals(lines, base, responses, scale), rng, is_alone)
    elif phases == "random":
        inside, between = random_phases((2, F, n_u), rng)
    elif phases == "schroeder":
        inside = np.stack([schroeder(column) for column in amplitude.T], axis=1)
    elif phases == "newman":
        inside = np.repeat(newman(F)[:, None], n_u, axis=1)
    else:
        sweep = sweep_spectrum(phases, lines)[:, None]
        inside = np.repeat(np.angle(sweep), n_u, axis=1)
        weighted = amplitude * np.abs(sweep)
        amplitude = weighted * np.sqrt(np.sum(amplitude**2, axis=0) / np.sum(weighted**2, axis=0))
    return with_phases(basis, amplitude, inside, between)


def orthogonal_set(amplitude: FloatArray, rng: np.random.Generator) -> ComplexArray:
    """Return U (n_u experiments, F, n_u inputs) with random phases and the DFT matrix: the robust method's."""
    return experiments("random", "dft", np.arange(len(amplitude)), amplitude, rng, np.zeros((0, 0, 0), complex))


def synthesise(lines: IntArray, U: ComplexArray, n_samples: int) -> FloatArray:
    """Return one period (n_samples, n_u) of u(t) = Re sum_k U_k exp(2 pi j k t / T), from U (F, n_u) at lines (F,)."""
    spectrum = np.zeros((n_samples // 2 + 1, U.shape[1]), dtype=np.complex128)
    spectrum[lines] = U
    return np.fft.irfft(spectrum * (n_samples / 2), n=n_samples, axis=0).astype(np.float64)


def growing_loops(smallest: float, largest: float, count: int, frequency_hz: float, rate_hz: float) -> FloatArray:
    """Return one cycle of a sine for each of `count` amplitudes, spaced logarithmically, the smallest first (n,).

    >>> growing_loops(1.0, 4.0, 3, 2.0, 8.0).reshape(3, 4)[:, 1].round(6).tolist()
    [1.0, 2.0, 4.0]
    """
    samples = round(rate_hz / frequency_hz)
    cycle = np.sin(2 * np.pi * np.arange(samples) / samples)
    return np.outer(np.geomspace(smallest, largest, count), cycle).ravel()


def small_multisine(
    peak: float, band_hz: tuple[float, float], period_samples: int, rate_hz: float, rng: np.random.Generator
) -> FloatArray:
    """Return one period (n,) of an odd random-phase multisine of equal lines whose largest value is `peak`."""
    lines = grid_lines("odd", band_hz, rate_hz, period_samples)
    signal = synthesise(lines, np.exp(1j * random_phases((len(lines), 1), rng)), period_samples)[:, 0]
    return np.asarray(peak / np.abs(signal).max() * signal)
