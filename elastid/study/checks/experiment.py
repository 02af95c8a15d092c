"""`experiment`, `excitation`, `estimator` and `design` against each other and the robot, and studies without one."""

from collections.abc import Iterator

import numpy as np

from elastid.base.errors import StudyError
from elastid.base.names import posture_of
from elastid.excitation.spec import planned_lines
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.study.checks.names import check_names, check_units, refusal_of
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath

_SIMULATED: KeyPath = ("experiment", "simulated")


def check_count(study: Study) -> Iterator[Problem]:
    """Yield problems unless a realisation has at most as many experiments as motors, and enough for the estimator."""
    experiment, estimator = study.experiment, study.estimator
    count, n_u, path = experiment.experiments, len(study.as_robot().driven), ("experiment", "experiments")
    if count is None or experiment.simulated is None:
        return
    min_count = estimator.experiments_needed(n_u, experiment.realisations)
    if not min_count <= count <= n_u:
        text = f"{count} experiments in each of {experiment.realisations} realisations; estimator.method"
        yield Problem(path, f"{text} {estimator.method} needs {min_count} to {n_u} for {n_u} motors")


def check_configurations(study: Study) -> Iterator[Problem]:
    """Check that angles are one for each driven joint, in its unit and limits with the swing, and that loops close."""
    for name, angles in study.experiment.configurations.items():
        path = ("experiment", "configurations", name)
        if posture_of(name) != name:
            text = "names of configurations must not end in `amplitude` and a number. Rename it"
            yield Problem(path, text, at_key=True)
        if refusal := study.places.count_refusal(len(angles)):
            yield Problem(path, refusal)
            continue
        if (robot := study.robot) is None:
            continue
        refusals = [
            joint.refusal_of(angle) or joint.position_refusal(angle, swing)
            for angle, joint, swing in zip(angles, robot.driven, _swings(study), strict=True)
        ]
        yield from (Problem((*path, i), refusal) for i, refusal in enumerate(refusals) if refusal)
        if robot.loops and not any(refusals):
            from elastid.model.closed_posture import assemble  # imports CasADi, needed only for loops

            if refusal := refusal_of(assemble, robot, np.array(angles, dtype=float)):
                yield Problem(path, refusal)


def check_payload(study: Study) -> Iterator[Problem]:
    """Check that configurations without a payload exist, and so does the payload."""
    names, path = study.experiment.without_payload, ("experiment", "without_payload")
    yield from check_names(path, "configuration", names, list(study.experiment.configurations))
    if names and study.as_robot().payload is None:
        yield Problem(path, "the robot model has no payload. Add the weighed payload, or remove this key")


def _swings(study: Study) -> list[float]:
    """Return amplitude of the superimposed slow motion at each driven joint; 0 without one, or for a wrong count."""
    n_u, simulated = len(study.as_robot().driven), study.experiment.simulated
    carrier = None if simulated is None else simulated.carrier
    if carrier is None or carrier.amplitude is None or np.size(carrier.amplitude) not in (1, n_u):
        return [0.0] * n_u
    return list(carrier.amplitudes(n_u).tolist())


def check_simulated(study: Study, simulated: SimulatedSpec) -> Iterator[Problem]:
    """Convert gains and superimposed slow motion to the joints' units; the stage checks the rest."""
    robot, carrier = study.as_robot(), simulated.carrier
    yield from _check_controller(study, simulated)
    if carrier is not None:
        yield from check_units((*_SIMULATED, "carrier", "amplitude"), carrier.amplitude, robot)
        yield from check_units((*_SIMULATED, "carrier", "velocity"), carrier.velocity, robot)


