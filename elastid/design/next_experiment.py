r"""Next experiment towards a goal: posture and length with the largest gain per robot time.

.. math:: \Phi(M) = 1 \Big/ \sum_p r_p^2, \qquad \max_{c, P}\ \frac{\Phi(M_0 + H_{cP}) - \Phi(M_0)}{T_P}, \qquad
          r_p = \frac{1.96\, \sigma_p}{w_p |p|} \le 1

M_0: information of the fit so far; H: of a configuration c in P periods, with robot time T_P. r_p is the interval of
parameter p over its goal, with the relative half width w_p and the standard deviation sigma_p. Parameters that have
reached their goals hardly contribute to Phi, which is proportional to the information. If an experiment reaches the
goal, the shortest one is best. The spectrum is the study's, or the optimal one with `flat: information`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.base.statistics import QUANTILE_95
from elastid.base.units import to_si
from elastid.design.configuration_selection import Candidates, collisions, informations
from elastid.design.design import completed_problem
from elastid.design.limit_use import LimitUse
from elastid.design.limits import within_limits
from elastid.design.problem import DesignProblem, best_spectra_of
from elastid.design.spec import identified_names, unit_time_s
from elastid.experiment.plan.plan import DesignedConfiguration, Plan
from elastid.fit.parameter_selection import with_tolerances
from elastid.fit.result import Result
from elastid.parameters import Parameters
from elastid.record import Configuration
from elastid.robot import Robot

EXAMPLE = '"k_*: 1 %"'


@dataclass(frozen=True)
class Goal:
    """Goal of an identification.  widths: half width of the 95 % interval over the value, by parameter."""

    widths: Mapping[str, float]

    def used(self, parameters: Parameters, x: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return r (n_goals,) for parameters x (n_x,) with a covariance (n_x, n_x) of x."""
        names, values = parameters.free_names, parameters.as_dict(x)
        std = np.sqrt(np.maximum(np.diag(covariance)[[names.index(name) for name in self.widths]], 0.0))
        size = [1.0 if parameters[name].log else max(abs(values[name]), 1e-300) for name in self.widths]
        return np.asarray(QUANTILE_95 * std / size / np.array([*self.widths.values()]))

    def reached(self, result: Result) -> dict[str, float]:
        """Return r of each parameter of a fit by its intervals; infinite for an unidentifiable parameter."""
        ratios = {}
        for name, width in self.widths.items():
            low, high = result.interval(name)
            ratio = (high - low) / 2 / max(abs(result.values[name]), 1e-300) / width
            ratios[name] = ratio if np.isfinite(ratio) else np.inf
        return ratios


def read_goal(texts: Sequence[str], names: Sequence[str]) -> Goal:
    """Read a goal from texts such as `k_*: 1 %` or `k_1: 0.5 %, d_*: 5 %`; of two widths the narrower one applies.

    names: parameters of the fit.  StudyError for a text without a width or without a matching parameter.
    """
    widths: dict[str, float] = {}
    for text in (entry.strip() for argument in texts for entry in argument.split(",")):
        pattern, _, width = map(str.strip, text.partition(":"))
        if not pattern or not 0 < (fraction := _parse_width(width)) < 1:
            raise StudyError(
                "design/goal",
                f"--goal '{text}' is invalid. Give parameters and half-widths of their intervals between 0 and 100 % "
                f"of the value, as {EXAMPLE}",
            )
        for name in identified_names(pattern, names):
            widths[name] = min(fraction, widths.get(name, np.inf))
    return Goal({name: widths[name] for name in names if name in widths})


def _parse_width(width: str) -> float:
    try:
        return to_si(width, "1") if width.endswith("%") else math.nan
    except ValueError:
        return math.nan


MAX_TRIALS = 8  # best configurations whose other lengths are compared, and most plans that limits may reject


@dataclass(frozen=True)
class PriorEstimate:
    """Present estimate x (n_x,) with its covariance (n_x, n_x)."""

    parameters: Parameters
    x: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, problem: DesignProblem) -> "PriorEstimate":
        """Return the estimate before any measurement, from start values, priors and tolerances of the study."""
        parameters = with_tolerances(problem.parameters, problem.robot, problem.fit)
        return cls(parameters, parameters.x, np.asarray(np.linalg.inv(_prior_information(parameters))))

    @property
    def information(self) -> FloatArray:
        """Information M_0 (n_x, n_x), with vague priors for unidentifiable parameters."""
        is_finite, M = np.isfinite(np.diag(self.covariance)), _prior_information(self.parameters)
        M[np.ix_(is_finite, is_finite)] = np.linalg.inv(self.covariance[np.ix_(is_finite, is_finite)])
        return M


def _prior_information(parameters: Parameters) -> FloatArray:
    """Return the information (n_x, n_x) of the priors; without a prior the std is 1 of ln p, or the value of p."""
    stds = [p.prior.std if p.prior else 1.0 if p.log else abs(p.value) or 1.0 for p in parameters.free]
    return np.diag(1 / np.square(stds))


@dataclass(frozen=True)
class Option:
    """Possible next experiment.

    reaches: the goal is expected to be reached after it.  gain: of Phi.  more_s: robot time of such experiments until
    the goal is reached, infinite if it is not.  floor: parameter with the largest r then, and r.
    """

    configuration: Configuration
    periods: int
    reaches: bool
    gain: float
    time_s: float
    more_s: float
    floor: tuple[str, float]

    @property
    def order(self) -> tuple[bool, float, float]:
        """Sort key: options that reach the goal, the shortest first; then by the gain per time."""
        return (False, self.time_s, -self.gain) if self.reaches else (True, -self.gain / self.time_s, self.time_s)


