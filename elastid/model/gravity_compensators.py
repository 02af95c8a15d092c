r"""Gravity compensators: potentials and torques of coil and gas springs between two bodies.

A compensator at the distance L between its two points has the potential

.. math:: V_{coil} = \tfrac12 k_c (L - L_0)^2, \qquad
          V_{gas} = F_0 h_0 \int_0^1 \ell\, e^{(\kappa - 1) \ell t}\, dt, \quad \ell = \ln (h_0 / h), \quad
          h = h_0 + s (L - L_0)

Their torque -dV/dq is tau_g of Niglis & Oberg (2015), eq. (2.32). s = 1 for a strut that pushes, -1 for a cylinder that
draws; the integral is [(h_0 / h)^(kappa - 1) - 1] / (kappa - 1), which is 0 / 0 at kappa = 1. dV/dq = (dV/dL) / (2 L)
d(L^2)/dq is written out: a simulation evaluates it at every step.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from elastid.model.frame_tree import Tree, Turn, between, located, seat
from elastid.robot import Compensator, Robot

# Nodes of Gauss and Legendre for the gas: exact to 1e-14 for columns that change by a factor of 5.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(7)


def compensators(
    robot: Robot, layout: Tree, turned: tuple[Turn, ...], q: ca.SX, theta: Mapping[str, ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """V, a scalar, and dV/dq (n_q, 1) of all compensators; the joints that `turned` turns are among q."""
    V, gradient = ca.SX(0), ca.SX(q.size1(), 1)
    for compensator in robot.compensators:
        first, second = (
            (seat(robot, layout, end.body), located(f"pc{i}_{compensator.name}", end.point, theta))
            for i, end in enumerate(compensator.ends, start=1)
        )
        square = ca.sumsqr(between(layout, turned, first, second))
        # Two points that meet are 1 nm apart, so that a coil without rest length has its derivatives there too.
        L = ca.sqrt(square + 1e-9**2)
        energy, force = (_coil if compensator.coil is not None else _gas)(compensator, L, theta)
        V += energy
        gradient += force / (2 * L) * ca.gradient(square, q)
    return V, gradient


def _coil(compensator: Compensator, L: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    k, L0 = (theta[f"{letter}_{compensator.name}"] for letter in ("kc", "L0"))
    return k * (L - L0) ** 2 / 2, k * (L - L0)


def _gas(compensator: Compensator, L: ca.SX, theta: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    F0, L0, h0, kappa = (theta[f"{letter}_{compensator.name}"] for letter in ("F0", "L0", "h0", "kappa"))
    s = 1 if compensator.gas is not None and compensator.gas.action == "push" else -1
    log = ca.log(h0 / (h0 + s * (L - L0)))
    integral = sum(
        weight / 2 * ca.exp((kappa - 1) * log * (1 + t) / 2) for t, weight in zip(_NODES, _WEIGHTS, strict=True)
    )
    return F0 * h0 * log * integral, -s * F0 * ca.exp(kappa * log)
