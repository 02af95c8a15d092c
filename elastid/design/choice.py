r"""The choice of configurations and realisations: optimal shares of the candidates, rounded to whole experiments.

.. math:: H_i = 2\,\mathrm{Re} \sum_k J_k^H W_k J_k

at the nominal parameters, or at guesses about them, with the weights W that the fit will give to the expected responses
(`prospect`). The shares: `optimal`.
"""

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
from elastid.design.candidates import Candidates
from elastid.design.optimal import DesignCriterion, relaxed_design, whole_experiments
from elastid.design.prospect import Prospect
from elastid.design.spec import DesignSpec, GuessSpec, interest
from elastid.experiment.plan.plan import ChosenConfiguration
from elastid.parameters import ParameterSet
from elastid.record import Configuration


@dataclass(frozen=True)
class Choice:
    """chosen: measured in addition to the configurations given.  periods: of each experiment.

    efficiency: of the whole experiments, relative to the best possible shares.  than_random: expected mean standard
    deviation of the median random choice, relative to that of this one.  n_candidates: admissible ones.
    """

    chosen: tuple[ChosenConfiguration, ...]
    periods: int
    efficiency: float
    than_random: float
    n_candidates: int

    @property
    def sentence(self) -> str:
        """The choice in a sentence."""
        names = ", ".join(f"{c.configuration.name} ({c.realisations} realisations)" for c in self.chosen)
        return (
            f"chosen among {self.n_candidates} candidates: {names}, {self.periods} periods each; "
            f"{100 * self.efficiency:.1f} % of the best possible allocation, standard deviations "
            f"{self.than_random:.2f} times smaller in the mean than for the median of random choices"
        )


@dataclass(frozen=True)
class InformationTask:
    """Number of experiments to choose and of their periods, with the information that exists without them.

    known (S, n_x, n_x): information of given configurations, earlier measurements and priors, for each guess.
    """

    prospect: Prospect
    count: int
    known: FloatArray


def draw_guesses(parameters: ParameterSet, spec: GuessSpec | None, seed: int) -> FloatArray:
    """Guesses (S, n_x) of the parameters, the nominal one first; linear parameters keep their number."""
    if spec is None:
        return parameters.x[None]
    draw = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x90,)))
    spread = np.array([math.log(spec.factor) if p.log else 0.0 for p in parameters.free])
    lower, upper = parameters.x_bounds
    drawn = parameters.x + spread * draw.standard_normal((spec.guesses - 1, len(spread)))
    return np.vstack([parameters.x, np.clip(drawn, lower, upper)])


def choose_configurations(
    spec: DesignSpec,
    tasks: Sequence[InformationTask],
    candidates: Candidates,
    x: FloatArray,
    taken: Sequence[str],
    seed: int,
    execution: Execution,
) -> Choice:
    """The best whole experiments among the candidates, for the best of the tasks.

    x (S, n_x): guesses of the parameters.  taken: names that other configurations have.  StudyError for unknown
    parameters, fewer candidates than asked for, and where no candidate informs any parameter.
    """
    parameters = tasks[0].prospect.parameters
    wanted = interest(parameters.free_names, spec.parameters)
    configurations = candidates.configurations
    if spec.count is not None and len(configurations) < spec.count:
        raise StudyError(
            f"design.count: {spec.count} configurations are asked for, {len(configurations)} candidates are admissible"
            + (f" ({candidates.reasons})" if candidates.refused else "")
            + f"; lower count to {len(configurations)}, give more candidates, or more realisations of each"
        )
    over = "mean" if spec.robust is None else spec.robust.over
    choices: list[tuple[float, Choice]] = []
    for task in tasks:
        H, rows = informations(task.prospect, configurations, x, execution)
        criterion, ground = visible(DesignCriterion(spec.criterion, wanted, over), H, task.known, parameters)
        known = task.known + ground
        shares = relaxed_design(H, criterion, known / task.count)
        numbers = whole_experiments(H, shares.weights, task.count, criterion, known)
        value = _value(H, numbers, criterion, known)
        efficiency = math.exp(min(0.0, value - math.log(task.count) - shares.bound))
        random = _random_value(H, task.count, criterion, known, seed)
        chosen = _named([configurations[i] for i in rows], numbers, task.prospect.realisations, taken)
        than_random = math.exp((value - random) / 2)
        choices.append((value, Choice(chosen, task.prospect.plan.periods, efficiency, than_random, len(rows))))
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
    return [_information(prospect, x, configuration) for configuration in configurations]


def _information(prospect: Prospect, x: FloatArray, configuration: Configuration) -> FloatArray | None:
    """H (S, n_x, n_x); None where there is no equilibrium for one of the guesses."""
    try:
        return np.stack([prospect.expected(configuration, guess).information(guess) for guess in x])
    except (StudyError, DataError):
        return None


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
    """Median of the criterion over random choices of as many candidates."""
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
