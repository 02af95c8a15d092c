r"""Export of friction compensation: the torque of each motor's friction at a velocity, as C and as a table.

.. math:: u_f(v) = g(v) \tanh(v / v_s) + \alpha_3 v |v| + \alpha_2 v

the identified law in steady sliding with viscous friction, turning around over v_s = 0.01 rad/s so that noise of a
velocity near 0 does not reverse the torque. Link side, SI.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.escape import c_comment
from elastid.export.code import c_sources, dense
from elastid.friction.robot_friction import frictions
from elastid.robot import Robot
from elastid.store.files import write_rows, write_text
from elastid.use.command.equations import SLIDING


def compensation(robot: Robot) -> ca.Function:
    """v (n_u,) -> u_f (n_u,): what the motors need beside the torque of the robot without friction."""
    v = ca.SX.sym("v", len(robot.driven))
    laws = {law.place: law for law in frictions(robot)}
    torques = []
    for i, joint in enumerate(robot.driven):
        viscous = joint.viscous if joint not in robot.flexible else 0.0
        if joint.motor is not None:
            viscous += joint.motor.viscous * joint.motor.ratio**2
        places = [f"motor {joint.name}", *([] if joint in robot.flexible else [f"joint {joint.name}"])]
        total = viscous * v[i]
        for law in (laws[place] for place in places if place in laws):
            curve = law.symbols(law.curve().tolist())
            total += curve.level(v[i]) * ca.tanh(v[i] / SLIDING) + curve.growing(v[i])
        torques.append(total)
    return dense("friction", [v], [ca.vertcat(*torques)])


def write_compensation(folder: Path, robot: Robot, name: str, known: Iterable[str]) -> tuple[Path, ...]:
    """friction.c, friction.h: `friction_torque(v, u)`; friction.csv: the same over velocity.

    known: lines on the intervals of the numbers.
    """
    function, m = compensation(robot), len(robot.driven)
    entries = ", ".join(f"[{i}] motor {joint.name}" for i, joint in enumerate(robot.driven))
    lines = [f"{name}: friction_torque, the torque u of the motors' friction at velocities v, link side, SI.", entries]
    comment = c_comment([*lines, *known])
    equations = c_sources("equations", [function])["equations.c"]
    call = f"""
#include "friction.h"

void friction_torque(const double v[{m}], double u[{m}]) {{
  double w[{function.sz_w()} + 1];
  casadi_int iw[{function.sz_iw()} + 1];
  const double *arg[{function.sz_arg()} + 1] = {{v}};
  double *res[{function.sz_res()} + 1] = {{u}};
  friction(arg, res, iw, w, 0);
}}
"""
    header = (
        f"#ifndef FRICTION_H\n#define FRICTION_H\nvoid friction_torque(const double v[{m}], double u[{m}]);\n#endif\n"
    )
    source, declared, table = (folder / f"friction.{end}" for end in ("c", "h", "csv"))
    write_text(source, comment + equations + call)
    write_text(declared, comment + header)
    write_rows(table, [("motor", "velocity", "torque"), *_rows(robot, function)])
    return source, declared, table


def _rows(robot: Robot, function: ca.Function) -> Iterable[tuple[str, float, float]]:
    # The table of a joint without a limit of velocity goes to 3 rad/s (m/s).
    fastest = [joint.limits.velocity if np.isfinite(joint.limits.velocity) else 3.0 for joint in robot.driven]
    # Denser about standstill, where friction turns around.
    share = np.sinh(np.linspace(-6, 6, 201)) / np.sinh(6)
    v: FloatArray = np.outer(fastest, share)
    u = function.map(v.shape[1])(v).full()
    for joint, speeds, torques in zip(robot.driven, v.tolist(), u.tolist(), strict=True):
        yield from ((joint.name, speed, torque) for speed, torque in zip(speeds, torques, strict=True))
