"""The summary that `elastid check` prints of a study without errors: robot, unknowns, experiments, stages."""

from __future__ import annotations

from collections.abc import Iterator

from elastid.app.stage_table import stages_of_study
from elastid.base.display import columns
from elastid.excitation.spec import planned_lines
from elastid.fit.parameter_choice import choose, with_tolerances
from elastid.study import Study


def overview(study: Study) -> str:
    """A page of plain text."""
    if study.friction is not None:
        parts = [_robot(study), _friction(study)]
    else:
        about = [_structure(study)] if study.robot is None else [_robot(study), _unknowns(study)]
        parts = [*about, _experiments(study)]
    stages = f"stages: {', '.join(stages_of_study(study))}"
    return "\n\n".join(["\n".join(part) for part in parts] + [stages])


def _robot(study: Study) -> Iterator[str]:
    robot = study.as_robot()
    formulation = study.model.formulation or ("constrained" if robot.loops else "serial")
    variant = "" if study.model.variant == "exact" else f" ({study.model.variant})"
    yield f"study {study.name}, {formulation} model{variant}"
    yield robot.display.text


def _structure(study: Study) -> Iterator[str]:
    source = "responses from elsewhere" if study.experiment.responses is not None else "responses of recorded logs"
    yield f"study {study.name}, no robot: {source}"
    for role, noun in (("u", "input"), ("y", "output")):
        places = [f"{channel.at} ({channel.quantity})" for channel in study.experiment.channels if channel.role == role]
        yield f"  {_plural(len(places), noun)}: {', '.join(places) or 'named by the files'}"


def _unknowns(study: Study) -> Iterator[str]:
    parameters = choose(study.fit, study.as_robot(), tuple(study.experiment.configurations))
    if robots := [f"{name} ({', '.join(names)})" for name, names in study.fit.robots.items()]:
        yield f"{_plural(len(robots), 'robot')} of this type: {', '.join(robots)}"
    yield _plural(len(parameters.free), "unknown")
    table = parameters.display
    yield from (f"  {line}" for line in columns([table.headings, *table.rows]))
    if ties := [f"{p.name} = {p.tie.factor:g} {p.tie.to}" for p in parameters if p.tie is not None]:
        yield f"  tied: {', '.join(ties)}"
    if more := len(with_tolerances(parameters, study.as_robot(), study.fit).free) - len(parameters.free):
        yield f"  {_plural(more, 'number')} of the robot's file may move within tolerances (robot.tolerances)"


def _experiments(study: Study) -> Iterator[str]:
    experiment, excitation = study.experiment, study.excitation
    Q, names = len(experiment.configurations), ", ".join(experiment.configurations)
    measured = experiment.recorded or experiment.responses
    if measured is not None:
        noun = "log file" if experiment.recorded is not None else "response file"
        yield f"{_plural(len(measured.files), noun)} of {_plural(Q, 'configuration')} ({names})"
        return
    E, M = experiment.runs(len(study.as_robot().driven)), experiment.realisations
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
        periods, lines = experiment.periods + experiment.transient_periods, planned_lines(excitation, study.seed or 0)
        low, high = excitation.band_hz
        yield (
            f"  {_plural(periods, 'period')} of {excitation.period:g} s ({experiment.transient_periods} of transient); "
            f"{len(lines.excited)} {excitation.grid} lines from {low:g} to {high:g} Hz"
        )


def _friction(study: Study) -> Iterator[str]:
    joints, recorded = study.friction_joints, study.experiment.recorded
    yield f"friction of joint{'s' if len(joints) > 1 else ''} {', '.join(joint.name for joint in joints)}"
    yield "  simulated" if recorded is None else f"  {_plural(len(recorded.files), 'log file')}"


def _plural(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"
