"""The plan of a study with what it will tell: configurations chosen where the study asks for it, then foretold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import StudyError
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.choosing import Choice, Task, choose_configurations, guesses
from elastid.experiment.configurations import candidates
from elastid.experiment.design_spec import DesignSpec, LevelSpec
from elastid.experiment.expected import Expected, Level, Prospect, injected_power, linear_model
from elastid.experiment.forecast import Forecast, check_lines, forecast
from elastid.experiment.plan import Chosen, Plan, make_plan
from elastid.experiment.spec import ExperimentSpec, SimulatedSpec
from elastid.fit.choose import choose
from elastid.fit.spec import FitSpec
from elastid.fit.weights import weigh
from elastid.parallel import Progress, silent
from elastid.parameters import ParameterSet
from elastid.record import Configuration, Motion
from elastid.response import FrequencyResponse
from elastid.robot import Robot


@dataclass(frozen=True)
class Brief:
    """The sections of a study that a plan hangs on, and what has been measured before.

    left_out: configurations that the fit does not see.  measured: responses that the choice adds to.  found: values of
    parameters that their fit found.  like: responses whose variance is expected again.
    """

    robot: Robot
    excitation: MultisineSpec
    experiment: ExperimentSpec
    fit: FitSpec
    quantity: Motion
    seed: int
    design: DesignSpec | None = None
    left_out: tuple[str, ...] = ()
    measured: tuple[FrequencyResponse, ...] = ()
    found: tuple[tuple[str, float], ...] = ()
    like: tuple[FrequencyResponse, ...] = ()

    @property
    def simulated(self) -> SimulatedSpec:
        """The rig that is planned for, with its noise and its controller."""
        if self.experiment.simulated is None:
            raise StudyError("design: the experiment is recorded; there is nothing to plan")
        return self.experiment.simulated

    @property
    def parameters(self) -> ParameterSet:
        """What the fit identifies, at what an earlier fit found of it."""
        parameters = choose(self.fit, self.robot)
        known = dict(self.found)
        return parameters.with_values(
            {p.name: min(max(known[p.name], p.lower), p.upper) for p in parameters.free if p.name in known}
        )


@dataclass(frozen=True)
class Design:
    """A plan, what it will tell, and how its configurations were chosen, if they were."""

    plan: Plan
    forecast: Forecast
    choice: Choice | None


def designed(brief: Brief, jobs: int = 1, progress: Progress = silent) -> Design:
    """Choose, plan, foretell.  Raises StudyError for what cannot be chosen, planned or told."""
    choice, experiment = None, brief.experiment
    if brief.design is not None:
        choice = _choice(brief, brief.design, jobs, progress)
        experiment = replace(experiment, periods=choice.periods)
    chosen = choice.chosen if choice is not None else ()
    plan = make_plan(brief.excitation, experiment, brief.robot, brief.seed, chosen)
    return Design(plan, foretold(brief, plan), choice)


def foretold(brief: Brief, plan: Plan) -> Forecast:
    """What a plan will tell the fit, with what earlier measurements told left aside."""
    parameters = brief.parameters
    check_lines(plan.freq_hz, parameters)
    return forecast(_expected(brief, plan), parameters.x)


def _expected(brief: Brief, plan: Plan) -> list[Expected]:
    """The responses that the fit will get."""
    x = brief.parameters.x
    each = enumerate(zip(plan.configurations, plan.realisations, strict=True))
    return [
        _prospect(brief, plan, q).expected(configuration, x, realisations)
        for q, (configuration, realisations) in each
        if configuration.name not in brief.left_out
    ]


def _prospect(brief: Brief, plan: Plan, q: int) -> Prospect:
    """How configurations like the q-th of a plan will be measured."""
    simulated = brief.simulated
    outputs = simulated.outputs or brief.robot.motor_locations
    spec = brief.design.noise if brief.design is not None else LevelSpec()
    variance = None
    if brief.like:
        variance = _variance_like(brief.like, plan.freq_hz, outputs, plan.inputs) * brief.experiment.realisations
    return Prospect(
        robot=brief.robot,
        parameters=brief.parameters,
        fit=brief.fit,
        outputs=outputs,
        quantity=brief.quantity,
        controller=simulated.controller,
        level=Level(simulated.noise, spec.distortion, spec.absolute, variance),
        freq_hz=plan.freq_hz,
        power=injected_power(plan, q),
        rate_hz=plan.rate_hz,
        period_samples=plan.period_samples,
        periods=plan.periods,
        realisations=brief.experiment.realisations,
    )


def _choice(brief: Brief, spec: DesignSpec, jobs: int, progress: Progress) -> Choice:
    parameters = brief.parameters
    carrier = brief.simulated.carrier
    there = candidates(spec.candidates, brief.robot, brief.seed, carrier.amplitude if carrier is not None else 0.0)
    x = guesses(parameters, spec.robust, brief.seed)
    tasks = [_task(brief, spec, periods, there.configurations[0], x) for periods in _periods(brief, spec)]
    given = tuple(brief.experiment.configurations)
    return choose_configurations(spec, tasks, there, x, given, brief.seed, jobs, progress)


def _periods(brief: Brief, spec: DesignSpec) -> tuple[int, ...]:
    """The numbers of periods that leave room for a configuration; StudyError where none does."""
    options = spec.periods or (brief.experiment.periods,)
    fitting = tuple(periods for periods in options if spec.count is not None or _room(brief, spec, periods) >= 1)
    if not fitting:
        given, shortest = len(brief.experiment.configurations), _unit_time_s(brief, min(options))
        raise StudyError(
            f"design.robot_time: {spec.robot_time:g} s leave no room for a configuration beside the {given} given: one "
            f"takes {shortest:g} s of the robot's time; give at least {(given + 1) * shortest:g} s, or fewer "
            "realisations or periods"
        )
    return fitting


def _unit_time_s(brief: Brief, periods: int) -> float:
    """Robot time of one configuration."""
    experiment = brief.experiment
    runs = experiment.realisations * len(brief.robot.driven)
    return runs * (periods + experiment.transient_periods) * brief.excitation.period


def _room(brief: Brief, spec: DesignSpec, periods: int) -> int:
    """How many configurations can be chosen."""
    if spec.robot_time is None:
        return spec.count or 0
    return int(spec.robot_time / _unit_time_s(brief, periods) + 1e-9) - len(brief.experiment.configurations)


def _task(brief: Brief, spec: DesignSpec, periods: int, anywhere: Configuration, x: FloatArray) -> Task:
    """The prospect and what is known before: given configurations, earlier measurements, priors."""
    experiment = replace(brief.experiment, periods=periods)
    probe = make_plan(brief.excitation, experiment, brief.robot, brief.seed, [Chosen(anywhere, 1)])
    check_lines(probe.freq_hz, brief.parameters)
    brief = replace(brief, experiment=experiment)
    prospect = _prospect(brief, probe, len(probe.configurations) - 1)
    known = np.stack([_known(brief, prospect, probe, one) for one in x])
    return Task(prospect, _room(brief, spec, periods), known)


def _known(brief: Brief, prospect: Prospect, plan: Plan, x: FloatArray) -> FloatArray:
    """Information (n_x, n_x) at x that is there without a choice."""
    slopes = [0.0 if p.prior is None else 1 / p.prior.std for p in prospect.parameters.free]
    known: FloatArray = np.diag(np.square(slopes))
    for q, configuration in enumerate(plan.configurations[:-1]):
        if configuration.name not in brief.left_out:
            known = known + _prospect(brief, plan, q).expected(configuration, x).information(x)
    for response in brief.measured:
        model = linear_model(brief.robot, prospect.parameters, response, x)
        expected = Expected(response, model, weigh(response, brief.fit), prospect.parameters, brief.fit)
        known = known + expected.information(x)
    return known


def _variance_like(
    responses: Sequence[FrequencyResponse], freq_hz: FloatArray, outputs: tuple[str, ...], inputs: tuple[str, ...]
) -> FloatArray:
    """Variance (F, n_y, n_u) of G: geometric mean over earlier responses, between their lines.

    StudyError where they have other inputs or outputs, or no variance.
    """
    logs = []
    for response in responses:
        known = response.uncertainty
        if response.inputs != inputs or response.outputs != outputs or known is None:
            raise StudyError(
                f"design.noise.frf: configuration {response.configuration.name} was measured from "
                f"{', '.join(response.inputs)} to {', '.join(response.outputs)}"
                f"{' without a variance' if known is None else ''}; needed are {', '.join(inputs)} to "
                f"{', '.join(outputs)} with one"
            )
        log = np.log(np.maximum(known.variance, 1e-300)).reshape(response.n_lines, -1)
        logs.append([np.interp(freq_hz, response.freq_hz, column) for column in log.T])
    variance: FloatArray = np.exp(np.mean(logs, axis=0)).T.reshape(len(freq_hz), len(outputs), len(inputs))
    return variance
