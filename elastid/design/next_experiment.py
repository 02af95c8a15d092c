r"""The next experiment towards a goal: posture and length of the largest gain for each second of the robot.

.. math:: \Phi(M) = 1 \Big/ \sum_p r_p^2, \qquad \max_{c, P}\ \frac{\Phi(M_0 + H_{cP}) - \Phi(M_0)}{T_P}

M_0: the information of the fit so far, H: of a configuration c in P periods, which take T_P; r_p: the part of the goal
that its interval uses, so that goals which are reached barely count. Phi doubles with twice the information.
If one experiment reaches the goal, the shortest one is best. The spectrum is from the study; with
`flat: information` it is the optimal spectrum of the posture.

.. math:: r_p = \frac{1.96\, \sigma_p}{w_p |p|} \le 1

w_p: the half width of the 95 % interval of the goal, sigma_p the standard deviation (of ln p times p for a
logarithmic parameter).
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
from elastid.design.forecast import LimitUse
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
    """widths: name of a parameter to the half width of its 95 % interval, relative to its value."""

    widths: Mapping[str, float]

    def used(self, parameters: Parameters, x: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return r (n_goals,) at x (n_x,) with a covariance (n_x, n_x) of x; at most 1 where the goal is reached."""
        names, values = parameters.free_names, parameters.as_dict(x)
        std = np.sqrt(np.maximum(np.diag(covariance)[[names.index(name) for name in self.widths]], 0.0))
        size = [1.0 if parameters[name].log else max(abs(values[name]), 1e-300) for name in self.widths]
        return np.asarray(QUANTILE_95 * std / size / np.array([*self.widths.values()]))

    def reached(self, result: Result) -> dict[str, float]:
        """Return the half-width of each interval of a fit relative to the value, divided by the requested one."""
        ratios = {}
        for name, width in self.widths.items():
            low, high = result.interval(name)
            ratio = (high - low) / 2 / max(abs(result.values[name]), 1e-300) / width
            ratios[name] = ratio if np.isfinite(ratio) else np.inf  # parameters that the data do not reach
        return ratios


def read_goal(texts: Sequence[str], names: Sequence[str]) -> Goal:
    """Read the goal of texts such as `k_*: 1 %` or `k_1: 0.5 %, d_*: 5 %`; the narrower of two for one parameter.

    names: of the parameters that the fit identifies.  StudyError for a text without a width, or of no parameter.
    """
    widths: dict[str, float] = {}
    for text in (part.strip() for argument in texts for part in argument.split(",")):
        pattern, _, width = (part.strip() for part in text.partition(":"))
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


MAX_TRIALS = 8  # configurations whose other lengths are compared, and that are tried where limits refuse the best


@dataclass(frozen=True)
class PriorEstimate:
    """Values and covariance (n_x, n_x) of x so far."""

    parameters: Parameters
    x: FloatArray
    covariance: FloatArray

    @classmethod
    def before(cls, problem: DesignProblem) -> "PriorEstimate":
        """Return the estimate before any data: starts, priors and tolerances of the study."""
        parameters = with_tolerances(problem.parameters, problem.robot, problem.fit)
        return cls(parameters, parameters.x, np.asarray(np.linalg.inv(_prior_information(parameters))))

    @property
    def information(self) -> FloatArray:
        """M_0 (n_x, n_x): vague prior information for unidentifiable parameters."""
        is_finite, M = np.isfinite(np.diag(self.covariance)), _prior_information(self.parameters)
        M[np.ix_(is_finite, is_finite)] = np.linalg.inv(self.covariance[np.ix_(is_finite, is_finite)])
        return M


def _prior_information(parameters: Parameters) -> FloatArray:
    """Return information (n_x, n_x) of the priors, with vague priors for all other parameters."""
    # Without a prior 1 of ln p, or the size of a linear parameter.
    stds = [p.prior.std if p.prior else 1.0 if p.log else abs(p.value) or 1.0 for p in parameters.free]
    return np.diag(1 / np.square(stds))


