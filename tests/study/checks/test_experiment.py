"""What a study may ask of its excitation, and how it is refused: file, line, and what would fit."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import pytest
from plants.channel_mistakes import RIGS, Mistake, complaint, is_at_line, write_rig
from plants.refusals import refused

from elastid.app import scaffold
from elastid.app.stage_table import stages_of
from elastid.base.errors import StudyError
from elastid.experiment.specs.recorded import ResponseFileSpec, ResponsesSpec
from elastid.friction_study.spec import LoadSpec
from elastid.study import Study, load, load_with_logs
from elastid.study.checks import UNUSED

CONFIGS = Path(__file__).parents[3] / "configs"


def test_a_configuration_in_which_loops_do_not_close_is_refused_at_its_line(tmp_path: Path) -> None:
    """Before anything is measured: with a rod of half the length the linkage does not even close at its start."""
    linkage, short = CONFIGS / "linkage_arm.yml", tmp_path / "short.yml"
    robot = (CONFIGS / "robots" / "linkage_arm.yml").read_text(encoding="utf-8")
    short.write_text(robot.replace("length: 0.89", "length: 0.45"), encoding="utf-8")
    with refused("study/invalid", holds=("experiment.configurations", "loop rod")):
        load(linkage, [f"robot={short}"])


# Overrides of templates that make a study of each kind.
TEMPLATES = {
    "simulated": "serial",
    "recorded": "recorded",
    "frf": "frf",
    "friction": "friction",
}


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
    assert studies[kind].name in repr(studies[kind])
    handed = {key.partition(".")[0] for stage in stages_of(kind).values() for key in stage.keys.split()}
    used = handed | {
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


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, tuple[Mistake, ...]]]:
    """Folder and mistakes of each rig."""
    folders = {name: tmp_path_factory.mktemp(f"rig-{i}") for i, name in enumerate(RIGS)}
    return {name: (folder, write_rig(folder, name)) for name, folder in folders.items()}


# What nothing in the log contradicts where the motor's angle is alone in it: the fit says so, by its numbers.
ALONE = ("velocity as position, alone", "degrees as radians, alone")


def test_every_mistake_is_reported_at_its_line(rigs: dict[str, tuple[Path, tuple[Mistake, ...]]]) -> None:
    """More than 30 of as many: names, columns, rate, time, period, length, units, side, quantity, sign, order."""
    missed, made = [], set()
    for rig, (folder, mistakes) in rigs.items():
        assert not complaint(folder, None)
        for mistake in mistakes:
            made.add(mistake.name)
            if mistake.name not in ALONE and not is_at_line(complaint(folder, mistake), folder, mistake):
                missed.append((rig, mistake.name))
    assert not missed
    assert len(made) >= 30


def test_other_commands_do_not_open_the_logs(rigs: dict[str, tuple[Path, tuple[Mistake, ...]]]) -> None:
    """A doubt does not stop who is sure: run reads the study alone."""
    folder, mistakes = rigs["motors alone"]
    assert complaint(folder, next(mistake for mistake in mistakes if mistake.name == "sign of an angle"))
    assert load(folder / "tried.yml").study.name == "motion"
    with pytest.raises(StudyError):
        load_with_logs(folder / "tried.yml")
