"""What only the sections together can tell: names that must exist, counts that must agree, limits, files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from elastid.base.errors import StudyError, did_you_mean
from elastid.excitation.grids import line_count_refusal
from elastid.excitation.lines import planned_lines
from elastid.excitation.phases import hadamard
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.recorded import ChannelSpec, FileSpec, RecordedSpec
from elastid.experiment.specs.responses import ResponseFileSpec, ResponsesSpec
from elastid.experiment.specs.simulated import carrier_refusal
from elastid.fit.setup.groups import OF
from elastid.fit.setup.parameter_choice import choose, named_geometry
from elastid.fit.spec import FactorSpec, MaskSpec
from elastid.robot import Joint
from elastid.study.checks.design import check_design, chosen_names
from elastid.study.messages import Problem
from elastid.study.sections import Study, check_file_name
from elastid.study.yaml_source import KeyPath

# Without limits, angles in rad and positions in m beyond which a unit was forgotten: two turns, and a long rail.
_FARTHEST = {False: 4 * math.pi, True: 50.0}


def check(study: Study, base: Path) -> Iterator[Problem]:
    """Every contradiction between the sections of a study whose files are relative to `base`."""
    yield from _formulation(study)
    yield from _excitation(study)
    yield from _experiments(study)
    yield from _configurations(study)
    yield from _units_of_motors(study)
    yield from check_design(study, base)
    yield from _references(study)
    yield from _hardware(study)
    yield from _geometry(study)
    if study.experiment.recorded is not None:
        yield from _files(study.experiment.recorded, study, base)
        yield from _channels(study.experiment.recorded.channels, study)
    if study.experiment.responses is not None:
        yield from _response_files(study.experiment.responses, study, base)
        yield from _channels(study.experiment.responses.channels, study)


def line_problems(study: Study) -> Iterator[Problem]:
    """Enough lines for an orthogonal set and for the unknowns; some in each band; none where the carrier is."""
    excitation, simulated = study.excitation, study.experiment.simulated
    if excitation is None or simulated is None:
        return
    path: KeyPath = ("excitation", "lines" if excitation.grid == "lines" else "band_hz")
    try:
        planned = planned_lines(excitation, study.seed)
        lines = planned.excited
        unknowns = len(choose(study.fit, study.robot).free)
    except StudyError as error:
        yield Problem(path, str(error))
        return
    needed, noun = max((len(study.robot.driven), "motors"), (unknowns, "unknowns"))
    if refused := line_count_refusal(len(lines), needed, noun):
        yield Problem(path, refused)
    freq_hz = lines / excitation.period
    for key, band in (("estimator", study.estimator.band_hz), ("fit", study.fit.band_hz)):
        if band is not None and not any(band[0] <= f <= band[1] for f in freq_hz):
            yield Problem(
                (key, "band_hz"),
                f"none of the excited lines from {freq_hz[0]:g} to {freq_hz[-1]:g} Hz is within [{band[0]:g}, "
                f"{band[1]:g}] Hz; nothing would be left",
            )
    if simulated.carrier is not None:
        analysed = np.concatenate([lines, planned.detection])
        refused = carrier_refusal(simulated.carrier, analysed, 1 / excitation.period, len(study.robot.driven))
        if refused:
            yield Problem(("experiment", "simulated", "carrier"), refused)


def _formulation(study: Study) -> Iterator[Problem]:
    """A tree is serial, loops are not; independent coordinates are coordinates."""
    robot, simulated = study.robot, study.experiment.simulated
    coordinates = [f"joint {joint.name}" for joint in robot.joints] + [
        f"motor {joint.name}" for joint in robot.flexible
    ]
    for i, name in enumerate(study.model.independent):
        if name not in coordinates:
            yield _unknown(("model", "independent", i), "coordinate", name, coordinates)
    for path, spec in (
        (("model",), study.model),
        (("experiment", "simulated", "model"), simulated.model if simulated is not None else study.model),
    ):
        if spec.formulation == "serial" and robot.loops:
            loops = ", ".join(loop.name for loop in robot.loops)
            yield Problem(
                (*path, "formulation"), f"robot {robot.name} has loops ({loops}); take constrained or minimal"
            )
            return


def _excitation(study: Study) -> Iterator[Problem]:
    excitation = study.excitation
    if excitation is None:
        if study.experiment.simulated is not None:
            yield Problem(("excitation",), "this section is needed where the experiment is simulated", at_key=True)
        return
    yield from _realisations(study, excitation)
    torque_rms = excitation.torque_rms
    refused = study.robot.count_refusal(len(torque_rms), "torques") if isinstance(torque_rms, tuple) else ""
    if refused:
        yield Problem(("excitation", "torque_rms"), f"{refused}, or one for all")


def _hardware(study: Study) -> Iterator[Problem]:
    """Torque limits to clip at; a chain that the simulated rig can have; temperatures that friction bears."""
    simulated, driven = study.experiment.simulated, study.robot.driven
    if simulated is None:
        return
    path: KeyPath = ("experiment", "simulated")
    if simulated.saturation and all(math.isinf(joint.limits.torque) for joint in driven):
        yield Problem(
            (*path, "saturation"),
            "no joint has a limit of its torque, so that nothing can be clipped; give limits: {torque: ...} in the "
            "robot's file",
        )
    if study.robot.chain.differentiator is not None:
        yield Problem(
            path,
            "the simulated rig logs positions, which nothing differentiates; leave it out of the robot's chain",
            at_key=True,
        )
    warming = simulated.warming
    if warming is None or warming.temperature is None:
        return
    from elastid.friction.robot_friction import frictions  # brings CasADi, which few checks need

    laws = [law for law in frictions(study.robot) if law.spec.temperature is not None]
    if not laws:
        yield Problem(
            (*path, "warming", "temperature"),
            "no friction of the robot depends on temperature; give a `temperature` to its friction, or leave this out",
        )
    for law in laws:
        for temperature in warming.temperature:
            try:
                law.curve(0.0, temperature)
            except ValueError as error:
                yield Problem((*path, "warming", "temperature"), str(error))


def _geometry(study: Study) -> Iterator[Problem]:
    """Coordinates that are to be identified start where the robot can stand, and keep the ends of springs apart."""
    if not named_geometry(study.fit.parameters, study.robot):
        return
    from elastid.fit.setup.geometry import refusals  # brings CasADi, which few checks need

    configurations = study.experiment.configurations
    if any(study.robot.count_refusal(len(angles)) for angles in configurations.values()):
        return  # said elsewhere
    try:
        parameters = choose(study.fit, study.robot, tuple(configurations))
    except StudyError:
        return  # said elsewhere
    for name, message in refusals(parameters, study.robot, configurations):
        keys = [key for key in study.fit.parameters if fnmatchcase(name.partition("@")[0], key)]
        yield Problem(("fit", "parameters", *keys[-1:]), message)
        return


def _realisations(study: Study, excitation: MultisineSpec) -> Iterator[Problem]:
    """Signals that are drawn once can be realised once; Hadamard matrices are not there for every robot."""
    if study.experiment.realisations > 1 and not excitation.is_new_in_every_realisation:
        yield Problem(
            ("excitation", "phases"),
            f"{excitation.phases} gives the same signal in each of {study.experiment.realisations} realisations, which "
            "tells nothing about nonlinear distortion; set experiment.realisations: 1, or random or optimised phases",
        )
    try:
        if excitation.orthogonal == "hadamard":
            hadamard(len(study.robot.driven))
    except StudyError as error:
        yield Problem(("excitation", "orthogonal"), str(error))


def _experiments(study: Study) -> Iterator[Problem]:
    """As many experiments in a realisation as motors at most, and enough for the estimator."""
    experiment, excitation = study.experiment, study.excitation
    given, n_u, path = experiment.experiments, len(study.robot.driven), ("experiment", "experiments")
    if given is None:
        return
    if experiment.simulated is None:
        yield Problem(
            path, f"the experiment is {experiment.kind}: its files say how many there are; drop this key", True
        )
        return
    if given > n_u:
        yield Problem(
            path,
            f"{given} experiments in a realisation, but an orthogonal set for {n_u} motors has {n_u}; give {n_u} at "
            "most, and more realisations instead",
        )
    needed = study.estimator.experiments_needed(n_u, experiment.realisations)
    if given < needed:
        yield Problem(
            path,
            f"{given} experiments in each of {experiment.realisations} realisations, but estimator.method "
            f"{study.estimator.method} needs at least {needed} to tell {n_u} motors apart; give {needed}, or take "
            "estimator.method local_rational, local_polynomial or auto",
        )
    if excitation is None or given >= n_u or excitation.orthogonal == "zippered":
        return
    if not excitation.is_new_in_every_realisation:
        yield Problem(
            path,
            f"with {excitation.phases} phases all motors move in proportion in each of {given} experiments, so that "
            f"neighbouring lines do not tell {n_u} motors apart; take random phases, orthogonal: zippered, or {n_u} "
            "experiments",
        )


def _configurations(study: Study) -> Iterator[Problem]:
    """One angle for each driven joint, within its limits, the carrier's swing included."""
    driven, simulated = study.robot.driven, study.experiment.simulated
    carrier = simulated.carrier if simulated is not None else None
    n_u = len(driven)
    fits = carrier is not None and np.size(0.0 if carrier.amplitude is None else carrier.amplitude) in (1, n_u)
    swings = carrier.amplitudes(n_u).tolist() if carrier is not None and fits else [0.0] * n_u
    for name, angles in study.experiment.configurations.items():
        path: KeyPath = ("experiment", "configurations", name)
        try:
            check_file_name(name)
        except ValueError as error:
            yield Problem(path, str(error), at_key=True)
        if refused := study.robot.count_refusal(len(angles)):
            yield Problem(path, refused)
            continue
        for i, (angle, joint, swing) in enumerate(zip(angles, driven, swings, strict=True)):
            wrong = joint.refusal_of(angle)
            if wrong:
                yield Problem((*path, i), wrong)
                continue
            low, high = joint.limits.angle
            if math.isinf(high - low) and abs(angle) > _FARTHEST[joint.slides]:
                yield Problem((*path, i), _too_far(joint, angle))
                continue
            if not low <= angle - swing <= angle + swing <= high:
                reach = f" with the carrier's {swing:.4g} {joint.unit} to either side" if swing else ""
                yield Problem(
                    (*path, i),
                    f"joint {joint.name} at {angle:.4g} {joint.unit}{reach} is outside its limits [{low:.4g}, "
                    f"{high:.4g}] {joint.unit}",
                )


