"""Levels of friction of passes, one at each speed, direction, load and temperature."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError, Note
from elastid.friction.static import Conditions
from elastid.friction_study.least_squares import FALSE_ALARM, chance_of_terms
from elastid.friction_study.passes import Pass, PassRegression, one_way, passes_of, usable_passes
from elastid.record import FrictionRecord, motion_unit

MAX_RELATIVE_STD = 0.2  # std over level, above which a level does not count


@frozen_value
class Levels:
    """Friction of one place at n conditions, each at steady sliding; numbers on the side of the place, SI.

    speed (n,): |v|, positive.  direction (n,): 1, -1, or 0 where the level is the mean of both directions.
    torque (n,): that brakes, positive, viscous friction included.  std (n,): of torque.  load (n,): |torque| on the
    joint, 0 where none is known.  temperature (n,): degC, NaN where none is known.  shared: value and std of what all
    passes share, by name (`inertia`, `gravity.cos`, `gravity.sin`, `offset`, ripple).  notes: on passes left out.

    Raises DataError for friction that drives at every condition.
    """

    place: str
    speed: FloatArray
    direction: FloatArray
    torque: FloatArray
    std: FloatArray
    load: FloatArray
    temperature: FloatArray
    slides: bool = False
    shared: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        if len(self.torque) and np.all(self.torque < 0):
            raise DataError(
                "friction/levels",
                f"friction drives at every speed (torque {self.torque.min():.4g} to "
                f"{self.torque.max():.4g}): torque and velocity have opposite signs; turn one channel (sign: -1)",
                f"levels of {self.place}",
            )

    @property
    def n_levels(self) -> int:
        """Number of conditions."""
        return len(self.speed)

    @property
    def known_temperatures(self) -> FloatArray:
        """Temperatures of the levels that have one, degC."""
        return self.temperature[np.isfinite(self.temperature)]

    @property
    def conditions(self) -> Conditions:
        """Conditions at which the levels hold."""
        return Conditions(self.speed, self.direction, self.load, self.temperature)


def find_levels(passes: Sequence[Pass], has_gravity: bool, turn: float = 0.0) -> Levels:
    """The levels of all pairs of one place, by direction.

    has_gravity: True if its torque changes with the angle.  turn: of the joint for one of the motor, whose ripple is
    regressed too; 0 for none.  DataError where a pair has one direction only, or no pair slides.
    """
    used, notes = usable_passes(passes)
    pairs = _pairs(used)
    design = PassRegression.of(used, has_gravity, turn)
    values, covariance = design.solve()
    n_k = len(pairs)
    each = [[(np.abs(one.velocity).mean(), one.load, one.temperature) for one in pair] for pair in pairs.values()]
    conditions = np.array([np.mean(pair, axis=0) for pair in each])
    speed = conditions[:, 0]
    g, o = values[:n_k], values[n_k : 2 * n_k]
    uneven, offset = _uneven(o, covariance[n_k : 2 * n_k, n_k : 2 * n_k], speed)
    std = np.sqrt(np.diag(covariance)[:n_k])
    known = std < MAX_RELATIVE_STD * np.abs(g)
    if not known.all():
        weak, place = ", ".join(f"{v:.3g}" for v in speed[~known]), f"passes of {used[0].place}"
        text = (
            f"levels at {weak} {motion_unit('velocity', used[0].slides)} are not known to {MAX_RELATIVE_STD:.0%} and "
            "do not count: gravity, ripple or noise are too large compared with them; repeat these passes, or make "
            "them longer"
        )
        if not known.any():
            raise DataError("friction/levels", text, place)
        notes.append(Note("friction/levels", text, place))
    shared = {
        name: (float(values[i]), float(np.sqrt(covariance[i, i]))) for i, name in enumerate(design.shared, 2 * n_k)
    } | {"offset": offset}
    levels = _levels(used, conditions[known], g[known], std[known], uneven[known])
    return replace(levels, shared=shared, notes=tuple(notes))


def _pairs(passes: Sequence[Pass]) -> dict[str, list[Pass]]:
    pairs = {each.pair: [other for other in passes if other.pair == each.pair] for each in passes}
    for name, members in pairs.items():
        directions = {each.direction for each in members}
        if len(directions) < 2:
            raise DataError("friction/levels", f"it has {one_way(directions)}", f"pass {name} of {members[0].place}")
    return pairs


def _uneven(o: FloatArray, covariance: FloatArray, v: FloatArray) -> tuple[FloatArray, tuple[float, float]]:
    """Excess of friction forwards (n_k,), a slope of o over speed where an F test finds it; the offset and its std."""
    W = np.linalg.inv(np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) / len(o) * np.eye(len(o))))

    def fitted(*columns: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        A = W @ np.stack(columns, axis=1)
        x = np.linalg.lstsq(A, W @ o, rcond=None)[0]
        left = W @ o - A @ x
        return np.asarray(x), np.asarray(np.linalg.pinv(A.T @ A)), float(left @ left)

    one = np.ones_like(v)
    mean, covariance, cost = fitted(one)
    dof, slope = len(o) - 1, 0.0
    if len(o) >= 4 and np.ptp(v) > 0:
        line, of_line, less = fitted(one, v)
        if chance_of_terms(cost, less, 1, dof - 1) <= FALSE_ALARM:
            (mean, covariance, cost), dof, slope = (line, of_line, less), dof - 1, float(line[1])
    return slope * v, (float(mean[0]), float(np.sqrt(max(1.0, cost / max(1, dof)) * covariance[0, 0])))


def _levels(
    passes: Sequence[Pass], conditions: FloatArray, g: FloatArray, std: FloatArray, uneven: FloatArray
) -> Levels:
    """By direction where the directions differ, else their means."""
    signs = (1.0, -1.0) if uneven.any() else (0.0,)
    speed, load, temperature = np.tile(conditions.T, len(signs))
    torque = np.concatenate([g + s * uneven for s in signs])
    std = np.tile(std * np.sqrt(len(signs)), len(signs))
    direction = np.repeat(signs, len(g))
    return Levels(passes[0].place, speed, direction, torque, std, load, temperature, passes[0].slides)


def levels_of_records(records: Sequence[FrictionRecord], has_gravity: bool, turn: float) -> Levels:
    """The levels of all passes of a joint under all loads, as `find_levels`."""
    return find_levels([each for record in records for each in passes_of(record)], has_gravity, turn)
