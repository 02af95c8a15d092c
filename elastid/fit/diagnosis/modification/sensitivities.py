r"""Residuals at the optimum and their derivatives to all that the fit held, summed up over configurations.

Beside the numbers of `HeldNumbers` there are those whose derivative follows from the response itself:

.. math:: \text{gain of an output } i: \; G_{ij}, \quad \text{of an input } j: \; -G_{ij}, \quad
          \text{delay}: \; -j \omega G, \text{ of one channel in its row or column}

.. math:: \text{ratio of motor } i: \quad \dot S G + G \dot S^T
          + 2 \Big( J_m \frac{\partial G}{\partial J_m} + f_m \frac{\partial G}{\partial f_m} + \ldots \Big),
          \qquad \dot S = E^{-1} e_i e_i^T E

since torque and angle were referred to the link side by the wrong ratio.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.diagnosis.modification.held_numbers import RATE, HeldNumbers
from elastid.fit.problem.elastic import Part
from elastid.fit.problem.residuals import RESIDUALS, as_real
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.linear.response.kernel import Kernel
from elastid.parameters import ParameterSet
from elastid.robot import Robot, gain_name


@dataclass(frozen=True, eq=False)
class Evaluated:
    """One configuration at x: G (F, n_y, n_u) of the model and its derivatives, to x and by name to ln p or p.

    mixing: `Part.mixing`, for all that is whitened here.
    """

    part: Part
    mixing: ComplexArray | None
    G: ComplexArray
    free: ComplexArray
    held: dict[str, ComplexArray] = field(default_factory=dict)

    @cached_property
    def rows(self) -> FloatArray:
        """J (n_x, N) of the free parameters."""
        return -self.whitened(self.free)

    @cached_property
    def information(self) -> FloatArray:
        """J J^T (n_x, n_x)."""
        return self.rows @ self.rows.T

    def whitened(self, slopes: ComplexArray) -> FloatArray:
        """-dr (n, N) of changes of G (n, F, n_y, n_u), N real numbers: those that count and zeros."""
        part = self.part
        # A logarithm of an element that is left out because it is zero has no slope.
        slope = np.where(part.gain > 0, RESIDUALS[part.criterion](part.measured, self.G)[1], 0.0)
        return _flat(self.mixing, part.gain * slope * slopes)

    @property
    def residual(self) -> FloatArray:
        """r (N,)."""
        part = self.part
        e = RESIDUALS[part.criterion](part.measured, self.G)[0]
        return np.asarray(
            _flat(self.mixing, np.where(part.gain > 0, part.gain * np.where(part.gain > 0, e, 0.0), 0.0)[None])[0]
        )


def _flat(mixing: ComplexArray | None, values: ComplexArray) -> FloatArray:
    flat = values.reshape(*values.shape[:2], -1)
    if mixing is not None:
        flat = (mixing @ flat.transpose(1, 2, 0)).transpose(2, 0, 1)
    return as_real(flat.reshape(len(values), -1))


def evaluated(held: HeldNumbers, fitted: ParameterSet, x: FloatArray, part: Part) -> Evaluated:
    """One configuration of a fit with these parameters, on its lines, at x (n_x,)."""
    model, theta = held.at(fitted, part.kernel.model, x)
    known = {DELAY, *model.gains, *(element.name for element in model.chain), *model.slopes}
    kernel = Kernel(model, part.kernel.freq_hz, tuple(name for name in model.parameters if name in known))
    G, dG = kernel.evaluate(theta)
    by_name = dict(zip(kernel.wanted, dG, strict=True))
    chain, names = fitted.jacobian(x, part.configuration), fitted.names
    moved = [(i, by_name[name]) for i, name in enumerate(names) if name in by_name and np.any(chain[i])]
    free = np.zeros((chain.shape[1], *G.shape), complex)
    for i, slope in moved:
        for k in np.flatnonzero(chain[i]):
            free[k] += chain[i, k] * slope
    followed = {names[i] for i, _ in moved}
    own = {name: slope for name, slope in by_name.items() if name not in followed}
    further = _further(held.linearisation.model.robot, model, theta, kernel, G, by_name)
    return Evaluated(part, part.mixing, G, free, own | further)


def _further(
    robot: Robot,
    model: LinearModel,
    theta: FloatArray,
    kernel: Kernel,
    G: ComplexArray,
    slopes: dict[str, ComplexArray],
) -> dict[str, ComplexArray]:
    """Slopes of what only the response knows: delays of channels, ratios, the rate, angles of this configuration."""
    s = 2j * np.pi * kernel.freq_hz[:, None, None]
    found = {RATE: slopes[RATE] - 2 * G}
    for role, places, axis in (("y", model.outputs, 1), ("u", model.inputs, 2)):
        for i, place in enumerate(places if len(places) > 1 else ()):  # a single one is all of them
            mask = np.zeros((1, len(model.outputs), len(model.inputs)))
            mask[(slice(None),) * axis + (i,)] = 1.0
            found[gain_name(role, place).replace("gain", "delay", 1)] = -s * mask * G
    at = dict(zip(model.parameters, theta.tolist(), strict=True))
    inverse = np.linalg.inv(robot.mixing)
    for i, joint in enumerate(robot.driven):
        turn = np.outer(inverse[:, i], robot.mixing[i])
        left, right = (_between(turn, robot, places) for places in (model.outputs, model.inputs))
        scaled = [f"{letters}_{joint.name}" for letters in ("Jm", "fm", "km", "dm")]
        moved = sum((2 * at[name] * slopes[name] for name in scaled if name in slopes), np.zeros_like(G))
        found[f"ratio_{joint.name}"] = left @ G + G @ right.T + moved
        found[f"angle_{joint.name}@{model.configuration.name}"] = slopes[f"angle_{joint.name}"]
    return found


def _between(turn: FloatArray, robot: Robot, places: tuple[str, ...]) -> FloatArray:
    """The entries of a matrix over motors (n_u, n_u) between places, zero for other places."""
    index = [robot.motor_locations.index(place) if place in robot.motor_locations else -1 for place in places]
    return np.array([[turn[i, j] if min(i, j) >= 0 else 0.0 for j in index] for i in index])
