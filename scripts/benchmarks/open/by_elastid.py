"""Entry of elastid: `elastid run` on a study for each robot, its options by the route of the records alone.

uv run --all-groups python scripts/benchmarks/open/by_elastid.py FOLDER [--seed 0] [--robots ...]
"""

import json
from typing import Any

import yaml
from entry import Task, enter

from elastid.app.cli import run_command


def robot_file(robot: dict[str, Any], is_sensed: bool) -> dict[str, Any]:
    """Robot model of the data sheet; motors before torque sensors are left out."""
    bodies = []
    for body in robot["bodies"]:
        joints = []
        for j in body["joints"]:
            row: dict[str, Any] = {"name": j["name"], "axis": j["axis"]}
            if motor := j["motor"]:
                ratio = motor["ratio"]
                rotor = {"inertia": motor["J"] / ratio**2, "ratio": ratio, "viscous": motor["f"] / ratio**2}
                row["motor"] = {"inertia": 1e-8} if is_sensed else rotor
            if j["k"]:
                row["spring"] = {"stiffness": j["k"], "damping": j["d"]}
            joints.append(row)
        place = {"parent": body["parent"], "placement": {"xyz": body["xyz"]}}
        inertia = {"mass": body["mass"], "center_of_mass": body["com"], "inertia": body["inertia"]}
        bodies.append({"name": body["name"], **place, "joints": joints, **inertia})
    file = {"name": robot["name"], "bodies": bodies}
    if rod := robot["rod"]:
        ends = [{"body": name, "point": point} for name, point in zip(rod["bodies"], rod["points"], strict=True)]
        inertia = rod["mass"] * (rod["length"] / 2) ** 2  # the mass is in both ends
        numbers = {"length": rod["length"], "mass": rod["mass"], "center": 0.5, "inertia": inertia}
        file["loops"] = [{"name": "rod", "ends": ends, "rod": numbers | {"stiffness": rod["k"], "damping": rod["d"]}}]
    return file if robot["tolerances"] else file | {"tolerances": "exact"}


def study(task: Task) -> dict[str, Any]:
    """Study of the records: all springs, viscous friction, and the delay of references or of the torque's log."""
    experiment = task.experiment
    route, is_sensed = experiment["route"], "sensor" in experiment["channels"]
    roles = {"r": "r", "u": "u", "q": "y"} if route == "torque" else {"r": "reference", "u": "u", "q": "y"}
    roles = {"sensor": "u", "q": "y", "joint": "y"} if is_sensed else roles
    channels = [
        {"role": role, "at": f"{'joint' if name == 'joint' else 'motor'} {i + 1}", "channel": f"{name}_{i + 1}",
         "quantity": "torque" if experiment["channels"][name]["unit"] == "N*m" else "position",
         "side": experiment["channels"][name]["side"]}
        for name, role in roles.items() if name in experiment["channels"]
        for i in range(len(experiment["torque_rms"]))
    ]  # fmt: skip
    if is_sensed:
        channels = [c | ({"side": "link"} if c["at"].startswith("motor") else {}) for c in channels]
        ratios = [motor.ratio for motor in task.sheet.motors]
        channels = [
            c | {"scale": 1 / ratios[int(c["at"][-1]) - 1]} if c["channel"].startswith("q") else c for c in channels
        ]
    record: dict[str, Any] = {"rate_hz": experiment["rate_hz"], "period": experiment["period_s"], "channels": channels}
    record["files"] = [
        {
            "path": f"logs/{f['file']}",
            "configuration": f["posture"],
            "realisation": f["realisation"],
            "experiment": f["experiment"],
        }
        for f in experiment["files"]
    ]
    free: dict[str, Any] = {"k_*": {}, "d_*": {}} | ({} if is_sensed else {"fm_*": {}})
    gains = {key: experiment["controller"][key] for key in ("position_gain", "velocity_gain")}
    if route == "torque" and not is_sensed:
        record["hold"] = "zero-order"
    elif route != "torque":
        gains["position_gain"] = [p / v for p, v in zip(gains["position_gain"], gains["velocity_gain"], strict=True)]
        path = {"reference": {"cycle": 1 / experiment["rate_hz"]}} if route == "position" else {}
        record["controller"] = gains | path
        free["delay_r" if route == "command" else "delay_u"] = {}
    file = {
        "name": task.robot["name"], "robot": "robot.yml",
        "experiment": {"configurations": experiment["postures"], "recorded": record}, "fit": {"parameters": free},
    }  # fmt: skip
    # A slow motion over turns of the motor is there to separate transmission errors and hysteresis.
    return file | {"gears": {}} if route == "torque" and experiment["carrier_rad"] else file


def identify(task: Task) -> dict[str, Any]:
    """Write both files beside the records and run them."""
    files = {"robot": robot_file(task.robot, "sensor" in task.experiment["channels"]), "study": study(task)}
    for name, content in files.items():
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
