"""Separate process that compiles an MJCF file with MuJoCo and prints the robot model as JSON.

    python -m elastid.app.mjcf_reader FILE

An MJCF file can name any other file and request any amount of memory; the process therefore has a memory limit.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from elastid.base.escape import unique_name
from elastid.logs.files.reader_process import limit_memory
from elastid.robot import BASE, Body, Frame, Joint, Limits, Motor, Placement, Robot, Spring
from elastid.robot.body import six_numbers
from elastid.study.robots import yaml_text

KINDS = ("free", "ball", "slide", "hinge")  # of joints, by MuJoCo's numbers


def robot_of(model: Any, name: str) -> Robot:
    """Convert a compiled model to a robot, angles in rad; ValueError for a ball joint, or a free joint inside.

    Bodies that are fixed to the base, and the trunk of a floating robot, become frames of the base.
    """
    names = [BASE, *(model.body(i).name or f"body {i}" for i in range(1, model.nbody))]
    bodies, frames = [], []
    seats = [(BASE, np.eye(3), np.zeros(3))]  # of each body: where its children are placed, in whose frame
    for i in range(1, model.nbody):
        parent, R, p = seats[int(model.body_parentid[i])]
        placement = Placement.of(R @ _rotation(model.body_quat[i]), p + R @ model.body_pos[i])
        first, count = int(model.body_jntadr[i]), int(model.body_jntnum[i])
        kinds = {KINDS[kind] for kind in model.jnt_type[first : first + count]}
        if parent == BASE and kinds <= {"free"}:  # fixed to the base, or a trunk, which is fixed here
            seats.append((BASE, placement.rotation, np.array(placement.xyz)))
            frames += [Frame(names[i], BASE, placement)] * (names[i] != BASE)
            continue
        seats.append((names[i], np.eye(3), np.zeros(3)))
        joints = tuple(_joint(model, j) for j in range(first, first + count))
        mass = float(model.body_mass[i]), tuple(model.body_ipos[i].tolist())
        turn = _rotation(model.body_iquat[i])
        inertia = six_numbers(turn @ np.diag(model.body_inertia[i]) @ turn.T)
        bodies.append(Body(names[i], parent, placement, joints, *mass, inertia))
    for i in range(model.nsite):
        body, R, p = seats[int(model.site_bodyid[i])]
        placement = Placement.of(R @ _rotation(model.site_quat[i]), p + R @ model.site_pos[i])
        name_of_site = unique_name(model.site(i).name or f"site {i}", [frame.name for frame in frames])
        frames.append(Frame(name_of_site, body, placement))
    name_in_file = model.names[: model.names.index(b"\0")].decode("utf-8", "replace")
    return Robot(name_in_file or name, tuple(bodies), tuple(model.opt.gravity.tolist()), "", tuple(frames))


def _joint(model: Any, i: int) -> Joint:
    """Convert a joint, driven by its actuator, or by a placeholder motor if the file has no actuator at all."""
    name, kind = model.joint(i).name or f"joint {i}", KINDS[int(model.jnt_type[i])]
    if kind in ("free", "ball"):
        raise ValueError(f"joint {name} is of type {kind}; take hinges and slides, a base that stands still")
    gears, spring, motor = _gears(model, i), None, None
    stiffness = float(model.jnt_stiffness[i]) if model.jnt_stiffness.ndim == 1 else 0.0
    dof = int(model.jnt_dofadr[i])
    damping = float(model.dof_damping.reshape(model.nv, -1)[dof, 0])
    if gears or not (stiffness or any(_gears(model, j) for j in range(model.njnt))):
        gear = next(iter(gears.values()), 1.0)
        ratio = math.copysign(max(1.0, abs(gear)), gear)  # below 1, gear only scales the control signal
        dry = float(model.dof_frictionloss[dof]) / abs(ratio)
        motor = Motor(max(float(model.dof_armature[dof]), 1e-290) / ratio**2, ratio, damping / ratio**2, dry)
    elif stiffness:
        spring = Spring(stiffness, damping)
    ends = model.jnt_range[i].tolist() if model.jnt_limited[i] else (-math.inf, math.inf)
    low, high = (end - float(model.qpos0[model.jnt_qposadr[i]]) for end in ends)
    strength = sum(abs(gear) * _torque_limit(model, a) for a, gear in gears.items()) or math.inf
    limits = Limits((low, high), torque=min(_limit(model.jnt_actfrclimited[i], model.jnt_actfrcrange[i]), strength))
    x, y, z = model.jnt_pos[i].tolist() if kind == "hinge" else (0.0, 0.0, 0.0)
    return Joint(
        name, tuple(model.jnt_axis[i].tolist()), spring, motor, 0.0 if spring or motor else damping, limits=limits,
        motion="rotation" if kind == "hinge" else "translation", point=(x, y, z)
    )  # fmt: skip


def gains_of(model: Any) -> dict[str, tuple[float, float]]:
    """Return link-side position and velocity gains of the joints with position servos."""
    gains = {}
    for i in range(model.njnt):
        gears = _gears(model, i)
        # <position>: an affine bias with the stiffness of the control gain.
        bias, gain = model.actuator_biasprm, model.actuator_gainprm
        servos = [a for a in gears if model.actuator_biastype[a] == 1 and bias[a, 1] == -gain[a, 0] != 0]
        if servos:
            kp, kd = np.sum([bias[a, 1:3] * -(gears[a] ** 2) for a in servos], axis=0).tolist()
            gains[model.joint(i).name or f"joint {i}"] = (kp, kd)
    return gains


def _gears(model: Any, i: int) -> dict[int, float]:
    at = zip(model.actuator_trntype.tolist(), model.actuator_trnid[:, 0].tolist(), strict=True)
    return {a: float(model.actuator_gear[a, 0]) for a, (kind, j) in enumerate(at) if kind in (0, 1) and j == i}


def _limit(is_limited: bool, ends: Any) -> float:
    return float(abs(ends).max()) if is_limited else math.inf


def _torque_limit(model: Any, a: int) -> float:
    is_force = model.actuator_gaintype[a] == 0 == model.actuator_biastype[a] and model.actuator_ctrllimited[a]
    by_control = _limit(is_force, model.actuator_gainprm[a, 0] * model.actuator_ctrlrange[a])
    return min(by_control, _limit(model.actuator_forcelimited[a], model.actuator_forcerange[a]))


def _rotation(quaternion: Any) -> Any:
    """Return R (3, 3) of w, x, y, z."""
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()


def _remove_appearance(spec: Any) -> None:
    """Remove textures, and meshes that add no inertia: their files need not exist."""
    is_always_by_geometry = int(spec.compiler.inertiafromgeom) == 1
    for element in (*spec.geoms, *spec.sites, *spec.tendons):
        element.material = ""
    for geom in spec.geoms:
        has_no_inertia = geom.parent.name == "world" or geom.parent.explicitinertial or geom.mass == 0
        if geom.meshname and has_no_inertia and not is_always_by_geometry:
            spec.delete(geom)
    mesh_names = {geom.meshname for geom in spec.geoms}
    unused_meshes = (mesh for mesh in spec.meshes if mesh.name not in mesh_names)
    for asset in (*spec.skins, *spec.materials, *spec.textures, *unused_meshes):
        spec.delete(asset)


def main(path: Path) -> dict[str, Any]:
    """Return the robot file and gains by joint, or the reason for a failure."""
    import mujoco

    try:
        spec = mujoco.MjSpec.from_file(str(path))
        if hasattr(spec, "delete"):  # a newer release of MuJoCo
            _remove_appearance(spec)
        model = spec.compile()
        return {"robot": yaml_text(robot_of(model, path.stem)), "gains": gains_of(model)}
    except (ValueError, MemoryError) as error:
        return {"wrong": " ".join(str(error).split())}


if __name__ == "__main__":
    limit_memory()
    json.dump(main(Path(sys.argv[1])), sys.stdout)
