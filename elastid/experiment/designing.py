"""The plan of a study with what it will tell: configurations chosen where the study asks for it, then foretold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import digamma

from elastid.arrays import FloatArray
from elastid.errors import StudyError
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.choosing import Choice, Task, choose_configurations, guesses
from elastid.experiment.configurations import candidates
from elastid.experiment.design_spec import DesignSpec, LevelSpec
from elastid.experiment.expected import Expected, Level, Prospect, linear_model
from elastid.experiment.forecast import Forecast, check_lines, forecast
from elastid.experiment.limits import Peaks, nearest_run, within_limits
from elastid.experiment.movement import one_period, reach
from elastid.experiment.plan import Chosen, Plan, make_plan
from elastid.experiment.rehearsal import Rehearsal
from elastid.experiment.simulated import true_robot
from elastid.experiment.spec import ExperimentSpec, SimulatedSpec
from elastid.experiment.sticking import sticking
from elastid.fit.choose import choose
from elastid.fit.spec import FitSpec
from elastid.fit.weights import weigh
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parallel import Progress, silent
from elastid.parameters import ParameterSet
from elastid.record import Motion
from elastid.response import FrequencyResponse
from elastid.robot import Robot

# Candidates, with so many realisations each, on which the excitation is tried out before any is chosen.
PROBES, PROBED = 8, 4
# Rounds in which the damping by Coulomb friction and the motion that it damps agree.
FRICTION_ROUNDS = 3


@dataclass(frozen=True)
class Brief:
    """The sections of a study that a plan hangs on, and what has been measured before.

    left_out: configurations that the fit does not see.  measured: responses that the choice adds to.  found: values of
    parameters that their fit found.  like: responses whose variance is expected again.  model: of the fit.
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
    model: ModelSpec = EXACT

    def with_amplitudes(self) -> Brief:
        """The same with the torques that a few postures bear, where the study leaves them to the limits."""
        if self.excitation.torque_rms != "limits":
            return self
        probe = _probe(self, replace(self.experiment, realisations=1), 1)
        probe, _ = within_limits(probe, self.excitation, self.experiment, self.robot, self.seed)
        rms = np.sqrt(np.mean(np.sum(np.abs(probe.R) ** 2, axis=3) / 2, axis=(0, 1, 2)))
        return replace(self, excitation=replace(self.excitation, torque_rms=tuple(rms.tolist())))

    def sliding(self) -> Brief:
        """The same for a robot whose viscous friction includes what Coulomb friction adds under this excitation.

        Averaged over the configurations given and some candidates; repeated since the more damping the less motion.
        """
        brief = self
        probe = _probe(self, self.experiment)
        for _ in range(FRICTION_ROUNDS):
            x = brief.parameters.x
            prospects = [_prospect(brief, probe, q) for q in range(len(probe.configurations))]
            each = zip(prospects, probe.configurations, strict=True)
            d = np.mean([prospect.equivalent_damping(c, x) for prospect, c in each], axis=0)
            if not d.any():
                return self
            brief = self._with_damping(d)
        return brief

    def _with_damping(self, d: FloatArray) -> Brief:
        """With d (n_u,) in Nms/rad more viscous friction in the motors, link side."""
        values = {}
        for joint, more in zip(self.robot.driven, d, strict=True):
            if joint.motor is not None:
                values[f"fm_{joint.name}"] = joint.motor.viscous + float(more) / joint.motor.ratio**2
        unknown = {name: value for name, value in values.items() if name not in dict(self.found)}
        return replace(self, robot=self.robot.with_parameters(values), found=(*self.found, *unknown.items()))

    @property
    def simulated(self) -> SimulatedSpec:
        """The rig that is planned for, with its noise and its controller."""
        if self.experiment.simulated is None:
            raise StudyError("design: the experiment is recorded; there is nothing to plan")
        return self.experiment.simulated

    @property
    def parameters(self) -> ParameterSet:
        """What the fit identifies, at what is found of it already."""
        parameters = choose(self.fit, self.robot)
        known = dict(self.found)
        return parameters.with_values(
            {p.name: min(max(known[p.name], p.lower), p.upper) for p in parameters.free if p.name in known}
        )


@dataclass(frozen=True)
class Design:
    """A plan within the robot's limits, the peaks of its rehearsal, its run nearest to a limit, what it will tell."""

    plan: Plan
    forecast: Forecast
    peaks: Peaks
    nearest: Rehearsal


def designed(brief: Brief, jobs: int = 1, progress: Progress = silent) -> Design:
    """Choose, plan, keep within limits, foretell.  Raises StudyError for what cannot be chosen, planned or told."""
    excitation, robot = brief.excitation, brief.robot
    brief = brief.with_amplitudes().sliding()
    choice, experiment = None, brief.experiment
    if brief.design is not None:
        choice = _choice(brief, brief.design, jobs, progress)
        experiment = replace(experiment, periods=choice.periods)
    chosen = choice.chosen if choice is not None else ()
    plan = make_plan(excitation, experiment, robot, brief.seed, chosen)
    check_lines(plan.freq_hz, brief.parameters)
    # The rehearsal has Coulomb friction itself: it takes the robot as it was before friction counted as damping.
    plan, peaks = within_limits(plan, excitation, experiment, robot, brief.seed, jobs, progress)
    told = forecast(_expected(brief, plan), brief.parameters.x)
    simulated = brief.simulated
    stuck = sticking(plan, true_robot(robot, simulated.truth), simulated.carrier)
    told = replace(told, notes=(*stuck, *told.notes, *_by_neighbours(plan)))
    nearest = nearest_run(plan, peaks, experiment, robot, brief.seed)
    return Design(plan, told if choice is None else replace(told, choice=choice.said), peaks, nearest)


