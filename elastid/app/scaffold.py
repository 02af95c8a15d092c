"""Studies to start from: the templates of `elastid new` and `elastid demo`, some with a small simulated log.

`elastid new DIR --from robot.urdf`, or an MJCF file: a commented study of a simulated measurement that runs at once.

The file gives the rigid bodies. Motors, gears and excitation that it does not contain are guessed from the inertia at
each joint. MuJoCo compiles an MJCF file: armatures become rotors before the gear of their actuator, with the damping of
their joint; a joint with stiffness and no actuator becomes an elastic joint; sites become frames. Torque limits are the
ranges of forces, and of controls that are forces. An angle is MuJoCo's angle minus its reference.
"""

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from textwrap import indent
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.escape import file_name, one_line
from elastid.base.files import from_template, open_regular_file
from elastid.model.formulation import formulate
from elastid.model.rigid_body import inverse_dynamics
from elastid.robot import Joint, Motor, Robot, Spring
from elastid.robot.simplified import with_joints
from elastid.robot.urdf import UrdfJoint, UrdfRobot, read_elements
from elastid.store.files import text_file
from elastid.study.reference import SCHEMA_NAME, make_schema
from elastid.study.robots import Servos, load_robot, yaml_text

# Guessed drives: gear ratio, and natural frequency (Hz) and damping ratio of the link with locked motor.
_RATIO, _LOCKED_HZ, _DAMPING = 100.0, 15.0, 0.03
_MIN_TIME_S = 0.01  # least time constant of inertia and viscous friction of a joint, s
# Excitation, rms: rad/s^2 (m/s^2), least relative to Coulomb friction, largest relative to the torque limit.
_ACCELERATION, _COULOMB_RATIO, _LIMIT_FRACTION = 4.0, 3.0, 0.2
_NO_ROTOR = 1e-250  # inertia of an unknown rotor, kg m^2
_LEAST_INERTIA = 1e-12  # least inertia of driven links, kg m^2; smaller values are rounding errors
_POSTURES, _RANGE_RAD, _RANGE_M = 5, 1.0, 0.2
_NATIVE = (".yml", ".yaml")


def is_robot_file(path: Path) -> bool:
    """Return True for a path with the extension of a robot model."""
    return path.suffix.lower() in (".urdf", ".xml", ".mjcf", *_NATIVE)


def from_robot(path: Path) -> tuple[Robot, dict[str, str], Servos]:
    """Return the robot, study.yml and robot.yml by name, and its servos; raise StudyError for an unreadable robot.

    Motors and gears of URDF and MJCF files are guessed; a robot in elastid's own format stays as it is.
    """
    if not path.is_file():
        raise StudyError("files/missing", "no such file", path)
    servos: Servos = {}
    if is_native := path.suffix.lower() in _NATIVE:
        robot = load_robot(path)
    elif path.suffix.lower() == ".urdf":
        robot = _links_of_urdf(path)
    else:
        robot, servos = read_mjcf_servos(path)
    if not robot.driven:
        raise StudyError("robot/file", "nothing drives a joint; give it actuators", path)
    postures, gravity = _postures(robot)
    if is_native:
        rotors = [joint.motor.inertia * joint.motor.ratio**2 for joint in robot.driven if joint.motor is not None]
        inertia, driven, comments = np.array(rotors), robot, tuple[str, ...]()
    else:
        inertia, driven, comments = _with_guessed_drives(robot, postures, path)
    texts = {"study.yml": _study(driven, postures, gravity, inertia), "robot.yml": yaml_text(driven, comments)}
    return robot, texts, servos


