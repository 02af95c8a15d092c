r"""Residuals at the optimum and their derivatives to everything that the fit held.

The numbers of `HeldModel` are parameters of its equations.  Others have a derivative that follows from the response
itself; each is the `columns` of a hypothesis:

.. math:: \text{delay of an output or input}: \; -j \omega G \text{ in its row or column}, \qquad
          \text{rate}: \; \frac{dG}{d\epsilon} = \omega \frac{\partial G}{\partial \omega} - 2 G

.. math:: \text{ratio of motor } i: \quad \dot S G + G \dot S^T
          + 2 \Big( J_m \frac{\partial G}{\partial J_m} + f_m \frac{\partial G}{\partial f_m} + \ldots \Big),
          \qquad \dot S = E^{-1} e_i e_i^T E

since torque and angle were referred to the link side by the wrong ratio.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.diagnosis.held_model import RATE, HeldModel
from elastid.fit.problem.elastic import Part
from elastid.fit.problem.least_squares import RESIDUALS, as_real
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.linear.response.kernel import Kernel
from elastid.parameters import ParameterSet
from elastid.robot import Robot, gain_name


@dataclass(frozen=True, eq=False)
class Evaluated:
    """One configuration at x: G (F, n_y, n_u) of the model and its derivatives, to x and by name to ln p or p.

    mixing: `Part.mixing`, for all that is whitened.
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
        r = np.where(part.gain > 0, part.gain * np.where(part.gain > 0, e, 0.0), 0.0)
        return np.asarray(_flat(self.mixing, r[None])[0])


@dataclass(frozen=True, eq=False)
class HeldResponse:
    """G (F, n_y, n_u) of the model in one configuration, as the `columns` of a hypothesis get it.

    slopes: dG by name of the parameters of `model`.  theta (n,): their values, SI.
    """

    robot: Robot
    model: LinearModel
    theta: FloatArray
    freq_hz: FloatArray
    G: ComplexArray
    slopes: Mapping[str, ComplexArray]


def evaluate_held(
    held: HeldModel,
    fitted: ParameterSet,
    x: FloatArray,
    columns: Sequence[Callable[[HeldResponse], Mapping[str, ComplexArray]]],
    part: Part,
) -> Evaluated:
    """One configuration of a fit with these parameters, on its lines, at x (n_x,); columns: of the hypotheses."""
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
    numbers = {name: slope for name, slope in by_name.items() if name not in followed}
    response = HeldResponse(held.linearisation.model.robot, model, theta, kernel.freq_hz, G, by_name)
    for further in columns:
        numbers |= further(response)
    return Evaluated(part, part.mixing, G, free, numbers)


def rate_column(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivative to a sampling rate 1 + e of the stated one."""
    return {RATE: response.slopes[RATE] - 2 * response.G}


def channel_delays(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivatives to the delay of each output and input in s; a single one is the delay of all."""
    s, model, columns = 2j * np.pi * response.freq_hz[:, None, None], response.model, dict[str, ComplexArray]()
    for role, places, axis in (("y", model.outputs, 1), ("u", model.inputs, 2)):
        for i, place in enumerate(places if len(places) > 1 else ()):
            mask = np.zeros((1, len(model.outputs), len(model.inputs)))
            mask[(slice(None),) * axis + (i,)] = 1.0
            columns[gain_name(role, place).replace("gain", "delay", 1)] = -s * mask * response.G
    return columns


def gear_ratios(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivatives to the logarithm of each gear ratio."""
    robot, model, G, slopes = response.robot, response.model, response.G, response.slopes
    values = dict(zip(model.parameters, response.theta.tolist(), strict=True))
    inverse, columns = np.linalg.inv(robot.mixing), {}
    for i, joint in enumerate(robot.driven):
        turn = np.outer(inverse[:, i], robot.mixing[i])
        left, right = (_between(turn, robot, places) for places in (model.outputs, model.inputs))
        scaled = [f"{letters}_{joint.name}" for letters in ("Jm", "fm", "km", "dm")]
        moved = sum((2 * values[name] * slopes[name] for name in scaled if name in slopes), np.zeros_like(G))
        columns[f"ratio_{joint.name}"] = left @ G + G @ right.T + moved
    return columns


def posture_angles(response: HeldResponse) -> dict[str, ComplexArray]:
    """Derivatives to the angle of each axis in this configuration alone, rad."""
    name = response.model.configuration.name
    return {f"angle_{j.name}@{name}": response.slopes[f"angle_{j.name}"] for j in response.robot.driven}


def _between(turn: FloatArray, robot: Robot, places: tuple[str, ...]) -> FloatArray:
    """The entries of a matrix over motors (n_u, n_u) between places, zero for other places."""
    index = [robot.motor_locations.index(place) if place in robot.motor_locations else -1 for place in places]
    return np.array([[turn[i, j] if min(i, j) >= 0 else 0.0 for j in index] for i in index])


def _flat(mixing: ComplexArray | None, values: ComplexArray) -> FloatArray:
    """Elements (n, F, n_y, n_u), mixed line by line, as real rows (n, N)."""
    flat = values.reshape(*values.shape[:2], -1)
    if mixing is not None:
        flat = (mixing @ flat.transpose(1, 2, 0)).transpose(2, 0, 1)
    return as_real(flat.reshape(len(values), -1))