def _by_neighbours(plan: Plan) -> tuple[str, ...]:
    """A word where lines alone do not tell the inputs apart."""
    E, n_u = plan.R.shape[2], len(plan.inputs)
    if n_u <= E:
        return ()
    return (
        f"the expected deviations are an approximation: {E} of {n_u} experiments in a realisation tell the inputs "
        "apart by neighbouring lines only, and what a local method gives up for that, and for transients, is not "
        "counted",
    )


def _probe(brief: Brief, experiment: ExperimentSpec, realisations: int = PROBED) -> Plan:
    """A plan of the given configurations, and of a few more that stand for all candidates."""
    if brief.design is None:
        return make_plan(brief.excitation, experiment, brief.robot, brief.seed)
    anywhere = candidates(brief.design.candidates, brief.robot, brief.seed, _swing(brief)).configurations
    some = [Chosen(replace(c, name=f"probe{i}"), realisations) for i, c in enumerate(anywhere[:PROBES])]
    return make_plan(brief.excitation, experiment, brief.robot, brief.seed, some)


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
        model=brief.model,
        robot=brief.robot,
        parameters=brief.parameters,
        fit=brief.fit,
        outputs=outputs,
        quantity=brief.quantity,
        controller=simulated.controller,
        carrier_velocity=one_period(simulated.carrier, plan),
        level=Level(simulated.noise, spec.distortion, spec.absolute, variance),
        lines=plan.lines,
        R=plan.R[q, : plan.realisations[q]],
        rate_hz=plan.rate_hz,
        period_samples=plan.period_samples,
        periods=plan.periods,
        realisations=brief.experiment.realisations,
    )


def _swing(brief: Brief) -> float:
    carrier, excitation, experiment = brief.simulated.carrier, brief.excitation, brief.experiment
    if carrier is None:
        return 0.0
    periods = experiment.transient_periods + experiment.periods
    swing = reach(carrier, excitation.period, periods * excitation.period + 2 * experiment.ramp)
    return swing / (1 - excitation.margin)  # the plan keeps that margin to the limits


def _choice(brief: Brief, spec: DesignSpec, jobs: int, progress: Progress) -> Choice:
    there = candidates(spec.candidates, brief.robot, brief.seed, _swing(brief))
    x = guesses(brief.parameters, spec.robust, brief.seed)
    tasks = [_task(brief, spec, periods, x) for periods in _periods(brief, spec)]
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
    runs = experiment.realisations * experiment.runs(len(brief.robot.driven))
    at_ends = 2 * (experiment.ramp + experiment.hold)
    return runs * ((periods + experiment.transient_periods) * brief.excitation.period + at_ends)


def _room(brief: Brief, spec: DesignSpec, periods: int) -> int:
    """How many configurations can be chosen."""
    if spec.robot_time is None:
        return spec.count or 0
    return int(spec.robot_time / _unit_time_s(brief, periods) + 1e-9) - len(brief.experiment.configurations)


def _task(brief: Brief, spec: DesignSpec, periods: int, x: FloatArray) -> Task:
    """The prospect and what is known before: given configurations, earlier measurements, priors."""
    brief = replace(brief, experiment=replace(brief.experiment, periods=periods))
    probe = _probe(brief, brief.experiment)
    check_lines(probe.freq_hz, brief.parameters)
    prospect = _prospect(brief, probe, len(probe.configurations) - 1)
    known = np.stack([_known(brief, prospect, probe, one) for one in x])
    return Task(prospect, _room(brief, spec, periods), known)


def _known(brief: Brief, prospect: Prospect, plan: Plan, x: FloatArray) -> FloatArray:
    """Information (n_x, n_x) at x that is there without a choice."""
    slopes = [0.0 if p.prior is None else 1 / p.prior.std for p in prospect.parameters.free]
    known: FloatArray = np.diag(np.square(slopes))
    for q, configuration in enumerate(plan.configurations):
        if configuration.name in set(brief.experiment.configurations) - set(brief.left_out):
            known = known + _prospect(brief, plan, q).expected(configuration, x).information(x)
    for response in brief.measured:
        model = linear_model(brief.robot, brief.model, prospect.parameters, response, x)
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
        # The logarithm of a variance from few degrees of freedom lies too low: E ln(v~/v) = psi(dof) - ln dof.
        shortfall = np.log(known.dof) - digamma(known.dof) if np.isfinite(known.dof) else 0.0
        log = np.log(np.maximum(known.variance, 1e-300)).reshape(response.n_lines, -1) + shortfall
        logs.append([np.interp(freq_hz, response.freq_hz, column) for column in log.T])
    variance: FloatArray = np.exp(np.mean(logs, axis=0)).T.reshape(len(freq_hz), len(outputs), len(inputs))
    return variance
