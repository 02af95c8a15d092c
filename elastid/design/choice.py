"""The choice of configurations and realisations: optimal shares (`optimal`), rounded to whole experiments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, StudyError
from elastid.base.execution import Execution
from elastid.design.optimal import DesignCriterion, relaxed_design, whole_experiments
from elastid.design.prospect import Prospect
from elastid.experiment.plan.plan import ChosenConfiguration
from elastid.parameters import ParameterSet
from elastid.record import Configuration


@dataclass(frozen=True)
class Choice:
    """chosen: measured in addition to the configurations given.  periods: of each experiment."""

    chosen: tuple[ChosenConfiguration, ...]
    periods: int
    sentence: str


def choose_configurations(
    criterion: DesignCriterion,
    tasks: Sequence[tuple[Prospect, int, FloatArray]],
    configurations: Sequence[Configuration],
    x: FloatArray,
    taken: Sequence[str],
    seed: int,
    execution: Execution,
) -> Choice:
    """The best whole experiments among candidate configurations, for the best of the tasks.

    tasks: number of experiments to choose, with their prospect, and the information (S, n_x, n_x) that exists without
    them (given configurations, earlier measurements, priors).  x (S, n_x): guesses of the parameters.  taken: names
    that other configurations have.  StudyError where no candidate informs any parameter.
    """
    choices: list[tuple[float, Choice]] = []
    for prospect, count, elsewhere in tasks:
        H, rows = informations(prospect, configurations, x, execution)
        seen, ground = visible(criterion, H, elsewhere, prospect.parameters)
        known = elsewhere + ground
        shares = relaxed_design(H, seen, known / count)
        numbers = whole_experiments(H, shares.weights, count, seen, known)
        value = _value(H, numbers, seen, known)
        efficiency = math.exp(min(0.0, value - math.log(count) - shares.bound))
        # The expected mean standard deviation of the median random choice, relative to that of this one.
        than_random = math.exp((value - _random_value(H, count, seen, known, seed)) / 2)
        chosen = _named([configurations[i] for i in rows], numbers, prospect.realisations, taken)
        periods = prospect.plan.periods
        names = ", ".join(f"{c.configuration.name} ({c.realisations} realisations)" for c in chosen)
        sentence = (
            f"chosen among {len(rows)} candidates: {names}, {periods} periods each; {100 * efficiency:.1f} % of the "
            f"best possible allocation, standard deviations {than_random:.2f} times smaller in the mean than for the "
            "median of random choices"
        )
        choices.append((value, Choice(chosen, periods, sentence)))
    return max(choices, key=lambda choice: choice[0])[1]


def informations(
    prospect: Prospect, configurations: Sequence[Configuration], x: FloatArray, execution: Execution
) -> tuple[FloatArray, IntArray]:
    """H (S, Q, n_x, n_x) for guesses x (S, n_x), and which of the configurations (Q,) have an equilibrium in all.

    StudyError or DataError of the first where none has.
    """
    chunks = [configurations[i : i + 16] for i in range(0, len(configurations), 16)]
    if len(configurations) * len(x) < 400:  # less work than it takes to start other processes
        execution = replace(execution, jobs=1)
    parts = execution.ordered(partial(_informations, prospect, x), chunks)
    informative = {i: H for i, H in enumerate(chain.from_iterable(parts)) if H is not None}
    if not informative:
        prospect.expected(configurations[0], x[0])  # raises with the reason
        raise StudyError(
            "design: no candidate has an equilibrium for all guesses of the parameters; lower robust.factor"
        )
    return np.stack([*informative.values()], axis=1), np.array([*informative])


def _informations(
    prospect: Prospect, x: FloatArray, configurations: Sequence[Configuration]
) -> list[FloatArray | None]:
    """H (S, n_x, n_x) of each; None where there is no equilibrium for one of the guesses."""
    found: list[FloatArray | None] = []
    for configuration in configurations:
        try:
            found.append(prospect.information(configuration, x))
        except (StudyError, DataError):
            found.append(None)
    return found


def visible(
    criterion: DesignCriterion, H: FloatArray, known: FloatArray, parameters: ParameterSet
) -> tuple[DesignCriterion, FloatArray]:
    """The criterion on the parameters that the candidates together inform, and information (n_x, n_x) for the rest."""
    pooled = (H.mean(axis=1) + known).mean(axis=0)
    length = np.sqrt(np.maximum(np.diag(pooled), 0.0))
    length[length == 0] = 1.0
    eigenvalues, V = np.linalg.eigh(pooled / np.outer(length, length))
    blind = V[:, eigenvalues < 1e-12]  # relative to the best known direction
    informed = np.abs(blind).max(axis=1, initial=0.0) < 1e-3
    columns = criterion.interest[:, [informed[int(np.argmax(column))] for column in criterion.interest.T]]
    if columns.shape[1] == 0:
        names = ", ".join(parameters.free_names[i] for i in np.flatnonzero(criterion.interest.sum(axis=1)))
        raise StudyError(
            f"design: no candidate informs {names}: the measured outputs do not depend on it; fix these parameters, or "
            "log a place that they move (experiment.simulated.outputs)"
        )
    ground = (blind * length[:, None]) @ (blind * length[:, None]).T
    return replace(criterion, interest=columns), ground


def _value(H: FloatArray, numbers: IntArray, criterion: DesignCriterion, known: FloatArray) -> float:
    return float(criterion.value(known + np.einsum("q,sqij->sij", numbers, H)))


def _random_value(H: FloatArray, count: int, criterion: DesignCriterion, known: FloatArray, seed: int) -> float:
    draw = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x4D,)))
    Q = H.shape[1]
    values = [
        _value(H, np.bincount(draw.choice(Q, count, replace=count > Q), minlength=Q), criterion, known)
        for _ in range(100)
    ]
    return float(np.median(values))


def _named(
    configurations: Sequence[Configuration], numbers: IntArray, realisations: int, taken: Sequence[str]
) -> tuple[ChosenConfiguration, ...]:
    """The chosen ones, in the order of the candidates; those without a name of the user's are c1, c2 ..."""
    chosen: list[ChosenConfiguration] = []
    used = {*taken, *(c.name for c in configurations if not c.name.startswith("candidate"))}
    free = (name for name in (f"c{i}" for i in range(1, len(used) + len(configurations) + 2)) if name not in used)
    for configuration, number in zip(configurations, numbers.tolist(), strict=True):
        if number:
            name = next(free) if configuration.name.startswith("candidate") else configuration.name
            chosen.append(ChosenConfiguration(replace(configuration, name=name), number * realisations))
    return tuple(chosen)
