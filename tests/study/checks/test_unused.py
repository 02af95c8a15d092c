"""Keys that a kind of study does not use are refused, each at its place."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest

from elastid.app import scaffold
from elastid.app.stage_table import stages_of
from elastid.experiment.specs.recorded import ResponseFileSpec, ResponsesSpec
from elastid.friction_study.spec import LoadSpec
from elastid.study import Study, load
from elastid.study.checks import UNUSED

# Overrides of templates that make a study of each kind.
TEMPLATES = {
    "simulated": "serial",
    "recorded": "recorded",
    "frf": "frf",
    "friction": "friction",
}
# Properties of a study that stages are handed, and the sections that they are made of.
MADE_OF = {"places": "robot", "friction_joints": "friction", "seeded_fit": "fit", "text": "name"}


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
    refused = {key for kinds, keys in UNUSED if kind in kinds for key in keys}
    refused |= {"validation"} if kind.startswith("friction") else set()  # by its keys
    missing = {field.name for field in fields(Study)} - used - refused
    assert not missing - ({"estimator"} if kind == "frf-responses" else set())
