r"""Static load tests against the responses: do both show one stiffness?

The fit of the responses alone, x with covariance C, predicts the readings with residuals r of covariance S,

.. math:: S = 1 + J\, C J^T, \qquad T = r^T S^{-1} r \sim \chi^2, \qquad
          \rho - 1 = \frac{h^T S^{-1} r}{h^T S^{-1} h}, \quad h = W \hat y

Where the responses predict some reading to no better than a tenth, their errors are not linear there, and all is taken
at the optimum x of both, with H = A + J^T J of both and r of it,

.. math:: r \to r + J A^{-1} J^T r, \qquad C \to A^{-1}

widened as the intervals of the responses alone are. Directions that these do not reach are left to the load tests.
Where T or the ratio rho of the deflections is beyond chance, the cause is the column c, of those below, with the
largest drop (c^T S^-1 r)^2 / c^T S^-1 c: a common factor, a part that does not depend on the load (hysteresis, slack),
a base that moves or tilts under the stand of the gauge, one spring.
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
from elastid.fit.result import Result
from elastid.fit.static_agreement import LoadReading, StaticAgreement
from elastid.model.kinematics import frame_poses
from elastid.parameters import Parameters


@dataclass(frozen=True)
class LoadLimits:
    """Thresholds of a disagreement: each test errs once in 700 fits (scripts/studies/results.csv)."""

    tail: float = 1 / 700  # probability of T, and of the ratio, by chance
    linear: float = 0.1  # of the largest deflection, above which a std of the prediction is not one of first order
    reached: float = 1e-9  # of the information, below which the responses do not reach a direction
    unreached: float = 30.0  # std of x in a direction that the responses do not reach
    known: float = 1e6  # variance over that of the reading, above which the responses predict nothing
    share: float = 0.3  # of T beyond its degrees of freedom, that a cause must explain
    alternative: float = 6.0  # drop of V within which a further cause is named


LIMITS = LoadLimits()
Words: TypeAlias = Callable[[float], str]  # of a cause by its size


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Of the responses alone: residuals r (n,), S^-1 (n, n), J (n, n_x), y (n,) in m and the std (n,) of that."""

    loads: StaticLoads
    parameters: Parameters
    residual: FloatArray
    weight: FloatArray
    J: FloatArray
    predicted: FloatArray
    std: FloatArray
    dof: int

    @property
    def chi_square(self) -> float:
        """T."""
        return float(self.residual @ self.weight @ self.residual)

    def drop(self, column: FloatArray) -> tuple[float, float, float]:
        """Drop of V by a column (n,), its factor and the standard deviation of that."""
        size = float(column @ self.weight @ column)
        if not size > 1 / LIMITS.known:
            return 0.0, 0.0, np.inf
        pull = float(column @ self.weight @ self.residual)
        return pull**2 / size, pull / size, size**-0.5


def static_agreement(loads: StaticLoads, alone: Result, both: Result, fit: ElasticFit) -> StaticAgreement:
    """Load tests next to the deflections of `alone`, the fit of the responses without them; fit: that of `both`."""
    now = _compared(loads, alone)
    if np.any(now.std > LIMITS.linear * np.abs(now.predicted).max()):
        now = replace(_compared_at_both(loads, alone, both, fit), std=now.std)
    _, factor, std = now.drop(loads.whitening @ now.predicted)
    is_beyond = now.chi_square > chi_square_limit(max(now.dof, 1), LIMITS.tail) or (
        (factor / std) ** 2 > chi_square_limit(1, LIMITS.tail)
    )
    cause = _cause(now) if is_beyond else ""
    ratio = 1 + factor if np.isfinite(std) else np.nan
    return StaticAgreement(_readings(now, alone), ratio, std, now.chi_square, now.dof, cause)


def _compared(loads: StaticLoads, alone: Result) -> _Comparison:
    r, J = loads.residual(alone.parameters, alone.x)
    y, slopes = loads.predicted(alone.parameters, alone.x)
    C = alone.covariance.copy()
    unknown = ~np.isfinite(np.diag(C))
    C[unknown] = C[:, unknown] = 0.0
    C[unknown, unknown] = LIMITS.unreached**2
    mu, U = np.linalg.eigh(np.eye(len(r)) + J @ C @ J.T)
    known = mu < LIMITS.known
    weight = (U[:, known] / mu[known]) @ U[:, known].T
    std = np.sqrt(np.einsum("ij,jk,ik->i", slopes, C, slopes))
    return _Comparison(loads, alone.parameters, r, weight, J, y, std, int(known.sum()))


