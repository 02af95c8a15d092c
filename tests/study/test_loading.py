"""A study file is read strictly: every error by file, line and column, in one readable sentence."""

import json
import math
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.strategies import DataObject
from plants.paths import TEMPLATES
from plants.refusals import refused

from elastid.base.errors import StudyError
from elastid.robot import Tolerances
from elastid.study import load
from elastid.study.reference import make_schema


def errors(study: Path, *overrides: str) -> list[str]:
    """The lines of the refusal, without the folder."""
    with pytest.raises(StudyError) as refusal:
        load(study, overrides)
    return str(refusal.value).replace(f"{study.parent}/", "").splitlines()


def edited(study: Path, old: str, new: str, file: str = "study.yml") -> Path:
    path = study.parent / file
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    return study


def test_a_good_study_is_read_in_si(tiny: Path) -> None:
    study = load(edited(tiny, "k_1: 60 N*m/rad", "k_1: 0.06 kN*m/rad")).study
    assert study.experiment.simulated.truth == {"k_1": 60.0}
    assert study.experiment.configurations["b"] == (pytest.approx(math.radians(30)),)
    assert study.robot.driven[0].limits.angle == pytest.approx((-math.pi / 2, math.pi / 2))
    assert study.validation.configurations == ()


def test_true_inertias_are_possible_together_or_not_at_all() -> None:
    """Of a slender body none of two equal ones may grow alone; the message then names it."""
    key, study = "experiment.simulated.truth.I_fore_arm", TEMPLATES / "serial" / "study.yml"
    assert load(study, [f"{key}_yy=13", f"{key}_zz=13"])
    (alone,) = errors(study, f"{key}_yy=13")
    assert "truth.I_fore_arm_yy: no robot has this value: inertia of body fore_arm" in alone


# (what stands in the study, what is written instead, the key path)
WRONG = [
    ("rate_hz: 500", "rate_hs: 500", "excitation.rate_hs"),
    ("torque_rms: 0.1", "torque_rms: 0.1 kg", "excitation.torque_rms"),
    ("torque_rms: 0.1", "torque_rms: {a: 1}", "excitation.torque_rms"),
    ("band_hz: [5, 100]", "band_hz: [5, 100, 3]", "excitation.band_hz"),
    ("band_hz: [5, 100]", "band_hz: [5, 300]", "excitation.band_hz"),
    ("band_hz: [5, 100]", "band_hz: [5, 100]\n  grid: ood", "excitation.grid"),
    ("seed: 1", "seed: -1", "seed"),
    ("seed: 1", "seed: 1.5", "seed"),
    ("seed: 1", "seed: " + "9" * 30, ""),
    ("name: tiny", "name: a/b", "name"),
    ("fit:\n  starts: 2", "fit: 3\nfoo:\n  starts: 2", "fit"),
    ("a: [0]", "a: [0, 1]", "experiment.configurations.a"),
    ("a: [0]", "a: [100 deg]", "experiment.configurations.a[0]"),
    ("truth: {k_1: 60 N*m/rad}", "truth: {k_1: 60 N*m}", "experiment.simulated.truth.k_1"),
    ("truth: {k_1: 60 N*m/rad}", "truth: {k_l: 60}", "experiment.simulated.truth.k_l"),
    ("truth: {k_1: 60 N*m/rad}", "truth: {k_1: -60}", "experiment.simulated.truth.k_1"),
    ("    k_1: {}", "    k_1:", "fit.parameters.k_1"),
    ("    k_1: {}", "    k_1: {tie: {to: d_l}}", "fit.parameters.k_1.tie.to"),
    ("    k_1: {}", "    '*_1': {start: 1}", "fit.parameters.*_1.start"),
    ("    k_1: {}", "    delay: {start: 1 m}", "fit.parameters.delay.start"),
    ("report:", "validation: {configurations: [c]}\nreport:", "validation.configurations[0]"),
    ("  starts: 2", "  weights: {factors: [{factor: 0, input: motor 2}]}", "fit.weights.factors[0].input"),
    ("    k_1: {}", "    k_1: {tie: {to: d_1}, bounds: [1, 100]}", "fit.parameters.k_1"),
    ("  starts: 2", "  profile: [k_1, d_l]", "fit.profile[1]"),
    ("    noise:", "    outputs: [motor 1, joint 1, motor 1]\n    noise:", "experiment.simulated.outputs"),
    ("  simulated:", "  realisations: 10001\n  simulated:", "experiment.realisations"),
    ("  starts: 2", "  starts: true", "fit.starts"),
    ("  starts: 2", "  band_hz: [110, 120]", "fit.band_hz"),
    ("  starts: 2", "  band_hz: [100, 10]", "fit.band_hz"),
    ("friction: none", "band_hz: [1, 4]", "estimator.band_hz"),
    ("  starts: 2", "  start_factor: .inf", "fit.start_factor"),
    ("    noise:", "    controller: {kind: cascade, integral_time: -1}\n    noise:", ""),
    ("robot: robot.yml", "robot: !!bool maybe", ""),
    ("robot: robot.yml", "robot: !!float x", ""),
    ("robot: robot.yml", r'robot: "\ud800"', ""),
    ("robot: robot.yml", "robot: " + "a" * 4000, "robot"),
]

