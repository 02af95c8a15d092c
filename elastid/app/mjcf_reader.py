"""A process of its own that compiles an MJCF file with MuJoCo and prints its bodies, joints and sites as JSON.

    python -m elastid.app.mjcf_reader FILE

MuJoCo trusts the file, which may name any other and ask for any amount of memory; so it works apart, within limits.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any

from elastid.recorded.files.reader_process import limit_memory


def compiled(path: str) -> dict[str, Any]:
    """The numbers that a robot takes from the compiled model; everything in MuJoCo's units, angles in rad."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(path)
    name_of = mujoco.mj_id2name

    def named(kind: Any, i: int, default: str) -> str:
        return name_of(model, kind, i) or f"{default} {i}"

    bodies = [
        {
            "name": named(mujoco.mjtObj.mjOBJ_BODY, i, "body"),
            "parent": int(model.body_parentid[i]),
            "joints": list(range(model.body_jntadr[i], model.body_jntadr[i] + model.body_jntnum[i])),
            **{key: getattr(model, f"body_{key}")[i].tolist() for key in ("pos", "quat", "ipos", "iquat", "inertia")},
            "mass": float(model.body_mass[i]),
        }
        for i in range(1, model.nbody)
    ]
    joints = []
    at_joints = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    for i in range(model.njnt):
        address, dof = int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])
        actuators = [
            a
            for a in range(model.nu)
            if int(model.actuator_trntype[a]) in at_joints and model.actuator_trnid[a, 0] == i
        ]
        joints.append(
            {
                "name": named(mujoco.mjtObj.mjOBJ_JOINT, i, "joint"),
                "type": mujoco.mjtJoint(int(model.jnt_type[i])).name.removeprefix("mjJNT_").lower(),
                "axis": model.jnt_axis[i].tolist(),
                "pos": model.jnt_pos[i].tolist(),
                "range": model.jnt_range[i].tolist() if model.jnt_limited[i] else None,
                "force": min(
                    largest(model.jnt_actfrclimited[i], model.jnt_actfrcrange[i]),
                    sum(abs(model.actuator_gear[a, 0]) * strength(model, a) for a in actuators) or math.inf,
                ),
                "stiffness": float(model.jnt_stiffness[i]) if model.jnt_stiffness.ndim == 1 else 0.0,
                "reference": float(model.qpos0[address]),
                "armature": float(model.dof_armature[dof]),
                "damping": float(model.dof_damping.reshape(model.nv, -1)[dof, 0]),
                "friction": float(model.dof_frictionloss[dof]),
                "gears": [float(model.actuator_gear[a, 0]) for a in actuators],
            }
        )
    sites = [
        {
            "name": named(mujoco.mjtObj.mjOBJ_SITE, i, "site"),
            "body": int(model.site_bodyid[i]),
            **{key: getattr(model, f"site_{key}")[i].tolist() for key in ("pos", "quat")},
        }
        for i in range(model.nsite)
    ]
    left_out = {"equality constraint": model.neq, "tendon": model.ntendon}
    name = model.names[: model.names.index(b"\0")].decode("utf-8", "replace")
    return {
        "name": name, "gravity": model.opt.gravity.tolist(), "bodies": bodies, "joints": joints, "sites": sites,
        "left_out": {key: int(count) for key, count in left_out.items() if count},
    }  # fmt: skip


def largest(is_limited: bool, ends: Any) -> float:
    """The largest size within a range that holds, else infinity."""
    return float(abs(ends).max()) if is_limited else math.inf


def strength(model: Any, a: int) -> float:
    """Largest force of an actuator before its gear: of its range, and of its control where that is a force."""
    import mujoco

    is_force = (
        model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_ctrllimited[a]
    )
    by_control = largest(is_force, model.actuator_gainprm[a, 0] * model.actuator_ctrlrange[a])
    return min(by_control, largest(model.actuator_forcelimited[a], model.actuator_forcerange[a]))


if __name__ == "__main__":
    limit_memory()
    try:
        json.dump({"model": compiled(sys.argv[1])}, sys.stdout)
    except ImportError:
        json.dump({"lacks": "mujoco"}, sys.stdout)
    except (ValueError, MemoryError) as error:
        json.dump({"wrong": str(error)}, sys.stdout)
