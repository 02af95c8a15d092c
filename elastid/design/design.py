"""The plan of a study with what it will tell: configurations chosen where the study asks for it, then foretold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.execution import Progress, silent
from elastid.design.candidates import candidates
from elastid.design.choice import Choice, InformationTask, choose_configurations, guesses
from elastid.design.expected_response import Expected, Level, Prospect, linear_model, variance_like
from elastid.design.forecast import Forecast, check_line_count, forecast
from elastid.design.friction_effects import sticking
from elastid.design.information_spectra import best_spectra
from elastid.design.limits import LimitUse, costs, nearest_run, within_limits
from elastid.design.optimal import DesignCriterion
from elastid.design.robot_time import period_options, robot_time_refusal, room
from elastid.design.spec import DesignSpec, LevelSpec, interest
from elastid.design.spring_effects import stiffening_words
from elastid.excitation.spec import AskedTorque, MultisineSpec
from elastid.experiment.plan.movement import one_period, reach
from elastid.experiment.plan.plan import Chosen, Plan, make_plan
from elastid.experiment.plan.rehearsal import Rehearsal
from elastid.experiment.plan.torque_spectra import PredictClosedLoop
from elastid.experiment.simulated.closed_loop import closed_loop_of
from elastid.experiment.simulated.plant import true_robot
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.setup.parameter_choice import choose
from elastid.fit.spec import FitSpec
from elastid.fit.weights.weights import weigh
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parameters import ParameterSet
from elastid.record import Motion
from elastid.response import FrequencyResponse
from elastid.robot import Robot

# Candidates, with so many realisations each, on which the excitation is tried out before any is chosen.
PROBES, PROBED = 8, 4
# Rounds in which the damping by Coulomb friction and the motion that it damps agree.
FRICTION_ROUNDS = 3


@dataclass(frozen=True)
class DesignProblem:
    """The sections of a study that a plan hangs on, and what has been measured before.

    left_out: configurations that the fit does not see.  measured: responses that the choice adds to.  found: values of
    parameters that their fit found.  like: responses whose variance is expected again.  model: of the fit.  typical
    (F, n_u): spectrum that stands for all while none is found for each configuration.
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
    typical: FloatArray | None = None

    def with_amplitudes(self) -> DesignProblem:
        """The same with the torques that a few postures bear, where the study leaves them to the limits."""
        if self.excitation.torque_rms != "limits":
            return self
        probe = _probe(self, replace(self.experiment, realisations=1), 1)
        balanced = replace(self.excitation, flat="torque")
        probe, _ = within_limits(probe, balanced, self.experiment, self.robot, self.seed)
        rms = np.sqrt(np.mean(np.sum(np.abs(probe.R) ** 2, axis=3) / 2, axis=(0, 1, 2)))
        return replace(self, excitation=replace(self.excitation, torque_rms=tuple(rms.tolist())))

    def with_spectrum(self, torque_rms: AskedTorque) -> DesignProblem:
        """The same with a spectrum that tells most about a few configurations, where the study leaves it to that.

        torque_rms: as the study has it, `limits` included.
        """
        if self.excitation.flat != "information":
            return self
        probe, kept, cost = _probe(self, self.experiment), [], []
        refused: StudyError | DataError | None = None
        for q in range(len(probe.configurations)):
            try:
                for one in self.guesses:
                    _prospect(self, probe, q).expected(probe.configurations[q], one)
                cost.append(_cost(self, _only(probe, q), torque_rms))
                kept.append(q)
            except (StudyError, DataError) as error:
                refused = error
        if refused is not None and not kept:
            raise refused
        found = _best_spectra(self, probe, kept, np.concatenate(cost), together=True)
        return replace(self, typical=found[0])

    def sliding(self) -> DesignProblem:
        """The same for a robot whose viscous friction includes what Coulomb friction adds under this excitation.

        Averaged over the configurations given and some candidates; repeated since the more damping the less motion.
        """
        brief = self
        probe = _probe(self, self.experiment)
        for _ in range(FRICTION_ROUNDS):
            x = brief.parameters.x
            d = np.mean(_damping(brief, probe, x), axis=0)
            if not d.any():
                return self
            brief = self._with_damping(d)
        return brief

    def _with_damping(self, d: FloatArray) -> DesignProblem:
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
        return self.experiment.as_simulated()

    @property
    def closed_loop(self) -> PredictClosedLoop:
        """The closed-loop response of the nominal robot."""
        return closed_loop_of(self.robot, self.simulated.controller, self.excitation.rate_hz)

    @property
    def guesses(self) -> FloatArray:
        """Guesses (S, n_x) of the parameters, the nominal one first."""
        return guesses(self.parameters, None if self.design is None else self.design.robust, self.seed)

    @property
    def criterion(self) -> DesignCriterion:
        """What makes a design good; without the section `design` the volume of the ellipsoid of all parameters."""
        design = self.design
        wanted = interest(self.parameters.free_names, () if design is None else design.parameters)
        over = design.robust.over if design is not None and design.robust is not None else "mean"
        return DesignCriterion("D" if design is None else design.criterion, wanted, over)

    @property
    def parameters(self) -> ParameterSet:
        """What the fit identifies, at what is found of it already.

        Robots and other groups of configurations have parameters of their own where all configurations are given; what
        a design chooses is of one robot.
        """
        given = () if self.design is not None else tuple(self.experiment.configurations)
        parameters = choose(self.fit, self.robot, [name for name in given if name not in self.left_out])
        known = dict(self.found)
        return parameters.with_values(
            {p.name: min(max(known[p.stands_for], p.lower), p.upper) for p in parameters.free if p.stands_for in known}
        )


