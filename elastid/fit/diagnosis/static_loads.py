"""Static load tests against the responses: do both show one stiffness?

Where they do not (`second_source`), the cause is a common factor, a part that does not depend on the load (hysteresis,
slack), a base that moves or tilts under the stand of the gauge, or one spring.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.fit.diagnosis.second_source import SecondSource, Unknown, agreement, likeliest
from elastid.fit.problem.static_loads import StaticLoads
from elastid.fit.result import Result
from elastid.fit.static_agreement import LoadReading, StaticAgreement
from elastid.model.kinematics import frame_poses
from elastid.parameters import Parameters

Words: TypeAlias = Callable[[float], str]  # of a cause by its size
# dy (n,) in m of a further unknown, of the predicted y and its slopes (n, n_x).
Column: TypeAlias = Callable[[FloatArray, FloatArray], FloatArray]


def _residuals(
    loads: StaticLoads, parameters: Parameters, column: Column | None, x: FloatArray, root: FloatArray, size: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Whitened residuals (n,) and their slopes."""
    y, slopes = loads.predicted(parameters, x)
    J = slopes @ root
    if column is not None:
        further = column(y, slopes)
        y, J = y + size * further, np.column_stack([J, further])
    yield loads.whitening @ (loads.measured - y), -loads.whitening @ J


def static_agreement(loads: StaticLoads, alone: Result) -> StaticAgreement:
    """Load tests next to the deflections of `alone`, the fit of the responses without them."""
    unknown = partial(partial, _residuals, loads, alone.parameters)
    now = SecondSource.of(alone, unknown(None), loads.n_residuals)
    factor = Unknown(unknown(lambda y, _: y), _of_factor)
    found = agreement(now, alone, factor)
    cause = ""
    if found.is_beyond:
        others = (Unknown(unknown(column), words) for column, words in _columns(loads, alone.parameters))
        causes = likeliest(now, found.T, (factor, *others))
        cause = " or ".join(causes) or _worst(loads, alone)
    known = np.isfinite(found.std)
    ratio = (1 + found.factor, found.std) if known else (np.nan, np.nan)
    return StaticAgreement(_readings(loads, alone, now), *ratio, found.T, now.n_residuals, cause)


def _readings(loads: StaticLoads, alone: Result, now: SecondSource) -> tuple[LoadReading, ...]:
    predicted, slopes = loads.predicted(alone.parameters, alone.x)
    std = np.sqrt(np.concatenate([np.diag(test.error_covariance) for test in loads.tests]))
    rows = [row for load in loads.robot.loads for row in load.directions.tolist()]
    by_responses_std = np.linalg.norm(slopes @ now.root, axis=1)
    numbers = np.column_stack([loads.measured, std, predicted, by_responses_std]).tolist()
    return tuple(
        LoadReading(loads.robot.loads[i].configuration.name, loads.robot.loads[i].read_at, (x, y, z), *own)
        for i, (x, y, z), own in zip(loads.owners, rows, numbers, strict=True)
    )


def _worst(loads: StaticLoads, alone: Result) -> str:
    """The reading that is farthest off, where no single cause explains all."""
    predicted = loads.predicted(alone.parameters, alone.x)[0]
    worst = int(np.argmax(np.abs(loads.whitening @ (loads.measured - predicted))))
    load = loads.robot.loads[loads.owners[worst]]
    return (
        f"no single cause explains it; the worst is a reading at {load.read_at} in {load.configuration.name} with "
        f"{1e6 * loads.measured[worst]:.4g} um instead of {1e6 * predicted[worst]:.4g} um: check its load, direction "
        "and std"
    )


def _columns(loads: StaticLoads, parameters: Parameters) -> Iterator[tuple[Column, Words]]:
    """Deflections by a unit of each further unknown, and words by its size."""
    robot, owners = loads.robot, np.array(loads.owners)

    def slack(y: FloatArray, slopes: FloatArray) -> FloatArray:
        return np.asarray(y / np.maximum(np.sqrt(np.bincount(owners, y**2))[owners], 1e-300))

    yield slack, _of_slack
    count = len(robot.model.robot.joints)
    moved, tilted = [], []
    for i, load in enumerate(robot.loads):
        q = robot.held[i : i + 1, :count]
        acting, read = (frame_poses(robot.model.robot, q, name).position[0] for name in (load.frame, load.read_at))
        moved.append(load.directions @ load.force)
        tilted.append(load.directions @ np.cross(np.cross(acting, load.force) + load.torque, read))
    for parts, unit, does in ((moved, "N/m", "moved"), (tilted, "N*m/rad", "tilted")):
        of_base = np.concatenate(parts)
        yield (lambda y, _, own=of_base: own), _of_base(unit, does)  # type: ignore[misc]
    for i, parameter in enumerate(parameters.free):
        if parameter.stands_for.startswith("k_") and parameter.log:
            yield (lambda y, slopes, i=i: slopes[:, i]), _of_spring(parameter.name)  # type: ignore[misc]


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