def _too_far(joint: Joint, angle: float) -> str:
    other = f"{angle:g} mm" if joint.slides else f"{angle:g} deg"
    far = f"{angle:g} m" if joint.slides else f"{angle:g} rad, {abs(angle) / (2 * math.pi):.2g} turns,"
    return (
        f"joint {joint.name} at {far} is farther than robots go; a number without a unit is in {joint.unit}: write "
        f"'{other}' if that is meant, or give the joint its limits"
    )


def _units_of_motors(study: Study) -> Iterator[Problem]:
    """What is given for all motors or for each has the unit of its joint's motion."""
    driven, simulated = study.robot.driven, study.experiment.simulated
    carrier = simulated.carrier if simulated is not None else None
    asked = study.excitation.torque_rms if study.excitation is not None else "limits"
    given: list[tuple[KeyPath, object]] = [(("excitation", "torque_rms"), asked)]
    if carrier is not None:
        within: KeyPath = ("experiment", "simulated", "carrier")
        given += [((*within, "amplitude"), carrier.amplitude), ((*within, "velocity"), carrier.velocity)]
    if study.design is not None:
        path: KeyPath = ("design", "candidates")
        given += [((*path, "given", name), angles) for name, angles in study.design.candidates.given.items()]
        given.append(((*path, "margin"), study.design.candidates.margin))
    for path, values in given:
        each = values if isinstance(values, tuple) else (values,) * len(driven)
        for i, (value, joint) in enumerate(zip(each, driven, strict=False)):
            wrong = joint.refusal_of(value) if isinstance(value, float) else ""
            if wrong and isinstance(values, tuple):
                yield Problem((*path, i), wrong)
            elif wrong:
                yield Problem(path, f"{wrong}, or one number for each motor")
                break