@dataclass(frozen=True)
class Design:
    """A plan within the robot's limits, the peaks of its rehearsal, its run nearest to a limit, what it will tell."""

    plan: Plan
    forecast: Forecast
    peaks: LimitUse
    nearest: Rehearsal


def designed(brief: DesignProblem, jobs: int = 1, progress: Progress = silent) -> Design:
    """Choose, plan, keep within limits, foretell.  Raises StudyError for what cannot be chosen, planned or told."""
    excitation, robot = brief.excitation, brief.robot
    brief = brief.with_amplitudes().with_spectrum(excitation.torque_rms).sliding()
    choice, experiment = None, brief.experiment
    if brief.design is not None:
        choice = _choice(brief, brief.design, jobs, progress)
        experiment = replace(experiment, periods=choice.periods)
    chosen = choice.chosen if choice is not None else ()
    spectra = _spectra(brief, experiment, chosen, excitation.torque_rms)
    plan = make_plan(excitation, experiment, robot, brief.seed, chosen, spectra, brief.closed_loop)
    check_line_count(plan.freq_hz, brief.parameters)
    # The rehearsal has Coulomb friction itself: it takes the robot as it was before friction counted as damping.
    plan, peaks = within_limits(plan, excitation, experiment, robot, brief.seed, jobs, progress)
    told = forecast(_expected(brief, plan), brief.parameters.x)
    simulated = brief.simulated
    stuck = sticking(plan, true_robot(robot, simulated.truth), simulated.carrier)
    told = replace(told, notes=(*stuck, *told.notes, *_by_neighbours(plan)))
    told = replace(told, notes=(*told.notes, *_stiffened(brief, plan)))
    nearest = nearest_run(plan, peaks, experiment, robot, brief.seed)
    return Design(plan, told if choice is None else replace(told, choice=choice.said), peaks, nearest)


def _spectra(
    brief: DesignProblem, experiment: ExperimentSpec, chosen: Sequence[Chosen], torque_rms: AskedTorque
) -> dict[str, FloatArray]:
    """The best spectrum of every configuration of a plan; none where the study says what the spectrum is."""
    if brief.typical is None:
        return {}
    plan = _planned(brief, experiment, chosen)
    fitted = [q for q, c in enumerate(plan.configurations) if c.name not in brief.left_out]
    found = _best_spectra(brief, plan, fitted, _cost(brief, plan, torque_rms)[fitted])
    spectra = {c.name: brief.typical for c in plan.configurations}
    return spectra | {plan.configurations[q].name: one for q, one in zip(fitted, found, strict=True)}


def _best_spectra(
    brief: DesignProblem, plan: Plan, which: Sequence[int], cost: FloatArray, together: bool = False
) -> FloatArray:
    """Amplitudes of some configurations of a plan, whose powers cost (Q, n_o, F, n_u)."""
    x = brief.guesses
    return best_spectra(
        [_prospect(brief, plan, q) for q in which],
        [plan.configurations[q] for q in which],
        [plan.realisations[q] for q in which],
        cost,
        x,
        brief.criterion,
        _before(brief, x),
        brief.excitation.least,
        together,
    )


def _cost(brief: DesignProblem, plan: Plan, torque_rms: AskedTorque) -> FloatArray:
    excitation = replace(brief.excitation, torque_rms=torque_rms)
    return costs(plan, excitation, brief.experiment, brief.robot, brief.seed)


def _only(plan: Plan, q: int) -> Plan:
    """One configuration of a plan."""
    return replace(plan, configurations=plan.configurations[q : q + 1], R=plan.R[q : q + 1])


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


def _probe(brief: DesignProblem, experiment: ExperimentSpec, realisations: int = PROBED) -> Plan:
    """A plan of the given configurations, and of a few more that stand for all candidates."""
    if brief.design is None:
        return _planned(brief, experiment)
    anywhere = candidates(brief.design.candidates, brief.robot, brief.seed, _swing(brief)).configurations
    some = [Chosen(replace(c, name=f"probe{i}"), realisations) for i, c in enumerate(anywhere[:PROBES])]
    return _planned(brief, experiment, some)


def _damping(brief: DesignProblem, probe: Plan, x: FloatArray) -> list[FloatArray]:
    """What Coulomb friction adds (n_u,) in each configuration of a plan, but for candidates without equilibrium."""
    given, found = brief.experiment.configurations, []
    refused: StudyError | DataError | None = None
    for q, configuration in enumerate(probe.configurations):
        try:
            found.append(_prospect(brief, probe, q).equivalent_damping(configuration, x))
        except (StudyError, DataError) as error:
            if configuration.name in given:
                raise
            refused = error
    if refused is not None and not found:
        raise refused
    return found


