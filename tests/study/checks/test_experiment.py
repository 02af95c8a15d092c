"""What a study may ask of its excitation, and how it is refused: file, line, and what would fit."""

import re
from dataclasses import dataclass, fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from plants import dry_friction, moving_arm
from plants.arm import RATIO
from plants.paths import CONFIGS
from plants.refusals import refused

from elastid.app import scaffold
from elastid.app.stage_table import stages_of
from elastid.base.errors import StudyError
from elastid.experiment.specs.logs import ResponseFileSpec, ResponsesSpec
from elastid.friction_study.spec import LoadSpec
from elastid.study import Study, load, load_with_logs
from elastid.study.checks import UNUSED
from elastid.study.robots import yaml_text


def test_open_loop_configuration_is_refused_at_its_row(tmp_path: Path) -> None:
    """Before anything is measured: with a rod of half the length the linkage does not even close at its start."""
    linkage, short = CONFIGS / "linkage_arm.yml", tmp_path / "short.yml"
    robot = (CONFIGS / "robots" / "linkage_arm.yml").read_text(encoding="utf-8")
    short.write_text(robot.replace("length: 0.89", "length: 0.45"), encoding="utf-8")
    with refused("study/invalid", holds=("experiment.configurations", "loop rod")):
        load(linkage, [f"robot={short}"])


# Overrides of templates that make a study of each kind.
TEMPLATES = {"simulated": "serial", "recorded": "recorded", "frf": "frf", "friction": "friction"}


@pytest.fixture(scope="module")
def studies(tmp_path_factory) -> dict[str, Study]:
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
    used = handed | {"name", "robot", "experiment", "report", "friction", "filter"}
    used |= {"excitation"} if kind in ("recorded", "responses") else set()  # a remark on how the data were made
    used |= {"compare", "validation", "fit", "model"} if kind in ("simulated", "recorded", "responses") else set()
    refused = {key for kinds, keys in UNUSED if kind in kinds for key in keys}
    refused |= {"validation"} if kind.startswith("friction") else set()  # by its keys
    missing = {field.name for field in fields(Study)} - used - refused
    assert not missing - ({"estimator"} if kind == "frf-responses" else set())


# The study of a motion.
MOTION = """name: motion
robot: robot.yml
friction: {constant_velocity: detect}
experiment:
  recorded:
    rate_hz: 250
    channels:
      - {role: u, at: motor 1, channel: tau_1, side: motor}
      - {role: u, at: motor 2, channel: tau_2, side: motor}
      - {role: y, at: motor 1, channel: phi_1, quantity: position, unit: deg, side: motor}
      - {role: y, at: motor 2, channel: phi_2, quantity: position, unit: deg, side: motor}
"""
LINKS = """      - {role: y, at: joint 1, channel: link_1, quantity: position, unit: deg}
      - {role: y, at: joint 2, channel: link_2, quantity: position, unit: deg}
"""
SPEEDS = """      - {role: y, at: joint 1, channel: w_1, quantity: velocity, unit: rpm, side: motor}
      - {role: y, at: joint 2, channel: w_2, quantity: velocity, unit: rpm, side: motor}
"""
FILES = """    files:
      - {path: log.csv}
"""


@dataclass(frozen=True)
class Mistake:
    """A text of a right study, the wrong one, and the text at whose line the report must stand."""

    name: str
    right: str
    wrong: str
    line: str = ""


