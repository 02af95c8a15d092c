"""Score results of the open benchmark against the truth.

    uv run --all-groups python scripts/benchmarks/open/score.py FOLDER [--save FILE]

It scores all files in FOLDER/results, and the start values of the data sheet as an entry `start`. The documentation
defines the scores (scripts/docs/pages/howto/neighbours.rst) and shows FILE. The last line is one JSON object.
"""

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from engine import Array, Plant, equilibrium
from entry import tasks
from robots import STEPS_HZ, Robot

PULSE_S, TIME_S, POSTURES = 0.02, 0.5, 50


def tool_motion(robot: Robot, postures: Array, forces: Array) -> Array:
    """Simulate the tool after a push, (postures, samples, 3) in m from its rest; motors are locked, gears linear."""
    plant, motions = Plant(robot), []
    plant.model.dof_armature[plant.motors] = 1e9
    body = plant.model.site("tool").bodyid[0]
    for posture, force in zip(postures, forces, strict=True):
        data = mujoco.MjData(plant.model)
        hold, tool = equilibrium(plant, posture, data), data.site("tool").xpos
        rest, applied = tool.copy(), data.qfrc_applied
        for n in range(round(TIME_S * STEPS_HZ)):
            applied[:], applied[plant.motors] = 0.0, hold
            if n < PULSE_S * STEPS_HZ:
                mujoco.mj_applyFT(plant.model, data, force, np.zeros(3), tool, body, applied)
            mujoco.mj_step(plant.model, data)
            motions.append(tool - rest)
    return np.reshape(motions, (len(postures), -1, 3))


def tool_error(truth: Robot, values: Mapping[str, float], seed: int) -> float:
    """Compute the rms deviation of the tool over the rms of its motion, in %."""
    rng = np.random.default_rng([seed, 50])
    postures = rng.uniform(-1.2, 1.2, (POSTURES, len(truth.gears)))
    if truth.rod:  # the linkage keeps its branch
        postures[:, 1] = postures[:, 0] + rng.uniform(-0.6, 0.6, POSTURES)
    forces = rng.standard_normal((POSTURES, 3))
    forces /= np.linalg.norm(forces, axis=1)[:, None]
    true, estimated = (tool_motion(truth.with_parameters(v), postures, forces) for v in ({}, values))
    return 100 * float(np.sqrt(np.mean((true - estimated) ** 2) / np.mean(true**2)))


def score(truth: Mapping[str, Any], estimates: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Compare the estimates of one robot with its truth; a value without std has no interval."""
    scored, parameters = truth["scored"], estimates["parameters"]
    values = {name: parameters[name][0] for name in scored if name in parameters}
    off = {name: 100 * abs(value / scored[name] - 1) for name, value in values.items()}
    z = np.array([(value - scored[name]) / std for name, value in values.items() if (std := parameters[name][1])])
    return {
        **{f"{c}_percent": max((e for name, e in off.items() if name[0] == c), default=None) for c in "kd"},
        "inside": int(np.sum(np.abs(z) < 1.96)), "of": len(scored),
        "error_over_std": float(np.sqrt(np.mean(z**2))) if z.size else None,
        "tool_percent": tool_error(Robot(**truth["robot"]), values, seed) if len(values) == len(scored) else None,
        "cpu_s": estimates.get("cpu_s"), "status": estimates.get("status"),
    }  # fmt: skip


def main() -> None:
    """Print a row for each robot and one JSON object."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--save", type=Path)
    folder, save = vars(parser.parse_args()).values()
    results, rows = [json.loads(path.read_text()) for path in sorted((folder / "results").glob("*.json"))], []
    for seed in sorted({result["seed"] for result in results}):
        sheets = {task.folder.name: task.sheet.parameters.items() for task in tasks(folder, seed)}
        starts = {robot: {"parameters": {name: (k, 0.0) for name, k in sheet}} for robot, sheet in sheets.items()}
        results.append({"entry": "start", "seed": seed, "robots": starts})
    for result in results:
        for name, estimates in result["robots"].items():
            truth = json.loads((folder / "truth" / f"seed-{result['seed']}" / f"{name}.json").read_text())
            numbers = score(truth, estimates, result["seed"])
            rows.append({"entry": result["entry"], "seed": result["seed"], "robot": name, **numbers})
            print(json.dumps(rows[-1]), flush=True)
    if save:
        save.write_text('{"open": [\n' + ",\n".join(map(json.dumps, rows)) + "\n]}\n")
    print(json.dumps({"open": rows}))


if __name__ == "__main__":
    main()
