"""`elastid new DIR --from robot.xml`: the robot of an MJCF file, as MuJoCo compiles it.

Armatures are rotors before the gear of their actuator, which the damping of their joint slows; a joint with a stiffness
and no actuator is an elastic one; sites are frames. Torque is limited by the ranges of forces and of controls that are
forces. An angle here is MuJoCo's less that of its reference pose.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.robot import BASE, Body, Frame, Joint, Limits, Motor, Placement, Robot, Spring
from elastid.robot.body import InertiaTensor, six_numbers

_MOVING: Mapping[str, Literal["rotation", "translation"]] = {"hinge": "rotation", "slide": "translation"}


def read_mjcf(path: Path) -> tuple[Robot, tuple[str, ...]]:
    """The robot of an MJCF file, and what is not taken over; a motor without an armature has no inertia yet.

    Raises StudyError where MuJoCo is not installed, does not take the file, or a joint is neither hinge nor slide.
    """
    model = _compiled(path)
    try:
        return _robot(model, path.stem), tuple(_left_out(model))
    except ValueError as error:
        raise StudyError(f"{path}: {error}") from None


def _compiled(path: Path) -> Mapping[str, Any]:
    with tempfile.TemporaryDirectory() as folder:  # where MuJoCo writes its log
        try:
            done = subprocess.run(
                [sys.executable, "-m", "elastid.app.mjcf_reader", str(path.resolve())],
                cwd=folder, capture_output=True, timeout=120, check=False,
            )  # fmt: skip
            reply: dict[str, Any] = json.loads(done.stdout)
        except (subprocess.TimeoutExpired, ValueError):
            raise StudyError(
                f"{path}: MuJoCo ends without an answer on this file; load it in `simulate` first"
            ) from None
    if "lacks" in reply:
        raise StudyError(
            f"{path}: MJCF is compiled by mujoco, which is not installed; install it with `uv sync --extra mjcf` "
            "(or `pip install 'elastid[mjcf]'`)"
        )
    if "wrong" in reply:
        raise StudyError(f"{path}: MuJoCo does not take it: {' '.join(reply['wrong'].split())}")
    model: Mapping[str, Any] = reply["model"]
    return model


def _robot(model: Mapping[str, Any], name: str) -> Robot:
    joints, actuated = model["joints"], any(joint["gears"] for joint in model["joints"])
    names = [BASE, *(body["name"] for body in model["bodies"])]
    bodies = tuple(
        Body(
            body["name"],
            names[body["parent"]],
            Placement.of(_rotation(body["quat"]), np.array(body["pos"])),
            tuple(_joint(joints[i], actuated) for i in body["joints"]),
            body["mass"],
            tuple(body["ipos"]),
            _inertia(body),
        )
        for body in model["bodies"]
    )
    frames = tuple(
        Frame(site["name"], names[site["body"]], Placement.of(_rotation(site["quat"]), np.array(site["pos"])))
        for site in model["sites"]
    )
    return Robot(model["name"] or name, bodies, tuple(model["gravity"]), "", frames)


def _joint(joint: Mapping[str, Any], actuated: bool) -> Joint:
    """Driven by its actuator, or by a motor to come where the file has no actuator at all."""
    name, kind = joint["name"], joint["type"]
    if kind not in _MOVING:
        raise ValueError(f"joint {name} is of type {kind}; take hinges and slides, a base that stands still")
    spring, motor = None, None
    if joint["gears"] or not (actuated or joint["stiffness"]):
        ratio = joint["gears"][0] if joint["gears"] and joint["gears"][0] else 1.0
        motor = Motor(max(joint["armature"], 1e-290) / ratio**2, ratio, joint["damping"] / ratio**2)
    elif joint["stiffness"]:
        spring = Spring(joint["stiffness"], joint["damping"])
    angle = joint["range"] or (-math.inf, math.inf)
    low, high = (end - joint["reference"] for end in angle)
    limits = Limits((low, high), torque=joint["force"])
    x, y, z = joint["pos"] if kind == "hinge" else (0.0, 0.0, 0.0)
    viscous = 0.0 if spring or motor else joint["damping"]
    axis = tuple(joint["axis"])
    return Joint(name, axis, spring, motor, viscous, limits=limits, motion=_MOVING[kind], point=(x, y, z))


def _left_out(model: Mapping[str, Any]) -> list[str]:
    """Parts that count in MuJoCo and are not taken over, in words."""
    lines = [f"{count} {what}{'s' if count > 1 else ''}" for what, count in model["left_out"].items()]
    lines += [f"dry friction of joint {joint['name']}" for joint in model["joints"] if joint["friction"]]
    lines += [
        f"stiffness of joint {j['name']}, which is driven" for j in model["joints"] if j["stiffness"] and j["gears"]
    ]
    lines += [
        f"armature of joint {j['name']}, which is not driven" for j in model["joints"] if _lost_armature(j, model)
    ]
    return lines


def _lost_armature(joint: Mapping[str, Any], model: Mapping[str, Any]) -> bool:
    return bool(joint["armature"]) and not joint["gears"] and any(other["gears"] for other in model["joints"])


def _rotation(quaternion: Sequence[float]) -> FloatArray:
    """R (3, 3) of w, x, y, z."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(quaternion, scalar_first=True).as_matrix())


def _inertia(body: Mapping[str, Any]) -> InertiaTensor:
    R = _rotation(body["iquat"])
    return six_numbers(R @ np.diag(body["inertia"]) @ R.T)
