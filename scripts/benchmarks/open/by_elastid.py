"""Entry of elastid: `elastid run` on a study for each robot, its options by the route of the records alone.

uv run --all-groups python scripts/benchmarks/open/by_elastid.py FOLDER [--seed 0] [--robots ...]
"""

import json
from collections.abc import Iterator
from typing import Any

import yaml
from entry import Task, enter
from robots import Joint

from elastid.app.cli import run_command


def robot_file(task: Task, is_sensed: bool) -> dict[str, Any]:
    """Return the robot model of the data sheet, without motors if the robot has torque sensors."""

    def joint(j: Joint) -> dict[str, Any]:
        row: dict[str, Any] = {"name": j.name, "axis": j.axis}
        if m := j.motor:
            rotor = {"inertia": m.J / m.ratio**2, "ratio": m.ratio, "viscous": m.f / m.ratio**2}
            row["motor"] = {"inertia": 1e-8} if is_sensed else rotor
        return row | ({"spring": {"stiffness": j.k, "damping": j.d}} if j.k else {})

    bodies = [
        {"name": b.name, "parent": b.parent, "placement": {"xyz": b.xyz}, "joints": [joint(j) for j in b.joints],
         "mass": b.mass, "center_of_mass": b.com, "inertia": b.inertia}
        for b in task.sheet.bodies
    ]  # fmt: skip
    file = {"name": task.robot["name"], "bodies": bodies}
    if rod := task.robot["rod"]:
        ends = [{"body": name, "point": point} for name, point in zip(rod["bodies"], rod["points"], strict=True)]
        inertia = rod["mass"] * (rod["length"] / 2) ** 2  # the mass is in both ends
        numbers = {"length": rod["length"], "mass": rod["mass"], "center": 0.5, "inertia": inertia}
        file["loops"] = [{"name": "rod", "ends": ends, "rod": numbers | {"stiffness": rod["k"], "damping": rod["d"]}}]
    return file if task.robot["tolerances"] else file | {"tolerances": "exact"}


def channels(task: Task, is_sensed: bool) -> Iterator[dict[str, Any]]:
    """Yield the channels: torque sensors and link angles if the robot has sensors, else motor torques and angles."""
    reference = "r" if task.experiment["route"] == "torque" else "reference"
    roles = {"sensor": "u", "q": "y", "joint": "y"} if is_sensed else {"r": reference, "u": "u", "q": "y"}
    for name in [name for name in roles if name in task.experiment["channels"]]:
        channel = task.experiment["channels"][name]
        for i, motor in enumerate(task.sheet.motors, 1):
            row = {
                "role": roles[name],
                "at": f"{'joint' if name == 'joint' else 'motor'} {i}",
                "channel": f"{name}_{i}",
            }
            row["quantity"] = "torque" if channel["unit"] == "N*m" else "position"
            link = {"side": "link"} | ({"scale": 1 / motor.ratio} if name == "q" else {})
            yield row | (link if is_sensed else {"side": channel["side"]})


def study(task: Task, is_sensed: bool) -> dict[str, Any]:
    """Return the study: free springs, viscous friction, and the delay of the references or of the torque log."""
    experiment, route = task.experiment, task.experiment["route"]
    keys = {"configuration": "posture", "realisation": "realisation", "experiment": "experiment"}
    files = [
        {"path": f"logs/{log['file']}"} | {key: log[name] for key, name in keys.items()} for log in experiment["files"]
    ]
    record: dict[str, Any] = {"rate_hz": experiment["rate_hz"], "period": experiment["period_s"], "files": files}
    record["channels"] = [*channels(task, is_sensed)]
    free: dict[str, Any] = {"k_*": {}, "d_*": {}} | ({} if is_sensed else {"fm_*": {}})
    if route == "torque" and not is_sensed:
        record["hold"] = "zero-order"
    elif route != "torque":
        kp, kd = (experiment["controller"][key] for key in ("position_gain", "velocity_gain"))
        record["controller"] = {"position_gain": [p / d for p, d in zip(kp, kd, strict=True)], "velocity_gain": kd}
        if route == "position":
            record["controller"]["reference"] = {"cycle": 1 / experiment["rate_hz"]}
        free["delay_r" if route == "command" else "delay_u"] = {}
    file = {"name": task.robot["name"], "robot": "robot.yml", "fit": {"parameters": free}}
    file["experiment"] = {"configurations": experiment["postures"], "recorded": record}
    # A slow motion over several motor turns separates transmission errors and hysteresis.
    return file | {"gears": {}} if route == "torque" and experiment["carrier_rad"] else file


def identify(task: Task) -> dict[str, Any]:
    """Write both files beside the records and run them."""
    is_sensed = "sensor" in task.experiment["channels"]
    for name, content in {"robot": robot_file(task, is_sensed), "study": study(task, is_sensed)}.items():
        (task.folder / f"{name}.yml").write_text(yaml.safe_dump(content, sort_keys=False))
    run = task.folder / "run"
    code = run_command(["run", str(task.folder / "study.yml"), "-q", "--jobs", "1", "--run", str(run)])
    if not (run / "summary.json").exists():
        return {"parameters": {}, "exit": code}
    summary = json.loads((run / "summary.json").read_text())
    values = {name: (p["value"], p["std"]) for name, p in summary["parameters"].items()}
    return {"parameters": values, "exit": code, "status": summary["status"]}


if __name__ == "__main__":
    enter("elastid", identify)
