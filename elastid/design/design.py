"""The design of an experiment: configurations chosen if the study asks for it, a plan within limits, its forecast."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.execution import Execution
from elastid.base.note import Note
from elastid.design.amplitudes import best_spectra_of, with_torques, with_typical_spectrum
from elastid.design.choice import Choice, InformationTask, choose_configurations
from elastid.design.expected_response import sticking
from elastid.design.forecast import Forecast, LimitUse, check_line_count, forecast
from elastid.design.limits import nearest_run, within_limits
from elastid.design.problem import DesignProblem
from elastid.design.prospect import Prospect
from elastid.design.spec import DesignSpec, period_options, robot_time_refusal, room
from elastid.experiment.plan.movement import Rehearsal
from elastid.experiment.plan.plan import Plan
from elastid.experiment.simulated.plant import true_robot
from elastid.linear.equilibrium import equilibrium, preloads
from elastid.model.elastic import ElasticModel
from elastid.model.springs import deflections, tangents
from elastid.record import Configuration

# Relative change of the tangent stiffness by the amplitude that is not reported.
MAX_CHANGE = 0.02
# Gauss-Hermite quadrature: exact for polynomials, within a few percent at the flanks of a gap.
N_NODES = 41


@dataclass(frozen=True)
class Stiffening:
    """The springs of a configuration: sigma (n_s,), rms deflection in the run that has most; change k_eq / k_t - 1."""

    configuration: str
    joints: tuple[str, ...]
    sigma: FloatArray
    change: FloatArray


def stiffening(prospect: Prospect, configuration: Configuration, x: FloatArray) -> Stiffening:
    """The effect of a plan on the springs of a robot with parameters x (n_x,); StudyError without equilibrium."""
    model = prospect.linearisation.model
    theta = prospect.parameters.expand(x)[:-1]
    (load,) = preloads(model, theta, [equilibrium(model, theta, configuration)])
    X = prospect.motion(configuration, x) @ _rows(model, load.joints).T
    sigma = np.sqrt(np.sum(np.abs(X) ** 2, axis=1) / 2).max(axis=0)
    nodes, weights = np.polynomial.hermite_e.hermegauss(N_NODES)
    tangent = _tangents(model, load.joints)
    at_nodes = np.array([tangent(load.deflection + sigma * node, theta).full()[:, 0] for node in nodes])
    k_eq = weights @ at_nodes / weights.sum()
    return Stiffening(configuration.name, load.joints, sigma, k_eq / load.tangent - 1)


def stiffening_notes(prospects: Sequence[Prospect], points: Sequence[Configuration], x: FloatArray) -> tuple[Note, ...]:
    """A note for each spring that the planned amplitude changes by more than MAX_CHANGE; x (n_x,)."""
    if all(joint.spring is None or joint.spring.is_linear for joint in prospects[0].robot.joints):
        return ()
    found = [stiffening(prospect, point, x) for prospect, point in zip(prospects, points, strict=True)]
    units = {joint.name: joint.unit for joint in prospects[0].robot.joints}
    return tuple(note for i, joint in enumerate(found[0].joints) for note in _notes(joint, units[joint], found, i))


def _notes(joint: str, unit: str, found: Sequence[Stiffening], i: int) -> Iterator[Note]:
    worst = max(found, key=lambda one: abs(one.change[i]))
    change = float(worst.change[i])
    if abs(change) > MAX_CHANGE:
        yield Note(
            "stiffened-spring",
            f"the multisine deflects its spring by {worst.sigma[i]:.2g} {unit} rms in {worst.configuration}, which "
            f"makes it {abs(change):.1%} {'stiffer' if change > 0 else 'softer'} than the tangent at rest of the "
            "model, and biases the estimates by as much; lower excitation.torque_rms of its motors by a factor of "
            f"{np.sqrt(abs(change) / MAX_CHANGE):.1f} or more",
            f"joint {joint}",
        )


def _rows(model: ElasticModel, joints: Sequence[str]) -> FloatArray:
    """z (n_s, n_q): springs are deflected by z q."""
    q = ca.SX.sym("q", model.n_q)
    deflection = deflections(model.robot, q)
    jacobian = ca.jacobian(ca.vertcat(*(deflection[name] for name in joints)), q)
    return np.asarray(ca.DM(ca.evalf(jacobian)).full())


def _tangents(model: ElasticModel, joints: Sequence[str]) -> ca.Function:
    """Tangent stiffness (n_s,) at deflections (n_s,) and parameters (n_theta,)."""
    deflection, theta = ca.SX.sym("deflection", len(joints)), ca.SX.sym("theta", len(model.parameters))
    named = dict(zip(model.parameters, ca.vertsplit(theta), strict=True))
    found = tangents(dict(zip(joints, ca.vertsplit(deflection), strict=True)), named)
    return ca.Function("tangents", [deflection, theta], [ca.vertcat(*found.values())])


# Rounds in which the damping by Coulomb friction and the motion that it damps converge, at most, and when they have.
FRICTION_ROUNDS = 20
MAX_DAMPING_CHANGE = 0.01


@dataclass(frozen=True)
class Design:
    """A plan within the robot's limits, its forecast, its use of the limits, and its run nearest to one of them."""

    plan: Plan
    forecast: Forecast
    limit_use: LimitUse
    nearest: Rehearsal


