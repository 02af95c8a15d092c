"""The section `design` against robot, experiment and fit: room in the robot time, candidates, earlier measurements."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from elastid.base.errors import StudyError, did_you_mean
from elastid.design.spec import CandidateSpec, DesignSpec, interest, robot_time_refusal
from elastid.fit.parameter_choice import choose
from elastid.study.checks.names import check_units
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath

_DESIGN: KeyPath = ("design",)
_CANDIDATES: KeyPath = ("design", "candidates")


def check_design(study: Study, base: Path) -> Iterator[Problem]:
    """Every contradiction between the design and the rest of the study, whose files are relative to `base`."""
    design = study.design
    if design is None:
        if not study.experiment.configurations:
            problem = "no configuration is given; name at least one, or add a section `design` that chooses them"
            yield Problem(("experiment", "configurations"), problem)
        return
    if study.experiment.recorded is not None:
        problem = "the experiment is recorded: what was measured cannot be chosen any more; drop this section"
        yield Problem(_DESIGN, problem, at_key=True)
    if study.excitation is not None and study.experiment.simulated is not None:
        n_u = len(study.as_robot().driven)
        if refused := robot_time_refusal(design, study.excitation, study.experiment, n_u):
            yield Problem((*_DESIGN, "robot_time"), refused)
    yield from _check_parameters(study, design)
    yield from _check_candidates(study, design.candidates)
    earlier: list[tuple[KeyPath, str]] = [((*_DESIGN, "measured", i), path) for i, path in enumerate(design.measured)]
    if design.noise.frf:
        earlier.append(((*_DESIGN, "noise", "frf"), design.noise.frf))
    for place, path in earlier:
        if not os.path.isfile(responses_file(base, path)):
            problem = f"no such measurement (looked for {responses_file(base, path)}); `elastid estimate` makes it"
            yield Problem(place, problem)


def responses_file(base: Path, path: str) -> Path:
    """The frf.h5 that a run folder or a file stands for."""
    given = base / path
    return given / "frf.h5" if os.path.isdir(given) or not given.suffix else given


def _check_parameters(study: Study, design: DesignSpec) -> Iterator[Problem]:
    try:
        names = choose(study.fit, study.as_robot()).free_names
    except StudyError:
        return  # reported where fit.parameters is checked
    for i, pattern in enumerate(design.parameters):
        try:
            interest(names, [pattern])
        except StudyError as error:
            yield Problem((*_DESIGN, "parameters", i), str(error))


def _check_candidates(study: Study, spec: CandidateSpec) -> Iterator[Problem]:
    robot = study.as_robot()
    if isinstance(spec.grid, tuple) and (refused := robot.count_refusal(len(spec.grid), "numbers")):
        yield Problem((*_CANDIDATES, "grid"), refused)
    yield from check_units((*_CANDIDATES, "margin"), spec.margin, robot)
    for name, angles in spec.given.items():
        path: KeyPath = (*_CANDIDATES, "given", name)
        yield from check_units(path, angles, robot)
        if refused := robot.count_refusal(len(angles)):
            yield Problem(path, refused)
        if name in study.experiment.configurations:
            yield Problem(path, f"{name} is a configuration of experiment.configurations already; rename one", True)
    bodies = [body.name for body in robot.bodies]
    for name in spec.points:
        if name not in bodies:
            message = f"no body is called '{name}'; {did_you_mean(name, bodies)}"
            yield Problem((*_CANDIDATES, "points", name), message, at_key=True)