def _references(study: Study) -> Iterator[Problem]:
    """Configurations, outputs and inputs that validation, estimator and mask speak of."""
    configurations = list(study.experiment.configurations)
    left_out = study.validation.left_out
    for i, name in enumerate(left_out):
        if name not in configurations:
            yield _unknown(("validation", "left_out", i), "configuration", name, configurations)
    if configurations and study.design is None and set(left_out) >= set(configurations):
        yield Problem(("validation", "left_out"), "every configuration is left out; leave at least one to the fit")
    masked = configurations + chosen_names(study)
    yield from _groups(study, masked)
    inputs, outputs = _inputs(study), _outputs(study)
    for i, output in enumerate(outputs):
        if study.experiment.simulated is not None:
            yield from _place(study, ("experiment", "simulated", "outputs", i), output)
    asked: list[tuple[KeyPath, MaskSpec | FactorSpec]] = [
        *((("fit", "mask", i), mask) for i, mask in enumerate(study.fit.mask)),
        *((("fit", "weights", "factors", i), factor) for i, factor in enumerate(study.fit.weights.factors)),
    ]
    for path, mask in asked:
        for j, name in enumerate(mask.configurations):
            if name not in masked:
                yield _unknown((*path, "configurations", j), "configuration", name, masked)
        if mask.output and outputs and mask.output not in outputs:
            yield _unknown((*path, "output"), "output", mask.output, outputs)
        if mask.input and mask.input not in inputs:
            yield _unknown((*path, "input"), "input", mask.input, inputs)
    yield from _profiled(study)


