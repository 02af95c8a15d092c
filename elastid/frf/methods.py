r"""The estimators of the field: one function each, from the blocks of all realisations to G (F, n_y, n_u).

Each takes the mean spectra, and of the scatter of [Y; U] over their periods only `errors_in_variables` the covariance
C_Z in one period, and returns G with its weights W_m and their share s, so that to first order in V = Y - G U

.. math:: \hat G - G = s \sum_m V_m W_m, \quad s \sum_m U_m W_m = 1

(Wernholt and Moberg, LiTH-ISY-R-2827, 2008; Guillaume, Pintelon and Schoukens, IEEE TIM 41(6), 1992; for H2 and Hv
Maia and Silva, Theoretical and Experimental Modal Analysis, 1997.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray
from elastid.base.errors import DataError, StudyError
from elastid.base.note import Note
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.frf.matrices import added_cross_products, added_products, adjoint, total_least_squares, transposed


@dataclass(frozen=True)
class Estimate:
    """G (F, n_y, n_u), the weights s W_m, W_m (F, E_m, n_u), of every block's equation error, and notes."""

    G: ComplexArray
    W: tuple[ComplexArray, ...]
    notes: tuple[Note, ...] = ()
    share: float = 1.0

    @cached_property
    def left(self) -> ComplexArray:
        """s^2 sum_m W_m^T W_m^* (F, n_u, n_u): the input factor, where all errors V have the same covariance."""
        W = [transposed(W_m) for W_m in self.W]
        return self.share**2 * added_cross_products(W, W)


Estimator: TypeAlias = Callable[[MeanSpectra], Estimate]


def arithmetic(data: MeanSpectra) -> Estimate:
    """G = (1/M) sum_m G_m,  G_m = Y_m U_m^-1: each realisation keeps its pairing of u and y."""
    W, share = tuple(block.W for block in data.blocks), 1 / len(data.blocks)
    return Estimate(share * added_products(data.Y, W), W, share=share)


def harmonic(data: MeanSpectra) -> Estimate:
    """G = [(1/M) sum_m G_m^-1]^-1, for n_y = n_u."""
    _refuse_oblong(data, "harmonic")
    return replace(arithmetic(data), G=harmonic_mean(_each(data.blocks)))


def logarithmic(data: MeanSpectra) -> Estimate:
    """G = exp((1/M) sum_m log G_m) element by element where G_m stands 8 dB above its scatter, arithmetic elsewhere.

    The logarithm of an element that is zero or below the noise means nothing.
    """
    G = _each(data.blocks)
    safe = log_is_safe(G)
    note = Note(
        "frf/method",
        f"logarithmic mean at {100 * safe.mean():.3g} % of lines and elements, arithmetic where an element is less "
        "than 8 dB above its scatter over the realisations",
        severity="information",
    )
    mean = np.where(safe, logarithmic_mean(G), arithmetic_mean(G))
    return replace(arithmetic(data), G=mean, notes=() if safe.all() else (note,))


def h1(data: MeanSpectra) -> Estimate:
    """G = (sum Y U^H)(sum U U^H)^-1: least squares with all noise on the outputs; biased by noise in the loop."""
    return _instrumental(data, data.U)


def h2(data: MeanSpectra) -> Estimate:
    """G = (sum Y Y^H)(sum U Y^H)^-1, for n_y = n_u: all noise on the inputs."""
    _refuse_oblong(data, "h2")
    return _instrumental(data, data.Y)


def joint(data: MeanSpectra) -> Estimate:
    """G = (sum Y R^H)(sum U R^H)^-1: the responses of y and u to the injected torque, divided (joint input-output)."""
    R = [block.R for block in data.blocks if block.R is not None]
    if len(R) < len(data.blocks):
        raise DataError(
            "frf/method", "estimator.method joint needs the injected torque r of every record; take arithmetic"
        )
    return _instrumental(data, R)


def hv(data: MeanSpectra) -> Estimate:
    """Total least squares of each output: as much noise on it as on every input, in their units."""
    Y, U = data.every.Y, data.every.U
    Z = [np.concatenate([Y[:, i : i + 1], U], axis=1) for i in range(Y.shape[1])]
    rows = [total_least_squares(each @ adjoint(each)) for each in Z]
    return replace(h1(data), G=np.stack(rows, axis=1))


