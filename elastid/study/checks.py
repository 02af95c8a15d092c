"""What only the sections together can tell: names that must exist, counts that must agree, limits, files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from elastid.errors import StudyError
from elastid.experiment.spec import ChannelSpec, RecordedSpec
from elastid.record import MOTION_UNIT
from elastid.study.design_checks import check_design, chosen_names
from elastid.study.messages import Problem
from elastid.study.sections import Study, check_file_name
from elastid.study.types_of_keys import did_you_mean
from elastid.study.yaml_source import KeyPath
from elastid.units import factor

_QUANTITY_UNIT = {**MOTION_UNIT, "torque": "N*m", "current": "A"}


def check(study: Study, base: Path) -> Iterator[Problem]:
    """Every contradiction between the sections of a study whose files are relative to `base`."""
    yield from _excitation(study)
    yield from _configurations(study)
    yield from check_design(study, base)
    yield from _references(study)
    if study.experiment.recorded is not None:
        yield from _files(study.experiment.recorded, study, base)
        yield from _channels(study.experiment.recorded, study)


def _excitation(study: Study) -> Iterator[Problem]:
    excitation, driven = study.excitation, study.robot.driven
    if excitation is None:
        if study.experiment.simulated is not None:
            yield Problem(("excitation",), "this section is needed where the experiment is simulated", at_key=True)
        return
    torque_rms = excitation.torque_rms
    if isinstance(torque_rms, tuple) and len(torque_rms) != len(driven):
        names = ", ".join(joint.name for joint in driven)
        yield Problem(
            ("excitation", "torque_rms"),
            f"{len(torque_rms)} torques for {len(driven)} motors; give one for all or one for each of joints {names}",
        )


def _configurations(study: Study) -> Iterator[Problem]:
    """One angle for each driven joint, within its limits, the carrier's swing included."""
    driven, simulated = study.robot.driven, study.experiment.simulated
    swing = simulated.carrier.amplitude if simulated is not None and simulated.carrier is not None else 0.0
    for name, angles in study.experiment.configurations.items():
        path: KeyPath = ("experiment", "configurations", name)
        try:
            check_file_name(name)
        except ValueError as error:
            yield Problem(path, str(error), at_key=True)
        if len(angles) != len(driven):
            joints = ", ".join(joint.name for joint in driven)
            yield Problem(path, f"{len(angles)} angles for {len(driven)} driven joints ({joints})")
            continue
        for i, (angle, joint) in enumerate(zip(angles, driven, strict=True)):
            low, high = joint.limits.angle
            if not low <= angle - swing <= angle + swing <= high:
                reach = f" with the carrier's {swing:.4g} rad to either side" if swing else ""
                yield Problem(
                    (*path, i),
                    f"joint {joint.name} at {angle:.4g} rad{reach} is outside its limits [{low:.4g}, {high:.4g}] rad",
                )


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
    inputs, outputs = _inputs(study), _outputs(study)
    for i, output in enumerate(outputs):
        if study.experiment.simulated is not None:
            yield from _place(study, ("experiment", "simulated", "outputs", i), output)
    for i, mask in enumerate(study.fit.mask):
        path: KeyPath = ("fit", "mask", i)
        for j, name in enumerate(mask.configurations):
            if name not in masked:
                yield _unknown((*path, "configurations", j), "configuration", name, masked)
        if mask.output and mask.output not in outputs:
            yield _unknown((*path, "output"), "output", mask.output, outputs)
        if mask.input and mask.input not in inputs:
            yield _unknown((*path, "input"), "input", mask.input, inputs)


def _inputs(study: Study) -> list[str]:
    recorded = study.experiment.recorded
    if recorded is None:
        return list(study.robot.motor_locations)
    return [channel.at for channel in recorded.channels if channel.role == "u"]


def _outputs(study: Study) -> list[str]:
    simulated, recorded = study.experiment.simulated, study.experiment.recorded
    if recorded is not None:
        return [channel.at for channel in recorded.channels if channel.role == "y"]
    return list(simulated.outputs if simulated is not None and simulated.outputs else study.robot.motor_locations)


def _files(recorded: RecordedSpec, study: Study, base: Path) -> Iterator[Problem]:
    """Log files exist, name configurations that exist, and no run of the robot is given twice."""
    configurations = list(study.experiment.configurations)
    seen: dict[tuple[str, int, int], str] = {}
    for i, file in enumerate(recorded.files):
        path: KeyPath = ("experiment", "recorded", "files", i)
        if not (base / file.path).is_file():
            where = (base / file.path).parent
            beside = sorted(p.name for p in where.iterdir() if p.is_file()) if where.is_dir() else []
            hint = f"; {did_you_mean(Path(file.path).name, beside[:20])}" if beside else ""
            yield Problem((*path, "path"), f"no such file (looked for {base / file.path}){hint}")
        if file.configuration not in configurations:
            yield _unknown((*path, "configuration"), "configuration", file.configuration, configurations)
        run = (file.configuration, file.realisation, file.experiment)
        if run in seen:
            yield Problem(
                path,
                f"{file.path} and {seen[run]} both claim configuration {run[0]}, realisation {run[1]}, experiment "
                f"{run[2]}; give each file its own realisation or experiment",
            )
        seen[run] = file.path
    for name in configurations:
        if name not in {file.configuration for file in recorded.files}:
            path = ("experiment", "configurations", name)
            yield Problem(path, f"no file holds configuration {name}; list one in experiment.recorded.files", True)


def _channels(recorded: RecordedSpec, study: Study) -> Iterator[Problem]:
    """Channels are on the robot, in units of their quantity, and one signal each."""
    seen: set[tuple[str, str]] = set()
    for i, channel in enumerate(recorded.channels):
        path: KeyPath = ("experiment", "recorded", "channels", i)
        yield from _channel(channel, path, study)
        if (channel.role, channel.at) in seen:
            yield Problem((*path, "at"), f"two channels of role {channel.role} at '{channel.at}'")
        seen.add((channel.role, channel.at))


def _channel(channel: ChannelSpec, path: KeyPath, study: Study) -> Iterator[Problem]:
    motors = study.robot.motor_locations
    if channel.role != "y" and channel.at not in motors:
        yield _unknown((*path, "at"), "motor", channel.at, list(motors))
    else:
        yield from _place(study, (*path, "at"), channel.at)
    if channel.unit:
        try:
            factor(channel.unit, _QUANTITY_UNIT[channel.quantity])
        except ValueError as error:
            yield Problem((*path, "unit"), str(error))


def _place(study: Study, path: KeyPath, location: str) -> Iterator[Problem]:
    try:
        study.robot.check_location(location)
    except StudyError as error:
        yield Problem(path, str(error))


def _unknown(path: KeyPath, what: str, name: str, known: list[str]) -> Problem:
    return Problem(path, f"no {what} is called '{name}'; {did_you_mean(name, known)}")
