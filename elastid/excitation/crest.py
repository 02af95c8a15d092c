r"""Low crest factors: phases that minimise the peaks of several signals of the same multisine at once.

.. math:: \min_{a, b} \Bigl(\sum_{e, o, t} |x_{eo}(t) / w_o|^p\Bigr)^{1/p}, \qquad
          x_{eo}(t) = \mathrm{Re} \sum_k \sum_i T_{oi}(k)\, U_{eki}\, e^{2\pi j k t / T}

over all experiments e of an orthogonal set and all linear outputs o, with p growing from 4 to 8192: each step begins
where the last one ended (L-BFGS with the exact gradient, two FFTs). Lines without amplitude stay without. (The L_p
method of Guillaume, Schoukens, Pintelon and Kollar, IEEE Trans. Instrumentation and Measurement 40 (1991) 982.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.phases import random_phases, schroeder

# p, samples per cycle of the highest line, iterations at most.
_EARLY = ((4, 4, 60), (8, 4, 60), (16, 4, 60), (32, 8, 60), (64, 8, 60))
_LATE = ((128, 12, 60), (512, 16, 100), (2048, 20, 100), (8192, 32, 100))


@dataclass(frozen=True)
class Signals:
    """Signals whose peaks are minimised: base (E, F, n_u), U without its phases, at lines (F,).

    response (F, n_o, n_u): from the inputs to the outputs.  scale (n_o,): the unit in which each output's peaks count.
    """

    lines: IntArray
    base: ComplexArray
    response: ComplexArray
    scale: FloatArray

    def spectra(self, phases_in: FloatArray, phases_ex: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """U (E, F, n_u) and the outputs' spectra (E, n_o, F) in units of scale, for a (F, n_u) and b (F, E)."""
        U = self.base * np.exp(1j * (phases_in + phases_ex.T[:, :, None]))
        return U, np.einsum("foi,efi->eof", self.response, U) / self.scale[:, None]


def minimise_peaks(signals: Signals, rng: np.random.Generator, is_alone: bool = True) -> tuple[FloatArray, FloatArray]:
    """Phases a (F, n_u) of the inputs and b (F, E) of the experiments with small peaks of every signal.

    is_alone: the first start is Schroeder's for every input, and often the best. Realisations must differ, or they
    would all show the same distortion: every start is drawn, and another generator gives another optimum.
    """
    E, F, n_u = signals.base.shape
    candidates = []
    # The best of four starts is carried to the end; the ends of sets differ less, two are enough.
    for start in range(4 if E == 1 else 2):
        inside = random_phases((F, n_u), rng)
        if is_alone and start == 0:
            power = np.sqrt(np.mean(np.abs(signals.base) ** 2, axis=0))
            inside = np.stack([schroeder(column) for column in power.T], axis=1)
        phases = _continued(signals, np.concatenate([inside.ravel(), np.zeros(F * E)]), _EARLY)
        candidates.append((_peak(signals, phases), start, phases))
    *_, best = min(candidates, key=lambda candidate: candidate[:2])
    phases = _continued(signals, best, _LATE)
    return phases[: F * n_u].reshape(F, n_u), phases[F * n_u :].reshape(F, E)


def peaks(lines: IntArray, S: ComplexArray, samples_per_cycle: int = 32) -> FloatArray:
    """Largest |x(t)| (...,) of signals with the spectra S (..., F); with 32 samples a cycle 0.5 % too small at most."""
    return np.asarray(np.abs(_signal(lines, S, samples_per_cycle * (int(lines[-1]) + 1))).max(axis=-1))


def crest_factors(lines: IntArray, S: ComplexArray) -> FloatArray:
    """Peak over RMS (...,) of signals with the spectra S (..., F)."""
    return np.asarray(peaks(lines, S) / np.sqrt(np.sum(np.abs(S) ** 2, axis=-1) / 2))


def _continued(signals: Signals, phases: FloatArray, steps: Sequence[tuple[int, int, int]]) -> FloatArray:
    # Half of the time in which a command without them starts.
    from scipy.fft import next_fast_len
    from scipy.optimize import minimize

    for p, samples_per_cycle, iterations in steps:
        n = int(next_fast_len(samples_per_cycle * int(signals.lines[-1]), real=True))
        options = {"maxiter": iterations, "maxcor": 20, "ftol": 1e-12, "gtol": 1e-9}
        phases = minimize(_norm, phases, (signals, p, n), jac=True, method="L-BFGS-B", options=options).x
    return phases


def _norm(phases: FloatArray, signals: Signals, p: int, n: int) -> tuple[float, FloatArray]:
    """log of the L_p norm of all signals at n samples a period, p a power of 2, and its gradient to the phases."""
    E, F, n_u = signals.base.shape
    U, S = signals.spectra(phases[: F * n_u].reshape(F, n_u), phases[F * n_u :].reshape(F, E))
    x = _signal(signals.lines, S, n)
    largest = max(float(np.abs(x).max()), 1e-30)
    z = np.where(x == 0, 1e-30, x / largest)
    power = z * z
    for _ in range(p.bit_length() - 2):
        np.multiply(power, power, out=power)
    total = power.sum()
    slope = rfft(power / z, axis=-1)[..., signals.lines]
    sensitivity = slope / (total * largest * signals.scale[:, None])  # d / dS, conjugate
    d_phase = (1j * U * np.einsum("foi,eof->efi", signals.response, sensitivity.conj())).real
    gradient = np.concatenate([d_phase.sum(axis=0).ravel(), d_phase.sum(axis=2).T.ravel()])
    return float(np.log(largest) + np.log(total / x.size) / p), gradient


def _peak(signals: Signals, phases: FloatArray) -> float:
    E, F, n_u = signals.base.shape
    _, S = signals.spectra(phases[: F * n_u].reshape(F, n_u), phases[F * n_u :].reshape(F, E))
    return float(peaks(signals.lines, S, samples_per_cycle=16).max())


def _signal(lines: IntArray, S: ComplexArray, n: int) -> FloatArray:
    """x (..., n) over a period from spectra (..., F)."""
    spectrum = np.zeros((*S.shape[:-1], n // 2 + 1), dtype=np.complex128)
    spectrum[..., lines] = S
    return np.asarray(irfft(spectrum, n, axis=-1) * (n / 2))
