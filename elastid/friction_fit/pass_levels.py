"""Levels of friction from passes there and back, one for each speed, load and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_fit.law_choice import FALSE_ALARM
from elastid.friction_fit.levels import Levels
from elastid.friction_fit.pass_faults import check_loads, gravity_note, offset_steps, usable_passes
from elastid.friction_fit.pass_regression import Pass, PassRegression

# A level wider than this says nothing of friction.
MAX_RELATIVE_STD = 0.2
# Pairs are of one condition where their speeds are as close as this share, and their temperatures as these kelvins.
SAME_SPEED, SAME_KELVIN = 0.03, 2.0


@dataclass(frozen=True)
class PassLevels:
    """The levels, the parts of the torque that all passes share, and what was left out.

    shared: numbers by name (`inertia`, `gravity.cos`, `gravity.sin`, `offset`) with their std.  turn: of the joint for
    a turn of its motor, whose ripple is among them; 0 for none.
    """

    levels: Levels
    shared: dict[str, tuple[float, float]]
    residual_rms: float
    notes: tuple[Note, ...]
    turn: float = 0.0


def find_levels(passes: Sequence[Pass], has_gravity: bool, turn: float = 0.0) -> PassLevels:
    """The levels of all pairs of one place, by direction.

    has_gravity: whether its torque changes with the angle.  turn: angle of the joint for one turn of the motor, whose
    ripple is regressed too; 0 for none.
    Raises DataError where a pair has one direction only, or no pair slides.
    """
    check_loads(passes)
    used, notes = usable_passes(passes)
    pairs = _pairs(used)
    design = PassRegression.of(used, pairs, has_gravity, turn)
    values, covariance, left = design.solve()
    n_k = len(pairs)
    g, o = values[:n_k], values[n_k : 2 * n_k]
    conditions = [_condition(members) for members in pairs.values()]
    scale = _scatter_scale(g, np.sqrt(np.diag(covariance)[:n_k]), conditions)
    covariance = covariance * scale
    uneven, offset = _uneven(o, covariance[n_k : 2 * n_k, n_k : 2 * n_k], conditions)
    std = np.sqrt(np.diag(covariance)[:n_k])
    known = std < MAX_RELATIVE_STD * np.abs(g)
    notes += [
        Note(
            "level-unknown",
            f"its level at {condition.speed:.3g} {_unit(used)} is {level:.3g} +- {error:.2g} {_torque_unit(used)} and "
            "does not count: gravity, ripple or noise are too large beside it; repeat the pass, or make it longer",
            f"pass {name}",
        )
        for name, condition, level, error, good in zip(pairs, conditions, g, std, known, strict=True)
        if not good
    ]
    if not known.any():
        raise DataError(f"passes of {used[0].place}: no level is known to {MAX_RELATIVE_STD:.0%}; {notes[-1]}")
    names = design.shared
    shared = {
        name: (float(values[2 * n_k + i]), float(np.sqrt(covariance[2 * n_k + i, 2 * n_k + i])))
        for i, name in enumerate(names)
    } | {"offset": offset}
    levels = _levels(used, conditions, g, std, uneven, known)
    v, load = np.array([c.speed for c in conditions]), np.array([c.load for c in conditions])
    notes += offset_steps(o, v, load, list(pairs), g, used[0].place, used[0].slides)
    notes += gravity_note(shared, g, used[0].place, used[0].slides)
    return PassLevels(levels, shared, float(np.sqrt(np.mean(left**2))), tuple(notes), turn)


@dataclass(frozen=True)
class _Condition:
    speed: float
    load: float
    temperature: float


def _pairs(passes: Sequence[Pass]) -> dict[str, list[Pass]]:
    pairs: dict[str, list[Pass]] = {}
    for each in passes:
        pairs.setdefault(each.pair, []).append(each)
    for name, members in pairs.items():
        directions = {each.direction for each in members}
        if len(directions) < 2:
            word = "positive" if 1.0 in directions else "negative"
            raise DataError(
                f"pass {name} of {members[0].place}: it has {word} velocity only; friction cannot be told from gravity "
                "and offset without the way back; record both directions"
            )
    return pairs


def _condition(members: Sequence[Pass]) -> _Condition:
    speeds = [float(np.abs(each.velocity).mean()) for each in members]
    return _Condition(
        float(np.mean(speeds)),
        float(np.mean([each.load for each in members])),
        float(np.mean([each.temperature for each in members])),
    )


def _scatter_scale(g: FloatArray, std: FloatArray, conditions: Sequence[_Condition]) -> float:
    """By what the variance of the levels is larger than stated: 1 where pairs of one condition scatter no more."""
    keys = np.array([
        (round(np.log(c.speed) / SAME_SPEED), round(c.load, 6), round(np.nan_to_num(c.temperature) / SAME_KELVIN))
        for c in conditions
    ])  # fmt: skip
    squares, dof = 0.0, 0
    for key in np.unique(keys, axis=0):
        own = np.all(keys == key, axis=1)
        if own.sum() < 2:
            continue
        w = 1 / std[own] ** 2
        mean = np.sum(w * g[own]) / w.sum()
        squares += float(np.sum(w * (g[own] - mean) ** 2))
        dof += int(own.sum()) - 1
    return squares / dof if dof and chi2.sf(squares, dof) < FALSE_ALARM else 1.0


def _uneven(
    o: FloatArray, covariance: FloatArray, conditions: Sequence[_Condition]
) -> tuple[FloatArray, tuple[float, float]]:
    """What friction is larger in the positive direction at each speed (n_k,), and the offset with its std.

    A slope of o over speed counts where an F test finds it; without one all of o is an offset.
    """
    v = np.array([condition.speed for condition in conditions])
    W = np.linalg.inv(np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) / len(o) * np.eye(len(o))))
    flat, sloped = np.ones((len(o), 1)), np.stack([np.ones_like(v), v], axis=1)

    def fitted(A: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        x, *_ = np.linalg.lstsq(W @ A, W @ o, rcond=None)
        left = W @ (o - A @ x)
        return np.asarray(x), np.asarray(np.linalg.pinv((W @ A).T @ (W @ A))), float(left @ left)

    mean, of_mean, cost = fitted(flat)
    scale = max(1.0, cost / max(1, len(o) - 1))
    if len(o) > 3 and np.ptp(v) > 0:
        line, of_line, less = fitted(sloped)
        dof = len(o) - 2
        if f_distribution.sf((cost - less) / max(less / dof, 1.0), 1, dof) < FALSE_ALARM:
            scale = max(1.0, less / dof)
            return line[1] * v, (float(line[0]), float(np.sqrt(scale * of_line[0, 0])))
    return np.zeros_like(v), (float(mean[0]), float(np.sqrt(scale * of_mean[0, 0])))


def _levels(
    passes: Sequence[Pass],
    conditions: Sequence[_Condition],
    g: FloatArray,
    std: FloatArray,
    uneven: FloatArray,
    known: BoolArray,
) -> Levels:
    """By direction where the directions differ, else their means."""
    chosen = [c for c, good in zip(conditions, known, strict=True) if good]
    g, std, uneven = g[known], std[known], uneven[known]
    signs = (1.0, -1.0) if uneven.any() else (0.0,)
    n = len(chosen)
    return Levels(
        passes[0].place,
        np.tile([c.speed for c in chosen], len(signs)),
        np.repeat(signs, n),
        np.concatenate([g + s * uneven for s in signs]),
        np.tile(std * np.sqrt(len(signs)), len(signs)),
        np.tile([c.load for c in chosen], len(signs)),
        np.tile([c.temperature for c in chosen], len(signs)),
        passes[0].slides,
    )


def _unit(passes: Sequence[Pass]) -> str:
    return "m/s" if passes[0].slides else "rad/s"


def _torque_unit(passes: Sequence[Pass]) -> str:
    return "N" if passes[0].slides else "N*m"