def _check_controller(study: Study, simulated: SimulatedSpec) -> Iterator[Problem]:
    controller, path = simulated.controller, (*_SIMULATED, "controller")
    if study.friction is not None and (controller.gains is not None or controller.delay_samples):
        key = "gains" if controller.gains is not None else "delay_samples"
        yield Problem((*path, key), "friction studies design their runs with bandwidth_hz. Remove this key")
    if (study.excitation is None or study.excitation.inject == "torque") != (controller.reference is None):
        key = "excitation.inject: position or velocity"
        yield Problem((*path, "reference"), f"{key} and the path of the references go together. Give both or neither")
    elif (excitation := study.excitation) is not None and controller.reference is not None:
        N, highest_hz = excitation.period_samples, excitation.band_hz[1]
        if refusal := controller.reference.cycle_refusal(excitation.rate_hz, N, highest_hz):
            yield Problem((*path, "reference", "cycle"), refusal)
        if controller.reference.unit == "increments" and not simulated.noise.encoder_counts:
            text = "increments need the counts of a motor turn. Give experiment.simulated.noise.encoder_counts"
            yield Problem((*path, "reference", "unit"), text)
    if study.friction is None and controller.gains is not None and study.excitation is not None:
        for keys, refusal in controller.gains.refusals(study.as_robot().driven_names, study.excitation.rate_hz):
            yield Problem((*path, "gains", *keys), refusal)


def check_structure(study: Study) -> Iterator[Problem]:
    """Yield every contradiction between the sections of a study without a robot, its files and channels excepted."""
    if study.experiment.simulated is not None:
        message = "the experiment is simulated and needs a robot. Give the path of its file"
        yield Problem(("robot",), message, at_key=True)
        return
    if not study.experiment.configurations:
        message = "no configuration is given; name each state of the structure that was measured, for example"
        yield Problem(("experiment", "configurations"), f"{message} {{bench: []}}")
    yield from check_configurations(study)


def check_excitation(study: Study) -> Iterator[Problem]:
    """Check torques for each motor in its unit, and bands with excited lines; the design checks the rest."""
    excitation = study.excitation
    if excitation is None or study.experiment.simulated is None:
        return
    for i, torque_rms in enumerate(excitation.amplitudes):
        path: KeyPath = ("excitation", "torque_rms", *((i,) if len(excitation.amplitudes) > 1 else ()))
        yield from check_units(path, torque_rms, study.as_robot())
    try:
        lines = planned_lines(excitation, study.seed)
    except StudyError as error:
        yield Problem(("excitation", "lines" if excitation.grid == "lines" else "band_hz"), str(error))
        return
    freq_hz, carrier = lines.excited / excitation.period, study.experiment.simulated.carrier
    if carrier is not None:
        lowest, n_u = int(min(*lines.excited, *lines.detection)), len(study.as_robot().driven)
        if refusal := carrier.refusal(n_u, lowest):
            yield Problem((*_SIMULATED, "carrier"), refusal)
    for key, band in (("estimator", study.estimator.band_hz), ("fit", study.fit.band_hz)):
        if band is not None and not any(band[0] <= f <= band[1] for f in freq_hz):
            text = f"none of the excited lines from {freq_hz[0]:g} to {freq_hz[-1]:g} Hz is within [{band[0]:g},"
            advice = "Widen this band, or excite lines in it"
            yield Problem((key, "band_hz"), f"{text} {band[1]:g}] Hz. {advice}")


_CANDIDATES: KeyPath = ("design", "candidates")


def check_design(study: Study) -> Iterator[Problem]:
    """Check that candidates are new and in units of the joints."""
    design = study.design
    if design is None:
        if not study.experiment.configurations:
            problem = "no configuration is given. Name at least one, or add a section `design` that chooses them"
            yield Problem(("experiment", "configurations"), problem)
        return
    yield from check_units((*_CANDIDATES, "margin"), design.candidates.margin, study.as_robot())
    for name, angles in design.candidates.given.items():
        yield from check_units((*_CANDIDATES, "given", name), angles, study.as_robot())
        if name in study.experiment.configurations:
            text = f"{name} is a configuration of experiment.configurations already; rename one"
            yield Problem((*_CANDIDATES, "given", name), text, True)