@dataclass(frozen=True)
class NextExperiment:
    """Plan of one configuration within the limits.  limit_use: largest use by any sampled robot."""

    plan: Plan
    option: Option
    limit_use: LimitUse


def next_experiment(
    problem: DesignProblem, candidates: Candidates, state: PriorEstimate, goal: Goal, robots: Sequence[Robot],
    name: str, phase_seed: int, execution: Execution, remaining_s: float = math.inf,
) -> NextExperiment:  # fmt: skip
    """Return the experiment with the largest gain per time, called `name`, with multisine phases by phase_seed.

    problem: at the values of the fit, with a section `design` that has the candidates.  robots: posterior samples that
    must be within the limits, too.  remaining_s: robot time; a longer experiment is only proposed if all are longer.
    StudyError if no candidate has an experiment within the limits.
    """
    completed = completed_problem(problem)
    options = _rank(completed, candidates, state, goal, execution)
    options = [option for option in options if option.time_s <= remaining_s] or options
    refusals = []
    for option in options[:MAX_TRIALS]:
        experiment = replace(completed.experiment, periods=option.periods)
        configuration = replace(option.configuration, name=name)
        configurations = [DesignedConfiguration(configuration, experiment.realisations)]
        try:
            spectra = best_spectra_of(completed, experiment, configurations, problem.excitation.torque_rms)
            with_phases = replace(completed, seed=phase_seed, excitation=problem.excitation)
            plan = with_phases.plan(experiment, configurations, spectra)
            plan, use = _within_envelope(problem, plan, robots, execution)
            _check_obstacles(problem, configuration, use)
            return NextExperiment(plan, option, use)
        except StudyError as error:
            refusals.append(f"{option.configuration.name}: {error}")
    raise StudyError("design/limits", f"no experiment keeps the limits of the robot: {refusals[0]}")


def _rank(
    problem: DesignProblem, candidates: Candidates, state: PriorEstimate, goal: Goal, execution: Execution
) -> list[Option]:
    """Return options, the best first: all candidates with the study's periods, the best ones also with 2 and twice."""
    periods_of_study = problem.experiment.periods

    def options_with(periods: int, configurations: Sequence[Configuration]) -> list[Option]:
        variant = replace(problem, experiment=replace(problem.experiment, periods=periods))
        prospect = replace(variant.prospect(variant.probe(variant.experiment), -1), parameters=state.parameters)
        H, rows = informations(prospect, configurations, state.x, execution)
        time_s = unit_time_s(problem.excitation, problem.experiment, problem.robot.n_u, periods)
        pairs = zip(H, rows.tolist(), strict=True)
        return [_option(state, goal, H_i, configurations[i], periods, time_s) for H_i, i in pairs]

    options = sorted(options_with(periods_of_study, candidates.configurations), key=lambda option: option.order)
    best = [option.configuration for option in options[:MAX_TRIALS]]
    for periods in sorted({2, 2 * periods_of_study} - {periods_of_study}):
        options += options_with(periods, best)
    return sorted(options, key=lambda option: option.order)


def _option(
    state: PriorEstimate, goal: Goal, H: FloatArray, configuration: Configuration, periods: int, time_s: float
) -> Option:
    """Return the option of an experiment with information H (n_x, n_x)."""
    M = state.information

    def r(repeats: int) -> FloatArray:
        return goal.used(state.parameters, state.x, np.asarray(np.linalg.inv(M + repeats * H)))

    now_ratio, next_ratio, repeats = r(0), r(1), 1
    while repeats < 4096 and r(repeats).max() > 1:  # beyond, the goal is out of reach
        repeats *= 2
    final = r(repeats)
    floor = [*goal.widths][int(np.argmax(final))], float(final.max())
    more_s = repeats * time_s if floor[1] <= 1 else math.inf
    gain = float(1 / np.sum(next_ratio**2) - 1 / np.sum(now_ratio**2))
    # The goal counts as reached with an expected r of 0.9, because the estimate of r is itself uncertain.
    return Option(configuration, periods, bool(next_ratio.max() <= 0.9), gain, time_s, more_s, floor)


def _within_envelope(
    problem: DesignProblem, plan: Plan, robots: Sequence[Robot], execution: Execution
) -> tuple[Plan, LimitUse]:
    """Scale the plan until all robots are within their limits; return it with the largest use of a limit."""
    plan, closest = within_limits(problem.rig(plan), problem.excitation, execution)
    spec = replace(problem.excitation, torque_rms=1.0)  # a number: amplitudes are never raised for a sampled robot
    for robot in robots:
        # One realisation suffices, because realisations differ by less than the margin.
        _, use = within_limits(replace(problem, robot=robot).rig(replace(plan, R=plan.R[:, :1])), spec, execution)
        plan = plan.scaled(use.factor)
        closest = max(closest, use, key=lambda use: float(use.used.max()))
    return plan, closest


def _check_obstacles(problem: DesignProblem, configuration: Configuration, use: LimitUse) -> None:
    """Raise StudyError if the robot reaches an obstacle at the corners of its excursions."""
    assert problem.design is not None
    excursion = np.minimum(use.peak[0, 1], np.pi)
    corners = np.array([np.zeros(len(excursion)), *product((-1, 1), repeat=len(excursion))])
    angles = configuration.angles + excursion * corners
    for reason, is_bad in collisions(problem.design.candidates, problem.robot, angles):
        if is_bad.any():
            raise StudyError("design/candidates", f"during the excitation, parts of the robot {reason}")