def _compared_at_both(loads: StaticLoads, alone: Result, both: Result, fit: ElasticFit) -> _Comparison:
    r, J = loads.residual(both.parameters, both.x)
    y, _ = loads.predicted(both.parameters, both.x)
    A = replace(fit, loads=None, inertias=()).evaluate(both.x).hessian / 2
    size = np.sqrt(np.maximum(np.diag(A) + np.sum(J**2, axis=0), 1e-300))
    values, V = np.linalg.eigh(A / np.outer(size, size))
    root = (V / np.sqrt(np.maximum(values, LIMITS.reached))) / size[:, None]
    with np.errstate(invalid="ignore"):
        widened = np.sqrt(np.diag(alone.covariance)) / np.linalg.norm(root, axis=1)
    spread = J @ (np.where(np.isfinite(widened), np.maximum(widened, 1.0), 1.0)[:, None] * root)
    mu, U = np.linalg.eigh(np.eye(len(r)) + spread @ spread.T)
    known = mu < LIMITS.known
    weight = (U[:, known] / mu[known]) @ U[:, known].T
    left = r + J @ (root @ (root.T @ (J.T @ r)))
    return _Comparison(loads, both.parameters, left, weight, J, y, np.zeros(len(y)), int(known.sum()))


def _readings(now: _Comparison, alone: Result) -> tuple[LoadReading, ...]:
    loads = now.loads
    predicted = loads.predicted(alone.parameters, alone.x)[0]
    std = np.sqrt(np.concatenate([np.diag(test.error_covariance) for test in loads.tests]))
    rows = [row for load in loads.robot.loads for row in load.directions.tolist()]
    numbers = np.column_stack([loads.measured, std, predicted, now.std]).tolist()
    return tuple(
        LoadReading(loads.robot.loads[i].configuration.name, loads.robot.loads[i].read_at, (x, y, z), *own)
        for i, (x, y, z), own in zip(loads.owners, rows, numbers, strict=True)
    )


def _cause(now: _Comparison) -> str:
    """The likeliest cause, and others that explain as much."""
    tried = [(now.drop(column), words) for column, words in _columns(now)]
    every = sorted(((drop, words(factor)) for (drop, factor, _), words in tried if drop > 0), key=lambda e: -e[0])
    best = every[0][0] if every else 0.0
    if not best or best < LIMITS.share * (now.chi_square - now.dof):  # a single reading that is off, or several causes
        worst = int(np.argmax(np.abs(now.residual)))
        load = now.loads.robot.loads[now.loads.owners[worst]]
        return (
            f"no single cause explains it; the worst is a reading at {load.read_at} in {load.configuration.name} with "
            f"{1e6 * now.loads.measured[worst]:.4g} um instead of {1e6 * now.predicted[worst]:.4g} um: check its load, "
            "direction and std"
        )
    return " or ".join([words for drop, words in every if drop > max(best - LIMITS.alternative, best / 2)][:3])


def _columns(now: _Comparison) -> Iterator[tuple[FloatArray, Words]]:
    """Whitened readings (n,) by a unit of each cause, and its words by its size."""
    W, robot, owners = now.loads.whitening, now.loads.robot, np.array(now.loads.owners)
    yield W @ now.predicted, _of_factor
    length = np.sqrt(np.bincount(owners, now.predicted**2))[owners]
    yield W @ (now.predicted / np.maximum(length, 1e-300)), _of_slack
    count = len(robot.model.robot.joints)
    moved, tilted = [], []
    for i, load in enumerate(robot.loads):
        q = robot.held[i : i + 1, :count]
        acting, read = (frame_poses(robot.model.robot, q, name).position[0] for name in (load.frame, load.read_at))
        moved.append(load.directions @ load.force)
        tilted.append(load.directions @ np.cross(np.cross(acting, load.force) + load.torque, read))
    yield W @ np.concatenate(moved), _of_base("N/m", "moved")
    yield W @ np.concatenate(tilted), _of_base("N*m/rad", "tilted")
    for i, parameter in enumerate(now.parameters.free):
        if parameter.stands_for.startswith("k_") and parameter.log:
            yield -now.J[:, i], _of_spring(parameter.name)


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
        return (
            f"{1e6 * by:.3g} um in each test whatever the load: hysteresis or backlash of gears, or slack in the hook"
        )
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
        factor = 1 / max(1 - by, 1e-3)  # the deflection of a spring goes with its compliance
        return f"as if {name} were {factor:.3g} times as large at rest, as hysteresis or friction of that gear makes it"

    return words


def contradiction(static: StaticAgreement) -> str:
    """The disagreement with its cause."""
    return f"static load tests contradict the responses: {static.words}; {static.cause}"


def static_notes(result: Result) -> tuple[Note, ...]:
    """A warning where load tests contradict the responses."""
    if result.static is None or not result.static.disagrees:
        return ()
    return (
        Note(
            "fit/loads",
            f"{contradiction(result.static)}; the numbers are those of the responses alone, and their intervals "
            "contain those of both together",
        ),
    )
