"""One evaluation of a fit with everything as a parameter, as the score test of all candidates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import chdtri

from elastid.base.arrays import FloatArray
from elastid.base.execution import Execution
from elastid.fit.diagnosis.modification.candidates import candidates, held_number
from elastid.fit.diagnosis.modification.held_numbers import HeldNumbers
from elastid.fit.diagnosis.modification.reading import thinned
from elastid.fit.diagnosis.modification.score_test import Candidate, HeldNumber, ScoreTest
from elastid.fit.diagnosis.modification.sensitivities import evaluated
from elastid.fit.problem.elastic import Part
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import Assembly, RelinearisedOptimum
from elastid.parameters import ParameterSet

# Real residuals that are looked at: with more, every so many lines of each configuration are.
MAX_RESIDUALS = 60_000
# Probability that any of the candidates has so large a drop by the noise alone.
FALSE_ALARM_RATE = 0.01


@dataclass(frozen=True, eq=False)
class Scores:
    """The test of all candidates on the lines looked at.

    excess: of V over the noise.  level: of the residuals' variance by the noise.  lines: share of all residuals.
    noise: V by the noise alone, of all residuals.  held: what is freed.
    """

    held: HeldNumbers
    test: ScoreTest
    candidates: tuple[Candidate, ...]
    excess: float
    level: float
    lines: float
    noise: float

    @property
    def least(self) -> dict[int, float]:
        """The drop that one of all candidates has by the noise alone at the false alarm rate, by its directions."""
        counts = {one.directions.shape[1] for one in self.candidates}
        tail = FALSE_ALARM_RATE / max(len(self.candidates), 1)
        return {n: max(self.level, 1e-300) * float(chdtri(n, tail)) for n in counts}


@dataclass(frozen=True, eq=False)
class _Sums:
    """J^T J (n, n), J^T r (n,) and r^T r; held: names of the columns of J behind those of x (n_x,)."""

    A: FloatArray
    b: FloatArray
    V: float
    held: tuple[str, ...]


def score(
    assembly: Assembly, optimum: RelinearisedOptimum, result: FitResult, noise_cost: float, execution: Execution
) -> Scores:
    """The test at the optimum; parameters at a bound stay there."""
    fit, x = optimum.fit, optimum.end.x
    held, thin = HeldNumbers.of(assembly, fit.parts[0].kernel.model), thinned(fit, MAX_RESIDUALS)
    used = [part for part in thin.parts if part.n_residuals]
    A, b, V, names = _added(execution.ordered(partial(_sums_in, held, assembly.parameters, x), used), len(x))
    numbers, scale = _held_numbers(names, assembly, held, x)
    every = np.concatenate([np.ones(len(x)), scale])
    A, b = A * np.outer(every, every), b * every
    A[range(len(x)), range(len(x))] += fit.prior_slopes**2
    share = thin.n_residuals / max(fit.n_residuals, 1)
    noise = noise_cost * share
    return Scores(
        held,
        ScoreTest.of(numbers, A, b, ~result.at_bound),
        tuple(candidates(numbers, held.linearisation.model.robot)),
        V - noise,
        (noise or V) / max(thin.n_residuals - len(x), 1),
        share,
        noise_cost,
    )


def _sums_in(held: HeldNumbers, fitted: ParameterSet, x: FloatArray, part: Part) -> _Sums:
    """The sums over one configuration."""
    one = evaluated(held, fitted, x, part)
    J, r = -one.whitened(np.concatenate([one.free, np.stack(list(one.held.values()))])), one.residual
    return _Sums(J @ J.T, J @ r, float(r @ r), tuple(one.held))


def _added(every: Iterable[_Sums], n_x: int) -> tuple[FloatArray, FloatArray, float, tuple[str, ...]]:
    """J^T J, J^T r and r^T r over all configurations, and the names of the columns behind those of x."""
    names: dict[str, int] = {}
    A, b, V = np.zeros((n_x, n_x)), np.zeros(n_x), 0.0
    for one in every:
        for name in one.held:
            names.setdefault(name, len(names))
        more = n_x + len(names) - len(b)
        A, b = np.pad(A, (0, more)), np.pad(b, (0, more))
        places = np.concatenate([np.arange(n_x), [n_x + names[name] for name in one.held]]).astype(int)
        A[np.ix_(places, places)] += one.A
        b[places] += one.b
        V += one.V
    return A, b, V, tuple(names)


def _held_numbers(
    names: Sequence[str], assembly: Assembly, held: HeldNumbers, x: FloatArray
) -> tuple[list[HeldNumber], FloatArray]:
    """The numbers by name, and dp / d ln p (n_h,) of the logarithmic ones."""
    theta = held.theta(assembly.parameters, x, assembly.responses[0].configuration.name)
    at = dict(zip(held.parameters, theta.tolist(), strict=True))
    robot = held.linearisation.model.robot
    units = {name: unit for name, (_, unit) in robot.parameters(held.linearisation.model.parameters).items()}
    found, scale = [], []
    for name in names:
        of_ratio = name.startswith("ratio_")
        if name in held.rigid:
            one = held_number(held.rigid[name], 0.0)
        elif of_ratio:
            one = held_number(name, abs(robot.ratio(name.removeprefix("ratio_"))))
        else:
            one = held_number(name, at.get(name, 0.0), units.get(name, ""))
        found.append(one)
        scale.append(one.value if one.log and not of_ratio else 1.0)  # the slope of a ratio is to its logarithm
    return found, np.array(scale)
