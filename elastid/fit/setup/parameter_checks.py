r"""Checks of the parameters to identify before a fit: possible geometry, an effect of each, a scale of the gains.

The ends a_1, a_2 of a compensator, within their bounds, at the closest that they come in a configuration:

.. math:: \min_{a_1, a_2} |p_2 + R_2 a_2 - p_1 - R_1 a_1|

where they meet its force has no direction, and its lateral stiffness k L_0 / L no bound.

.. math:: \hat G = \frac{g_y}{g_u}\, G(M, D, K), \qquad G(c M, c D, c K) = G(M, D, K) / c

Where all inertias, stiffnesses and dampings that a gain multiplies are free, their common factor is that of the gain;
and where the torques' and the motions' gains are all free, one of them stands for the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError, StudyError
from elastid.fit.problem.elastic import ElasticFit
from elastid.model.closed_posture import assembled, followed
from elastid.model.kinematics import frame_poses
from elastid.parameters import Parameter, ParameterSet
from elastid.robot import BASE, Compensator, Robot

# Names of configurations to the motors' angles (n_u,).
Configurations: TypeAlias = Mapping[str, Sequence[float] | FloatArray]
# m: two ends nearer to each other are one point.
MIN_DISTANCE_M = 1e-3


def geometry_problems(
    parameters: ParameterSet, robot: Robot, configurations: Configurations
) -> Iterator[tuple[str, str]]:
    """Each parameter whose start or bounds are impossible in one of the configurations, with a message."""
    free = [p for p in parameters.free if p.stands_for in robot.geometry]
    if not free:
        return
    for name, angles in configurations.items():
        moved = [p for p in free if not p.only or name in p.only]
        table = robot.parameters(parameters.names)
        numbers = dict(zip(parameters.names, parameters.expand(parameters.x, name).tolist(), strict=True))
        started = ", ".join(f"{p.stands_for} = {p.value:g} m" for p in moved)
        try:
            placed = robot.with_parameters({key: numbers[key] for key in table if key in robot.geometry})
            assembled(placed, np.array(angles, dtype=float))
        except (StudyError, ValueError) as error:
            yield moved[0].name, f"the robot cannot stand at the start {started} in configuration {name}: {error}"
            return
        for compensator in placed.compensators:
            mine = [p for p in moved if p.stands_for in compensator.geometry]
            if mine and _has_a_direction(compensator, parameters):
                yield from _meeting(placed, compensator, mine, name, np.array(angles, dtype=float))


def check_geometry(parameters: ParameterSet, robot: Robot, configurations: Configurations) -> None:
    """StudyError with the first of the `geometry_problems`."""
    for name, message in geometry_problems(parameters, robot, configurations):
        raise StudyError(f"fit.parameters.{name}: {message}")


def _has_a_direction(compensator: Compensator, parameters: ParameterSet) -> bool:
    """True if it pulls where its ends meet: all but a coil without rest length do."""
    rest = f"L0_{compensator.name}"
    moves = any(p.stands_for == rest for p in parameters.free)
    return compensator.coil is None or compensator.coil.rest_length > 0 or moves


def _meeting(
    robot: Robot, compensator: Compensator, free: Sequence[Parameter], configuration: str, angles: FloatArray
) -> Iterator[tuple[str, str]]:
    """The problem where the ends come together at the start of these coordinates, or within their bounds."""
    from scipy.optimize import lsq_linear  # slow to load, for the few robots with compensators

    q = followed(robot, angles[None])
    (start, first), (end, second) = (_pose(robot, q, anchor.body) for anchor in compensator.ends)
    points = [np.array(anchor.point, dtype=float) for anchor in compensator.ends]
    bounded = [p for p in free if np.isfinite(p.upper - p.lower)]
    axes = np.zeros((3, len(bounded)))
    for column, parameter in enumerate(bounded):
        _, i, _, axis = compensator.geometry[parameter.stands_for][1]
        axes[:, column] = (second if i else -first)[:, int(axis)]
    gap = end + second @ points[1] - start - first @ points[0]
    values, low, high = (np.array([getattr(p, which) for p in bounded]) for which in ("value", "lower", "upper"))
    if np.linalg.norm(gap) > MIN_DISTANCE_M and bounded:
        solution = lsq_linear(axes, axes @ values - gap, (low, high)).x
        gap, values = gap + axes @ (solution - values), solution
    if np.linalg.norm(gap) > MIN_DISTANCE_M:
        return
    places = ", ".join(f"{p.stands_for} = {value:.4g} m" for p, value in zip(bounded, values, strict=True))
    yield (
        (bounded or list(free))[0].name,
        f"within the bounds both ends of compensator {compensator.name} come together in configuration "
        f"{configuration}, at {places or 'its start'}, where its force has no direction; narrow them, so that its ends "
        "stay apart",
    )


def _pose(robot: Robot, q: FloatArray, body: str) -> tuple[FloatArray, FloatArray]:
    """Origin (3,) and axes (3, 3) of a body in the base frame."""
    if body == BASE:
        return np.zeros(3), np.eye(3)
    poses = frame_poses(robot, q, body)
    return poses.position[0], poses.rotation[0]


# A parameter with a larger part in such a combination of length one belongs to it.
MIN_PART = 1e-3


def check_effects(fit: ElasticFit, robot: Robot) -> None:
    """FitError that names the free parameters without effect on the responses that count."""
    x = fit.parameters.x
    information = np.diag(replace(fit, inertias=()).evaluate(x).hessian) / 2 - fit.prior_slopes**2
    # A plausible change of x: a factor e, or the range of the bounds of a linear parameter.
    spans = [1.0 if p.log or not np.isfinite(p.upper - p.lower) else p.upper - p.lower for p in fit.parameters.free]
    effect = np.sqrt(np.maximum(information, 0.0)) * np.array(spans)
    without = effect <= 1e-9 * effect.max()  # rounding leaves about 1e-16
    if without.any():
        names = ", ".join(name for name, none in zip(fit.parameters.free_names, without, strict=True) if none)
        places = any(name.partition("@")[0] in robot.geometry for name in names.split(", "))
        hint = "; a coordinate along the axis of a joint does nothing, one across it may from another start"
        raise FitError(
            f"{names}: without effect on any of the {len(fit.parts)} frequency responses, so that no fit can find it; "
            f"fix it (fit.parameters: {{{names.split(', ')[0]}: {{fixed: true}}}}), or measure what it moves"
            + (hint if places else "")
        )


def check_scale(fit: ElasticFit, robot: Robot) -> None:
    """FitError where a gain and other parameters have no effect together; it names priors that would fix the scale."""
    names = fit.parameters.free_names
    gains = np.array([parameter.stands_for in robot.gains for parameter in fit.parameters.free])
    if not gains.any():
        return
    rows = [np.diag(fit.prior_slopes)]
    for _, J in fit.blocks(fit.parameters.x):
        flat = J.reshape(len(names), -1)
        rows.append(np.asarray(np.linalg.qr(np.vstack([flat.real.T, flat.imag.T]), mode="r")))
    R = np.vstack(rows)
    R /= np.maximum(np.linalg.norm(R, axis=0), 1e-300)
    together, needed = _without_scale(R), []
    parts = together
    while np.any(parts[gains] > MIN_PART):
        place = int(np.argmax(np.where(gains, parts, 0.0)))
        needed.append(names[place])
        R = np.vstack([R, np.eye(len(names))[place]])
        parts = _without_scale(R)
    if needed:
        listed = ", ".join(name for name, part in zip(names, together, strict=True) if part > MIN_PART)
        priors = ", ".join(f"{name}: {{prior: {{std: 0.05}}}}" for name in needed)
        raise FitError(
            f"nothing fixes the scale of {listed}: they can change together without any effect on the responses; say "
            f"how well a gain is known (fit.parameters: {{{priors}}} for 5 %), or fix {' and '.join(needed)} with "
            "fixed: true, or an inertia that is known"
        )


def _without_scale(R: FloatArray) -> FloatArray:
    """The part (n_x,) of each parameter in combinations without effect, of R (n, n_x) with columns of length one."""
    _, values, Vt = np.linalg.svd(R, full_matrices=True)
    effect = np.zeros(len(Vt))
    effect[: len(values)] = values
    # Rounding leaves about 1e-15.
    return np.asarray(np.linalg.norm(Vt[effect <= 1e-10 * effect[0]], axis=0))
