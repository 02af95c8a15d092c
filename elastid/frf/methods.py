r"""The estimators of the field: one function each, from the blocks of all realisations to G (F, n_y, n_u).

Each takes blocks and the scatter of [Y; U] over their periods, of which only `errors_in_variables` needs the
covariance C_Z in one period, and returns G with its weights W_m and their share s, so that to first order in the
equation error V = Y - G U

.. math:: \hat G - G = s \sum_m V_m W_m, \quad s \sum_m U_m W_m = 1

(Wernholt and Moberg, LiTH-ISY-R-2827, 2008; Guillaume, Pintelon and Schoukens, IEEE TIM 41(6), 1992; for H2 and Hv
Maia and Silva, Theoretical and Experimental Modal Analysis, 1997.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray
from elastid.base.errors import DataError, StudyError
from elastid.base.note import Note
from elastid.frf.experiment_blocks import Block, Scatter, pooled
from elastid.frf.matrices import added_cross_products, added_products, adjoint, transposed


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


Estimator: TypeAlias = Callable[[Sequence[Block], Scatter], Estimate]


def arithmetic(blocks: Sequence[Block], scatter: Scatter) -> Estimate:
    """G = (1/M) sum_m G_m,  G_m = Y_m U_m^-1: each realisation keeps its pairing of u and y."""
    W, share = _mean_weights(blocks)
    return Estimate(share * added_products([block.Y for block in blocks], W), W, share=share)


def harmonic(blocks: Sequence[Block], scatter: Scatter) -> Estimate:
    """G = [(1/M) sum_m G_m^-1]^-1, for n_y = n_u."""
    _square(blocks, "harmonic")
    W, share = _mean_weights(blocks)
    return Estimate(harmonic_mean(_each(blocks)), W, share=share)


def logarithmic(blocks: Sequence[Block], scatter: Scatter) -> Estimate:
    """G = exp((1/M) sum_m log G_m) element by element where G_m stands 8 dB above its scatter, arithmetic elsewhere.

    The logarithm of an element that is zero or below the noise means nothing.
    """
    G, (W, share) = _each(blocks), _mean_weights(blocks)
    safe = log_is_safe(G)
    mean = arithmetic_mean(G)
    note = Note(
        "logarithmic-mean",
        f"logarithmic mean at {100 * safe.mean():.3g} % of lines and elements, arithmetic where an element is less "
        "than 8 dB above its scatter over the realisations",
        severity="information",
    )
    return Estimate(np.where(safe, logarithmic_mean(G), mean), W, () if safe.all() else (note,), share)


def h1(blocks: Sequence[Block], scatter: Scatter) -> Estimate:
    """G = (sum Y U^H)(sum U U^H)^-1: least squares with all noise on the outputs; biased by noise in the loop."""
    return _instrumental(blocks, [block.U for block in blocks])


def h2(blocks: Sequence[Block], scatter: Scatter) -> Estimate:
    """G = (sum Y Y^H)(sum U Y^H)^-1, for n_y = n_u: all noise on the inputs."""
    _square(blocks, "h2")
    return _instrumental(blocks, [block.Y for block in blocks])


def joint(blocks: Sequence[Block], scatter: Scatter) -> Estimate:
    """G = (sum Y R^H)(sum U R^H)^-1: the responses of y and u to the injected torque, divided (joint input-output)."""
    R = [block.R for block in blocks if block.R is not None]
    if len(R) < len(blocks):
        raise DataError("estimator.method joint needs the injected torque r of every record; take arithmetic")
    return _instrumental(blocks, R)


def hv(blocks: Sequence[Block], scatter: Scatter) -> Estimate:
    """Total least squares of each output: as much noise on it as on every input, in their units."""
    every = pooled(blocks)
    G = np.empty((len(every.U), every.Y.shape[1], every.U.shape[1]), dtype=np.complex128)
    for i in range(every.Y.shape[1]):
        Z = np.concatenate([every.Y[:, i : i + 1], every.U], axis=1)
        # v^H z is smallest for the weakest direction v.
        v = np.linalg.eigh(Z @ adjoint(Z))[1][:, :, 0].conj()
        if not v[:, 0].all():
            raise np.linalg.LinAlgError("the weakest direction has no part of the output")
        G[:, i] = -v[:, 1:] / v[:, :1]
    return Estimate(G, _least_squares_weights(blocks))


def errors_in_variables(blocks: Sequence[Block], scatter: Scatter) -> Estimate:
    r"""Maximum likelihood with the noise of inputs and outputs from the periods: generalised total least squares.

    .. math:: \hat G = \arg\min_G \sum_e P_e\, V_e^H (\Gamma C_Z \Gamma^H)^{-1} V_e, \quad \Gamma = [1, -G]

    Whitened by C_Z, [Y; U] spans the n_u strongest directions Q: G = Q_y Q_u^-1.
    (Pintelon and Schoukens, System Identification, 2nd ed., chapter 9, for a nonparametric G.)
    """
    every = pooled(blocks)
    n_y, n_u = every.Y.shape[1], every.U.shape[1]
    Z = np.concatenate([every.Y, every.U], axis=1) * np.sqrt(every.periods)
    rms = np.sqrt(np.mean(np.abs(Z) ** 2, axis=2))
    rms[rms == 0] = 1.0
    Z, noise = Z / rms[:, :, None], scatter.C_Z / (rms[:, :, None] * rms[:, None, :])
    L = np.linalg.cholesky(noise + 1e-14 * np.eye(n_y + n_u))  # regular without noise, too
    white = np.linalg.solve(L, Z)
    Q = rms[:, :, None] * (L @ np.linalg.eigh(white @ adjoint(white))[1][:, :, -n_u:])
    G: ComplexArray = Q[:, :n_y] @ np.linalg.inv(Q[:, n_y:])
    return Estimate(G, _least_squares_weights(blocks))


AVERAGED: dict[str, Estimator] = {"arithmetic": arithmetic, "harmonic": harmonic, "logarithmic": logarithmic}
POOLED: dict[str, Estimator] = {method.__name__: method for method in (h1, h2, hv, joint, errors_in_variables)}
METHODS: dict[str, Estimator] = AVERAGED | POOLED


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


def _mean_weights(blocks: Sequence[Block]) -> tuple[tuple[ComplexArray, ...], float]:
    """W_m of the mean over realisations, and their share."""
    return tuple(block.W for block in blocks), 1 / len(blocks)


def _instrumental(blocks: Sequence[Block], instruments: Sequence[ComplexArray]) -> Estimate:
    """G = (sum Y A^H)(sum U A^H)^-1, W = A^H (sum U A^H)^-1."""
    pairs = list(zip(blocks, instruments, strict=True))
    of_inputs = np.linalg.inv(np.sum([block.U @ adjoint(A) for block, A in pairs], axis=0))
    W = tuple(adjoint(A) @ of_inputs for _, A in pairs)
    G: ComplexArray = np.sum([block.Y @ w for block, w in zip(blocks, W, strict=True)], axis=0)
    return Estimate(G, W)


def _least_squares_weights(blocks: Sequence[Block]) -> tuple[ComplexArray, ...]:
    of_inputs = np.linalg.inv(np.sum([block.U @ adjoint(block.U) for block in blocks], axis=0))
    return tuple(adjoint(block.U) @ of_inputs for block in blocks)


def _square(blocks: Sequence[Block], method: str) -> None:
    n_y, n_u = blocks[0].Y.shape[1], blocks[0].U.shape[1]
    if n_y != n_u:
        raise StudyError(
            f"estimator.method {method} needs as many outputs as inputs, here {n_y} and {n_u}; take arithmetic"
        )
