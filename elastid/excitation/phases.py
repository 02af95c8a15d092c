r"""Phases of a multisine, and the sets of n_u experiments that make the spectra invertible at every line.

.. math:: U_{eki} = A_{ki}\, e^{j a_{ki}}\, W_{ie}\, e^{j b_{ke}}, \qquad W W^H = n_u I

so that U U^H = n_u A^2 at every line: a factor n_u less variance than one input at a time with the same amplitude.
W is the DFT matrix, or Hadamard's where one exists (n_u = 2, 4, 8, 12 ..., not 6), or zippered: at line k of experiment
e only input (k + e) mod n_u has an amplitude, n_u^(1/2) times as large. Random a and b, fresh in every realisation, put
the nonlinear distortions where averaging removes them; Schroeder's and Newman's give one signal of a low crest factor.
(Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapters 2 and 5.)
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.errors import StudyError
from elastid.excitation.grids import Orthogonal, zippered_grid


def random_phases(shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Return independent phases of this shape, rad, uniform over a turn."""
    return 2 * np.pi * rng.random(shape)


def schroeder(amplitude: FloatArray) -> FloatArray:
    r"""Return phases (F,) of a multisine with amplitudes (F,) that sweeps through its lines as their power allows.

    .. math:: \phi_k = -2\pi \sum_{i<k} (k - i)\, p_i, \qquad p_i = A_i^2 / \sum A^2

    Schroeder, IEEE Transactions on Information Theory 16 (1970) 85, eq. (11).
    """
    return -2 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(amplitude**2 / np.sum(amplitude**2)))[:-1]])


def newman(n_lines: int) -> FloatArray:
    """Return phi_k = pi (k - 1)^2 / F, k = 1 ... F. Boyd, IEEE Trans. Circuits and Systems 33 (1986) 1018, eq. (7)."""
    return np.pi * np.arange(n_lines) ** 2 / n_lines


def orthogonal_basis(kind: Orthogonal, n_lines: int, n_u: int) -> ComplexArray:
    """Return W (n_u experiments, F, n_u inputs), W^H W = n_u I at every line. StudyError where there is no such set."""
    if kind == "zippered":
        owner = zippered_grid(n_lines, n_u)
        e, i = np.arange(n_u)[:, None, None], np.arange(n_u)
        return np.where((owner[:, None] + e) % n_u == i, np.sqrt(n_u), 0.0).astype(np.complex128)
    W = hadamard(n_u) if kind == "hadamard" else np.exp(2j * np.pi * np.outer(np.arange(n_u), np.arange(n_u)) / n_u)
    return np.repeat(W[:, None, :], n_lines, axis=1).astype(np.complex128)