PHI_1 = "at: motor 1, channel: phi_1, quantity: position, unit: deg, side: motor}"
W_1 = "at: joint 1, channel: w_1, quantity: velocity, unit: rpm, side: motor}"
LINK_1 = "at: joint 1, channel: link_1, quantity: position, unit: deg}"
OF_ALL = (
    Mistake("name", "channel: tau_1,", "channel: tau1,"),
    Mistake("file", "log.csv", "log.cvs"),
    Mistake("length", "path: log.csv", "path: log.csv, samples: [0, 9999999]"),
    Mistake("degrees as radians, motor", PHI_1, PHI_1.replace(", unit: deg", "")),
    Mistake("side of a motor's angle", PHI_1, PHI_1.replace(", side: motor", "")),
    Mistake("sign of an angle", PHI_1, PHI_1.replace("unit: deg", "unit: deg, sign: -1")),
    Mistake("order of torques", "channel: tau_1", "channel: tau_2", "channel: tau_2"),
    Mistake("constant channel", "channel: phi_1", "channel: spare"),
    Mistake("torque constant of zero", "channel: tau_1,", "channel: tau_1, quantity: current, torque_constant: 0,"),
    Mistake("delay of no channel", "channel: tau_1,", "channel: tau_1, delay: 60 ms,"),
    Mistake("angle of another motor", "motor 2, channel: phi_2", "motor 2, channel: phi_1"),
    Mistake("torque of another motor", "motor 2, channel: tau_2", "motor 2, channel: tau_1"),
    Mistake("rate of no log", "rate_hz: 250", "rate_hz: 1e30"),
    Mistake("negative realisation", "path: log.csv", "path: log.csv, realisation: -1"),
)
OF_TIME = (
    Mistake("rate by the time", "rate_hz: ", "rate_hz: 700 # "),
    Mistake("time", "rate_hz: ", "time: tt\n    rate_hz: ", "time: tt"),
)
OF_SPEEDS = (
    Mistake("rate by a speed", "rate_hz: ", "rate_hz: 700 # "),
    Mistake("rpm as rad/s", W_1, W_1.replace(", unit: rpm", "")),
    Mistake("rpm as deg/s", W_1, W_1.replace("rpm", "deg/s")),
    Mistake("velocity as position", W_1, W_1.replace("velocity, unit: rpm", "position, unit: deg")),
    Mistake("sign of a torque", "channel: tau_1", "sign: -1, channel: tau_1"),
    Mistake("sign of a speed", W_1, W_1.replace("unit: rpm", "unit: rpm, sign: -1")),
    Mistake("order of motor angles", "channel: phi_1", "channel: phi_2", "motor 1, channel: phi_2"),
)
OF_LINKS = (
    Mistake("degrees as radians, link", LINK_1, LINK_1.replace(", unit: deg", "")),
    Mistake("side of a link's angle", LINK_1, LINK_1.replace("unit: deg", "unit: deg, side: motor")),
    Mistake("position as velocity", LINK_1, LINK_1.replace("position, unit: deg", "velocity, unit: deg/s")),
    Mistake("sign of a torque", "channel: tau_1", "sign: -1, channel: tau_1"),
    Mistake("motor's angle as the link's", "joint 1, channel: link_1", "joint 1, channel: phi_1"),
    Mistake("sign of a link's angle", LINK_1, LINK_1.replace("unit: deg", "unit: deg, sign: -1")),
    Mistake("order of link angles", "channel: link_1", "channel: link_2", "joint 1, channel: link_2"),
)
OF_BARE = (Mistake("velocity as position, alone", "channel: phi_1, quantity: position, unit: deg",
                   "channel: w_1, quantity: position, unit: deg"),)  # fmt: skip
RESPONSE = """name: response
robot: robot.yml
experiment:
  configurations: {c: [0.5, 0.9]}
  recorded:
    rate_hz: 500
    period: 2 s
    channels:
      - {role: r, at: motor 1, channel: r, column: 1, side: motor}
      - {role: r, at: motor 2, channel: r, column: 2, side: motor}
      - {role: u, at: motor 1, channel: u, column: 1, side: motor}
      - {role: u, at: motor 2, channel: u, column: 2, side: motor}
      - {role: y, at: motor 1, channel: q, column: 1, quantity: position, unit: deg, side: motor}
      - {role: y, at: motor 2, channel: q, column: 2, quantity: position, unit: deg, side: motor}
    files:
      - {path: log.h5, configuration: c}
"""
POSITION = "quantity: position, unit: deg, side: motor}"
OF_RESPONSES = (
    Mistake("column", "channel: u, column: 1,", "channel: u, column: 3,"),
    Mistake("period", "period: 2 s", "period: 1.7 s"),
    Mistake("too short a log", "period: 2 s", "period: 20 s"),
    Mistake("rate by the period", "rate_hz: 500", "rate_hz: 600", "period: 2 s"),
    Mistake("sign of an angle, alone", POSITION, POSITION.replace("unit: deg", "sign: -1, unit: deg")),
    Mistake("degrees as radians, alone", POSITION, POSITION.replace(", unit: deg", "")),
    Mistake("position as velocity, alone", POSITION, "quantity: velocity, unit: deg/s, side: motor}"),
    Mistake("file of no numbers", "path: log.h5", "path: study.yml"),
)


