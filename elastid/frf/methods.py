r"""The estimators of the field: one function each, from the blocks of all realisations to G (F, n_y, n_u).

Each takes the mean spectra, and of the scatter of [Y; U] over their periods only `errors_in_variables` the covariance
C_Z in one period, and returns G with its weights W_m and their share s, so that to first order in V = Y - G U

.. math:: \hat G - G = s \sum_m V_m W_m, \quad s \sum_m U_m W_m = 1

(Wernholt and Moberg, LiTH-ISY-R-2827, 2008; Guillaume, Pintelon and Schoukens, IEEE TIM 41(6), 1992.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray
from elastid.base.errors import DataError
from elastid.frf.experiment_blocks import MeanSpectra
from elastid.frf.matrices import added_cross_products, added_products, adjoint, transposed


@dataclass(frozen=True)
class Estimate:
    """G (F, n_y, n_u) and the weights s W_m, W_m (F, E_m, n_u), of every block's equation error."""

    G: ComplexArray
    W: tuple[ComplexArray, ...]
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


def h1(data: MeanSpectra) -> Estimate:
    """G = (sum Y U^H)(sum U U^H)^-1: least squares with all noise on the outputs; biased by noise in the loop."""
    return _instrumental(data, data.U)


def joint(data: MeanSpectra) -> Estimate:
    """G = (sum Y R^H)(sum U R^H)^-1: the responses of y and u to the injected torque, divided (joint input-output)."""
    R = [block.R for block in data.blocks if block.R is not None]
    if len(R) < len(data.blocks):
        raise DataError(
            "frf/method", "estimator.method joint needs the injected torque r of every record; take arithmetic"
        )
    return _instrumental(data, R)


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


METHODS: dict[str, Estimator] = {method.__name__: method for method in (arithmetic, h1, joint, errors_in_variables)}


def _instrumental(data: MeanSpectra, instruments: Sequence[ComplexArray]) -> Estimate:
    """G = (sum Y A^H)(sum U A^H)^-1, W = A^H (sum U A^H)^-1."""
    of_inputs = np.linalg.inv(np.sum([U @ adjoint(A) for U, A in zip(data.U, instruments, strict=True)], axis=0))
    W = tuple(adjoint(A) @ of_inputs for A in instruments)
    G: ComplexArray = np.sum([Y @ W_m for Y, W_m in zip(data.Y, W, strict=True)], axis=0)
    return Estimate(G, W)
