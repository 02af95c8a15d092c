"""Robot models from URDF and MJCF files, and studies of their simulation (`elastid new DIR --from robot.urdf`).

The file gives the rigid bodies; missing motors, gears and excitation are guessed from the inertia at each joint. MuJoCo
compiles an MJCF file: armatures become rotors before the gear of their actuator, with the damping of their joint; a
joint with stiffness and no actuator becomes an elastic joint; sites become frames. Torque limits are the ranges of
forces, and of controls that are forces. An angle is MuJoCo's angle minus its reference.
"""

import json
import math
import subprocess
import sys
import tempfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.escape import file_name, one_line
from elastid.base.files import from_template
from elastid.model.formulation import formulate
from elastid.model.rigid_body import inverse_dynamics
from elastid.robot import Joint, Motor, Robot, Spring
from elastid.robot.simplified import with_joints
from elastid.robot.urdf import UrdfJoint, UrdfRobot, read_elements
from elastid.study.reference import SCHEMA_NAME
from elastid.study.robots import Servos, load_robot, yaml_text

# Guessed drives: gear ratio, and natural frequency (Hz) and damping ratio of the link with a locked motor.
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
    """Return the robot, the texts of study.yml and robot.yml, and the servos; StudyError for an unreadable file.

    Motors and gears of URDF and MJCF files are guessed; a robot model of elastid is used unchanged.
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
    texts = {"study.yml": _study_text(driven, postures, gravity, inertia), "robot.yml": yaml_text(driven, comments)}
    return robot, texts, servos


def _with_guessed_drives(robot: Robot, postures: FloatArray, path: Path) -> tuple[FloatArray, Robot, tuple[str, ...]]:
    """Return inertia (n_u,) of the links of each drive, the robot with guessed gears and rotors, and comments."""
    urdf = [*read_elements(path).all("joint")] if path.suffix.lower() == ".urdf" else []
    # Inertia of the links without rotors.
    links = with_joints(robot, lambda joint: replace(joint, motor=Motor(_NO_ROTOR)) if joint.motor else None)
    model, theta = formulate(links), [value for value, _ in links.parameters().values()]
    # Mean over postures of the inertia at each motor with all others locked, kg m^2 (translations: kg).
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
        return replace(joint, motor=replace(joint.motor, coulomb=dry.get(joint.name, 0.0))) if joint.motor else joint

    return with_joints(_links_of_urdf(path, 1.0), with_friction)


def _links_of_urdf(path: Path, ratio: float = _RATIO) -> Robot:
    """Read the links of a URDF file; motors of revolute joints have a gear ratio and negligible inertia."""
    root = read_elements(path)
    kinds = {joint.name: joint.attributes.get("type") for joint in root.all("joint") if not joint.first("mimic")}
    moving = {name: 1.0 if kind == "prismatic" else ratio for name, kind in kinds.items() if kind != "fixed"}
    if not moving:
        raise root.wrong("no joint moves; an elastic robot has driven ones")
    joints = {name: UrdfJoint(motor=Motor(_NO_ROTOR / 1e10, turns)) for name, turns in moving.items()}
    return UrdfRobot(path.name, joints).robot(path.parent)


def _with_drive(joint: Joint, link_inertia: float) -> Joint:
    """Guess missing values of spring and motor of a joint, to two digits, from the inertia of its links (kg m^2)."""
    if joint.motor is None:
        if joint.spring is None or joint.spring.damping:
            return joint
        return replace(joint, spring=replace(joint.spring, damping=_damping(joint.spring.stiffness)))
    k = link_inertia * (2 * math.pi * _LOCKED_HZ) ** 2
    ratio_squared, spring = joint.motor.ratio**2, joint.spring or Spring(float(f"{k:.2g}"), _damping(k))
    rotor = joint.motor.inertia if joint.motor.inertia >= _NO_ROTOR else link_inertia / ratio_squared
    viscous_in_file = joint.motor.viscous + joint.viscous / ratio_squared
    is_plausible = 0 < viscous_in_file < (rotor + link_inertia / ratio_squared) / _MIN_TIME_S
    viscous = viscous_in_file if is_plausible else float(f"{rotor:.2g}")
    return replace(joint, motor=replace(joint.motor, inertia=rotor, viscous=viscous), spring=spring, viscous=0.0)


def _damping(stiffness: float) -> float:
    return float(f"{_DAMPING * stiffness / (math.pi * _LOCKED_HZ):.2g}")


def _postures(robot: Robot) -> tuple[FloatArray, float]:
    """Draw angles (Q, n_u) within the joint limits, if possible with gravity torques of at most half their limits.

    Also returns the largest ratio of gravity torque to torque limit.
    """
    joints, rng = robot.driven, np.random.default_rng(0)
    half_ranges = [_RANGE_M if joint.motion == "translation" else _RANGE_RAD for joint in joints]
    low, high = np.clip([joint.limits.angle for joint in joints], -4, 4).T  # an unlimited joint: about zero
    half = np.minimum(0.3 * (high - low), half_ranges)
    angles = np.round((low + high) / 2 + half * rng.uniform(-1, 1, (_POSTURES**2, len(joints))), 2)
    q = robot.joint_positions(angles @ robot.mixing.T).T  # of the motors' shafts
    theta = np.array([[value] * len(angles) for value, _ in robot.parameters().values()])
    gravity = inverse_dynamics(robot)(q, 0 * q, 0 * q, theta).full()[list(robot.driven_indices)]
    load = np.max(np.abs(gravity.T) / [joint.limits.torque for joint in joints], axis=1)
    rows = np.argsort(np.maximum(load, 1 / 2), kind="stable")[:_POSTURES]
    return angles[rows], float(load[rows].max())


def _study_text(robot: Robot, postures: FloatArray, gravity: float, inertia: FloatArray) -> str:
    """Return a study of simulated measurements at the postures, with torques for the inertia (n_u,) of the drives."""
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

    A motor without armature gets a negligible inertia.  Raises StudyError if MuJoCo is not installed or rejects the
    file, or if a joint is neither hinge nor slide.
    """
    if find_spec("mujoco") is None:
        advice = "it is compiled by mujoco, which is not installed: `pip install 'elastid[mjcf]'`"
        raise StudyError("install/missing-package", advice, path)
    with tempfile.TemporaryDirectory() as folder:  # MuJoCo writes its log there
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
