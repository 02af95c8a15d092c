"""Export of a tuned move: C code with tables and interpolation, a ROS 2 JointTrajectory in YAML, and a MAT-file.

Link-side values, SI, over the time from the first sample; the robot is at rest before and after the move.
"""

from pathlib import Path

import numpy as np

from elastid.base.escape import c_comment, one_line
from elastid.base.files import from_template
from elastid.store.files import write_text
from elastid.store.trajectory import write_trajectory
from elastid.targets.matlab import write_mat
from elastid.targets.numbers import c_row
from elastid.use.tune import TunedMove


def write_move_c(folder: Path, tuned: TunedMove) -> tuple[Path, ...]:
    """Write move.c and move.h with `move_at(t, q, v, u)`, which returns 1 after the last sample."""
    texts = move_sources(tuned)
    for name, text in texts.items():
        write_text(folder / name, text)
    return tuple(folder / name for name in texts)


def move_sources(tuned: TunedMove) -> dict[str, str]:
    """Return the text of move.c and move.h."""
    n, m, step = len(tuned.time_s), len(tuned.joints), float(np.diff(tuned.time_s).mean())
    motors = enumerate(zip(tuned.joints, tuned.units, strict=True))
    comment = c_comment([
        f"{tuned.name}: a move of {tuned.duration:.6g} s, link side, SI, t in s from its first sample.", "",
        f"Entries: {', '.join(f'[{i}] motor {name} ({unit})' for i, (name, unit) in motors)}",
        "move_at: position q, velocity v, feedforward torque u at t; returns 1 once the move is over.",
        "Torque on the motor's side is u over the gear ratio, position and velocity times it.",
    ])  # fmt: skip
    rows = {
        name: "".join(f"  {c_row(row)},\n" for row in getattr(tuned, name))
        for name in ("position", "velocity", "torque")
    }
    source = from_template(
        "targets/templates/move.c", comment=comment, n=n, m=m, step=repr(step), last=float(n - 1), cells=n - 1, **rows
    )
    return {
        "move.c": source,
        "move.h": from_template("targets/templates/move.h", comment=comment, m=m, duration=float(step * (n - 1))),
    }


def write_move(folder: Path, tuned: TunedMove) -> tuple[Path, ...]:
    """Write the move for C, ROS 2 and MATLAB; `fmu.write_move_fmu` writes it together with a robot.

    trajectory.yaml: a trajectory_msgs/msg/JointTrajectory for `ros2 topic pub`, with torques as effort.  move.mat
    (version 5): time, position, velocity, acceleration, torque, joints; load_move.m reads it.
    """
    motion = {"positions": tuned.position, "velocities": tuned.velocity, "accelerations": tuned.acceleration}
    table = write_trajectory(folder / "trajectory.yaml", tuned.joints, tuned.time_s, **motion, effort=tuned.torque)
    content = {name: getattr(tuned, name) for name in ("position", "velocity", "acceleration", "torque")}
    content |= {"time": (tuned.time_s - tuned.time_s[0])[:, None], "path": tuned.target}
    data, script = folder / "move.mat", folder / "load_move.m"
    write_mat(data, {**content, "joints": np.array(tuned.joints, dtype=object)})
    write_text(script, from_template("targets/templates/load_move.m", name=one_line(tuned.name)))
    return *write_move_c(folder, tuned), table, data, script
