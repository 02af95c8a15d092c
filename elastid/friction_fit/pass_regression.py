r"""One regression over all passes of a joint: what all share, and the level of each pair.

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

from elastid.base.arrays import FloatArray, IntArray, frozen_value

# Harmonics of one motor turn that the regression has, where passes cover a turn.
RIPPLE_HARMONICS = 2
# Samples over which residuals may be correlated.
MAX_LAG = 200
# Of the mean speed, below which a change of it is rounding.
ROUNDING = 1e-9
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
class PassRegression:
    """Columns A (n, n_x) and torque y (n,): every steps-th sample of the passes of_pass (n,); shared: their names."""

    A: FloatArray
    y: FloatArray
    of_pass: IntArray
    steps: IntArray
    shared: tuple[str, ...]

    @classmethod
    def of(cls, passes: Sequence[Pass], pairs: dict[str, list[Pass]], has_gravity: bool, turn: float) -> PassRegression:
        """The columns of all passes; turn: angle of the joint for a turn of the motor, 0 without ripple."""
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
            columns = [a, s * _about_mean(speed)[::step]]
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
        bread = (Vt[good].T / s[good] ** 2) @ Vt[good]
        spare = len(self.y) / max(1, len(self.y) - B.shape[1])
        autocovariance = self._autocovariance(left)
        covariance = bread @ self._meat(B, autocovariance) @ bread
        if np.any(np.diag(covariance) < 0):
            # Cut off where it is still large, an autocovariance is none; tapered to zero it is.
            tapered = autocovariance * (1 - np.arange(len(autocovariance)) / len(autocovariance))
            covariance = bread @ self._meat(B, tapered) @ bread
        return values / size, spare * covariance / np.outer(size, size), left

    def _meat(self, B: FloatArray, autocovariance: FloatArray) -> FloatArray:
        """B^T Gamma B of all passes: each has columns of its own pair and the shared ones alone."""
        meat = np.zeros((B.shape[1], B.shape[1]))
        for own, step in self._passes():
            used = np.flatnonzero(np.any(B[own], axis=0))
            meat[np.ix_(used, used)] += _long_run(B[own][:, used], autocovariance[::step])
        return meat

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


def _about_mean(speed: FloatArray) -> FloatArray:
    """|q'| - v_k of a pass; a commanded speed that never changes leaves rounding, which is no slope."""
    about = speed - speed.mean()
    about[np.abs(about) < ROUNDING * speed.mean()] = 0.0
    return np.asarray(about)


def _long_run(B: FloatArray, autocovariance: FloatArray) -> FloatArray:
    """B^T Gamma B (n_x, n_x) of one pass, Gamma the Toeplitz matrix of the autocovariance."""
    total = autocovariance[0] * B.T @ B
    for lag in range(1, min(len(autocovariance), len(B))):
        product = B[lag:].T @ B[:-lag]
        total = total + autocovariance[lag] * (product + product.T)
    return np.asarray(total)