# The same in the robot's own file.
WRONG_ROBOT = [
    ("ratio: 1", "ratio: 0", "bodies[0].joints[0].motor.ratio"),
    ("    inertia: 1e-3\n", "    inertia: [1, 1, 9]\n", "bodies[0].inertia"),
    ("    inertia: 1e-3\n", "    inertia: [1, 2]\n", "bodies[0].inertia"),
    ("    inertia: 1e-3\n", "    inertia: [1, 2 kg, 3]\n", "bodies[0].inertia[1]"),
    ("stiffness: 50", "stifness: 50", "bodies[0].joints[0].spring.stifness"),
    ("axis: z", "axis: w", "bodies[0].joints[0].axis"),
    ("name: load", "name: load\n    parent: bas", "bodies[0].parent"),
    ("name: load", "name: load\n    name: load", ""),
    ("gravity:", "\tgravity:", ""),
]


@pytest.mark.parametrize(
    ("old", "new", "keys", "file"),
    [(*row, "study.yml") for row in WRONG] + [(*row, "robot.yml") for row in WRONG_ROBOT],
    ids=[f"{row[2]}-{row[1][:20]}" for row in WRONG + WRONG_ROBOT],
)
def test_each_mistake_has_one_sentence_at_its_place(tiny: Path, old: str, new: str, keys: str, file: str) -> None:
    """file:line:col: key.path: message; the line is the one that was edited, the path starts in its file."""
    of_file = (line for line in errors(edited(tiny, old, new, file)) if line.startswith(f"{file}:"))
    (found,) = (line for line in of_file if f": {keys}" in line)
    place, _, rest = found.partition(": ")
    _, line, column = place.split(":")
    text = (tiny.parent / file).read_text()
    before = text[: text.index(new)].count("\n")
    assert before < int(line) <= before + new.count("\n") + 1
    assert int(column) >= 1
    assert rest.startswith(keys)
    assert "Input should" not in rest


def test_impossible_inertia_start_is_refused_before_measuring(tiny: Path) -> None:
    """At the parameter's line; beside the two others of the robot's file it is the one at fault."""
    edited(tiny, "inertia: 1e-3\n", "inertia: [1e-3, 1e-3, 1e-3]\n", "robot.yml")
    (error,) = errors(edited(tiny, "d_1: {}", "I_load_zz: {start: 5}"))
    assert "fit.parameters.I_load_zz: the start gives body load a physically impossible inertia" in error
    line = int(error.partition(":")[2].partition(":")[0])
    assert "I_load_zz" in tiny.read_text().splitlines()[line - 1]
    load(edited(tiny, "start: 5", "start: 1.9e-3"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "study.yml:1:1: a study is a mapping"),
        (b"- 1\n- 2\n", "study.yml:1:1: a study is a mapping"),
        (b"\x89HDF\r\n\x1a\n\x00\x01", "study.yml:1:1: not a YAML text in UTF-8 (byte 0x89)"),
        (b"name: tiny\n\x00\n", "study.yml:2:1: not a YAML text"),
        (b"name: [tiny\n", "broken YAML"),
        (b"fit:\n\tstarts: 2\n", "study.yml:2:1: broken YAML"),
        (b"name: tiny\nname: tiny\n", "study.yml:2:1: key 'name' occurs twice (first in row 1)"),
        (b"name: !!python/object/apply:os.system ['false']\n", "study.yml:1:7: the tag"),
        (b"name: &a [*a]\n", "study.yml:1:7: aliases are recursive"),
        (b"- " * 3000 + b"1\n", "nested too deeply"),
        (b"? [1, 2]\n: 3\n", "study.yml:1:3: a key must be a name"),
    ],
)
def test_what_is_no_study_is_refused_by_place(tiny: Path, content: bytes, message: str) -> None:
    """Empty, binary, broken, doubled, tagged: the same form."""
    tiny.write_bytes(content)
    (error,) = errors(tiny)
    assert error.startswith("study.yml:")
    assert message in error


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("fit.starts", " key.path=value"),
        ("fit.starts=0", "fit.starts: it must be at least 1"),
        ("fit.strats=1", "fit.strats: unknown key; did you mean 'starts'?"),
        ("excitation.band_hz.7=1", "'7' must be a number from 0 to 1"),
        ("fit.starts=[1", "broken YAML"),
        ("robot=other.yml", "robot: no such file"),
        ("robot.bodies.0.joints.0.motor.ratio=0", "ratio is 0"),
        ("excitation.band_hz=[4.1, 4.9]", "holds no line: the lines are odd multiples of 1 Hz"),
        (
            "excitation={band_hz: [5, 100], rate_hz: 500, period: 1, torque_rms: 0.1, phases: prbs, grid: odd-random}",
            "prbs needs all lines or all odd lines",
        ),
        (
            "excitation={band_hz: [5, 100], rate_hz: 500, period: 1, torque_rms: 0.1, lines: [5, 7, 300], grid: lines}",
            "line 300 is outside band_hz",
        ),
        ("experiment.ramp=-1", "experiment.ramp: "),
    ],
)
def test_errors_of_an_override_name_it(tiny: Path, override: str, message: str) -> None:
    """Not a line of a file that the user did not write it in."""
    (error,) = errors(tiny, override)
    assert error.startswith(f"--set {override}: ")
    assert message in error


