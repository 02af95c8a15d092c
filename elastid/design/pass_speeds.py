"""The speeds at which passes tell most of a friction law: a D-optimal design with its certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.design.optimal import DesignCriterion, relaxed_design, whole
from elastid.friction.static_terms import Conditions, columns, slopes

# Speeds that may be chosen, spaced logarithmically.
CANDIDATES = 200
LINEAR, SEARCHED = ("coulomb", "excess", "viscous"), ("stribeck_velocity", "exponent")


@dataclass(frozen=True)
class StribeckGuess:
    """A law as it may be: F_c, F_s, viscous friction, nu_s and the exponent, SI of one side."""

    coulomb: float
    stiction: float
    viscous: float
    stribeck_velocity: float
    exponent: float = 2.0


@dataclass(frozen=True)
class PassSpeeds:
    """speed (n,), lowest first, with the number of passes there and back at each, passes (n,).

    excess: max Tr(M^-1 H_i) / d - 1 of the shares before they were rounded: 0 at the optimum.  efficiency: of the whole
    passes against the best shares, (det M / det M*)^(1 / d).
    """

    speed: FloatArray
    passes: IntArray
    excess: float
    efficiency: float


def optimal_speeds(guesses: Sequence[StribeckGuess], lowest: float, highest: float, count: int) -> PassSpeeds:
    """`count` passes between two speeds that know all five numbers of a Stribeck curve best, over all guesses.

    Every level is known to the same torque.  Raises DataError for a range without room, or fewer passes than numbers.
    """
    d = len(LINEAR) + len(SEARCHED)
    if not 0 < lowest < highest / 4:
        raise DataError(
            f"passes from {lowest:.3g} to {highest:.3g} rad/s: a friction curve takes a range of four and more; lower "
            "the lowest speed, or raise the highest"
        )
    if count < d:
        raise DataError(f"{count} passes for the {d} numbers of a Stribeck curve; give {d} or more")
    speeds = np.geomspace(lowest, highest, CANDIDATES)
    H = np.stack([_information(guess, speeds) for guess in guesses])
    criterion = DesignCriterion("D", np.eye(d))
    relaxed = relaxed_design(H, criterion)
    numbers = whole(H, relaxed.weights, count, criterion)
    reached = criterion.value(np.einsum("q,sqij->sij", numbers / count, H))
    chosen = numbers > 0
    return PassSpeeds(speeds[chosen], numbers[chosen], relaxed.excess, float(np.exp(float(reached) - relaxed.value)))


def _information(guess: StribeckGuess, speeds: FloatArray) -> FloatArray:
    """J^T J (n, d, d) of one level at each speed, by the numbers relative to themselves."""
    zeros = np.zeros_like(speeds)
    at = Conditions(speeds, zeros, zeros, np.full_like(speeds, np.nan))
    linear = {"coulomb": guess.coulomb, "excess": guess.stiction - guess.coulomb, "viscous": guess.viscous}
    eta = {"stribeck_velocity": guess.stribeck_velocity, "exponent": guess.exponent}
    J = np.hstack([columns(at, LINEAR, eta, 0.0), slopes(at, linear, SEARCHED, eta, 0.0)])
    J = J * np.array([*linear.values(), *eta.values()]) / guess.coulomb
    return np.asarray(J[:, :, None] * J[:, None, :])
