r"""Phases of a multisine, and the sets of n_u experiments that make the spectra invertible at every line.

.. math:: U_{eki} = A_{ki}\, e^{j a_{ki}}\, W_{ie}\, e^{j b_{ke}}, \qquad W W^H = n_u I

so that U U^H = n_u A^2 at every line: a factor n_u less variance than one input at a time with the same amplitude.
W is the DFT matrix, or Hadamard's where one exists (n_u = 2, 4, 8, 12 ..., not 6), or zippered: at line k of experiment
e only input (k + e) mod n_u has an amplitude, n_u^(1/2) times as large. Random a and b, fresh in every realisation, put
the nonlinear distortions where averaging removes them; Schroeder's and Newman's give one signal of a low crest factor.
(Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapters 2 and 5.)
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import StudyError
from elastid.excitation.grids import zippered

Orthogonal: TypeAlias = Literal["dft", "hadamard", "zippered"]


def random_phases(shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Independent phases, uniform over a turn."""
    return 2 * np.pi * rng.random(shape)


def schroeder(amplitude: FloatArray) -> FloatArray:
    r"""Phases (F,) of a multisine with amplitudes (F,) that sweeps through its lines as their power allows.

    .. math:: \phi_k = -2\pi \sum_{i<k} (k - i)\, p_i, \qquad p_i = A_i^2 / \sum A^2

    Schroeder, IEEE Transactions on Information Theory 16 (1970) 85, eq. (11).
    """
    power = amplitude**2 / np.sum(amplitude**2)
    return -2 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(power))[:-1]])


def newman(n_lines: int) -> FloatArray:
    """phi_k = pi (k - 1)^2 / F for k = 1 ... F. Boyd, IEEE Trans. Circuits and Systems 33 (1986) 1018, eq. (7)."""
    return np.pi * np.arange(n_lines) ** 2 / n_lines


def orthogonal_basis(kind: Orthogonal, n_lines: int, n_u: int) -> ComplexArray:
    """W (n_u experiments, F, n_u inputs), W^H W = n_u I at every line. StudyError where there is no such set."""
    if kind == "zippered":
        owner = zippered(n_lines, n_u)
        e, i = np.arange(n_u)[:, None, None], np.arange(n_u)
        return np.where((owner[:, None] + e) % n_u == i, np.sqrt(n_u), 0.0).astype(np.complex128)
    W = hadamard(n_u) if kind == "hadamard" else np.exp(2j * np.pi * np.outer(np.arange(n_u), np.arange(n_u)) / n_u)
    return np.repeat(W[:, None, :], n_lines, axis=1).astype(np.complex128)


def hadamard(n: int) -> FloatArray:
    """H (n, n) of +-1 with H^T H = n I, by Sylvester's doubling and Paley's first construction.

    StudyError where n is neither 1, 2 nor a multiple of 4, or where these two do not reach (28 is the first).
    """
    if n == 1:
        return np.ones((1, 1))
    if n % 4 == 0 and _is_prime(n - 1):
        return _paley(n - 1)
    if n == 2 or n % 8 == 0:
        half = hadamard(n // 2)
        return np.block([[half, half], [half, -half]])
    raise StudyError(
        f"no Hadamard matrix for {n} inputs is known here (there are those for 1, 2, 4, 8, 12, 16, 20 and 24); take "
        "orthogonal: dft"
    )


def _paley(q: int) -> FloatArray:
    """H (q + 1, q + 1) = I + S from the squares modulo a prime q = 3 (mod 4)."""
    square = np.isin(np.arange(q), np.arange(1, q) ** 2 % q)
    residue = np.where(square, 1.0, -1.0)
    residue[0] = 0.0
    Q = residue[(np.arange(q)[:, None] - np.arange(q)) % q]
    S = np.block([[np.zeros((1, 1)), np.ones((1, q))], [-np.ones((q, 1)), Q]])
    return np.asarray(np.eye(q + 1) + S)


def with_phases(
    basis: ComplexArray, amplitude: FloatArray, phases_in: FloatArray, phases_ex: FloatArray
) -> ComplexArray:
    """U (n_u experiments, F, n_u inputs) from W (n_u, F, n_u), A (F, n_u), a (F, n_u) and b (F, n_u).

    Input i has, over the experiments, the RMS amplitude A_ki; sum_e U_ei conj(U_ej) = 0 for i != j.
    """
    return np.asarray(basis * (amplitude * np.exp(1j * phases_in)) * np.exp(1j * phases_ex.T)[:, :, None])


def _is_prime(n: int) -> bool:
    return n > 1 and all(n % d for d in range(2, int(n**0.5) + 1))
