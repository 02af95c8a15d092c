"""Reference trajectories and torques for robot controllers: CSV, and JointTrajectory of ROS 2 in YAML."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.escape import csv_cell
from elastid.base.units import translation_unit
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.plan.reference_trajectory import Reference, references
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.robot import Robot
from elastid.store.files import text_file, write_text

_MOTION = (("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s^2"), ("feed_forward", "N*m"))


def write_trajectory(path: Path, joints: Sequence[str], time_s: FloatArray, **signals: FloatArray) -> Path:
    """Write signals (n, n_u), SI, link side, at times (n,) as trajectory_msgs/msg/JointTrajectory; return the path.

    signals: by the keys of the points, such as positions and velocities. Times are relative to the first one.
    """
    nanoseconds = np.rint((time_s - time_s[0]) * 1e9).astype(np.int64).tolist()
    rows = zip(nanoseconds, *(signal.tolist() for signal in signals.values()), strict=True)
    lines = ["header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}", f"joint_names: {json.dumps([*joints])}", "points:"]
    for time, *values in rows:
        values_text = "".join(f"{name}: {value}, " for name, value in zip(signals, values, strict=True))
        lines.append(f"- {{{values_text}time_from_start: {{sec: {time // 10**9}, nanosec: {time % 10**9}}}}}")
    write_text(path, "\n".join([*lines, ""]))
    return path


def write_run(
    path: Path, reference: Reference, inputs: Sequence[str], sliding: Sequence[str] = (),
    injected: FloatArray | None = None,
) -> None:  # fmt: skip
    """Write the reference trajectory of a whole run as CSV; the first period begins at time 0.

    sliding: inputs that translate.  injected (n, n_u): injected torque; None: write its scale factor instead.
    """
    signals = [(name, unit, getattr(reference, name)) for name, unit in _MOTION]
    signals += [] if injected is None else [("injected torque", "N*m", injected)]
    headings = [
        f"{name} of {location} ({translation_unit(unit) if location in sliding else unit}, link side)"
        for name, unit, _ in signals
        for location in inputs
    ]
    columns, scale = [signal for _, _, signal in signals], ["torque scale"] * (injected is None)
    rows = np.column_stack([reference.scale, *columns] if scale else columns)
    _write_csv(path, ["time_s", *scale, *headings], rows, reference.rate_hz, reference.first_sample)


def write_torque(path: Path, plan: Plan, experiment: Experiment) -> None:
    """Write one period of the injected torques as CSV; it begins at time 0 and repeats in both directions."""
    columns = [f"{location} ({'N' if location in plan.sliding else 'N*m'}, link side)" for location in plan.inputs]
    _write_csv(path, ["time_s", *columns], plan.torque(experiment), plan.rate_hz)


def write_references(path: Path, plan: Plan, experiment: Experiment, simulated: SimulatedSpec, robot: Robot) -> None:
    """Write all references of a run, one row per cycle, in the unit and on the side of `controller.reference`.

    The periods begin at time 0.  Positions also as a JointTrajectory, whose points have velocities (central
    differences) for the interpolation `spline`.
    """
    spec = simulated.controller.reference
    assert spec is not None  # the plan has references
    rows, counts = references(plan, simulated.carrier, experiment), simulated.noise.encoder_counts
    rate_hz, first = plan.rate_hz / plan.cycle_samples, plan.first_sample // plan.cycle_samples
    side = "motor" if spec.unit == "increments" else spec.side
    slides = np.array([location in plan.sliding and side == "link" for location in plan.inputs])
    scale = {"rad": 1.0, "deg": np.where(slides, 1.0, 180 / np.pi), "increments": counts / (2 * np.pi)}[spec.unit]
    x = (rows if side == "link" else rows @ robot.eta.T) * np.asarray(scale, np.float64)
    if spec.unit == "increments" and plan.inject == "position":
        x = np.rint(x)
    per_s = "/s" if plan.inject == "velocity" else ""
    headings = [
        f"{plan.inject} of {location} ({'m' if is_linear else spec.unit}{per_s}, {side} side)"
        for location, is_linear in zip(plan.inputs, slides, strict=True)
    ]
    _write_csv(path, ["time_s", *headings], x, rate_hz, first, 12)
    if plan.inject == "position":
        velocities = {"velocities": np.gradient(rows, axis=0) * rate_hz} if spec.interpolation == "spline" else {}
        time_s = np.arange(len(rows)) / rate_hz
        write_trajectory(path.with_suffix(".yaml"), robot.driven_names, time_s, positions=rows, **velocities)


def write_signals(path: Path, rate_hz: float, **signals: FloatArray) -> None:
    """Write signals (n,) by name as CSV, such as a reference of a joint for a robot controller, SI, link side."""
    _write_csv(path, ["t_s", *signals], np.column_stack([*signals.values()]), rate_hz)


def _write_csv(
    path: Path, headings: Sequence[str], rows: Any, rate_hz: float, first_sample: int = 0, digits: int = 9
) -> None:
    line = ",".join([f"%.{digits}g"] * len(headings)) + "\n"
    table = np.column_stack([(np.arange(len(rows)) - first_sample) / rate_hz, rows])
    with text_file(path) as file:
        csv.writer(file, lineterminator="\n").writerow(map(csv_cell, headings))
        file.write(line * len(table) % tuple(table.ravel().tolist()))