@dataclass(frozen=True)
class Option:
    """An experiment that may be next.

    reaches: intervals are expected to reach the goal after it.  gain: of Phi.  more_s: robot time of such experiments
    until the goal is reached, infinite where they never do.  floor: the parameter that then uses most of the goal, and
    its part.
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
        """Rank: those that reach the goal first, the shortest of them; else by the gain for each second."""
        return (False, self.time_s, -self.gain) if self.reaches else (True, -self.gain / self.time_s, self.time_s)


@dataclass(frozen=True)
class NextExperiment:
    """A plan of one configuration, within the limits of every robot that the fit allows.

    limit_use: of the robot that comes closest to a limit.
    """

    plan: Plan
    option: Option
    limit_use: LimitUse


def next_experiment(
    problem: DesignProblem,
    candidates: Candidates,
    state: PriorEstimate,
    goal: Goal,
    robots: Sequence[Robot],
    name: str,
    phase_seed: int,
    execution: Execution,
    left_s: float = math.inf,
) -> NextExperiment:
    """Return the experiment of the largest gain for each second, called `name`, its multisine drawn from phase_seed.

    problem: at the values of the fit, with a section `design` whose candidates are those.  robots: within the interval
    of the fit, on each of which the limits are kept.  left_s: robot time that is left; a longer experiment is proposed
    only where none is so short.  StudyError where no candidate has an experiment within limits.
    """
    completed = completed_problem(problem)
    options = _rank(completed, candidates, state, goal, execution)
    options = [option for option in options if option.time_s <= left_s] or options
    refusals: list[str] = []
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
    """Return options, the best first: all candidates at the study's length, and the best of them at others."""
    usual = problem.experiment.periods

    def at(periods: int, configurations: Sequence[Configuration]) -> list[Option]:
        longer = replace(problem, experiment=replace(problem.experiment, periods=periods))
        prospect = replace(longer.prospect(longer.probe(longer.experiment), -1), parameters=state.parameters)
        H, rows = informations(prospect, configurations, state.x, execution)
        time_s = unit_time_s(problem.excitation, problem.experiment, len(problem.robot.driven), periods)
        pairs = zip(H, rows.tolist(), strict=True)
        return [_option(state, goal, design, configurations[i], periods, time_s) for design, i in pairs]

    options = sorted(at(usual, candidates.configurations), key=lambda option: option.order)
    best = [option.configuration for option in options[:MAX_TRIALS]]
    for periods in sorted({2, usual, 2 * usual}):
        options += at(periods, best) if periods != usual else []
    return sorted(options, key=lambda option: option.order)


def _option(
    state: PriorEstimate, goal: Goal, H: FloatArray, configuration: Configuration, periods: int, time_s: float
) -> Option:
    """Return an experiment of information H (n_x, n_x)."""
    M = state.information

    def used(repeats: int) -> FloatArray:
        return goal.used(state.parameters, state.x, np.asarray(np.linalg.inv(M + repeats * H)))

    now_ratio, next_ratio, repeats = used(0), used(1), 1
    while repeats < 4096 and used(repeats).max() > 1:  # beyond, a goal is out of reach
        repeats *= 2
    largest = used(repeats)
    floor = [*goal.widths][int(np.argmax(largest))], float(largest.max())
    more_s = repeats * time_s if floor[1] <= 1 else math.inf
    gain = float(1 / np.sum(next_ratio**2) - 1 / np.sum(now_ratio**2))
    # A goal counts as reached where at most 0.9 of it is expected to be used.
    return Option(configuration, periods, bool(next_ratio.max() <= 0.9), gain, time_s, more_s, floor)


def _within_envelope(
    problem: DesignProblem, plan: Plan, robots: Sequence[Robot], execution: Execution
) -> tuple[Plan, LimitUse]:
    """Scale the plan until all robots keep the margin of their limits; return it with the largest use of a limit."""
    plan, closest = within_limits(problem.rig(plan), problem.excitation, execution)
    spec = replace(problem.excitation, torque_rms=1.0)  # a number: amplitudes are never raised for a drawn robot
    for robot in robots:
        # Realisations differ by less than the margin; one of them shows how another robot moves.
        first = replace(problem, robot=robot).rig(replace(plan, R=plan.R[:, :1]))
        _, use = within_limits(first, spec, execution)
        plan = plan.scaled(use.factor)
        closest = max(closest, use, key=lambda use: float(use.used.max()))
    return plan, closest


def _check_obstacles(problem: DesignProblem, configuration: Configuration, use: LimitUse) -> None:
    """Raise StudyError if the robot reaches an obstacle at the corners of its excursions."""
    assert problem.design is not None
    swing = np.minimum(use.peak[0, 1], np.pi)
    corners = np.array([np.zeros(len(swing)), *product((-1, 1), repeat=len(swing))])
    for reason, bad in collisions(problem.design.candidates, problem.robot, configuration.angles + swing * corners):
        if bad.any():
            raise StudyError("design/candidates", f"during the excitation, parts of the robot {reason}")
