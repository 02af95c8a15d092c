r"""LinearModel -> state space: what control engineers' tools read.

.. math:: \dot x = A x + B u(t - T_d), \quad y = C x + D u(t - T_d), \qquad x = [q;\, \dot q]

.. math:: A = \begin{bmatrix} 0 & I \\ -M^{-1} K & -M^{-1} D_q \end{bmatrix}, \qquad
          B = \begin{bmatrix} 0 \\ M^{-1} B_q \end{bmatrix}

y is position (C = [C_q, 0]), velocity (C = [0, C_q]) or acceleration (C = C_q [-M^-1 K, -M^-1 D_q], D = C_q M^-1 B_q).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.arrays import ComplexArray, FloatArray, frozen
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.record import Configuration, Motion


@dataclass(frozen=True)
class StateSpace:
    """A (2n, 2n), B (2n, n_u), C (n_y, 2n), D (n_y, n_u) of one configuration and the delay T_d in s; link side, SI."""

    configuration: Configuration
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    delay: float
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    quantity: Motion

    def __post_init__(self) -> None:
        """Freeze the matrices."""
        for name in ("A", "B", "C", "D"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """G (F, n_y, n_u) = [C (s I - A)^-1 B + D] exp(-s T_d) on the lines freq_hz (F,)."""
        s = (2j * np.pi * np.asarray(freq_hz)[:, None, None]).astype(complex)
        X = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B.astype(complex))
        G: ComplexArray = ((self.C @ X + self.D) * np.exp(-s * self.delay)).astype(complex)
        return G


def state_space(model: LinearModel, theta: FloatArray) -> StateSpace:
    """The state space of a LinearModel at theta (n_theta,), model.parameters in SI."""
    M, D, K = model.matrices(theta)
    n, n_u = model.B.shape
    motion = np.linalg.solve(M, np.hstack([-K, -D, model.B]))  # q'' = motion [q; q'; u]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [motion[:, : 2 * n]]])
    B = np.vstack([np.zeros((n, n_u)), motion[:, 2 * n :]])
    still, through = np.zeros_like(model.C), np.zeros((len(model.C), n_u))
    C, D_y = {
        "position": (np.hstack([model.C, still]), through),
        "velocity": (np.hstack([still, model.C]), through),
        "acceleration": (model.C @ motion[:, : 2 * n], model.C @ motion[:, 2 * n :]),
    }[model.quantity]
    delay = float(theta[model.parameters.index(DELAY)]) if DELAY in model.parameters else 0.0
    return StateSpace(model.configuration, A, B, C, D_y, delay, model.inputs, model.outputs, model.quantity)
