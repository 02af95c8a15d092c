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
from scipy.optimize import minimize

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.note import Note
from elastid.parameters import ParameterSet
from elastid.robot import Robot

MU = 1e-2
# The smallest principal second moment beside the largest below which a body is at the border.
BORDER = 1e-3
# A start whose smallest principal second moment is below this share of their sum is moved off the border; others are
# halved towards it, so often at most.
ROUND = 1e-4
HALVINGS = 20
# Rounding of a plate's moments.
SLACK = 1e-9
_TENSOR = {"_xx": (0, 0), "_yy": (1, 1), "_zz": (2, 2), "_xy": (0, 1), "_xz": (0, 2), "_yz": (1, 2)}


@dataclass(frozen=True)
class Shape:
    """The inertia of one body in a configuration: the places in theta of its entries, and theirs in the tensor."""

    body: str
    places: tuple[int, ...]
    entries: tuple[tuple[int, int], ...]
    configuration: str = ""

    def theta(self, parameters: ParameterSet, x: FloatArray) -> FloatArray:
        """theta (n_theta,) where the body has this inertia."""
        return parameters.expand(x, self.configuration)

    def slopes(self, parameters: ParameterSet, x: FloatArray) -> FloatArray:
        """d entry / d x (n_entries, n_x)."""
        return parameters.jacobian(x, self.configuration)[list(self.places)]

    def second_moment(self, theta: FloatArray) -> FloatArray:
        """Sigma (3, 3)."""
        return np.tensordot(theta[list(self.places)], self.directions, axes=1)

    def roundness(self, theta: FloatArray) -> float:
        """The smallest principal second moment over their sum: 1/3 for a ball, 0 for a plate, negative for no body."""
        values = np.linalg.eigvalsh(self.second_moment(theta))
        return float(values[0] / max(values.sum(), 1e-300))

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
    """The bodies with a tensor of which the fit moves at least one entry, once for each that configurations have."""
    found: list[Shape] = []
    for body in robot.bodies:
        names = {f"I_{body.name}{suffix}": _TENSOR[suffix] for suffix in body.inertia_entries if suffix in _TENSOR}
        groups = [p.only for p in parameters if p.only and p.stands_for in names]
        for where in dict.fromkeys(["", *(group[0] for group in groups)]):
            if names.keys() & set(parameters.moved(where)):
                places = tuple(parameters.index(name) for name in names)
                found.append(Shape(body.name, places, tuple(names.values()), where))
    return tuple(found)


def barrier(shapes: Sequence[Shape], parameters: ParameterSet, x: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """b, its gradient (n_x,) and its Gauss-Newton Hessian (n_x, n_x); b is infinite outside."""
    b, g, H = 0.0, np.zeros(len(x)), np.zeros((len(x), len(x)))
    for shape in shapes:
        sigma = shape.second_moment(shape.theta(parameters, x))
        scale = max(float(np.trace(sigma)), 1e-300)
        values = np.linalg.eigvalsh(sigma) / scale
        if values[0] <= 0 or not np.all(np.isfinite(sigma)):
            return math.inf, g, np.eye(len(x))
        inverse = np.linalg.inv(sigma)
        relative = inverse @ shape.directions  # Sigma^-1 dSigma
        local = shape.slopes(parameters, x)
        trace = np.trace(shape.directions, axis1=1, axis2=2) / scale
        # ln det(Sigma / tr Sigma): a large body is no more likely than a small one.
        b -= 2 * MU * float(np.sum(np.log(values)))
        g -= 2 * MU * local.T @ (np.trace(relative, axis1=1, axis2=2) - 3 * trace)
        H += 2 * MU * local.T @ np.einsum("pij,qji->pq", relative, relative) @ local
    return b, g, H


def possible(starts: FloatArray, shapes: Sequence[Shape], parameters: ParameterSet) -> FloatArray:
    """The starts (n, n_x), each drawn towards the given one until its bodies can have their inertias.

    Where the given one is at the border itself, as that of a plate or a rod, it first moves off it.
    Raises StudyError for a start that no body can have.
    """
    if not shapes:
        return starts
    begin = _moved_off(parameters.x, shapes, parameters)
    needed = 0.5 * _roundness(begin, shapes, parameters)
    return np.array([_drawn_in(start, begin, needed, shapes, parameters) for start in starts])


def _drawn_in(
    start: FloatArray, begin: FloatArray, needed: float, shapes: Sequence[Shape], parameters: ParameterSet
) -> FloatArray:
    for step in range(HALVINGS):
        x: FloatArray = begin + (start - begin) / 2**step
        if _roundness(x, shapes, parameters) >= min(needed, ROUND):
            return x
    return begin


def _moved_off(x: FloatArray, shapes: Sequence[Shape], parameters: ParameterSet) -> FloatArray:
    """x (n_x,) with its free inertias a little rounder where a body is at the border."""
    flat = [shape for shape in shapes if shape.roundness(shape.theta(parameters, x)) < ROUND]
    if not flat:
        return x
    if _roundness(x, flat, parameters) < -SLACK:
        raise StudyError(
            f"fit.parameters: the start gives body {', '.join(shape.body for shape in flat)} an inertia that no body "
            "can have (a principal moment above the sum of the other two); correct the start of its inertias"
        )
    lower, upper = parameters.x_bounds
    touched = np.flatnonzero(np.any([np.any(s.slopes(parameters, x) != 0, axis=0) for s in flat], axis=0))

    def off(z: FloatArray) -> float:
        moved = x.copy()
        moved[touched] = np.clip(z, lower[touched], upper[touched])
        far = float(np.sum(((moved - x) / np.maximum(1.0, np.abs(x)))[touched] ** 2))
        return max(0.0, 2 * ROUND - _roundness(moved, flat, parameters)) + ROUND * far

    best = minimize(off, x[touched], method="Nelder-Mead", options={"maxiter": 2000, "xatol": 1e-6, "fatol": 1e-9})
    moved = x.copy()
    moved[touched] = np.clip(best.x, lower[touched], upper[touched])
    return moved


def _roundness(x: FloatArray, shapes: Sequence[Shape], parameters: ParameterSet) -> float:
    """The smallest of all bodies at x (n_x,)."""
    return min(shape.roundness(shape.theta(parameters, x)) for shape in shapes)


def border_words(shapes: Sequence[Shape], parameters: ParameterSet, x: FloatArray) -> tuple[Note, ...]:
    """A word about each body whose inertia ended at the border of what a body can have."""
    words = []
    for shape in shapes:
        values = np.linalg.eigvalsh(shape.second_moment(shape.theta(parameters, x)))
        if values[0] < BORDER * values[-1]:
            words.append(
                Note(
                    "impossible-inertia",
                    "the data want an inertia that no body can have (a principal moment above the sum "
                    "of the other two); it ended at the border: check its mass, its centre of mass and the placement "
                    "of its joint",
                    f"body {shape.body}",
                )
            )
    return tuple(dict.fromkeys(words))
