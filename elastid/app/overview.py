"""Summary of a valid study for `elastid check`: robot, parameters, experiments, questions and stages."""

from collections.abc import Iterator

import numpy as np

from elastid.app.stage_table import stages_of_study
from elastid.excitation.spec import MultisineSpec, planned_lines
from elastid.fit.parameter_selection import choose, with_tolerances
from elastid.logs.headings import unit_of_heading
from elastid.study import Study


def overview(study: Study) -> str:
    """Summarise a study in plain text."""
    sections = [study.display.text]
    if study.robot is not None:
        sections.append(study.robot.display.text)
    if study.robot is not None and study.friction is None:
        parameters = choose(study.fit, study.robot, tuple(study.experiment.configurations))
        n_nuisance = len(with_tolerances(parameters, study.robot, study.fit).free) - len(parameters.free)
        may_move = f"\n  {_plural(n_nuisance, 'value')} of the robot model with tolerances (robot.tolerances)"
        sections.append(parameters.display.text + may_move * bool(n_nuisance))
    sections += ["\n".join(_experiments(study)), "\n".join(_questions(study))]
    sections.append(f"stages: {', '.join(stages_of_study(study))}")
    return "\n\n".join(filter(None, sections))


def _experiments(study: Study) -> Iterator[str]:
    """Yield lines on files or on planned experiments, periods and frequencies."""
    experiment, excitation, design = study.experiment, study.excitation, study.design
    Q, names = len(experiment.configurations), ", ".join(experiment.configurations)
    measured = experiment.recorded or experiment.responses
    if measured is not None:
        yield _plural(len(measured.files), "file") + (f" of {_plural(Q, 'configuration')} ({names})" if Q else "")
    if measured is not None or study.friction is not None:
        return
    E, M = experiment.runs(len(study.as_robot().driven)), experiment.realisations
    if design is not None and design.robot_time is not None:
        configurations = f"{_plural(Q, 'configuration')} ({names}) and " if Q else ""
        yield f"{design.robot_time:g} s of the robot's time: {configurations}as many as fit into it"
        return
    if design is not None:
        Q, names = Q + (design.count or 0), ", ".join(filter(None, (names, f"{design.count or 0} to be chosen")))
    L = 1 if excitation is None else len(excitation.amplitudes)
    factors = [f"{_plural(Q, 'configuration')} ({names})", _plural(M, "realisation"), _plural(E, "experiment")]
    factors[1:1] = [_plural(L, "amplitude")] if L > 1 else []
    yield f"{_plural(Q * L * M * E, 'experiment')}: {' x '.join(factors)}"
    if excitation is not None:
        periods, lines = experiment.periods + experiment.transient_periods, planned_lines(excitation, study.seed or 0)
        low, high = lines.excited[[0, -1]] / excitation.period
        yield (
            f"  {_plural(periods, 'period')} of {excitation.period:g} s ({experiment.transient_periods} of transient); "
            f"{len(lines.excited)} {excitation.grid} lines from {low:g} to {high:g} Hz"
        )
        if excitation.inject != "torque" and "limits" not in excitation.amplitudes and experiment.configurations:
            yield _margin(study, excitation)


def _questions(study: Study) -> Iterator[str]:
    """Yield questions on channels: unknown units, torque constants or all gains of exactly 1."""
    recorded = study.experiment.recorded
    channels = () if recorded is None else recorded.channels
    gains = None if recorded is None else recorded.controller
    if gains is not None and {*np.ravel(gains.position_gain), *np.ravel(gains.velocity_gain)} == {1.0}:
        yield "question: experiment.recorded.controller: are all gains 1? Inertia and friction are proportional to them"
    for i, channel in enumerate(channels):
        heading, key = unit_of_heading(channel.channel), f"question: experiment.recorded.channels[{i}]"
        if heading.unknown and channel.scale == 1 and channel.unit_factor(study.places.slides(channel.at)) == 1:
            yield f"{key}.scale: {heading.remedy}"
        if channel.torque_constant == 1:
            yield f"{key}.torque_constant: is it 1 N*m/A? Friction and inertia are proportional to it"


def _margin(study: Study, excitation: MultisineSpec) -> str:
    from elastid.app.stages.design import problem_of  # a slow import
    from elastid.design.limits import expected_use

    problem = problem_of(study)
    use = expected_use(problem.rig(problem.plan(study.experiment)), excitation.margin)
    text = "peak of the slow motion plus peak of the multisine, for loop-gain errors up to 30 %. The stage design"
    return f"  {use.closest}: {text} simulates the runs near a limit"


def _plural(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"