def _with_guessed_drives(robot: Robot, postures: FloatArray, path: Path) -> tuple[FloatArray, Robot, tuple[str, ...]]:
    """Return inertia (n_u,) of the links of each drive, the robot with guessed gears and rotors, and comments."""
    urdf = [*read_elements(path).all("joint")] if path.suffix.lower() == ".urdf" else []
    # Links alone: rotors have no inertia.
    links = with_joints(robot, lambda joint: replace(joint, motor=Motor(_NO_ROTOR)) if joint.motor else None)
    model, theta = formulate(links), [value for value, _ in links.parameters().values()]
    # Inertia at each motor with all others locked, mean over postures: kg m^2, or kg for translations.
    inertia = np.mean([np.diag(model.mass(q, theta).full()) for q in postures], axis=0)
    if lacking := [joint.name for joint, value in zip(robot.driven, inertia, strict=True) if value <= _LEAST_INERTIA]:
        line = next((f":{joint.line}" for joint in urdf if joint.name == lacking[0]), "")
        text = "its links have no inertia about its axis. State their inertia, or make the joint fixed"
        raise StudyError("robot/file", f"joint {lacking[0]}: {text}", f"{path}{line}")
    inertia_of = {joint.name: value for joint, value in zip(robot.driven, inertia.tolist(), strict=True)}
    driven = with_joints(robot, lambda joint: _with_drive(joint, inertia_of.get(joint.name, 0.0)))
    rotorless = [joint.name for joint in robot.driven if joint.motor is not None and joint.motor.inertia < _NO_ROTOR]
    rotors = f"; motors of {', '.join(rotorless)}, with as much inertia as the links behind them" if rotorless else ""
    mimics = [one_line(joint.name) for joint in urdf if joint.first("mimic")]
    comments = (
        *([f"Joints that mimic others are fixed at their zero: {', '.join(mimics)}."] if mimics else []),
        f"The rigid part is from {path.name}. Replace guessed numbers with those of data sheets:",
        f"the springs of gears, with a mode at {_LOCKED_HZ:g} Hz while the motor is locked{rotors};",
        "viscous friction that stops a motor's rotor within a second, where the file has none, or a placeholder that",
        f"stops a joint within {1e3 * _MIN_TIME_S:g} ms.",
        "Constraints, tendons and springs of driven joints are not read, and Coulomb friction only from MJCF files.",
    )
    return inertia, driven, comments


def read_urdf_model(path: Path) -> Robot:
    """Read the robot of a URDF file: rigid drives without rotors, with its damping and friction."""
    dry = {
        joint.name: dynamics.number("friction", "0")
        for joint in read_elements(path).all("joint")
        if (dynamics := joint.first("dynamics")) is not None
    }

    def with_friction(joint: Joint) -> Joint:
        coulomb = dry.get(joint.name, 0.0)
        return replace(joint, motor=replace(joint.motor, coulomb=coulomb)) if joint.motor else joint

    return with_joints(_links_of_urdf(path, 1.0), with_friction)


def _links_of_urdf(path: Path, ratio: float = _RATIO) -> Robot:
    """Read the links of a URDF file; motors of revolute joints have a gear ratio but no inertia yet."""
    root = read_elements(path)
    kinds = {joint.name: joint.attributes.get("type") for joint in root.all("joint") if not joint.first("mimic")}
    moving = {name: 1.0 if kind == "prismatic" else ratio for name, kind in kinds.items() if kind != "fixed"}
    if not moving:
        raise root.wrong("no joint moves; an elastic robot has driven ones")
    joints = {name: UrdfJoint(motor=Motor(_NO_ROTOR / 1e10, turns)) for name, turns in moving.items()}
    return UrdfRobot(path.name, joints).robot(path.parent)


def _with_drive(joint: Joint, of_links: float) -> Joint:
    """Complete the spring and the motor of a joint with values guessed from its links' inertia (kg m^2), two digits."""
    if joint.motor is None:
        if joint.spring is None or joint.spring.damping:
            return joint
        return replace(joint, spring=replace(joint.spring, damping=_damping(joint.spring.stiffness)))
    k = of_links * (2 * math.pi * _LOCKED_HZ) ** 2
    ratio_squared, spring = joint.motor.ratio**2, joint.spring or Spring(float(f"{k:.2g}"), _damping(k))
    rotor = joint.motor.inertia if joint.motor.inertia >= _NO_ROTOR else of_links / ratio_squared
    of_file = joint.motor.viscous + joint.viscous / ratio_squared
    is_plausible = 0 < of_file < (rotor + of_links / ratio_squared) / _MIN_TIME_S
    viscous = of_file if is_plausible else float(f"{rotor:.2g}")
    return replace(joint, motor=replace(joint.motor, inertia=rotor, viscous=viscous), spring=spring, viscous=0.0)


def _damping(stiffness: float) -> float:
    return float(f"{_DAMPING * stiffness / (math.pi * _LOCKED_HZ):.2g}")


