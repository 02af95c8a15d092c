r"""Static and tool data: consistency of load tests, or of responses at the tool, with the responses of the motors.

The fit to the motors' responses alone, x_m with covariance C, and the residuals r of the second source,

.. math:: T = \min_x \; |r(x)|^2 + (x - x_m)^T C^{-1} (x - x_m) \sim \chi^2

by the solver of the fit. They disagree if T, or a common factor of all measured values, is significant. The factor, c
in r - c W y, is the cause if it explains more than half of T. For responses at the tool, wrong channels of force and
motion (sign, quantity, state of the motors) are tested, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, laplace_variable
from elastid.base.errors import FitError
from elastid.base.statistics import FALSE_ALARM_RATE, chi_square_limit, max_cost_ratio
from elastid.covariance import scaled
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.refit import evaluate
from elastid.fit.frf_problem import Assembly
from elastid.fit.load_tests import Agreement, LoadReading, StaticAgreement, ToolAgreement, ToolComparison
from elastid.fit.problem.frf_residuals import ElasticFit, Part
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.problem.static_loads import StaticLoads
from elastid.fit.result import Result
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.parameters import Parameter, Parameters
from elastid.record import MOTION_ORDER
from elastid.response import Response

_UNKNOWN = (
    "check location, direction, sign, unit and std of the largest residual, the angles, and the state of the motors "
    "(no single cause explains it; a gear with friction or backlash has another stiffness for small motions)"
)
# Residuals (n,) and derivatives (n, n_z + 1) by parts: along the root of C at x (n_x,), and for c of a factor 1 + c.
Residuals: TypeAlias = Callable[[FloatArray, FloatArray, float], Iterable[tuple[FloatArray, FloatArray]]]


@dataclass(frozen=True, eq=False)
class SecondSource:
    """Fit to the motors: x_m (n_x,), a root L of C = L L^T with x = x_m + L z; and the residuals of the source."""

    x: FloatArray
    root: FloatArray
    residuals: Residuals
    n_residuals: int

    @classmethod
    def of(cls, alone: Result, residuals: Residuals, n_residuals: int) -> SecondSource:
        """Return the source beside `alone`, the fit to the motors' responses."""
        C = alone.covariance.copy()
        unknown = ~np.isfinite(np.diag(C))
        C[unknown] = C[:, unknown] = 0.0
        C[unknown, unknown] = LIMITS.unreached**2
        size = np.sqrt(np.maximum(np.diag(C), 1e-300))
        values, V = np.linalg.eigh(C / np.outer(size, size))
        return cls(alone.x, size[:, None] * V * np.sqrt(np.maximum(values, 0.0)), residuals, n_residuals)

    def least(self, with_factor: bool = False) -> tuple[float, float, float]:
        """Return T and the factor less 1 with its std, NaN without one."""
        z = np.zeros(self.root.shape[1] + with_factor)
        unknowns = Parameters(tuple(Parameter(f"z{i}", 0.0) for i in range(len(z))))
        try:
            end = solve(LeastSquares(unknowns, self.n_residuals, self._at), z, ROUGH, LIMITS.iterations)
        except FitError:  # no robot stands there
            return np.inf, np.nan, np.nan
        if not with_factor:
            return end.cost, np.nan, np.nan
        H = self._at(end.x).hessian / 2
        std = np.sqrt(max(np.linalg.pinv(H)[-1, -1], 0.0)) if H[-1, -1] > 0 else np.inf
        return end.cost, float(end.x[-1]), float(std)

    def _at(self, z: FloatArray) -> Evaluation:
        """Evaluate T and its derivatives at z (n,), or at (z, c) (n + 1,)."""
        n = self.root.shape[1]
        x, prior = self.x + self.root @ z[:n], np.where(np.arange(len(z)) < n, z, 0.0)
        cost, gradient, H = float(prior @ prior), prior, np.diag(np.where(np.arange(len(z)) < n, 1.0, 0.0))
        with np.errstate(all="ignore"):
            try:
                for r, every_slope in self.residuals(x, self.root, float(z[n:].sum())):
                    J = every_slope[:, : len(z)]
                    cost, gradient, H = cost + float(r @ r), gradient + J.T @ r, H + J.T @ J
            except np.linalg.LinAlgError:  # no robot stands there
                cost = np.inf
        # Far away slopes overflow before the cost does.
        return Evaluation(cost if np.isfinite(cost) and np.isfinite(H).all() else np.inf, 2 * gradient, 2 * H)


def agreement(now: SecondSource, alone: Result) -> tuple[Agreement, float]:
    """Return the source next to `alone`, without a cause; and T with the factor that explains it, else inf."""
    scale = alone.inflation_factor**2 if alone.exceeds_noise else 1.0
    dof, T = now.n_residuals, now.least()[0]
    least, by, std = now.least(with_factor=True)
    is_other_size = by**2 > scale * chi_square_limit(1, FALSE_ALARM_RATE) * std**2
    is_beyond = scale * dof * max_cost_ratio(dof) < T or is_other_size
    ratio = (1 + by, std) if np.isfinite(std) else (np.nan, std)
    return Agreement(*ratio, T, dof, _UNKNOWN if is_beyond else ""), least if explains(now, T, least) else np.inf


def explains(now: SecondSource, T: float, least: float) -> bool:
    """Return True if a cause lowers T to `least`, by more than half of the excess over its degrees of freedom."""
    return T - least > LIMITS.majority_fraction * (T - now.n_residuals)