def _planned(brief: DesignProblem, experiment: ExperimentSpec, chosen: Sequence[Chosen] = ()) -> Plan:
    """A plan in which all configurations have the typical spectrum, where there is one."""
    spectra = {}
    if brief.typical is not None:
        names = (*experiment.configurations, *(one.configuration.name for one in chosen))
        spectra = dict.fromkeys(names, brief.typical)
    return make_plan(brief.excitation, experiment, brief.robot, brief.seed, chosen, spectra, brief.closed_loop)


def _expected(brief: DesignProblem, plan: Plan) -> list[Expected]:
    """The responses that the fit will get."""
    x = brief.parameters.x
    each = enumerate(zip(plan.configurations, plan.realisations, strict=True))
    return [
        _prospect(brief, plan, q).expected(configuration, x, realisations)
        for q, (configuration, realisations) in each
        if configuration.name not in brief.left_out
    ]


def _stiffened(brief: DesignProblem, plan: Plan) -> tuple[str, ...]:
    """A word for each spring that is not at this amplitude what it is at rest."""
    fitted = [q for q, one in enumerate(plan.configurations) if one.name not in brief.left_out]
    prospects = [_prospect(brief, plan, q) for q in fitted]
    return stiffening_words(prospects, [plan.configurations[q] for q in fitted], brief.parameters.x)


def _prospect(brief: DesignProblem, plan: Plan, q: int) -> Prospect:
    """How configurations like the q-th of a plan will be measured."""
    simulated = brief.simulated
    outputs = simulated.outputs or brief.robot.motor_locations
    spec = brief.design.noise if brief.design is not None else LevelSpec()
    variance = None
    if brief.like:
        variance = variance_like(brief.like, plan.freq_hz, outputs, plan.inputs) * brief.experiment.realisations
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


def _swing(brief: DesignProblem) -> FloatArray:
    """(n_u,), rad or m."""
    carrier, excitation, experiment = brief.simulated.carrier, brief.excitation, brief.experiment
    n_u = len(brief.robot.driven)
    if carrier is None:
        return np.zeros(n_u)
    periods = experiment.transient_periods + experiment.periods
    swing = reach(carrier, n_u, excitation.period, periods * excitation.period + 2 * experiment.ramp)
    right: FloatArray = swing / (1 - excitation.margin)
    return right  # the plan keeps that margin to the limits


def _choice(brief: DesignProblem, spec: DesignSpec, jobs: int, progress: Progress) -> Choice:
    there = candidates(spec.candidates, brief.robot, brief.seed, _swing(brief))
    x = brief.guesses
    tasks = [_task(brief, spec, periods, x) for periods in _periods(brief, spec)]
    given = tuple(brief.experiment.configurations)
    return choose_configurations(spec, tasks, there, x, given, brief.seed, jobs, progress)


def _periods(brief: DesignProblem, spec: DesignSpec) -> tuple[int, ...]:
    """The numbers of periods that leave room for a configuration; StudyError where none does."""
    sections = spec, brief.excitation, brief.experiment, len(brief.robot.driven)
    refused = robot_time_refusal(*sections)
    if refused:
        raise StudyError(f"design.robot_time: {refused}")
    return tuple(periods for periods in period_options(spec, brief.experiment) if room(*sections, periods) >= 1)


def _task(brief: DesignProblem, spec: DesignSpec, periods: int, x: FloatArray) -> InformationTask:
    """The prospect and what is known before: given configurations, earlier measurements, priors."""
    brief = replace(brief, experiment=replace(brief.experiment, periods=periods))
    probe = _probe(brief, brief.experiment)
    check_line_count(probe.freq_hz, brief.parameters)
    prospect = _prospect(brief, probe, len(probe.configurations) - 1)
    count = room(spec, brief.excitation, brief.experiment, len(brief.robot.driven), periods)
    return InformationTask(prospect, count, _known(brief, probe, x))


def _known(brief: DesignProblem, plan: Plan, x: FloatArray) -> FloatArray:
    """Information (S, n_x, n_x) at guesses x (S, n_x) that is there without a choice."""
    known = _before(brief, x)
    for q, configuration in enumerate(plan.configurations):
        if configuration.name in set(brief.experiment.configurations) - set(brief.left_out):
            prospect = _prospect(brief, plan, q)
            known = known + np.stack([prospect.expected(configuration, one).information(one) for one in x])
    return known


def _before(brief: DesignProblem, x: FloatArray) -> FloatArray:
    """Information (S, n_x, n_x) of priors and of what was measured before."""
    parameters = brief.parameters
    slopes = [0.0 if p.prior is None else 1 / p.prior.std for p in parameters.free]
    known = np.repeat(np.diag(np.square(slopes))[None], len(x), axis=0)
    for response in brief.measured:
        for s, one in enumerate(x):
            model = linear_model(brief.robot, brief.model, parameters, response, one)
            expected = Expected(response, model, weigh(response, brief.fit), parameters, brief.fit)
            known[s] += expected.information(one)
    return known
