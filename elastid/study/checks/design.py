"""What only the sections together can tell about a study's design."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from elastid.base.errors import StudyError, did_you_mean
from elastid.design.robot_time import robot_time_refusal
from elastid.design.spec import DesignSpec, interest
from elastid.fit.setup.parameter_choice import choose
from elastid.study.messages import Problem
from elastid.study.sections import Study, check_file_name
from elastid.study.yaml_source import KeyPath

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
        refused = robot_time_refusal(design, study.excitation, study.experiment, len(study.robot.driven))
        if refused:
            yield Problem((*_DESIGN, "robot_time"), refused)
    yield from _parameters(study, design)
    yield from _candidates(study, design)
    earlier: list[tuple[KeyPath, str]] = [((*_DESIGN, "measured", i), path) for i, path in enumerate(design.measured)]
    if design.noise.frf:
        earlier.append(((*_DESIGN, "noise", "frf"), design.noise.frf))
    for place, path in earlier:
        if not responses_file(base, path).is_file():
            problem = f"no such measurement (looked for {responses_file(base, path)}); `elastid estimate` makes it"
            yield Problem(place, problem)


def responses_file(base: Path, path: str) -> Path:
    """The frf.h5 that a run folder or a file stands for."""
    given = base / path
    return given / "frf.h5" if given.is_dir() or not given.suffix else given


def chosen_names(study: Study) -> list[str]:
    """Names that configurations chosen by the design may get."""
    if study.design is None:
        return []
    numbered = study.design.count or 99
    return [*study.design.candidates.given, *(f"c{i + 1}" for i in range(numbered))]


def _parameters(study: Study, design: DesignSpec) -> Iterator[Problem]:
    try:
        names = choose(study.fit, study.robot).free_names
    except StudyError:  # said where fit.parameters is checked
        return
    for i, pattern in enumerate(design.parameters):
        try:
            interest(names, [pattern])
        except StudyError as error:
            yield Problem((*_DESIGN, "parameters", i), str(error))


def _candidates(study: Study, design: DesignSpec) -> Iterator[Problem]:
    spec, robot = design.candidates, study.robot
    refused = robot.count_refusal(len(spec.grid), "numbers") if isinstance(spec.grid, tuple) else ""
    if refused:
        yield Problem((*_CANDIDATES, "grid"), refused)
    for name, angles in spec.given.items():
        path: KeyPath = (*_CANDIDATES, "given", name)
        try:
            check_file_name(name)
        except ValueError as error:
            yield Problem(path, str(error), at_key=True)
        if refused := robot.count_refusal(len(angles)):
            yield Problem(path, refused)
        if name in study.experiment.configurations:
            yield Problem(path, f"{name} is the name of a configuration under experiment.configurations already", True)
    bodies = [body.name for body in study.robot.bodies]
    for name in spec.points:
        if name not in bodies:
            known = did_you_mean(name, bodies)
            yield Problem((*_CANDIDATES, "points", name), f"no body is called '{name}'; {known}", at_key=True)