def _postures(robot: Robot) -> tuple[FloatArray, float]:
    """Draw angles (Q, n_u) within the joint limits, if possible with gravity torques of at most half their limits.

    Also returns the largest ratio of gravity torque to torque limit.
    """
    joints, rng = robot.driven, np.random.default_rng(0)
    half_ranges = [_RANGE_M if joint.motion == "translation" else _RANGE_RAD for joint in joints]
    low, high = np.clip([joint.limits.angle for joint in joints], -4, 4).T  # an unlimited joint about zero
    half = np.minimum(0.3 * (high - low), half_ranges)
    angles = np.round((low + high) / 2 + half * rng.uniform(-1, 1, (_POSTURES**2, len(joints))), 2)
    q = robot.joint_positions(angles @ robot.mixing.T).T  # of the motors' shafts
    theta = np.array([[value] * len(angles) for value, _ in robot.parameters().values()])
    gravity = inverse_dynamics(robot)(q, 0 * q, 0 * q, theta).full()[list(robot.driven_indices)]
    load = np.max(np.abs(gravity.T) / [joint.limits.torque for joint in joints], axis=1)
    rows = np.argsort(np.maximum(load, 1 / 2), kind="stable")[:_POSTURES]
    return angles[rows], float(load[rows].max())


def _study(robot: Robot, postures: FloatArray, gravity: float, inertia: FloatArray) -> str:
    limits = [joint.limits.torque for joint in robot.driven]
    dry = [joint.motor.coulomb * abs(joint.motor.ratio) if joint.motor else 0.0 for joint in robot.driven]
    torque = np.maximum(2 * _ACCELERATION * inertia, _COULOMB_RATIO * np.array(dry))  # of motor and link
    rms = np.minimum(torque, _LIMIT_FRACTION * np.array(limits))
    rows = (", ".join(f"{angle:g}" for angle in angles) for angles in postures.tolist())
    configurations = "".join(f"    posture {i}: [{row}]\n" for i, row in enumerate(rows, start=1))
    families = [name for name in ("k", "d", "fm") if any(p.startswith(f"{name}_") for p in robot.parameters())]
    return from_template(
        "app/rehearsal/study.yml.txt", schema=SCHEMA_NAME, robot=one_line(robot.name),
        name=json.dumps(file_name(robot.name)), acceleration=f"{_ACCELERATION:g}", dry=f"{_COULOMB_RATIO:g}",
        percent=f"{100 * _LIMIT_FRACTION:g}",
        torque_rms=", ".join(f"{value:.2g}" for value in rms), configurations=configurations,
        gravity=f"; gravity takes up to {100 * gravity:.0f} % of a torque limit" * bool(gravity),
        parameters="{" + ", ".join(f"{name}_*: {{}}" for name in families) + "}",
        torque_std=f"{rms.min() / 10:.2g}", last=len(postures)
    )  # fmt: skip


def read_mjcf_servos(path: Path) -> tuple[Robot, Servos]:
    """Read the robot of an MJCF file, and kp and kd of its position servos by joint, link side.

    A motor without an armature has no inertia yet.

    Raises StudyError if MuJoCo is not installed or rejects the file, or if a joint is neither hinge nor slide.
    """
    if find_spec("mujoco") is None:
        advice = "it is compiled by mujoco, which is not installed: `pip install 'elastid[mjcf]'`"
        raise StudyError("install/missing-package", advice, path)
    with tempfile.TemporaryDirectory() as folder:  # where MuJoCo writes its log
        try:
            process = subprocess.run(
                [sys.executable, "-m", "elastid.app.mjcf_reader", str(path.resolve())],
                cwd=folder, capture_output=True, timeout=120, check=False
            )  # fmt: skip
            reply: dict[str, Any] = json.loads(process.stdout)
        except (subprocess.TimeoutExpired, ValueError):
            text = "MuJoCo ends without an answer on this file; load it in `simulate` first"
            raise StudyError("robot/file", text, path) from None
        if "wrong" in reply:
            raise StudyError("robot/file", reply["wrong"], path)
        file = Path(folder) / "robot.yml"
        file.write_text(reply["robot"], encoding="utf-8")
        return load_robot(file), {name: (kp, kd) for name, (kp, kd) in reply["gains"].items()}


# Numbers that the fit of the template `recorded` is to identify, and the torque constant in its study.
TRUTH: Mapping[str, float] = {"k_1": 64.0, "d_1": 0.014, "Jm_1": 1.2e-3, "I_load": 0.8e-3, "fm_1": 2e-3}
TORQUE_CONSTANT = 0.17


