r"""Inertias that a body can have: a barrier that the fit feels only where it comes near the border.

.. math:: b(x) = -2 \mu \sum_{bodies} \ln \det \Sigma, \qquad \Sigma = \tfrac12 \mathrm{tr}(I_c)\, 1 - I_c \succ 0

Sigma is the second moment of mass about the centre of mass: positive definite exactly where the principal moments are
positive and none exceeds the sum of the other two. With a positive mass this is the positive definite pseudo-inertia of
Wensing, Kim and Slotine (RA-L 2018). mu is a hundredth, so that an estimate inside moves by a few hundredths of a
standard deviation at most, while one that wants to leave ends at the border, and its message says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.arrays import FloatArray
from elastid.parameters import ParameterSet
from elastid.robot import Robot

MU = 1e-2
# The smallest principal second moment beside the largest below which a body is at the border.
BORDER = 1e-3
_TENSOR = {"_xx": (0, 0), "_yy": (1, 1), "_zz": (2, 2), "_xy": (0, 1), "_xz": (0, 2), "_yz": (1, 2)}


@dataclass(frozen=True)
class Shape:
    """The inertia of one body: the places in theta of its entries, with their places in the tensor."""

    body: str
    places: tuple[int, ...]
    entries: tuple[tuple[int, int], ...]

    def second_moment(self, theta: FloatArray) -> FloatArray:
        """Sigma (3, 3)."""
        return np.tensordot(theta[list(self.places)], self.directions, axes=1)

    @property
    def directions(self) -> FloatArray:
        """d Sigma / d entry (n_entries, 3, 3)."""
        tensors = np.zeros((len(self.entries), 3, 3))
        for tensor, (i, j) in zip(tensors, self.entries, strict=True):
            tensor[i, j] = tensor[j, i] = 1.0
        traces = np.trace(tensors, axis1=1, axis2=2)
        sigma: FloatArray = 0.5 * traces[:, None, None] * np.eye(3) - tensors
        return sigma


def shapes(parameters: ParameterSet, robot: Robot) -> tuple[Shape, ...]:
    """The bodies with a tensor of which the fit moves at least one entry."""
    moved, found = set(parameters.moved_names), []
    for body in robot.bodies:
        names = {f"I_{body.name}{suffix}": _TENSOR[suffix] for suffix in body.inertia_entries if suffix in _TENSOR}
        if moved & set(names):
            places = tuple(parameters.index(name) for name in names)
            found.append(Shape(body.name, places, tuple(names.values())))
    return tuple(found)


def barrier(shapes: Sequence[Shape], parameters: ParameterSet, x: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """b, its gradient (n_x,) and its Gauss-Newton Hessian (n_x, n_x); b is infinite outside."""
    theta, T = parameters.expand(x), parameters.jacobian(x)
    b, g, H = 0.0, np.zeros(len(x)), np.zeros((len(x), len(x)))
    for shape in shapes:
        sigma = shape.second_moment(theta)
        scale = max(float(np.trace(sigma)), 1e-300)
        values = np.linalg.eigvalsh(sigma) / scale
        if values[0] <= 0 or not np.all(np.isfinite(sigma)):
            return math.inf, g, np.eye(len(x))
        inverse = np.linalg.inv(sigma)
        relative = inverse @ shape.directions  # Sigma^-1 dSigma
        local = T[list(shape.places)]
        trace = np.trace(shape.directions, axis1=1, axis2=2) / scale
        # ln det(Sigma / tr Sigma): a large body is no more likely than a small one.
        b -= 2 * MU * float(np.sum(np.log(values)))
        g -= 2 * MU * local.T @ (np.trace(relative, axis1=1, axis2=2) - 3 * trace)
        H += 2 * MU * local.T @ np.einsum("pij,qji->pq", relative, relative) @ local
    return b, g, H


def border_words(shapes: Sequence[Shape], theta: FloatArray) -> tuple[str, ...]:
    """A word about each body whose inertia ended at the border of what a body can have."""
    words = []
    for shape in shapes:
        values = np.linalg.eigvalsh(shape.second_moment(theta))
        if values[0] < BORDER * values[-1]:
            words.append(
                f"body {shape.body}: the data want an inertia that no body can have (a principal moment above the sum "
                "of the other two); it ended at the border: check its mass, its centre of mass and the placement of "
                "its joint"
            )
    return tuple(words)