def errors_in_variables(data: MeanSpectra) -> Estimate:
    r"""Maximum likelihood with the noise of inputs and outputs from the periods: generalised total least squares.

    .. math:: \hat G = \arg\min_G \sum_e P_e\, V_e^H (\Gamma C_Z \Gamma^H)^{-1} V_e, \quad \Gamma = [1, -G]

    Whitened by C_Z, [Y; U] spans the n_u strongest directions Q: G = Q_y Q_u^-1.
    (Pintelon and Schoukens, System Identification, 2nd ed., chapter 9, for a nonparametric G.)
    """
    Y, U = data.every.Y, data.every.U
    n_y, n_u = Y.shape[1], U.shape[1]
    Z = np.concatenate([Y, U], axis=1) * np.sqrt(data.periods)
    rms = np.sqrt(np.mean(np.abs(Z) ** 2, axis=2))
    rms[rms == 0] = 1.0
    Z, noise = Z / rms[:, :, None], data.S_Z / data.dof / (rms[:, :, None] * rms[:, None, :])
    L = np.linalg.cholesky(noise + 1e-14 * np.eye(n_y + n_u))  # regular without noise, too
    white = np.linalg.solve(L, Z)
    Q = rms[:, :, None] * (L @ np.linalg.eigh(white @ adjoint(white))[1][:, :, -n_u:])
    return replace(h1(data), G=Q[:, :n_y] @ np.linalg.inv(Q[:, n_y:]))


AVERAGED: dict[str, Estimator] = {"arithmetic": arithmetic, "harmonic": harmonic, "logarithmic": logarithmic}
METHODS = AVERAGED | {method.__name__: method for method in (h1, h2, hv, joint, errors_in_variables)}


def arithmetic_mean(G: ComplexArray) -> ComplexArray:
    """(1/M) sum_m G_m of G (M, F, n_y, n_u)."""
    return np.asarray(G.mean(axis=0))


def harmonic_mean(G: ComplexArray) -> ComplexArray:
    """[(1/M) sum_m G_m^-1]^-1 of G (M, F, n, n)."""
    return np.asarray(np.linalg.inv(np.linalg.inv(G).mean(axis=0)))


def logarithmic_mean(G: ComplexArray) -> ComplexArray:
    """exp((1/M) sum_m log G_m) of each element of G (M, F, n_y, n_u).

    Turned by the phase of the arithmetic mean first, so that no phase has to be unwrapped.
    """
    mean = arithmetic_mean(G)
    turn = np.exp(1j * np.angle(mean))
    with np.errstate(divide="ignore", invalid="ignore"):
        log = np.log(G / turn).mean(axis=0)
    return np.where(mean == 0, 0.0, turn * np.exp(log))


def log_is_safe(G: ComplexArray) -> BoolArray:
    """Flags (F, n_y, n_u) of the elements of G (M, F, n_y, n_u) that are 8 dB above their scatter over realisations."""
    M = len(G)
    if M < 2:
        return np.ones(G.shape[1:], dtype=np.bool_)
    mean = arithmetic_mean(G)
    scatter = np.sum(np.abs(G - mean) ** 2, axis=0) / (M - 1)
    return np.asarray((np.abs(mean) ** 2 > 10**0.8 * scatter) & (np.abs(G) > 0).all(axis=0))


def _each(blocks: Sequence[Block]) -> ComplexArray:
    """G_m (M, F, n_y, n_u) of every realisation."""
    return np.stack([block.Y @ block.W for block in blocks])


def _instrumental(data: MeanSpectra, instruments: Sequence[ComplexArray]) -> Estimate:
    """G = (sum Y A^H)(sum U A^H)^-1, W = A^H (sum U A^H)^-1."""
    of_inputs = np.linalg.inv(np.sum([U @ adjoint(A) for U, A in zip(data.U, instruments, strict=True)], axis=0))
    W = tuple(adjoint(A) @ of_inputs for A in instruments)
    G: ComplexArray = np.sum([Y @ W_m for Y, W_m in zip(data.Y, W, strict=True)], axis=0)
    return Estimate(G, W)


def _refuse_oblong(data: MeanSpectra, method: str) -> None:
    n_y, n_u = data.Y[0].shape[1], data.U[0].shape[1]
    if n_y != n_u:
        raise StudyError(
            "frf/method",
            f"estimator.method {method} needs as many outputs as inputs, here {n_y} and {n_u}; take arithmetic",
        )
