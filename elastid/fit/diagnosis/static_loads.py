r"""Do static load tests and responses show one stiffness?

With the residuals r of the load tests and their slopes J at the optimum of both, H = A_d + J^T J, the responses alone
would end at x + dx, and predict the load tests with residuals r_d of covariance S,

.. math:: dx = A_d^{-1} J^T r, \quad r_d = r + J dx, \quad S = 1 + J\, C_d J^T, \qquad
          T = r_d^T S^{-1} r_d \sim \chi^2, \qquad
          \rho - 1 = \frac{h^T S^{-1} r_d}{h^T S^{-1} h}, \quad h = W \hat y

C_d: A_d^-1, widened as the intervals of the fit are. Directions that the responses do not reach are left to the load
tests. Where T or the ratio rho is beyond chance, the cause is the column c, of those below, with the largest drop
(c^T S^-1 r_d)^2 / c^T S^-1 c: a common factor, a part that does not depend on the load (hysteresis, slack), a base that
moves or tilts under the dial's stand, one spring.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.base.statistics import chi_square_limit
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.static_loads import StaticLoads
from elastid.fit.result import FitResult
from elastid.fit.static_agreement import LoadReading, StaticAgreement
from elastid.model.kinematics import frame_poses


@dataclass(frozen=True)
class LoadLimits:
    """Thresholds of a disagreement.  False alarms of 400 clean fits with load tests: static-stiffness 0."""

    tail: float = 1 / 700  # probability of T, and of the ratio, by chance
    reached: float = 1e-9  # of the information, below which the responses do not reach a direction
    known: float = 1e6  # variance over that of the reading, above which the responses predict nothing
    alternative: float = 6.0  # drop of V within which a further cause is named


LIMITS = LoadLimits()
Words: TypeAlias = Callable[[float], str]  # of a cause by its size


@dataclass(frozen=True, eq=False)
class _Comparison:
    """r_d (n,), S^-1 (n, n), W y (n,) of the responses alone; step dx (n_x,); std (n,) of their predictions."""

    residual: FloatArray
    weight: FloatArray
    predicted: FloatArray
    step: FloatArray
    std: FloatArray
    chi_square: float
    dof: int

    def drop(self, column: FloatArray) -> tuple[float, float, float]:
        """Drop of V by a column (n,), its factor and the standard deviation of that."""
        size = float(column @ self.weight @ column)
        if not size > 1e-12:
            return 0.0, 0.0, np.inf
        pull = float(column @ self.weight @ self.residual)
        return pull**2 / size, pull / size, size**-0.5


def with_static_agreement(result: FitResult, fit: ElasticFit, x: FloatArray) -> FitResult:
    """The result with its load tests compared; where they contradict the responses, their pull widens the intervals."""
    if fit.loads is None:
        return result
    now = _compared(result, fit, fit.loads, x)
    _, factor, std = now.drop(now.predicted)
    is_beyond = now.chi_square > chi_square_limit(max(now.dof, 1), LIMITS.tail) or (
        (factor / std) ** 2 > chi_square_limit(1, LIMITS.tail)
    )
    cause = _cause(now, result, fit, fit.loads, x) if is_beyond else ""
    agreement = StaticAgreement(
        _readings(now, fit, fit.loads, x), 1 + factor if np.isfinite(std) else np.nan, std, now.chi_square, now.dof,
        cause,
    )  # fmt: skip
    if not cause:
        return replace(result, static=agreement)
    covariance = result.covariance + np.outer(now.step, now.step)
    return replace(result, static=agreement, covariance=covariance)


def _compared(result: FitResult, fit: ElasticFit, loads: StaticLoads, x: FloatArray) -> _Comparison:
    r, J = fit.static(x)
    y, _ = loads.predicted(fit.parameters, x)
    free = np.flatnonzero(~result.at_bound & np.isfinite(np.diag(result.covariance)))
    A = replace(fit, inertias=()).evaluate(x).hessian[np.ix_(free, free)] / 2
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    scaled, J_f = A / np.outer(size, size), J[:, free] / size
    values, V = np.linalg.eigh(scaled - J_f.T @ J_f)
    reached = values > LIMITS.reached
    inverse = np.where(reached, 1 / np.maximum(values, LIMITS.reached), 0.0)
    step = V @ (inverse * (V.T @ (J_f.T @ r)))
    widened = np.sqrt(np.diag(result.covariance)[free]) * size / np.sqrt(np.diag(np.linalg.pinv(scaled, hermitian=True)))
    root = np.maximum(widened, 1.0)[:, None] * (V * np.sqrt(np.where(reached, inverse, 1 / LIMITS.reached)))
    spread = J_f @ root
    S = np.eye(len(r)) + spread @ spread.T
    mu, U = np.linalg.eigh(S)
    known = mu < LIMITS.known
    weight = (U[:, known] / mu[known]) @ U[:, known].T
    left = r + J_f @ step
    whole = np.zeros(len(x))
    whole[free] = step / size
    predicted = loads.whitening @ y - J_f @ step
    std = np.sqrt(np.diag(np.linalg.solve(loads.whitening, np.linalg.solve(loads.whitening, spread @ spread.T).T)))
    return _Comparison(left, weight, predicted, whole, std, float(left @ weight @ left), int(known.sum()))


def _readings(now: _Comparison, fit: ElasticFit, loads: StaticLoads, x: FloatArray) -> tuple[LoadReading, ...]:
    y, _ = loads.predicted(fit.parameters, x)
    std = np.sqrt(np.concatenate([np.diag(test.error_covariance) for test in loads.tests]))
    expected = np.linalg.solve(loads.whitening, now.predicted)
    rows = [row for load in loads.robot.loads for row in load.directions.tolist()]
    numbers = np.column_stack([loads.measured, std, y, expected, now.std]).tolist()
    return tuple(
        LoadReading(loads.robot.loads[i].configuration.name, loads.robot.loads[i].read_at, tuple(row), *own)
        for i, row, own in zip(loads.owners, rows, numbers, strict=True)
    )


def _cause(now: _Comparison, result: FitResult, fit: ElasticFit, loads: StaticLoads, x: FloatArray) -> str:
    """The likeliest cause, and others that explain as much."""
    tried = []
    for column, words in _columns(now, result, fit, loads, x):
        drop, factor, _ = now.drop(column)
        tried.append((drop, words(factor)))
    tried.sort(key=lambda each: -each[0])
    near = [words for drop, words in tried if drop > max(tried[0][0] - LIMITS.alternative, 0.5 * tried[0][0])]
    share = tried[0][0] / max(now.chi_square - now.dof, 1e-300)
    if share < 0.3:  # a single reading that is off, or several causes
        worst = int(np.argmax(np.abs(now.residual)))
        reading = _readings(now, fit, loads, x)[worst]
        return (
            f"no single cause explains it; the worst is a reading at {reading.frame} in {reading.configuration} with "
            f"{1e6 * reading.measured:.4g} um instead of {1e6 * reading.by_responses:.4g} um: check its load, "
            "direction and std"
        )
    return " or ".join(near[:3])


def _columns(
    now: _Comparison, result: FitResult, fit: ElasticFit, loads: StaticLoads, x: FloatArray
) -> Iterator[tuple[FloatArray, Words]]:
    """Whitened readings (n,) by a unit of each cause, and its words by its size."""
    W, robot = loads.whitening, loads.robot
    yield now.predicted, _of_factor
    expected, owners = np.linalg.solve(W, now.predicted), np.array(loads.owners)
    length = np.sqrt(np.bincount(owners, expected**2))[owners]
    yield W @ (expected / np.maximum(length, 1e-300)), _of_slack
    count = len(robot.model.robot.joints)
    moved, tilted = [], []
    for i, load in enumerate(robot.loads):
        q = robot.held[i : i + 1, :count]
        acting, read = (frame_poses(robot.model.robot, q, name).position[0] for name in (load.frame, load.read_at))
        moved.append(load.directions @ load.force)
        tilted.append(load.directions @ np.cross(np.cross(acting, load.force) + load.torque, read))
    yield W @ np.concatenate(moved), _of_base("N/m", "moved")
    yield W @ np.concatenate(tilted), _of_base("N*m/rad", "tilted")
    J = fit.static(x)[1]
    for i, parameter in enumerate(result.parameters.free):
        if parameter.stands_for.startswith("k_") and parameter.log:
            yield -J[:, i], _of_spring(parameter.name)


def _of_factor(by: float) -> str:
    if by > 0:
        return (
            "all springs are softer at rest than in motion, as gear hysteresis makes them under slow loads, or the "
            "loads or the gauge are in another scale"
        )
    return (
        "all springs are stiffer at rest than in motion, as friction in the gears makes them that carries part of the "
        "load, or the loads or the gauge are in another scale"
    )


def _of_slack(by: float) -> str:
    if by > 0:
        return f"{1e6 * by:.3g} um in each test whatever the load: hysteresis or backlash of gears, or slack in the hook"
    return (
        f"{-1e6 * by:.3g} um are missing in each test whatever the load: friction in the gears or a dial that sticks; "
        "load from both sides and take the mean"
    )


def _of_base(unit: str, does: str) -> Words:
    def words(by: float) -> str:
        if by > 0:
            return (
                f"as if the base {does} against the stand of the gauge, by a stiffness of {1 / by:.3g} {unit}: the "
                "base is elastic, which the robot's file lacks"
            )
        return (
            f"as if the stand of the gauge {does} with the base, by a stiffness of {-1 / by:.3g} {unit}: put it on the "
            "ground, away from the base"
        )

    return words


def _of_spring(name: str) -> Words:
    def words(by: float) -> str:
        factor = float(np.exp(np.clip(by, -5, 5)))
        return f"as if {name} were {factor:.3g} times as large at rest, as hysteresis or friction of that gear makes it"

    return words


def contradiction(static: StaticAgreement) -> str:
    """The disagreement with its cause."""
    return f"static load tests contradict the responses: {static.words}; {static.cause}"


def static_notes(result: FitResult) -> tuple[Note, ...]:
    """A warning where load tests contradict the responses; the intervals then contain what they pull."""
    if result.static is None or not result.static.disagrees:
        return ()
    return (Note("static-stiffness", f"{contradiction(result.static)}; intervals are widened by what the tests move"),)