def _residuals(
    loads: StaticLoads, parameters: Parameters, x: FloatArray, root: FloatArray, c: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield whitened residuals (n,) of load tests and their derivatives (n, n_z + 1)."""
    y, slopes = loads.predicted(parameters, x)
    J = np.column_stack([(1 + c) * (slopes @ root), y])
    yield (loads.measured - (1 + c) * y) / loads.std, -J / loads.std[:, None]


def static_agreement(loads: StaticLoads, alone: Result) -> StaticAgreement:
    """Compare load tests with the deflections predicted by `alone`, the fit of the responses without load tests."""
    now = SecondSource.of(alone, partial(_residuals, loads, alone.parameters), loads.n_residuals)
    comparison, least = agreement(now, alone)
    if comparison.disagrees and np.isfinite(least):
        why = "stiffer under static load (gear friction)" if comparison.ratio < 1 else "softer (gear hysteresis)"
        cause = f"check the scales of loads and gauge; if correct, all springs are {why}"
        comparison = replace(comparison, cause=cause)
    predicted, slopes = loads.predicted(alone.parameters, alone.x)
    rows = [row for load in loads.robot.loads for row in load.directions.tolist()]
    by_responses_std = np.linalg.norm(slopes @ now.root, axis=1)
    numbers = np.column_stack([loads.measured, loads.std, predicted, by_responses_std]).tolist()
    readings = tuple(
        LoadReading(loads.robot.loads[i].configuration.name, loads.robot.loads[i].read_at, (x, y, z), *row)
        for i, (x, y, z), row in zip(loads.owners, rows, numbers, strict=True)
    )
    return StaticAgreement(**vars(comparison), readings=readings)


def _tool_residuals(
    fit: ElasticFit, x: FloatArray, root: FloatArray, c: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield whitened residuals (N,) of each response and their derivatives (N, n_z + 1)."""
    for model in evaluate(fit, x):
        slopes = np.concatenate([(1 + c) * np.tensordot(root.T, model.free, axes=1), model.G[None]])
        with_factor = replace(model, G=(1 + c) * model.G)
        yield with_factor.residual, -with_factor.whitened(slopes).T


def tool_agreement(assembly: Assembly, alone: Result) -> ToolAgreement:
    """Compare the responses at the tool in `assembly` with `alone`, the fit to the motor responses."""
    fit, now = _source(assembly.with_model_error(alone.model_error), alone)
    result, with_factor = agreement(now, alone)
    is_misread = False
    if result.disagrees:
        others = [(_source(replace(assembly, responses=readings).with_model_error(alone.model_error), alone)[1], words)
                  for readings, words in _tool_readings(assembly.responses)]  # fmt: skip
        least, misreading = min(((trial.least()[0], words) for trial, words in others), key=lambda trial: trial[0])
        is_misread = explains(now, result.chi_square, least)
        if with_factor < least and abs(result.ratio - 1) < LIMITS.largest:
            is_misread, misreading = False, (
                "check unit and calibration of hammer and sensor, and the torque constants of the motors: all "
                f"responses at the tool are {result.ratio:.4g} times as large"
            )  # fmt: skip
            result = replace(result, cause=misreading)
        result = replace(result, cause=misreading if is_misread else result.cause)
    comparison = tuple(_compared(G, part, fit, alone.x) for G, part in zip(assembly.responses, fit.parts, strict=True))
    return ToolAgreement(**vars(result), responses=comparison, is_misread=is_misread)


def _source(assembly: Assembly, alone: Result) -> tuple[ElasticFit, SecondSource]:
    fit = replace(assembly, parameters=alone.parameters).at(alone.x, assembly.spec.criterion)
    return fit, SecondSource.of(alone, partial(_tool_residuals, fit), fit.n_residuals)


def _compared(response: Response, part: Part, fit: ElasticFit, x: FloatArray) -> ToolComparison:
    G, is_used = part.kernel.response(part.theta(fit.parameters, x)), part.gain > 0
    ratio = np.abs(response.G[is_used]) / np.maximum(np.abs(G[is_used]), 1e-300)
    rms = float(np.sqrt(np.mean((20 * np.log10(np.maximum(ratio, 1e-300))) ** 2))) if is_used.any() else np.nan
    return ToolComparison(response.configuration.name, response.motors, response.inputs, response.outputs, rms)


def _tool_readings(responses: Sequence[Response]) -> Iterator[tuple[tuple[Response, ...], str]]:
    def interpretation(sign: float, power: int) -> tuple[Response, ...]:
        readings = []
        for G in responses:
            s = laplace_variable(G.freq_hz[:, None, None])
            noise, total = (scaled(part, np.abs(s) ** (2 * power)) for part in (G.noise, G.total))
            readings.append(replace(G, G=sign * G.G * s**power, noise=noise, total=total))
        return tuple(readings)

    yield interpretation(-1.0, 0), "reverse the sign of force or motion: they have opposite signs"
    orders = {order: name for name, order in MOTION_ORDER.items()}
    for power in (-2, -1, 1, 2):
        stated = {MOTION_ORDER[G.quantity] for G in responses}
        if len(stated) == 1 and (quantity := orders.get(min(stated) - power)):
            yield (
                interpretation(1.0, power),
                f"correct the quantity: the file has the {quantity}, not the {orders[min(stated)]}",
            )
    moves = any(place.startswith("motor ") for G in responses for place in G.outputs)
    ways: tuple[Literal["locked", "free"], ...] = ("free",) if moves else ("locked", "free")
    for motors in ways:
        if any(G.motors != motors for G in responses):
            yield (tuple(replace(G, motors=motors, loop=None) for G in responses), f"correct tool.motors to {motors}")