@pytest.mark.parametrize("name", ["motor_bench", "go2"])
def test_missing_logs_of_measured_robots_state_their_origin_once(name: str, tmp_path: Path) -> None:
    """A clone has the studies of measured robots, not their records."""
    (tmp_path / "real").mkdir()
    text = (TEMPLATES.parents[2] / "configs" / "real" / f"{name}.yml").read_text()
    study = tmp_path / "real" / f"{name}.yml"
    study.write_text(text.replace("../robots", str(TEMPLATES.parents[2] / "configs" / "robots")))
    assert sum("github.com" in error for error in errors(study)) == 1


@given(data=st.data())
@settings(deadline=None, max_examples=60)
def test_no_text_breaks_the_reader(
    tmp_path_factory: pytest.TempPathFactory, tiny_texts: tuple[str, str], data: DataObject
) -> None:
    """Whatever replaces a part of a good study: it loads or is refused, in the form of all refusals."""
    text, robot = tiny_texts
    folder = tmp_path_factory.mktemp("study")
    (folder / "robot.yml").write_text(robot)
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(start + 12, len(text))))
    piece = data.draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=6) | st.sampled_from("{}[]&*!|>%\t:-"))
    study = folder / "study.yml"
    study.write_text(text[:start] + piece + text[end:], encoding="utf-8")
    try:
        load(study)
    except StudyError as error:
        for line in str(error).splitlines():
            assert line.startswith(f"{folder}/")


def test_the_schema_is_json_with_units_and_closed_sections() -> None:
    """For editors: 2020-12, no unknown keys, a description of every quantity's unit, names that may be numbers."""
    document = json.loads(json.dumps(make_schema(), allow_nan=False))
    assert document["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert document["additionalProperties"] is False
    assert {"name", "experiment"} == set(document["required"])
    assert "in N*m/rad" in document["$defs"]["Spring"]["properties"]["stiffness"]["description"]
    assert document["$defs"]["Joint"]["properties"]["name"]["type"] == ["string", "number"]
    assert {"type": ["string", "number"]} in document["properties"]["robot"]["anyOf"]


@pytest.mark.parametrize(("motion", "given"), [("rotation", "28.6"), ("translation", "150")])
def test_excessive_joint_speed_suggests_another_unit(tiny: Path, motion: str, given: str) -> None:
    """Degrees taken for rad, millimetres for m; a joint that really goes there says so by its limits."""
    overrides = [f"experiment.configurations.a=[{given}]", "experiment.simulated.truth={}"]
    edited(tiny, "        limits: {angle: [-90 deg, 90 deg]}\n", f"        motion: {motion}\n", "robot.yml")
    (error,) = errors(tiny, *overrides)
    assert ": experiment.configurations.a[0]: " in error
    load(tiny, [*overrides, "robot.bodies.0.joints.0.limits={angle: [-200, 200]}"])


def test_a_folder_in_place_of_a_study_is_told_apart(tiny: Path) -> None:
    with refused("study/yaml", place="tiny"):
        load(tiny.parent)


def test_file_without_robot_is_named_at_study(tiny: Path) -> None:
    """Its own place is given after that."""
    (tiny.parent / "words.txt").write_text("root:x:0:0\n")
    first, second = errors(edited(tiny, "robot: robot.yml", "robot: words.txt"))
    line = tiny.read_text().splitlines().index("robot: words.txt") + 1
    assert first == f"study.yml:{line}:8: robot: words.txt is no robot:"
    assert second.startswith("words.txt:1:1: a robot is a mapping")


def tolerances_of(study: Path, *overrides: str) -> Tolerances | Literal["exact"] | None:
    return load(study, overrides).study.as_robot().tolerances


def test_simulated_rig_is_file_except_fixed_truth(tiny: Path) -> None:
    """A stiffness is no such number, nor is an inertia that is identified."""
    assert tolerances_of(tiny) is None
    wrong = "experiment.simulated.truth={k_1: 60, I_load: 1.1e-3}"
    assert tolerances_of(tiny, wrong) == Tolerances()
    assert tolerances_of(tiny, wrong, "fit.parameters.I_load={}") is None
    assert tolerances_of(tiny, wrong, "robot.tolerances=exact") == "exact"


def test_a_posture_is_left_out_at_all_its_amplitudes(tiny: Path) -> None:
    """`left_out` names postures; wrong amplitudes are refused where they stand."""
    two = ("excitation.torque_rms=[[0.1], [0.05]]", "validation.configurations=[b]")
    assert load(tiny, two).study.validation.configurations == ("b", "b amplitude 2")
    assert load(tiny, two[1:]).study.validation.configurations == ("b",)
    (line,) = errors(tiny, "experiment.configurations={a: [0], b amplitude 2: [0.1]}")
    assert ": experiment.configurations.b amplitude 2: " in line