def complaint(folder: Path, mistake: Mistake | None) -> str:
    """What `elastid check` says of the study with a mistake, or of the right one; empty where nothing."""
    text = (folder / "study.yml").read_text()
    if mistake is not None:
        assert mistake.right in text, mistake.name
        text = text.replace(mistake.right, mistake.wrong, 1)
        if mistake.name.startswith("order"):  # the other one of the two
            other = mistake.wrong + ("," if mistake.wrong + "," in text else "")
            at = text.rindex(other)
            text = text[:at] + text[at:].replace(mistake.wrong, mistake.right, 1)
    (folder / "tried.yml").write_text(text)
    try:
        load_with_logs(folder / "tried.yml")
    except StudyError as error:
        return str(error)
    return ""


def is_at_line(said: str, folder: Path, mistake: Mistake) -> bool:
    """True if one of the lines of a message is about the line of the mistake."""
    lines = (folder / "tried.yml").read_text().splitlines()
    numbers = [int(number) for number in re.findall(r"tried\.yml:(\d+):", said)]
    return any((mistake.line or mistake.wrong) in lines[number - 1] for number in numbers)


# Lines of the study, further channels of the log and mistakes of each motion.
MOTIONS = {
    "links": (LINKS, ("t", "link"), OF_TIME + OF_LINKS),
    "speeds": (SPEEDS, ("w",), OF_SPEEDS),
    "motors alone": ("", ("w",), OF_BARE),
}
RIGS = (*MOTIONS, "multisine")


def write_rig(folder: Path, rig: str) -> tuple[Mistake, ...]:
    """Robot, log and right study of one of RIGS in a folder; the mistakes that can be made about it."""
    if rig == "multisine":
        return write_response(folder)
    lines, further, mistakes = MOTIONS[rig]
    log = {name: x for name, x in motion_log().items() if name.partition("_")[0] in ("tau", "phi", "spare", *further)}
    np.savetxt(folder / "log.csv", np.stack([*log.values()], 1), "%.9g", ",", header=",".join(log), comments="")
    inexact = moving_arm.ARM.with_parameters({"m_upper": 50.0, "m_fore": 12.0})
    (folder / "robot.yml").write_text(yaml_text(inexact))
    (folder / "study.yml").write_text(MOTION + lines + FILES)
    return OF_ALL + mistakes


def motion_log() -> dict[str, np.ndarray]:
    """Channels (n,) by name, as logged, of a motion of two axes; angles of the motors by an encoder of 16 bit."""
    rng, motions, ratio = np.random.default_rng(0), moving_arm.motion(0), RATIO
    n, count = len(motions["1"].position), 360 / 65536
    log = {"t": np.arange(n) / moving_arm.RATE, "spare": np.zeros(n)}
    for name, motion in motions.items():
        angle = np.rad2deg(motion.position)
        speed = np.gradient(motion.position) * moving_arm.RATE + 1e-3 * rng.standard_normal(n)
        log |= {f"tau_{name}": motion.torque / ratio, f"phi_{name}": np.round(ratio * angle / count) * count}
        log |= {f"w_{name}": ratio * speed * 60 / (2 * np.pi), f"link_{name}": np.round(angle, 4)}
    return log


def write_response(folder: Path) -> tuple[Mistake, ...]:
    """A log of multisines, matrices of HDF5 at the motor side, and its robot's file."""
    robot = dry_friction.robot((0.0, 0.0))
    record = dry_friction.simulated(robot, {"c": (0.5, 0.9)}, 1, 1, 2, carrier=None)[0][0][0]
    assert record.r is not None
    ratio = np.array(dry_friction.RATIO)
    with h5py.File(folder / "log.h5", "w") as file:
        file["r"], file["u"], file["q"] = record.r / ratio, record.u / ratio, np.rad2deg(record.y * ratio)
    (folder / "study.yml").write_text(RESPONSE)
    (folder / "robot.yml").write_text(yaml_text(robot))
    return OF_RESPONSES


@pytest.fixture(scope="module")
def rigs(tmp_path_factory) -> dict[str, tuple[Path, tuple[Mistake, ...]]]:
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
