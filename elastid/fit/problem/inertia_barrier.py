r"""Inertia barrier: a logarithmic penalty that keeps estimated inertias physically consistent.

.. math:: b(x) = -2 \mu \sum_{bodies} \ln \det \Sigma, \qquad \Sigma = \tfrac12 \mathrm{tr}(I_c)\, 1 - I_c \succ 0

Sigma is the second moment of mass about the centre of mass. It is positive definite if and only if the principal
moments are positive and satisfy the triangle inequality; with a positive mass, the pseudo-inertia of Wensing, Kim and
Slotine (RA-L 2018) is then positive definite. mu = 0.01 changes an estimate in the interior by at most a few hundredths
of a standard deviation; an inconsistent estimate ends at the border, and a note reports it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import Note, StudyError
from elastid.parameters import Parameters
from elastid.robot import Robot
from elastid.robot.body import TENSOR

BARRIER_WEIGHT = 1e-2
BORDER = 1e-5  # margin of the border, relative to the second moments, for a body that starts as a plate or a rod


@dataclass(frozen=True)
class BodyInertia:
    """Inertia of one body in a configuration.

    indices: positions of its entries in theta.
    margin: distance of the border beyond the consistent inertias, relative to the second moments.
    """

    name: str
    indices: tuple[int, ...]
    configuration: str = ""
    margin: float = 0.0

    @property
    def refusal(self) -> str:
        """Message for a physically impossible start (triangle inequality)."""
        return (
            f"the start gives body {self.name} a physically impossible inertia (a principal moment above the sum of "
            "the other two); correct the start of its inertias, those in the robot's file included"
        )

    def slopes(self, parameters: Parameters, x: FloatArray) -> FloatArray:
        """Return d entry / d x (n_entries, n_x)."""
        return parameters.jacobian(x, self.configuration)[list(self.indices)]

    def second_moment(self, parameters: Parameters, x: FloatArray) -> FloatArray:
        """Return sigma (3, 3)."""
        return np.tensordot(parameters.expand(x, self.configuration)[list(self.indices)], self.directions, axes=1)

    def roundness(self, parameters: Parameters, x: FloatArray) -> float:
        """Return the smallest principal second moment over their sum: 1/3 for a ball, 0 for a plate, < 0 impossible."""
        values = np.linalg.eigvalsh(self.second_moment(parameters, x))
        return float(values[0] / max(values.sum(), 1e-300))

    @property
    def directions(self) -> FloatArray:
        """d Sigma / d entry (n_entries, 3, 3)."""
        tensors = (np.arange(len(self.indices))[:, None, None] == TENSOR).astype(float)
        return np.asarray(0.5 * np.trace(tensors, axis1=1, axis2=2)[:, None, None] * np.eye(3) - tensors)


def free_inertias(parameters: Parameters, robot: Robot) -> tuple[BodyInertia, ...]:
    """Return the bodies with at least one free entry of the inertia tensor, once for each set of configurations."""
    inertias: list[BodyInertia] = []
    for body in robot.bodies:
        names = [f"I_{body.name}{suffix}" for suffix in body.inertia_entries if suffix]
        groups = [p.only for p in parameters if p.only and p.stands_for in names]
        for configuration in dict.fromkeys(["", *(group[0] for group in groups)]):
            if set(names) & set(parameters.dependent_names(configuration)):
                inertia = BodyInertia(body.name, tuple(parameters.index(name) for name in names), configuration)
                is_flat = abs(inertia.roundness(parameters, parameters.x)) < BORDER
                inertias.append(replace(inertia, margin=BORDER * is_flat))
    return tuple(inertias)


def impossible_inertias(inertias: Sequence[BodyInertia], parameters: Parameters, x: FloatArray) -> list[BodyInertia]:
    """Return the inertias that are physically impossible at x (n_x,) by more than rounding errors."""
    return [body for body in inertias if body.roundness(parameters, x) < -1e-9]


def barrier(
    inertias: Sequence[BodyInertia], parameters: Parameters, x: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Return b, its gradient (n_x,) and its Gauss-Newton Hessian (n_x, n_x); b is infinite outside."""
    b, g, H = 0.0, np.zeros(len(x)), np.zeros((len(x), len(x)))
    for body in inertias:
        sigma, directions = body.second_moment(parameters, x), body.directions
        scale, traces = max(float(np.trace(sigma)), 1e-300), np.trace(directions, axis1=1, axis2=2)
        sigma = sigma + body.margin * scale * np.eye(3)
        values = np.linalg.eigvalsh(sigma) / scale
        if values[0] <= 0 or not np.all(np.isfinite(sigma)):
            return math.inf, g, np.eye(len(x))
        inverse = np.linalg.inv(sigma)
        relative = inverse @ (directions + body.margin * traces[:, None, None] * np.eye(3))  # Sigma^-1 dSigma
        local = body.slopes(parameters, x)
        # ln det(Sigma / tr Sigma): the barrier does not depend on the size of the body.
        b -= 2 * BARRIER_WEIGHT * float(np.sum(np.log(values)))
        g -= 2 * BARRIER_WEIGHT * local.T @ (np.trace(relative, axis1=1, axis2=2) - 3 * traces / scale)
        H += 2 * BARRIER_WEIGHT * local.T @ np.einsum("pij,qji->pq", relative, relative) @ local
    return b, g, H


def border_metric(inertias: Sequence[BodyInertia], parameters: Parameters, x: FloatArray) -> FloatArray:
    """Return D (n_x, n_x) of Dikin's ellipsoid s^T D s < 1, within which Sigma + dSigma s stays positive definite."""
    return barrier(inertias, parameters, x)[2] / (2 * BARRIER_WEIGHT)


def feasible_starts(starts: FloatArray, inertias: Sequence[BodyInertia], parameters: Parameters) -> FloatArray:
    """Return the starts (n, n_x), each moved towards the nominal start until its inertias are possible.

    Raises StudyError for a start that is physically impossible.
    """
    if not inertias:
        return starts
    nominal = parameters.x
    for body in impossible_inertias(inertias, parameters, nominal):
        raise StudyError("fit/parameters", body.refusal, "fit.parameters")

    def move_inside(start: FloatArray) -> FloatArray:
        candidates = (nominal + (start - nominal) / 2**step for step in range(20))
        return next((x for x in candidates if not impossible_inertias(inertias, parameters, x)), nominal)

    return np.array([move_inside(start) for start in starts])


def find_border_inertias(inertias: Sequence[BodyInertia], parameters: Parameters, x: FloatArray) -> tuple[Note, ...]:
    """Return a note on each body whose inertia at x (n_x,) is at the border of physical consistency."""
    text = (
        "the data ask for a physically impossible inertia (a principal moment above the sum of the other two); it "
        "ended at the border: check its mass, its centre of mass and the placement of its joint"
    )
    values = (np.linalg.eigvalsh(body.second_moment(parameters, x)) for body in inertias)
    flat = [body for body, v in zip(inertias, values, strict=True) if v[0] < 1e-3 * v[-1]]
    return tuple(dict.fromkeys(Note("fit/impossible-inertia", text, f"body {body.name}") for body in flat))
