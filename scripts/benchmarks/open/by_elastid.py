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
    file = {"name": task.sheet.name, "bodies": bodies} | ({} if task.tolerances else {"tolerances": "exact"})
    if rod := task.sheet.rod:
        ends = [{"body": name, "point": point} for name, point in zip(rod.bodies, rod.points, strict=True)]
        inertia = rod.mass * (rod.length / 2) ** 2  # the mass is in both ends
        numbers = {"length": rod.length, "mass": rod.mass, "center": 0.5, "inertia": inertia}
        file["loops"] = [{"name": "rod", "ends": ends, "rod": numbers | {"stiffness": rod.k, "damping": rod.d}}]
    return file


def channels(task: Task, is_sensed: bool) -> Iterator[dict[str, Any]]:
    """Yield the channels: torque sensors and link angles if the robot has sensors, else motor torques and angles."""
    reference = "r" if task.experiment["route"] == "torque" else "reference"
    roles = {"sensor": "u", "q": "y", "joint": "y"} if is_sensed else {"r": reference, "u": "u", "q": "y"}
    for name, role in roles.items():
        channel, place = task.experiment["channels"].get(name), "joint" if name == "joint" else "motor"
        for i, j in enumerate(task.sheet.gears, 1) if channel else ():
            row = {"role": role, "at": f"{place} {i}", "channel": f"{name}_{i}"}
            row["quantity"] = "torque" if channel["unit"] == "N*m" else "position"
            row["side"] = "link" if is_sensed else channel["side"]
            yield row | ({"scale": 1 / j.motor.ratio} if is_sensed and name == "q" else {})


def study(task: Task, is_sensed: bool) -> dict[str, Any]:
    """Return the study: free springs, viscous friction, and the delay of the references or of the torque log."""
    experiment, route = task.experiment, task.experiment["route"]
    files = [
        {"path": f"logs/{name}", "configuration": posture, "realisation": m, "experiment": i}
        for name, posture, m, i in map(dict.values, experiment["files"])
    ]
    timing = {"rate_hz": experiment["rate_hz"], "period": experiment["period_s"]}
    record: dict[str, Any] = timing | {"channels": [*channels(task, is_sensed)], "files": files}
    delay = {"command": ["delay_r"], "position": ["delay_u"]}.get(route, [])
    free = ["k_*", "d_*", *([] if is_sensed else ["fm_*"]), *delay]
    if route != "torque":
        kp, kd = (experiment["controller"][key] for key in ("position_gain", "velocity_gain"))
        record["controller"] = {"position_gain": [p / d for p, d in zip(kp, kd, strict=True)], "velocity_gain": kd}
        record["controller"] |= {"reference": {"cycle": 1 / experiment["rate_hz"]}} if route == "position" else {}
    elif not is_sensed:
        record["hold"] = "zero-order"
    file = {"name": task.sheet.name, "robot": "robot.yml", "fit": {"parameters": {name: {} for name in free}}}
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
