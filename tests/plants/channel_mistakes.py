"""Rigs with logs, and mistakes about their channels that `check` reports."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.study import load_with_logs
from elastid.study.robots import yaml_text
from plants.clean_logs import RATIO, Kind

ARM_RATIO = (100.0, 80.0)
ARM = """name: arm
gravity: [0, 0, -9.81]
bodies:
  - name: upper
    joints: [{name: 1, axis: y, motor: {inertia: %g, ratio: 100}, spring: {stiffness: 5e5, damping: 50}}]
    mass: %g
    center_of_mass: [0.3, 0, 0]
    inertia: 0.5
  - name: fore
    parent: upper
    placement: {xyz: [0.6, 0, 0]}
    joints: [{name: 2, axis: y, motor: {inertia: %g, ratio: 80}, spring: {stiffness: 2e5, damping: 20}}]
    mass: %g
    center_of_mass: [0.25, 0, 0]
    inertia: 0.3
"""
# The study of a motion; %s: the rate.
MOTION = """name: motion
robot: robot.yml
friction: {passes: detect}
experiment:
  recorded:
    rate_hz: %g
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

    @property
    def place(self) -> str:
        """The text that the reported line holds."""
        return self.line or self.wrong


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
    Mistake("sign of a link's angle", LINK_1, LINK_1.replace("unit: deg", "unit: deg, sign: -1")),
    Mistake("order of link angles", "channel: link_1", "channel: link_2", "joint 1, channel: link_2"),
)
OF_BARE = (Mistake("velocity as position, alone", "channel: phi_1, quantity: position, unit: deg",
                   "channel: w_1, quantity: position, unit: deg"),)  # fmt: skip
