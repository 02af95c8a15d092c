"""Orthogonal random-phase multisines: n_u experiments whose spectra form an invertible matrix at every line.

    U(k) = A(k) D_1(k) W D_2(k),   W_pq = exp(2 pi j p q / n_u)

A holds the amplitudes of the inputs, D_1 and D_2 are diagonal with random phases, so that U U^H = n_u A^2: a factor
n_u less variance than one input at a time. W is the DFT matrix because Hadamard matrices do not exist for six axes.
(Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapter 3.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.arrays import ComplexArray, FloatArray, IntArray

# Samples per cycle of the highest line at which a peak is looked for: the true peak is missed by at most 1 %.
_SAMPLES_PER_CYCLE = 20


def amplitudes(freq_hz: FloatArray, spectrum: Sequence[tuple[float, float]], rms: FloatArray) -> FloatArray:
    """A (F, n_u): amplitude of every line, with sum_k A_ki^2 / 2 = rms_i^2.

    spectrum: relative amplitude as (frequency, amplitude) points, straight lines on log-log axes and constant
    beyond the ends; flat where there are none.  rms (n_u,): of each input over a period.
    """
    shape = np.ones(len(freq_hz))
    if spectrum:
        frequency, amplitude = np.log(np.array(sorted(spectrum))).T
        shape = np.exp(np.interp(np.log(freq_hz), frequency, amplitude))
    return np.outer(shape * np.sqrt(2 / np.sum(shape**2)), rms)


def orthogonal_set(amplitude: FloatArray, rng: np.random.Generator) -> ComplexArray:
    """U (n_u experiments, F, n_u inputs) = A D_1 W D_2 with fresh random phases; the same generator, the same set.

    Input i has amplitude A_ki in every experiment, and sum_e U_ei conj(U_ej) = 0 for i != j.
    """
    F, n_u = amplitude.shape
    D_1, D_2 = np.exp(2j * np.pi * rng.random((2, F, n_u)))
    W = np.exp(2j * np.pi * np.outer(np.arange(n_u), np.arange(n_u)) / n_u)
    U: ComplexArray = np.einsum("fi,ie,fe->efi", amplitude * D_1, W, D_2)
    return U


def synthesise(lines: IntArray, U: ComplexArray, n_samples: int) -> FloatArray:
    """One period (n_samples, n_u) of u(t) = Re sum_k U_k exp(2 pi j k t / T), from U (F, n_u) at lines (F,)."""
    spectrum = np.zeros((n_samples // 2 + 1, U.shape[1]), dtype=np.complex128)
    spectrum[lines] = U
    signal: FloatArray = np.fft.irfft(spectrum * (n_samples / 2), n=n_samples, axis=0).astype(np.float64)
    return signal


def crest_factor(lines: IntArray, U: ComplexArray) -> FloatArray:
    """Peak over RMS (n_u,) of each input, the peak sought between the samples too."""
    signal = synthesise(lines, U, _SAMPLES_PER_CYCLE * (int(lines[-1]) + 1))
    crest: FloatArray = np.abs(signal).max(axis=0) / np.sqrt(np.mean(signal**2, axis=0))
    return crest
