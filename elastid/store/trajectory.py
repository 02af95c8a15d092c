"""A trajectory_msgs/msg/JointTrajectory in YAML, as `ros2 topic pub` takes it."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.store.files import write_text


def write_trajectory(path: Path, joints: Sequence[str], time_s: FloatArray, **signals: FloatArray) -> Path:
    """Write signals (n, n_u) such as positions or velocities, in SI, link side, at times (n,) from the first one."""
    nanoseconds = np.rint((time_s - time_s[0]) * 1e9).astype(np.int64).tolist()
    rows = zip(nanoseconds, *(signal.tolist() for signal in signals.values()), strict=True)
    lines = ["header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}", f"joint_names: {json.dumps([*joints])}", "points:"]
    for time, *values in rows:
        values_text = "".join(f"{name}: {value}, " for name, value in zip(signals, values, strict=True))
        lines.append(f"- {{{values_text}time_from_start: {{sec: {time // 10**9}, nanosec: {time % 10**9}}}}}")
    write_text(path, "\n".join([*lines, ""]))
    return path