RESPONSE = """name: response
robot: robot.yml
experiment:
  configurations: {c: [%s]}
  recorded:
    rate_hz: 200
    period: 2 s
    channels:
"""
POSITION = "quantity: position, unit: deg, side: motor}"
OF_RESPONSES = (
    Mistake("column", "channel: u, column: 1,", "channel: u, column: 3,"),
    Mistake("period", "period: 2 s", "period: 1.7 s"),
    Mistake("too short a log", "period: 2 s", "period: 20 s"),
    Mistake("rate by the period", "rate_hz: 200", "rate_hz: 240", "period: 2 s"),
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
    return any(mistake.place in lines[number - 1] for number in numbers)


def write_rig(folder: Path, number: int, seed: int) -> tuple[Mistake, ...]:
    """Robot, log and right study of a rig in a folder; the mistakes that can be made about it."""
    if number % 2:
        return write_response(folder, Kind.drawn(number // 2, seed))
    rng = np.random.default_rng((seed, number))
    rate_hz = float(rng.choice((200, 250, 500, 1000)))
    log, robot = motion_log(rng, rate_hz)
    kinds = ((LINKS, ("link",), OF_LINKS), (SPEEDS, ("w",), OF_SPEEDS), ("", ("w",), OF_BARE))
    more, others, mistakes = kinds[number // 2 % 3]
    has_time = number // 2 % 3 == 0
    names = ("tau", "phi", "spare", *others, *(["t"] if has_time else []))
    kept = {name: x for name, x in log.items() if name.partition("_")[0] in names}
    rows = np.stack(list(kept.values()), axis=1)
    study, mistakes = MOTION % rate_hz + more + FILES, OF_ALL + (OF_TIME if has_time else ()) + mistakes
    np.savetxt(folder / "log.csv", rows, "%.9g", ",", header=",".join(kept), comments="")
    (folder / "robot.yml").write_text(robot)
    (folder / "study.yml").write_text(study)
    return mistakes


def motion_log(rng: np.random.Generator, rate_hz: float) -> tuple[Mapping[str, FloatArray], str]:
    """Channels (n,) by name, as logged, of a motion of the arm; and its robot's file."""
    t = np.arange(int(20 * rate_hz)) / rate_hz
    q, v, a = (np.stack(x, axis=1) for x in zip(*(motion(rng, t) for _ in range(2)), strict=True))
    J, mass = np.array([2e-3, 1e-3]) * rng.uniform(0.5, 2, 2), np.array([20.0, 10.0]) * rng.uniform(0.5, 2, 2)
    link = arm_torque(q, v, a, mass)
    friction = rng.uniform(5, 40, 2) * np.tanh(v / 1e-4) + rng.uniform(5, 40, 2) * v
    ratio = np.array(ARM_RATIO)
    torque = link + J * ratio**2 * a + friction
    torque += rng.choice((0.002, 0.01, 0.03)) * torque.std(axis=0) * rng.standard_normal(q.shape)
    wound = link / np.array([5e5, 2e5])
    counts = 2 * np.pi / float(rng.choice((4096, 65536, 2**20)))
    angle = np.round((q + wound) * ratio / counts) * counts
    speed = (v + 1e-3 * rng.standard_normal(q.shape)) * ratio
    beyond = np.round(q / 1e-5) * 1e-5
    log = {"t": t, "spare": 0 * t}
    for k in range(2):
        log |= {f"tau_{k + 1}": torque[:, k] / ratio[k], f"phi_{k + 1}": np.rad2deg(angle[:, k])}
        log |= {f"w_{k + 1}": speed[:, k] * 60 / (2 * np.pi), f"link_{k + 1}": np.rad2deg(beyond[:, k])}
    guess = rng.uniform(0.5, 2, 4)  # the robot's file is not exact
    return log, ARM % (J[0] * guess[0], mass[0] * guess[1], J[1] * guess[2], mass[1] * guess[3])


def motion(rng: np.random.Generator, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity and acceleration (n,) of a sum of sines."""
    omega, phase = 2 * np.pi * rng.uniform(0.1, 1.2, 4), rng.uniform(0, 2 * np.pi, 4)
    size = rng.uniform(0.1, 0.3, 4) / np.maximum(omega / 3, 1)
    return tuple(  # type: ignore[return-value]
        sum(s * w**k * np.sin(w * t + p + k * np.pi / 2) for s, w, p in zip(size, omega, phase, strict=True))
        for k in range(3)
    )


def arm_torque(q: FloatArray, v: FloatArray, a: FloatArray, mass: FloatArray) -> FloatArray:
    """Torque (n, 2) at the joints of a planar arm in a vertical plane (textbook, two links)."""
    l1, c1, c2, I1, I2 = 0.6, 0.3, 0.25, 0.5, 0.3
    m1, m2 = mass
    both = m2 * l1 * c2
    cos, sin = np.cos(q[:, 1]), np.sin(q[:, 1])
    outer = I2 + m2 * c2**2
    M11, M12 = I1 + m1 * c1**2 + outer + m2 * l1**2 + 2 * both * cos, outer + both * cos
    g1 = -9.81 * (m1 * c1 + m2 * l1) * np.cos(q[:, 0])
    g2 = -9.81 * m2 * c2 * np.cos(q[:, 0] + q[:, 1])
    first = M11 * a[:, 0] + M12 * a[:, 1] - both * sin * (2 * v[:, 0] + v[:, 1]) * v[:, 1] + g1 + g2
    return np.stack([first, M12 * a[:, 0] + outer * a[:, 1] + both * sin * v[:, 0] ** 2 + g2], axis=1)


def write_response(folder: Path, kind: Kind) -> tuple[Mistake, ...]:
    """The first log of a set of multisine logs, matrices of HDF5 at the motor side, and its robot's file."""
    log = next(kind.logs())
    ratio = np.array(RATIO[: kind.axes])
    with h5py.File(folder / "log.h5", "w") as file:
        for name in ("r", "u", "q"):
            x = np.stack([log.signals[f"{name}{k + 1}"] for k in range(kind.axes)], axis=1)
            file[name] = np.rad2deg(x) if name == "q" else x / ratio
    channels = [
        f"      - {{role: {role}, at: motor {k + 1}, channel: {role if role != 'y' else 'q'}, column: {k + 1}, {rest}"
        for role, rest in (("r", "side: motor}"), ("u", "side: motor}"), ("y", POSITION))
        for k in range(kind.axes)
        if role != "r" or kind.has_reference
    ]
    angles = ", ".join(f"{angle:.6g}" for angle in kind.configurations[log.configuration])
    end = "    files:\n      - {path: log.h5, configuration: c}\n"
    (folder / "study.yml").write_text(RESPONSE % angles + "\n".join(channels) + "\n" + end)
    (folder / "robot.yml").write_text(yaml_text(kind.robot))
    return OF_RESPONSES
