r"""Static and tool data: consistency of load tests, or of responses at the tool, with the responses of the motors.

The fit to the motors' responses alone, x_m with covariance C, and the residuals r of the second source,

.. math:: T = \min_x \; |r(x)|^2 + (x - x_m)^T C^{-1} (x - x_m) \sim \chi^2

by the solver of the fit. The data disagree if T, or the error c of a common factor 1 + c of all predicted values, is
significant. The factor is the cause if it explains more than half of the excess of T. For responses at the tool, wrong
interpretations of force and motion (sign, quantity, state of the motors) are also tested.
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
from elastid.covariance import scale_covariance
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.refit import evaluate
from elastid.fit.frf_problem import Assembly
from elastid.fit.load_tests import Agreement, LoadReading, StaticAgreement, ToolAgreement, ToolComparison
from elastid.fit.problem.frf_residuals import ElasticFit, FrfResiduals
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
# (x (n_x,), root (n_x, n_z), c) -> blocks of residuals (n,) with derivatives (n, n_z + 1) to z and c.
Residuals: TypeAlias = Callable[[FloatArray, FloatArray, float], Iterable[tuple[FloatArray, FloatArray]]]


@dataclass(frozen=True, eq=False)
class SecondSource:
    """An independent data set next to the fit of the motors' responses, x = x_m + L z with C = L L^T.

    x (n_x,): x_m.  root (n_x, n_z): L.  residuals: whitened residuals of the data set.
    """

    x: FloatArray
    root: FloatArray
    residuals: Residuals
    n_residuals: int

    @classmethod
    def of(cls, motor_fit: Result, residuals: Residuals, n_residuals: int) -> SecondSource:
        """Return the data set next to `motor_fit`, the fit of the motors' responses."""
        C = motor_fit.covariance.copy()
        unknown = ~np.isfinite(np.diag(C))
        C[unknown] = C[:, unknown] = 0.0
        C[unknown, unknown] = LIMITS.unidentifiable_std**2
        size = np.sqrt(np.maximum(np.diag(C), 1e-300))
        values, V = np.linalg.eigh(C / np.outer(size, size))
        return cls(motor_fit.x, size[:, None] * V * np.sqrt(np.maximum(values, 0.0)), residuals, n_residuals)

    def min_cost(self, with_factor: bool = False) -> tuple[float, float, float]:
        """Return the minimum T; with_factor: also c of a common factor 1 + c, and its std (otherwise NaN)."""
        z = np.zeros(self.root.shape[1] + with_factor)
        unknowns = Parameters(tuple(Parameter(f"z{i}", 0.0) for i in range(len(z))))
        try:
            end = solve(LeastSquares(unknowns, self.n_residuals, self._at), z, ROUGH, LIMITS.iterations)
        except FitError:  # the robot has no equilibrium there
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
                for r, slopes in self.residuals(x, self.root, float(z[n:].sum())):
                    J = slopes[:, : len(z)]
                    cost, gradient, H = cost + float(r @ r), gradient + J.T @ r, H + J.T @ J
            except np.linalg.LinAlgError:  # the robot has no equilibrium there
                cost = np.inf
        # Far from the minimum derivatives overflow before the cost.
        return Evaluation(cost if np.isfinite(cost) and np.isfinite(H).all() else np.inf, 2 * gradient, 2 * H)


def agreement(source: SecondSource, motor_fit: Result) -> tuple[Agreement, float]:
    """Test the agreement of a data set with the fit. Also return T with a common factor, inf if it is no cause."""
    scale = motor_fit.inflation_factor**2 if motor_fit.exceeds_noise else 1.0
    dof, T = source.n_residuals, source.min_cost()[0]
    cause_cost, factor_error, std = source.min_cost(with_factor=True)
    has_factor = factor_error**2 > scale * chi_square_limit(1, FALSE_ALARM_RATE) * std**2
    disagrees = scale * dof * max_cost_ratio(dof) < T or has_factor
    ratio = (1 + factor_error, std) if np.isfinite(std) else (np.nan, std)
    cause_cost = cause_cost if explains_excess(source, T, cause_cost) else np.inf
    return Agreement(*ratio, T, dof, _UNKNOWN if disagrees else ""), cause_cost


def explains_excess(source: SecondSource, T: float, cause_cost: float) -> bool:
    """Return True if a cause that lowers T to `cause_cost` explains most of the excess of T over its expectation."""
    return T - cause_cost > LIMITS.majority_fraction * (T - source.n_residuals)