def design(problem: DesignProblem, execution: Execution | None = None) -> Design:
    """Choose configurations, plan, keep within limits, forecast.

    Raises StudyError for a problem without a solution, with what is in the way.
    """
    execution = execution or Execution()
    excitation, experiment, robot = problem.excitation, problem.experiment, problem.robot
    settled = with_typical_spectrum(with_torques(problem), excitation.torque_rms)
    settled = with_friction_damping(settled)
    choice = None
    if problem.design is not None:
        choice = _choose(settled, problem.design, execution)
        experiment = replace(experiment, periods=choice.periods)
    chosen = choice.chosen if choice is not None else ()
    spectra = best_spectra_of(settled, experiment, chosen, excitation.torque_rms)
    # Plan and rehearsal take the problem as it was given: the rehearsal has Coulomb friction itself.
    plan = problem.plan(experiment, chosen, spectra)
    check_line_count(plan.freq_hz, settled.parameters)
    plan, limit_use = within_limits(plan, excitation, experiment, robot, problem.seed, execution)
    x, fitted = settled.parameters.x, settled.fitted(plan)
    expected = forecast([prospect.expected(c, x, realisations) for prospect, c, realisations in fitted], x)
    notes = (
        *sticking(plan, true_robot(robot, problem.simulated.truth), problem.simulated.carrier),
        *expected.notes,
        *_shared_lines(plan),
        *stiffening_notes([prospect for prospect, _, _ in fitted], [c for _, c, _ in fitted], x),
    )
    expected = replace(expected, notes=notes, choice="" if choice is None else choice.sentence)
    nearest = nearest_run(plan, limit_use.nearest, experiment, robot, problem.seed)
    return Design(plan, expected, limit_use, nearest)


def with_friction_damping(problem: DesignProblem) -> DesignProblem:
    """The problem of a robot whose viscous friction includes the damping by Coulomb friction under this excitation.

    Averaged over the configurations given and some candidates; repeated, since damping reduces the motion.
    """
    damped = problem
    probe = problem.probe(problem.experiment)
    before = np.zeros(len(problem.robot.driven))
    for _ in range(FRICTION_ROUNDS):
        d = np.mean(_equivalent_damping(damped, probe, damped.parameters.x), axis=0)
        if np.all(np.abs(d - before) <= MAX_DAMPING_CHANGE * d):
            break
        damped, before = _with_damping(problem, d), d
    return damped


def _equivalent_damping(problem: DesignProblem, probe: Plan, x: FloatArray) -> list[FloatArray]:
    """Damping (n_u,) by Coulomb friction in each configuration of a plan, but for candidates without equilibrium."""
    given, found = problem.experiment.configurations, []
    refused: StudyError | DataError | None = None
    for q, configuration in enumerate(probe.configurations):
        try:
            found.append(problem.prospect(probe, q).equivalent_damping(configuration, x))
        except (StudyError, DataError) as error:
            if configuration.name in given:
                raise
            refused = error
    if refused is not None and not found:
        raise refused
    return found


def _with_damping(problem: DesignProblem, d: FloatArray) -> DesignProblem:
    """With d (n_u,) in Nms/rad more viscous friction in the motors, link side."""
    values = {}
    for joint, more in zip(problem.robot.driven, d, strict=True):
        if joint.motor is not None:
            values[f"fm_{joint.name}"] = joint.motor.viscous + float(more) / joint.motor.ratio**2
    unknown = {name: value for name, value in values.items() if name not in dict(problem.found)}
    return replace(problem, robot=problem.robot.with_parameters(values), found=(*problem.found, *unknown.items()))


def _choose(problem: DesignProblem, spec: DesignSpec, execution: Execution) -> Choice:
    candidates = problem.candidates(spec)
    x = problem.guesses
    sections = spec, problem.excitation, problem.experiment, len(problem.robot.driven)
    refusal = robot_time_refusal(*sections)
    if refusal:
        raise StudyError(f"design.robot_time: {refusal}")
    options = [periods for periods in period_options(spec, problem.experiment) if room(*sections, periods) >= 1]
    tasks = [_task(problem, periods, room(*sections, periods), x) for periods in options]
    given = tuple(problem.experiment.configurations)
    return choose_configurations(spec, tasks, candidates, x, given, problem.seed, execution)


def _task(problem: DesignProblem, periods: int, count: int, x: FloatArray) -> InformationTask:
    """A prospect, and the information of given configurations, earlier measurements and priors."""
    problem = replace(problem, experiment=replace(problem.experiment, periods=periods))
    probe = problem.probe(problem.experiment)
    check_line_count(probe.freq_hz, problem.parameters)
    known = problem.prior_information(x)
    for q, configuration in enumerate(probe.configurations):
        if configuration.name in set(problem.experiment.configurations) - set(problem.left_out):
            prospect = problem.prospect(probe, q)
            known = known + np.stack([prospect.expected(configuration, one).information(one) for one in x])
    return InformationTask(problem.prospect(probe, len(probe.configurations) - 1), count, known)


def _shared_lines(plan: Plan) -> tuple[Note, ...]:
    """A note where fewer experiments than inputs are run."""
    E, n_u = plan.R.shape[2], len(plan.inputs)
    if n_u <= E:
        return ()
    return (
        Note(
            "approximate-forecast",
            f"the expected deviations are an approximation: with {E} of {n_u} experiments in a realisation the inputs "
            "are separated by neighbouring lines only, and the loss of a local method by that, and by transients, is "
            "not counted",
        ),
    )