def _profiled(study: Study) -> Iterator[Problem]:
    """Parameters whose profile is asked for are identified."""
    if isinstance(study.fit.profile, str):
        return
    try:
        free = choose(study.fit, study.robot, list(study.experiment.configurations)).free_names
    except StudyError:
        return  # told where the parameters are checked
    for i, pattern in enumerate(study.fit.profile):
        if not any(fnmatchcase(name, pattern) for name in free):
            yield _unknown(("fit", "profile", i), "identified parameter", pattern, list(free))


def _groups(study: Study, configurations: list[str]) -> Iterator[Problem]:
    """Robots and other groups hold configurations that there are; where robots are named, each is of one."""
    given: list[tuple[KeyPath, Sequence[str]]] = [
        (("fit", "robots", robot), names) for robot, names in study.fit.robots.items()
    ]
    for key, wish in study.fit.parameters.items():
        per = wish.per if isinstance(wish.per, dict) else {}
        given += [(("fit", "parameters", key, "per", group), names) for group, names in per.items()]
        base, _, one = key.partition(OF)
        each = any(
            p.per == "configuration" for k, p in study.fit.parameters.items() if fnmatchcase(k, base) or k == base
        )
        if one and each and not any(fnmatchcase(name, one) for name in configurations):
            yield _unknown(("fit", "parameters", key), "configuration", one, configurations)
    for path, names in given:
        try:
            check_file_name(str(path[-1]))
        except ValueError as error:
            yield Problem(path, str(error), at_key=True)
        for i, name in enumerate(names):
            if name not in configurations:
                yield _unknown((*path, i), "configuration", name, configurations)
    measured = {name for names in study.fit.robots.values() for name in names}
    missing = [name for name in study.experiment.configurations if name not in measured]
    if study.fit.robots and missing:
        problem = f"configuration {', '.join(missing)} is of none of these robots; name it at the one that it is of"
        yield Problem(("fit", "robots"), problem, at_key=True)


def _inputs(study: Study) -> list[str]:
    channels = _channels_of(study)
    return [channel.at for channel in channels if channel.role == "u"] or list(study.robot.motor_locations)


def _channels_of(study: Study) -> tuple[ChannelSpec, ...]:
    recorded, responses = study.experiment.recorded, study.experiment.responses
    return next((kind.channels for kind in (recorded, responses) if kind is not None), ())


def _outputs(study: Study) -> list[str]:
    """None where only a frf.h5 of another run tells them."""
    simulated, channels = study.experiment.simulated, _channels_of(study)
    if channels or study.experiment.kind == "responses":
        return [channel.at for channel in channels if channel.role == "y"]
    return list(simulated.outputs if simulated is not None and simulated.outputs else study.robot.motor_locations)