def new(folder: Path, template: str) -> Path:
    """Write a new folder with a study, its robot, the schema and, for studies of logs, a small log. Return the study.

    Raises StudyError if the folder is not empty.
    """
    _check_new(folder)
    study = _write(folder, _template(template) | _schema())
    if template in EXAMPLE_LOGS:
        EXAMPLE_LOGS[template](folder)
    return study


def new_from_logs(folder: Path, logs: Sequence[Path], more: Sequence[Path] = ()) -> Path:
    """Draft a study of logs, of a robot model, or of both, in a new folder with its robot; returns the study's path.

    more: those behind the last `--from`.  Raises StudyError where there is none such, or the folder holds anything
    already, and what `texts_from_logs` raises.
    """
    if not logs:
        raise StudyError("options/invalid", f"a study has one folder; where {more[0]} is a log write --from before it")
    _check_new(folder)
    robots = [path for path in (*logs, *more) if is_robot_file(path)]
    records = [path for path in (*logs, *more) if not is_robot_file(path)]
    if len(robots) > 1:
        text = f"{robots[0]} and {robots[1]} are two robots, and a study has one; give either"
        raise StudyError("options/invalid", text)
    robot, texts, servos = from_robot(robots[0]) if robots else (None, {}, {})
    if records:
        from elastid.app.from_log import texts_from_logs

        texts = texts_from_logs(folder, records, robot, servos) | {k: v for k, v in texts.items() if k != "study.yml"}
    return _write(folder, {**texts, **_schema()})


def _check_new(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        text = f"{folder} exists and is not empty; nothing was written. Give the name of a new folder"
        raise StudyError("options/invalid", text)


def demo(folder: Path) -> Path:
    """Write the demo's study, with its robot, into its run folder; existing files stay.

    Without a schema beside it, which takes longer to make than any stage.
    """
    texts = _template("serial")
    _, _, study = texts["study.yml"].partition("\n")
    robot = indent(texts["robot.yml"], "  ")
    return _write(folder, {"study.yml": study.replace("robot: robot.yml\n", f"robot:\n{robot}")})


def _schema() -> dict[str, str]:
    return {SCHEMA_NAME: json.dumps(make_schema(), indent=1) + "\n"}


def _template(name: str) -> dict[str, str]:
    sources = (files("elastid.app") / "templates" / name).iterdir()
    return {source.name: source.read_text(encoding="utf-8") for source in sources}


def _write(folder: Path, texts: Mapping[str, str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        if not (folder / name).exists():
            # Not through a link to a file that is yet to be made.
            with open(folder / name, "x", encoding="utf-8", newline="\n", opener=open_regular_file) as file:
                file.write(text)
    return folder / "study.yml"


def write_shaken_masses(folder: Path) -> None:
    """Write logs/bench_1.csv to bench_4.csv of three masses with two shakers: two realisations of two experiments."""
    from elastid.experiment.simulated.plant import shake

    columns = ("force_1", "force_3", "acc_1", "acc_2", "acc_3")
    logs = (log for realisation in range(2) for log in shake(256.0, 2048, 4, 1 + realisation))
    for i, log in enumerate(logs, start=1):
        _write_log(folder / "logs" / f"bench_{i}.csv", columns, log)


def write_elastic_joint(folder: Path) -> None:
    """Write logs/bench_1.csv and bench_2.csv of the template's robot with numbers that differ from its file."""
    from elastid.api import read_robot, simulate

    rig = {"truth": dict(TRUTH), "outputs": ["motor 1", "joint 1"], "noise": {"torque_std": 1e-4, "angle_std": 2e-6}}
    experiment = {"configurations": {"bench": [0]}, "periods": 4, "simulated": rig}
    excitation = {"rate_hz": 1000, "period": 2, "band_hz": [1, 150], "torque_rms": 0.1}
    records = simulate(read_robot(folder / "robot.yml"), excitation=excitation, experiment=experiment, seed=1)
    columns = ("current", "motor_angle", "load_angle")
    for i, record in enumerate(records, start=1):
        _write_log(folder / "logs" / f"bench_{i}.csv", columns, np.hstack([record.u / TORQUE_CONSTANT, record.y]))


EXAMPLE_LOGS: Mapping[str, Callable[[Path], None]] = {"recorded": write_elastic_joint, "frf": write_shaken_masses}


def _write_log(path: Path, columns: Sequence[str], values: FloatArray) -> None:
    path.parent.mkdir(exist_ok=True)
    with text_file(path) as file:
        np.savetxt(file, values, fmt="%.6g", delimiter=",", header=",".join(columns), comments="")
