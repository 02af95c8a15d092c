"""Keys that a kind of study does not use are refused, each at its place."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from elastid.app import scaffold
from elastid.app.stage_table import stages_of
from elastid.base.errors import StudyError
from elastid.experiment.specs.recorded import ResponseFileSpec, ResponsesSpec
from elastid.friction_study.spec import LoadSpec
from elastid.study import Study, load
from elastid.study.checks import UNUSED, check_unused

# Overrides of templates that make a study of each kind.
TEMPLATES = {
    "simulated": "serial",
    "recorded": "recorded",
    "frf": "frf",
    "friction": "friction",
}
# Properties of a study that stages are handed, and the sections that they are made of.
MADE_OF = {"places": "robot", "friction_joints": "friction", "seeded_fit": "fit", "text": "name"}
# A value other than the default of the keys whose type does not give one.
OTHERS: dict[str, Any] = {
    "passes": None, "left_out": ("log",), "experiments": 1, "carrier": 1, "warming": 1, "heat": 1, "filter": 1,
    "responses": 1, "speed": 1.0,
    "temperature": 300.0, "configuration": "c", "period": 1.0, "period_samples": 100.0, "local_order": 4,
    "transient_periods": 3, "segment": 1.0, "resolution_hz": 1.0, "method": "h1", "lines": "full", "window": "boxcar",
    "purpose": "loops", "excitation": 1, "design": 1,
}  # fmt: skip


@pytest.fixture(scope="module")
def studies(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Study]:
    """A study of each kind, of friction with loads and with logs, of responses with and without a robot."""
    folder = tmp_path_factory.mktemp("studies")
    made = {kind: load(scaffold.new(folder / kind, name)).study for kind, name in TEMPLATES.items()}
    recorded, friction = made["recorded"], made["friction"]
    loaded = replace(friction.as_friction(), loads=(LoadSpec("full"),))
    made["friction-recorded"] = replace(recorded, friction=loaded)
    responses = ResponsesSpec((ResponseFileSpec("frf.csv", "c"),))
    made["responses"] = replace(recorded, experiment=replace(recorded.experiment, recorded=None, responses=responses))
    made["frf-responses"] = replace(made["responses"], robot=None)
    return made


def changed(value: Any, steps: list[str | int]) -> Any:
    """A copy of a section with another value at a path."""
    step, *rest = steps
    if isinstance(step, int):
        return (*value[:step], changed(value[step], rest), *value[step + 1 :])
    given = getattr(value, step)
    if rest:
        inner = changed(given, rest)
    elif step in OTHERS:
        inner = OTHERS[step]
    elif isinstance(given, str):
        inner = f"{given}x"
    else:
        inner = (not given) if isinstance(given, bool) else (("x",) if isinstance(given, tuple) else 7)
    if is_dataclass(given) and not rest:
        inner = object()
    copy = object.__new__(type(value))  # unchecked: only the place of the key is at stake
    for field in fields(value):
        object.__setattr__(copy, field.name, inner if field.name == step else getattr(value, field.name))
    return copy


@pytest.mark.parametrize("entry", UNUSED, ids=lambda entry: f"{entry.kinds[0]}-{entry.keys[0]}")
def test_each_key_is_refused_at_its_place_and_its_default_is_not(entry: Any, studies: dict[str, Study]) -> None:
    for kind in entry.kinds:
        study = studies[kind]
        own = [problem.path for problem in check_unused(study)]
        for key in entry.keys:
            path = tuple(0 if step == "*" else step for step in key.split("."))
            assert study.kind == kind
            (problem,) = (each for each in check_unused(changed(study, list(path))) if each.path == path)
            assert problem.message == entry.why.format(key=key, kind=study.experiment.kind)
            assert path not in own or kind not in TEMPLATES  # made of the data of another kind


@pytest.mark.parametrize("kind", [*TEMPLATES, "friction-recorded", "responses", "frf-responses"])
def test_a_section_that_no_stage_is_handed_is_refused(kind: str, studies: dict[str, Study]) -> None:
    """The table of stages says which sections count; comparisons are a command of studies of elasticity."""
    handed = {value.name.partition(".")[0] for stage in stages_of(kind).values() for value in stage.values}
    used = {MADE_OF.get(name, name) for name in handed} | {
        "name",
        "robot",
        "experiment",
        "report",
        "friction",
        "filter",
    }
    used |= {"excitation"} if kind in ("recorded", "responses") else set()  # a remark on how the data were made
    used |= {"compare", "validation", "fit", "model"} if kind in ("simulated", "recorded", "responses") else set()
    refused = {key for each in UNUSED if kind in each.kinds for key in each.keys}
    refused |= {"validation"} if kind.startswith("friction") else set()  # by its keys
    missing = {field.name for field in fields(Study)} - used - refused
    assert not missing - ({"estimator"} if kind == "frf-responses" else set())


def test_the_message_has_line_and_advice(tmp_path: Path) -> None:
    study = scaffold.new(tmp_path / "logs", "recorded")
    text = study.read_text(encoding="utf-8")
    study.write_text(f"{text}filter: {{}}\n")
    with pytest.raises(StudyError, match=r"study.yml:\d+:1: filter: a filter follows friction; give friction"):
        load(study)