def hadamard(n: int) -> FloatArray:
    """Return H (n, n) of +-1 with H^T H = n I, by Sylvester's doubling and Paley's first construction.

    StudyError where n is neither 1, 2 nor a multiple of 4, or where these two do not reach (28 is the first).
    """
    if n == 1:
        return np.ones((1, 1))
    if n % 4 == 0 and all((n - 1) % d for d in range(2, math.isqrt(n - 1) + 1)):
        # From the squares modulo a prime q = 3 (mod 4).
        q = n - 1
        residue = np.where(np.isin(np.arange(q), np.arange(1, q) ** 2 % q), 1.0, -1.0)
        residue[0] = 0.0
        Q = residue[(np.arange(q)[:, None] - np.arange(q)) % q]
        return np.asarray(np.eye(n) + np.block([[np.zeros((1, 1)), np.ones((1, q))], [-np.ones((q, 1)), Q]]))
    if n == 2 or n % 8 == 0:
        half = hadamard(n // 2)
        return np.block([[half, half], [half, -half]])
    raise StudyError(
        "excitation/lines",
        f"no Hadamard matrix for {n} inputs is known here (there are those for 1, 2, 4, 8, 12, 16, 20 and 24); take "
        "orthogonal: dft",
    )


def with_phases(
    basis: ComplexArray, amplitude: FloatArray, phases_in: FloatArray, phases_ex: FloatArray
) -> ComplexArray:
    """Return U (n_u experiments, F, n_u inputs) from W (n_u, F, n_u), A (F, n_u), a (F, n_u) and b (F, n_u).

    Input i has, over the experiments, the RMS amplitude A_ki; sum_e U_ei conj(U_ej) = 0 for i != j.
    """
    return np.asarray(basis * (amplitude * np.exp(1j * phases_in)) * np.exp(1j * phases_ex.T)[:, :, None])


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

    def divided(self, phases: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return phases a (F, n_u) of the inputs and b (F, E) of the experiments, of which they are all in a row."""
        E, F, n_u = self.base.shape
        return phases[: F * n_u].reshape(F, n_u), phases[F * n_u :].reshape(F, E)

    def spectra(self, phases_in: FloatArray, phases_ex: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return U (E, F, n_u) and the outputs' spectra (E, n_o, F) in units of scale, for a (F, n_u) and b (F, E)."""
        U = self.base * np.exp(1j * (phases_in + phases_ex.T[:, :, None]))
        return U, np.einsum("foi,efi->eof", self.response, U) / self.scale[:, None]


def minimise_peaks(signals: Signals, rng: np.random.Generator, is_alone: bool = True) -> tuple[FloatArray, FloatArray]:
    r"""Minimise the peaks of all signals; return phases a (F, n_u) of inputs and b (F, E) of experiments.

    .. math:: \min_{a, b} \Bigl(\sum_{e, o, t} |x_{eo}(t) / w_o|^p\Bigr)^{1/p}, \qquad
              x_{eo}(t) = \mathrm{Re} \sum_k \sum_i T_{oi}(k)\, U_{eki}\, e^{2\pi j k t / T}

    over all experiments e of an orthogonal set and all linear outputs o, with p growing from 4 to 8192: each step
    begins where the last one ended (L-BFGS with the exact gradient, two FFTs). Lines without amplitude stay without.
    (The L_p method of Guillaume, Schoukens, Pintelon and Kollar, IEEE Trans. Instrumentation and Measurement 40 (1991)
    982.)

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
        phases = _continue(signals, np.concatenate([inside.ravel(), np.zeros(F * E)]), _EARLY)
        _, S = signals.spectra(*signals.divided(phases))
        candidates.append((float(peaks(signals.lines, S, samples_per_cycle=16).max()), start, phases))
    *_, best = min(candidates, key=lambda candidate: candidate[:2])
    phases = _continue(signals, best, _LATE)
    return signals.divided(phases)


def peaks(lines: IntArray, S: ComplexArray, samples_per_cycle: int = 32) -> FloatArray:
    """Return largest |x(t)| (...,) of signals of spectra S (..., F), at 32 samples a cycle 0.5 % too small or less."""
    return np.asarray(np.abs(_signal(lines, S, samples_per_cycle * (int(lines[-1]) + 1))).max(axis=-1))


def crest_factors(lines: IntArray, S: ComplexArray) -> FloatArray:
    """Return peak over RMS (...,) of signals with the spectra S (..., F)."""
    return np.asarray(peaks(lines, S) / np.sqrt(np.sum(np.abs(S) ** 2, axis=-1) / 2))


def _continue(signals: Signals, phases: FloatArray, steps: Sequence[tuple[int, int, int]]) -> FloatArray:
    # Half of the time in which a command without them starts.
    from scipy.fft import next_fast_len
    from scipy.optimize import minimize

    for p, samples_per_cycle, iterations in steps:
        n = int(next_fast_len(samples_per_cycle * int(signals.lines[-1]), real=True))
        options = {"maxiter": iterations, "maxcor": 20, "ftol": 1e-12, "gtol": 1e-9}
        phases = minimize(_norm, phases, (signals, p, n), jac=True, method="L-BFGS-B", options=options).x
    return phases


def _norm(phases: FloatArray, signals: Signals, p: int, n: int) -> tuple[float, FloatArray]:
    """Return the log of the L_p norm of all signals at n samples a period, p a power of 2, and its gradient."""
    U, S = signals.spectra(*signals.divided(phases))
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


def _signal(lines: IntArray, S: ComplexArray, n: int) -> FloatArray:
    """Return x (..., n) over a period from spectra (..., F)."""
    spectrum = np.zeros((*S.shape[:-1], n // 2 + 1), dtype=np.complex128)
    spectrum[..., lines] = S
    return irfft(spectrum, n, axis=-1) * (n / 2)
