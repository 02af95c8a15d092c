"""Contradictions between sections, each at its key: one row a rule."""

from pathlib import Path

import pytest
from plants.refusals import refused
from plants.two_axes import ROBOT, STUDY

from elastid.app.run import Run, carry_out
from elastid.base.errors import StudyError
from elastid.study import load

SIMULATED = "experiment.simulated"
DESIGN = "design={count: 1, candidates: {%s}}"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Two axes, four configurations, simulated."""
    (tmp_path / "robot.yml").write_text(ROBOT)
    (tmp_path / "study.yml").write_text(STUDY)
    (tmp_path / "a.csv").write_text("u,y\n1,2\n")
    return tmp_path / "study.yml"


def refusals(study: Path, *overrides: str) -> list[str]:
    """The lines of the refusal; none where the study is good."""
    try:
        load(study, overrides)
    except StudyError as error:
        return str(error).splitlines()
    return []


@pytest.mark.parametrize(
    ("overrides", "key", "message"),
    [
        (["experiment.experiments=3"], "experiment.experiments", "to 2 for 2 motors"),
        (
            ["experiment.experiments=1", "estimator.method=arithmetic"],
            "experiment.experiments",
            "estimator.method arithmetic takes 2 to 2",
        ),
        (
            ["robot.bodies.0.joints.0.limits={angle: [-0.45, 2]}", f"{SIMULATED}.carrier={{amplitude: 0.1}}"],
            "experiment.configurations.c[0]",
            "with the carrier's 0.1 rad to either side is outside its limits [-0.45, 2] rad",
        ),
        (["fit.robots={A: [a, b], B: [c]}"], "fit.robots", "configuration d is assigned to no robot"),
        ([DESIGN % "given: {a: [0, 0]}"], "design.candidates.given.a", "is a configuration of experiment.config"),
        ([DESIGN % "given: {e: [0, 1 mm]}"], "design.candidates.given.e[1]", "joint 2 is a rotation"),
        ([DESIGN % "margin: 1 mm"], "design.candidates.margin", "or one number for each motor"),
        ([f"{SIMULATED}.carrier={{amplitude: 1 mm}}"], f"{SIMULATED}.carrier.amplitude", "is a rotation"),
        ([f"{SIMULATED}.carrier={{amplitude: 0.1, cycles: 5}}"], f"{SIMULATED}.carrier", "5 cycles a period"),
        (["validation.left_out=[a, b, c, d]"], "validation.left_out", "leave at least one to the fit"),
    ],
    ids=lambda value: value if isinstance(value, str) and " " not in value else "",
)
def test_a_contradiction_is_reported_once_at_its_key(study: Path, overrides: list[str], key: str, message: str) -> None:
    """And no other key is."""
    assert refusals(study) == []
    (line,) = refusals(study, *overrides)
    assert f": {key}: " in line
    assert message in line


@pytest.mark.parametrize(
    ("override", "code"),
    [
        (DESIGN % "given: {e: [0]}", "design/candidates"),
        (DESIGN % "grid: [3]", "design/candidates"),
        ("design={robot_time: 1 s}", "design/limits"),
        ("robot.chain={differentiator: 1 ms}", "experiment/simulated"),
        ("model={formulation: minimal, independent: [joint 9]}", "model/variant"),
        (f"{SIMULATED}.model={{formulation: minimal, independent: [joint 9]}}", "model/variant"),
        (f"{SIMULATED}.outputs=[nowhere]", "robot/unknown-name"),
        (f"{SIMULATED}.saturation=true", "experiment/simulated"),
        ("excitation.band_hz=[4.5, 5.5]", "excitation/power"),
        ("excitation.phases=schroeder", "excitation/lines"),
        ("excitation.torque_rms=[1, 2, 3]", "excitation/power"),
        ("excitation=null", "study/stage"),
    ],
)
def test_what_cannot_be_designed_or_simulated_the_first_stage_refuses(study: Path, override: str, code: str) -> None:
    """Before anything is measured."""
    run = Run(load(study, [override]), study.parent / "run", 1)
    with refused(code):
        carry_out(run, "design")
        carry_out(run, "measure")


CHANNELS = (
    "{role: u, at: motor 1, channel: u}, {role: u, at: motor 2, channel: u}, "
    "{role: y, at: motor 1, channel: y, quantity: position}"
)
FILES = ", ".join(f"{{path: a.csv, configuration: {name}}}" for name in "abcd")


@pytest.mark.parametrize(
    ("kind", "channels", "files", "key", "message"),
    [
        ("recorded", CHANNELS, FILES, "", ""),
        ("responses", CHANNELS, FILES, "", ""),
        (
            "recorded",
            f"{CHANNELS}, {{role: u, at: motor 2, channel: u}}",
            FILES,
            "channels[3].at",
            "two channels of role u",
        ),
        (
            "recorded",
            f"{CHANNELS}, {{role: reference, at: motor 2, channel: q, quantity: position}}",
            FILES,
            "",
            "",
        ),
        ("recorded", CHANNELS, f"{FILES}, {{path: a.csv, configuration: a, samples: [0, 9]}}", "", ""),
        (
            "recorded",
            CHANNELS,
            f"{FILES}, {{path: a.csv, configuration: a, period: 3, samples: [0, 9]}}",
            "files[4]",
            "give each its own numbers",
        ),
        (
            "responses",
            CHANNELS,
            f"{FILES}, {{path: a.csv, configuration: a}}",
            "files[4]",
            "both claim configuration a",
        ),
        ("recorded", CHANNELS, FILES.replace(": d", ": c, experiment: 1"), "configurations.d", "no file holds"),
    ],
)
def test_files_and_channels_are_each_given_once(
    study: Path, kind: str, channels: str, files: str, key: str, message: str
) -> None:
    """One signal a channel; one response a file, or periods of one excitation; a file for every configuration."""
    rate = "rate_hz: 500, period: 2, " if kind == "recorded" else ""
    text = study.read_text().replace("simulated: {}", f"{kind}: {{{rate}channels: [{channels}], files: [{files}]}}")
    study.write_text(text)
    found = refusals(study)
    assert len(found) == bool(key)
    assert all(key in line and message in line for line in found)
