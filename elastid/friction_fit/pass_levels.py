r"""Levels of friction from passes there and back: one regression over all passes of a joint.

.. math:: u = s\, g_k + o_k + f s (|\dot q| - v_k) + J \ddot q + G \cos q + H \sin q
              + \sum_h (a_h \cos h N q + b_h \sin h N q)

for the passes of pair k, with s the direction of the motion: gravity, ripple of the motor's turns (N a turn of the
joint) and inertia are the same in all pairs; the level g_k and what is alike in both directions, o_k, are each pair's
own; f is the slope of friction about the mean speed v_k of a pass.  o_k is an offset of the torque where it does not
change with speed; what changes is friction that differs between the directions. Levels stand at the speed that was
measured, not at the one that was commanded.

A level's variance comes from how pairs of the same speed scatter, and within a pair from the autocovariance of the
residuals of all passes: ripple that the regression has not is no white noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from elastid.base.arrays import BoolArray, FloatArray, IntArray, frozen_value
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_fit.law_choice import FALSE_ALARM
from elastid.friction_fit.levels import Levels

# A level wider than this says nothing of friction.
MAX_RELATIVE_STD = 0.2
# Harmonics of one motor turn that the regression has, where passes cover a turn.
RIPPLE_HARMONICS = 2
# Pairs are of one condition where their speeds are as close as this share, and their temperatures as these kelvins.
SAME_SPEED, SAME_KELVIN = 0.03, 2.0
# Samples over which residuals may be correlated.
MAX_LAG = 200
# Samples of a pass in the regression: more of a slow one say nothing new.
MAX_SAMPLES = 2000


@frozen_value
class Pass:
    """A part of a log in which one joint slides steadily, on one side, SI.

    pair: passes of one pair belong together, there and back.  position, velocity, acceleration, torque (n,).  load:
    |torque| that the joint carries.  temperature: mean, degC, NaN where it is not known.
    """

    place: str
    pair: str
    rate_hz: float
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    load: float = 0.0
    temperature: float = float("nan")
    slides: bool = False

    @property
    def direction(self) -> float:
        """1 or -1."""
        return float(np.sign(self.velocity.mean()))

    @property
    def turns_back(self) -> bool:
        """Whether the velocity changes its sign: the joint sticks and slips, or stands."""
        return bool(np.any(self.velocity * self.direction <= 0))


@dataclass(frozen=True)
class PassLevels:
    """The levels, the parts of the torque that all passes share, and what was left out.

    shared: numbers by name (`inertia`, `gravity.cos`, `gravity.sin`, `offset`) with their std.
    """

    levels: Levels
    shared: dict[str, tuple[float, float]]
    residual_rms: float
    notes: tuple[Note, ...]


def find_levels(passes: Sequence[Pass], has_gravity: bool, turn: float = 0.0) -> PassLevels:
    """The levels of all pairs of one place, by direction.

    has_gravity: whether its torque changes with the angle.  turn: angle of the joint for one turn of the motor, whose
    ripple is regressed too; 0 for none.
    Raises DataError where a pair has one direction only, or no pair slides.
    """
    used, notes = _sliding(passes)
    pairs = _pairs(used)
    design = _Design.of(used, pairs, has_gravity, turn)
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
    return PassLevels(levels, shared, float(np.sqrt(np.mean(left**2))), tuple(notes))


@dataclass(frozen=True)
class _Condition:
    speed: float
    load: float
    temperature: float


def _sliding(passes: Sequence[Pass]) -> tuple[list[Pass], list[Note]]:
    """The passes that slide all the time, and notes about the others, whose pair goes with them."""
    stuck = {each.pair: each for each in passes if each.turns_back}
    notes = [
        Note(
            "stick-slip",
            f"the joint stands or turns back within the pass (velocity {each.velocity.min():.3g} to "
            f"{each.velocity.max():.3g}): it sticks and slips at this speed, and its level does not count; raise the "
            "bandwidth of the controller, or measure faster",
            f"pass {name}",
        )
        for name, each in stuck.items()
    ]
    used = [each for each in passes if each.pair not in stuck]
    if not used:
        place = passes[0].place if passes else "the joint"
        raise DataError(f"passes of {place}: none slides all the time; measure faster, or raise the bandwidth")
    return used, notes


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


@dataclass(frozen=True)
class _Design:
    """Columns A (n, n_x) and torque y (n,): every steps-th sample of the passes of_pass (n,); shared: their names."""

    A: FloatArray
    y: FloatArray
    of_pass: IntArray
    steps: IntArray
    shared: tuple[str, ...]

    @classmethod
    def of(cls, passes: Sequence[Pass], pairs: dict[str, list[Pass]], has_gravity: bool, turn: float) -> _Design:
        order, names = list(pairs), ["inertia", "slope"]
        rows, torques, numbers, steps = [], [], [], []
        has_ripple = turn > 0 and any(np.ptp(each.position) > turn for each in passes)
        for number, each in enumerate(passes):
            step = max(1, len(each.position) // MAX_SAMPLES)
            q, a, s = each.position[::step], each.acceleration[::step], each.direction
            speed = np.abs(each.velocity)
            own = np.zeros((len(q), 2 * len(order)))
            own[:, order.index(each.pair)] = s
            own[:, len(order) + order.index(each.pair)] = 1.0
            columns = [a, s * (speed - speed.mean())[::step]]
            if has_gravity:
                columns += [np.cos(q), np.sin(q)]
            if has_ripple:
                angles = [2 * np.pi * h / turn * q for h in range(1, RIPPLE_HARMONICS + 1)]
                columns += [wave for x in angles for wave in (np.cos(x), np.sin(x))]
            rows.append(np.hstack([own, np.stack(columns, axis=1)]))
            torques.append(each.torque[::step])
            numbers.append(np.full(len(q), number))
            steps.append(np.full(len(q), step))
        names += ["gravity.cos", "gravity.sin"] if has_gravity else []
        names += [f"ripple.{h}{w}" for h in range(1, RIPPLE_HARMONICS + 1) for w in "cs"] if has_ripple else []
        return cls(
            np.vstack(rows), np.concatenate(torques), np.concatenate(numbers), np.concatenate(steps), tuple(names)
        )

    def solve(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Numbers (n_x,), covariance (n_x, n_x) and residual (n,)."""
        size = np.linalg.norm(self.A, axis=0)
        size[size == 0] = 1.0
        B = self.A / size
        U, s, Vt = np.linalg.svd(B, full_matrices=False)
        good = s > 1e-10 * s[0]
        inverse = (Vt[good].T / s[good]) @ U[:, good].T
        values = inverse @ self.y
        left = self.y - B @ values
        autocovariance = self._autocovariance(left)
        meat = np.zeros((B.shape[1], B.shape[1]))
        for own, step in self._passes():
            meat += _long_run(B[own], autocovariance[::step])
        bread = (Vt[good].T / s[good] ** 2) @ Vt[good]
        spare = len(self.y) / max(1, len(self.y) - B.shape[1])
        covariance = spare * bread @ meat @ bread / np.outer(size, size)
        return values / size, covariance, left

    def _passes(self) -> list[tuple[slice, int]]:
        """Samples of each pass, and which part of the log's samples they are."""
        ends = np.flatnonzero(np.diff(self.of_pass)) + 1
        starts = [0, *ends.tolist()]
        stops = [*ends.tolist(), len(self.of_pass)]
        return [(slice(a, b), int(self.steps[a])) for a, b in zip(starts, stops, strict=True)]

    def _autocovariance(self, left: FloatArray) -> FloatArray:
        """Of the residuals of all passes, by lag in samples of the log, up to the first that is not above chance."""
        found = [float(left @ left / len(left))]
        for lag in range(1, MAX_LAG + 1):
            products = [
                left[own][lag // step :] @ left[own][: -(lag // step)]
                for own, step in self._passes()
                if lag % step == 0 and own.stop - own.start > lag // step
            ]
            counts = [
                own.stop - own.start - lag // step
                for own, step in self._passes()
                if lag % step == 0 and own.stop - own.start > lag // step
            ]
            if not counts or sum(products) / sum(counts) < 2 * found[0] / np.sqrt(sum(counts)):
                break
            found.append(float(sum(products) / sum(counts)))
        return np.array(found)


def _long_run(B: FloatArray, autocovariance: FloatArray) -> FloatArray:
    """B^T Gamma B (n_x, n_x) of one pass, Gamma the Toeplitz matrix of the autocovariance."""
    total = autocovariance[0] * B.T @ B
    for lag in range(1, min(len(autocovariance), len(B))):
        product = B[lag:].T @ B[:-lag]
        total = total + autocovariance[lag] * (product + product.T)
    return np.asarray(total)


def _scatter_scale(g: FloatArray, std: FloatArray, conditions: Sequence[_Condition]) -> float:
    """By what the variance of the levels is larger than stated: pairs of one condition, at least 1."""
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
    return max(1.0, squares / dof) if dof else 1.0


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