def _residuals(
    loads: StaticLoads, parameters: Parameters, x: FloatArray, root: FloatArray, c: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield whitened residuals (n,) of load tests and their derivatives (n, n_z + 1)."""
    y, slopes = loads.predicted(parameters, x)
    J = np.column_stack([(1 + c) * (slopes @ root), y])
    yield (loads.measured - (1 + c) * y) / loads.std, -J / loads.std[:, None]


def static_agreement(loads: StaticLoads, motor_fit: Result) -> StaticAgreement:
    """Compare load tests with the deflections that `motor_fit`, the fit of the motors' responses, predicts."""
    source = SecondSource.of(motor_fit, partial(_residuals, loads, motor_fit.parameters), loads.n_residuals)
    comparison, cause_cost = agreement(source, motor_fit)
    if comparison.disagrees and np.isfinite(cause_cost):
        reason = "stiffer under static load (gear friction)" if comparison.ratio < 1 else "softer (gear hysteresis)"
        cause = f"check the scales of loads and gauge; if correct, all springs are {reason}"
        comparison = replace(comparison, cause=cause)
    predicted, slopes = loads.predicted(motor_fit.parameters, motor_fit.x)
    rows = [row for load in loads.robot.loads for row in load.directions.tolist()]
    by_responses_std = np.linalg.norm(slopes @ source.root, axis=1)
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


def tool_agreement(assembly: Assembly, motor_fit: Result) -> ToolAgreement:
    """Compare the responses at the tool in `assembly` with `motor_fit`, the fit of the motors' responses."""
    fit, source = _source(assembly, motor_fit)
    result, cost_with_factor = agreement(source, motor_fit)
    is_misread = False
    if result.disagrees:
        costs = {
            remedy: _source(replace(assembly, responses=responses), motor_fit)[1].min_cost()[0]
            for responses, remedy in _interpretations(assembly.responses)
        }
        remedy = min(costs, key=costs.__getitem__)
        if cost_with_factor < costs[remedy] and abs(result.ratio - 1) < LIMITS.min_channel_factor_error:
            cause = "check unit and calibration of hammer and sensor, and the torque constants of the motors: all "
            result = replace(result, cause=f"{cause}responses at the tool are {result.ratio:.4g} times as large")
        elif is_misread := explains_excess(source, result.chi_square, costs[remedy]):
            result = replace(result, cause=remedy)
    comparison = tuple(_compare(G, frf, fit, motor_fit.x) for G, frf in zip(assembly.responses, fit.frfs, strict=True))
    return ToolAgreement(**vars(result), responses=comparison, is_misread=is_misread)


def _source(assembly: Assembly, motor_fit: Result) -> tuple[ElasticFit, SecondSource]:
    assembly = replace(assembly, parameters=motor_fit.parameters).with_model_error(motor_fit.model_error)
    fit = assembly.at(motor_fit.x)
    return fit, SecondSource.of(motor_fit, partial(_tool_residuals, fit), fit.n_residuals)


def _compare(response: Response, frf: FrfResiduals, fit: ElasticFit, x: FloatArray) -> ToolComparison:
    G, is_used = frf.kernel.response(frf.theta(fit.parameters, x)), frf.gain > 0
    ratio = np.abs(response.G[is_used]) / np.maximum(np.abs(G[is_used]), 1e-300)
    rms = float(np.sqrt(np.mean((20 * np.log10(np.maximum(ratio, 1e-300))) ** 2))) if is_used.any() else np.nan
    return ToolComparison(response.configuration.name, response.motors, response.inputs, response.outputs, rms)


def _interpretations(responses: Sequence[Response]) -> Iterator[tuple[tuple[Response, ...], str]]:
    def interpretation(sign: float, power: int) -> tuple[Response, ...]:
        interpreted = []
        for G in responses:
            s = laplace_variable(G.freq_hz[:, None, None])
            noise, total = (scale_covariance(covariance, np.abs(s) ** (2 * power)) for covariance in (G.noise, G.total))
            interpreted.append(replace(G, G=sign * G.G * s**power, noise=noise, total=total))
        return tuple(interpreted)

    yield interpretation(-1.0, 0), "reverse the sign of force or motion: they have opposite signs"
    orders = {order: name for name, order in MOTION_ORDER.items()}
    for power in (-2, -1, 1, 2):
        stated_orders = {MOTION_ORDER[G.quantity] for G in responses}
        if len(stated_orders) == 1 and (quantity := orders.get(min(stated_orders) - power)):
            yield (
                interpretation(1.0, power),
                f"correct the quantity: the file has the {quantity}, not the {orders[min(stated_orders)]}",
            )
    has_motor_motion = any(location.startswith("motor ") for G in responses for location in G.outputs)
    motor_states: tuple[Literal["locked", "free"], ...] = ("free",) if has_motor_motion else ("locked", "free")
    for motors in motor_states:
        if any(G.motors != motors for G in responses):
            yield (tuple(replace(G, motors=motors, loop=None) for G in responses), f"correct tool.motors to {motors}")