def _files(recorded: RecordedSpec, study: Study, base: Path) -> Iterator[Problem]:
    """Log files exist, name configurations that exist, and no run of the robot is given twice."""
    configurations = list(study.experiment.configurations)
    seen: dict[tuple[str, int, int], str] = {}
    for i, file in enumerate(recorded.files):
        path: KeyPath = ("experiment", "recorded", "files", i)
        yield from _file(file, path, configurations, base)
        run = (file.configuration, file.realisation, file.experiment)
        if run in seen:
            yield Problem(
                path,
                f"{file.path} and {seen[run]} both claim configuration {run[0]}, realisation {run[1]}, experiment "
                f"{run[2]}; give each file its own realisation or experiment",
            )
        seen[run] = file.path
    yield from _without_file(study, recorded.files)


def _response_files(responses: ResponsesSpec, study: Study, base: Path) -> Iterator[Problem]:
    """Files of responses exist, one for each configuration."""
    configurations = list(study.experiment.configurations)
    seen: dict[str, str] = {}
    for i, file in enumerate(responses.files):
        path: KeyPath = ("experiment", "responses", "files", i)
        yield from _file(file, path, configurations, base)
        if file.configuration in seen:
            yield Problem(
                path,
                f"{seen[file.configuration]} and {file.path} both claim configuration {file.configuration}; one "
                "response of each can be fitted: leave one out, or give it a configuration of its own",
            )
        seen[file.configuration] = file.path
    yield from _without_file(study, responses.files)


def _file(file: FileSpec | ResponseFileSpec, path: KeyPath, configurations: list[str], base: Path) -> Iterator[Problem]:
    if not (base / file.path).is_file():
        where = (base / file.path).parent
        beside = sorted(p.name for p in where.iterdir() if p.is_file()) if where.is_dir() else []
        hint = f"; {did_you_mean(Path(file.path).name, beside[:20])}" if beside else ""
        yield Problem((*path, "path"), f"no such file (looked for {base / file.path}){hint}")
    if file.configuration not in configurations:
        yield _unknown((*path, "configuration"), "configuration", file.configuration, configurations)


def _without_file(study: Study, files: Sequence[FileSpec | ResponseFileSpec]) -> Iterator[Problem]:
    for name in study.experiment.configurations:
        if name not in {file.configuration for file in files}:
            where = f"experiment.{study.experiment.kind}.files"
            path = ("experiment", "configurations", name)
            yield Problem(path, f"no file holds configuration {name}; list one in {where}", True)


def _channels(channels: tuple[ChannelSpec, ...], study: Study) -> Iterator[Problem]:
    """Channels are on the robot, in units of their quantity, and one signal each."""
    seen: set[tuple[str, str, int]] = set()
    for i, channel in enumerate(channels):
        path: KeyPath = ("experiment", study.experiment.kind, "channels", i)
        yield from _channel(channel, path, study)
        # r may be in several files, which it brings into step.
        signal = (channel.role, channel.at, channel.file if channel.role == "r" else 1)
        if signal in seen:
            yield Problem((*path, "at"), f"two channels of role {channel.role} at '{channel.at}'")
        seen.add(signal)


def _channel(channel: ChannelSpec, path: KeyPath, study: Study) -> Iterator[Problem]:
    motors = study.robot.motor_locations
    if channel.role != "y" and channel.at not in motors:
        yield _unknown((*path, "at"), "motor", channel.at, list(motors))
    else:
        yield from _place(study, (*path, "at"), channel.at)
    if channel.unit:
        try:
            channel.unit_factor(study.robot.slides(channel.at) and channel.side == "link")
        except ValueError as error:
            yield Problem((*path, "unit"), str(error))


def _place(study: Study, path: KeyPath, location: str) -> Iterator[Problem]:
    try:
        study.robot.check_location(location)
    except StudyError as error:
        yield Problem(path, str(error))


def _unknown(path: KeyPath, what: str, name: str, known: list[str]) -> Problem:
    return Problem(path, f"no {what} is called '{name}'; {did_you_mean(name, known)}")
