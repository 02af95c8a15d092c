"""The summary that `elastid check` prints of a study without errors: robot, unknowns, experiments, stages."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from elastid.base.display import columns
from elastid.excitation.spec import MultisineSpec, planned_lines
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.fit.parameter_choice import choose
from elastid.fit.tolerances import with_tolerances
from elastid.parameters import Parameter
from elastid.robot import Robot
from elastid.study import Study

if TYPE_CHECKING:
    from elastid.experiment.plan.friction import FrictionPlan


def overview(study: Study) -> str:
    """A page of plain text."""
    if study.friction is not None:
        parts = [_robot(study), _friction(study)]
    else:
        about = [_structure(study)] if study.robot is None else [_robot(study), _unknowns(study)]
        parts = [*about, _experiments(study), _plan_of_work(study)]
    return "\n\n".join("\n".join(part) for part in parts)


def _robot(study: Study) -> Iterator[str]:
    robot = study.as_robot()
    elastic = [joint.name for joint in robot.joints if joint.spring is not None or joint.is_flexible]
    yield f"study {study.name}, robot {robot.name}"
    bodies, joints = _plural(len(robot.bodies), "body", "bodies"), _plural(len(robot.joints), "joint")
    yield (
        f"  {bodies}, {joints}, of which {len(robot.driven)} driven "
        f"({', '.join(joint.name for joint in robot.driven)}) and {len(elastic)} elastic ({', '.join(elastic)})"
    )
    yield from _nonlinear(study)
    coordinates = _plural(len((*robot.joints, *robot.flexible)), "coordinate")
    loops = (
        f", {_plural(len(robot.loops), 'loop')} ({', '.join(loop.name for loop in robot.loops)})" if robot.loops else ""
    )
    formulation = study.model.formulation or ("constrained" if robot.loops else "serial")
    variant = "" if study.model.variant == "exact" else f" ({study.model.variant})"
    carried = "" if robot.payload is None else f", carries {robot.payload.mass:g} kg at {robot.payload.at}"
    yield f"  {coordinates}{loops}, {formulation} model{variant}{carried}"
    motors = ((joint.name, joint.motor) for joint in robot.driven)
    if riding := [f"{name} on {motor.on}" for name, motor in motors if motor is not None and motor.on]:
        yield f"  motors that ride on bodies: {', '.join(riding)}"
    if robot.gears:
        yield f"  coupled gears: {', '.join(f'motor {gear.motor} with joint {gear.joint}' for gear in robot.gears)}"


def _nonlinear(study: Study) -> Iterator[str]:
    springs = {joint.name: joint.spring for joint in study.as_robot().joints if joint.spring is not None}
    if bent := [name for name, spring in springs.items() if not spring.is_linear]:
        yield f"  nonlinear springs: {', '.join(bent)}; the fit uses their tangent under gravity"
    if gaps := [f"{name} (+-{spring.backlash:.3g})" for name, spring in springs.items() if spring.backlash is not None]:
        yield f"  backlash: {', '.join(gaps)}; take configurations in which gravity loads these joints"
    for compensator in study.as_robot().compensators:
        kind = "coil" if compensator.coil is not None else "gas spring"
        yield f"  compensator {compensator.name}: {kind} from {' to '.join(end.body for end in compensator.ends)}"


def _structure(study: Study) -> Iterator[str]:
    source = "responses from elsewhere" if study.experiment.responses is not None else "responses of recorded logs"
    yield f"study {study.name}, no robot: {source}"
    channels = study.experiment.channels
    if not channels:
        yield "  its files name the inputs and outputs"
        return
    for role, noun in (("u", "input"), ("y", "output")):
        ours = [channel for channel in channels if channel.role == role]
        places = (f"{channel.at} ({channel.quantity}{f', {channel.unit}' if channel.unit else ''})" for channel in ours)
        yield f"  {_plural(len(ours), noun)}: {', '.join(places)}"


def _unknowns(study: Study) -> Iterator[str]:
    parameters = choose(study.fit, study.as_robot(), tuple(study.experiment.configurations))
    if robots := [f"{name} ({', '.join(names)})" for name, names in study.fit.robots.items()]:
        yield f"{_plural(len(robots), 'robot')} of this type: {', '.join(robots)}"
    yield _plural(len(parameters.free), "unknown")
    rows = [("  name", "start", "lower", "upper", "unit")]
    rows += [
        ("  " + p.name, f"{p.value:.5g}", f"{p.lower:.5g}", f"{p.upper:.5g}", p.unit + _prior(p))
        for p in parameters.free
    ]
    yield from columns(rows)
    if ties := [f"{p.name} = {p.tie.factor:g} {p.tie.to}" for p in parameters if p.tie is not None]:
        yield f"  tied: {', '.join(ties)}"
    if more := len(with_tolerances(parameters, study.as_robot(), study.fit).free) - len(parameters.free):
        yield f"  {_plural(more, 'number')} of the robot's file may move within tolerances (robot.tolerances)"


def _prior(parameter: Parameter) -> str:
    return "" if parameter.prior is None else f"  (prior {parameter.prior.mean:g}, std {parameter.prior.std:g})"


def _experiments(study: Study) -> Iterator[str]:
    experiment, excitation = study.experiment, study.excitation
    names = ", ".join(experiment.configurations)
    if experiment.recorded is not None:
        configurations = _plural(len(experiment.configurations), "configuration")
        yield f"{_plural(len(experiment.recorded.files), 'log file')} of {configurations} ({names})"
        return
    if experiment.responses is not None:
        files = _plural(len(experiment.responses.files), "frequency response")
        yield f"{files} from elsewhere of {_plural(len(experiment.configurations), 'configuration')} ({names})"
        return
    E, M = experiment.runs(len(study.as_robot().driven)), experiment.realisations
    Q = len(experiment.configurations)
    if study.design is not None:
        if study.design.robot_time is not None:
            given = f"{_plural(Q, 'configuration')} ({names}) and " if Q else ""
            yield f"{study.design.robot_time:g} s of the robot's time: {given}as many as fit into it"
            return
        chosen = study.design.count or 0
        Q, names = Q + chosen, ", ".join(filter(None, (names, f"{chosen} to be chosen")))
    L = 1 if excitation is None else len(excitation.levels)
    factors = [f"{_plural(Q, 'configuration')} ({names})", _plural(M, "realisation"), _plural(E, "experiment")]
    factors[1:1] = [_plural(L, "amplitude")] if L > 1 else []
    yield f"{_plural(Q * L * M * E, 'experiment')}: {' x '.join(factors)}"
    if excitation is not None:
        yield from _run(study.as_robot(), experiment, excitation, Q * L * M * E)
        yield from _signal(study, excitation)


def _run(robot: Robot, experiment: ExperimentSpec, excitation: MultisineSpec, runs: int) -> Iterator[str]:
    periods = experiment.periods + experiment.transient_periods
    duration = periods * excitation.period + 2 * (experiment.ramp + experiment.hold)
    yield (
        f"  {_plural(periods, 'period')} of {excitation.period:g} s each ({experiment.transient_periods} of transient) "
        f"with ramps of {experiment.ramp:g} s, {runs * duration:g} s of the robot's time, movements between not counted"
    )
    carrier = experiment.simulated.carrier if experiment.simulated is not None else None
    if carrier is None:
        yield "  the robot rests in each configuration: sticking friction then looks like stiffness"
    else:
        yield f"  carrier: {carrier.kind}, {_speed(carrier, robot)}"


def _speed(carrier: CarrierSpec, robot: Robot) -> str:
    """How far or how fast each joint goes, with its unit; stated once where all are the same."""
    sine, n_u = carrier.kind == "sine", len(robot.driven)
    values = carrier.amplitudes(n_u) if sine else carrier.velocities(n_u)
    each = [f"{v:.3g} {joint.unit}{'' if sine else '/s'}" for v, joint in zip(values, robot.driven, strict=True)]
    stated = each[:1] if len(set(each)) == 1 else each
    return f"{'amplitude' if sine else 'velocity'} {', '.join(stated)}"


def _signal(study: Study, excitation: MultisineSpec) -> Iterator[str]:
    lines = planned_lines(excitation, study.seed)
    low, high = excitation.band_hz
    free = f" and {len(lines.detection)} left free for detection" if len(lines.detection) else ""
    yield (
        f"  {len(lines.excited)} {excitation.grid} lines{free} from {low:g} to {high:g} Hz, sampled at "
        f"{excitation.rate_hz:g} Hz"
    )
    as_large = "scaled to the limits" if excitation.torque_rms == "limits" else "as given, lowered where limits ask"
    informative = "spectra with the most information about the parameters"
    shaped = informative if excitation.flat == "information" else f"flat in {excitation.flat}"
    yield (
        f"  {excitation.phases} phases, {excitation.orthogonal} set, {shaped}, {as_large} "
        f"({excitation.margin:.0%} of every limit stays free)"
    )


def _plan_of_work(study: Study) -> Iterator[str]:
    first = {
        "simulated": "design, simulate the experiments, estimate the responses",
        "recorded": "import the logs, estimate the responses",
        "responses": "import the responses",
    }[study.experiment.kind]
    if study.robot is None:
        yield f"will {first} in {study.estimator.quantity} per input, find their modes, write the report"
        return
    left_out = study.validation.left_out
    judged = f"judge it on {', '.join(left_out)}, not fitted" if left_out else "judge it on the fitted configurations"
    judged = f"lay its gears open, {judged}" if study.gears is not None else judged
    log_first = "logarithmic criterion first, then " if study.fit.log_first and study.fit.criterion != "log" else ""
    yield (
        f"will {first} in {study.estimator.quantity}, fit from {_plural(study.fit.starts, 'start')} "
        f"({log_first}{study.fit.criterion}), {judged}, write the report"
    )


def _friction(study: Study) -> Iterator[str]:
    """Plain text below the lines on the robot; StudyError where a simulated study cannot be planned."""
    joints, recorded = study.friction_joints, study.experiment.recorded
    yield f"friction of joint{'s' if len(joints) > 1 else ''} {', '.join(joint.name for joint in joints)}"
    if recorded is not None:
        yield f"  {_plural(len(recorded.files), 'log file')}; passes are found in them, the rest is regressed"
        if stated := [f"{file.path}: {file.speed:.4g}" for file in recorded.files if file.speed is not None]:
            yield f"  speeds given (SI): {', '.join(stated)}"
    else:
        from elastid.design.friction import design_friction  # brings CasADi, which other overviews do not need

        yield from _motions(
            design_friction(study.as_friction(), joints, study.experiment, study.as_robot(), study.seed)
        )
    yield ""
    yield (
        f"will {'import the logs' if recorded is not None else 'plan and simulate the motions'}, find the levels, "
        "identify the law, write identified_robot.yml and the report"
    )


def _motions(plan: FrictionPlan) -> Iterator[str]:
    for design in plan.designs:
        unit = design.limits.unit
        low, high = design.limits.window
        speeds = ", ".join(
            f"{speed:.3g}" + (f" ({round(count)} times)" if count > 1 else "")
            for speed, count in zip(design.speed.tolist(), design.passes.tolist(), strict=True)
        )
        yield f"  joint {design.joint}: window {low:.4g} to {high:.4g} {unit}, speeds in {unit}/s: {speeds}"
    kinds = [motion.purpose for motion in plan.motions]
    names = {"passes": "passes there and back", "loops": "logs of loops", "at_rest": "multisines at rest"}
    counted = [f"{kinds.count(kind)} {name}" for kind, name in names.items() if kind in kinds]
    counted += [f"{len(plan.warm_ups)} warm-up{'s' if len(plan.warm_ups) > 1 else ''}"] if plan.warm_ups else []
    yield f"  {', '.join(counted)}, {plan.robot_time_s / 60:.3g} min of the robot's time"
    yield "will be known:"
    yield from (f"  {sentence}" for sentence in plan.known)
    if plan.unknown:
        yield "will not be known:"
        yield from (f"  {sentence}" for sentence in plan.unknown)


def _plural(number: int, noun: str, plural: str = "") -> str:
    return f"{number} {noun if number == 1 else plural or noun + 's'}"
