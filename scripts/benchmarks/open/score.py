"""Score results of the open benchmark against the truth.

    uv run --all-groups python scripts/benchmarks/open/score.py FOLDER [RESULT.json ...]

For each robot: the largest errors of stiffnesses and dampings in %, how many of the intervals value +- 1.96 std contain
the truth, the rms of error over std, the tool error and the CPU seconds. Tool error: in 50 postures that no record has,
the motors are locked and a force pushes the tool for 20 ms; the tool's deviation in 0.5 s of the engine with estimated
instead of true springs, rms over rms. Without files: all of FOLDER/results, and the guesses of the data sheet as an
entry `start`. The last line is one JSON object; --save writes it to a file, which the documentation shows.
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from engine import Array, build, equilibrium, physics, push
from entry import read_robot, tasks
from robots import Joint, Robot

PULSE_S, TIME_S, POSTURES = 0.02, 0.5, 50


def with_springs(robot: Robot, values: Mapping[str, float]) -> Robot:
    """Return the robot with the estimated springs and dampers, locked motors and no gear effects."""

    def joint(j: Joint) -> Joint:
        k, d = values.get(f"k_{j.name}", j.k), values.get(f"d_{j.name}", j.d)
        return replace(j, k=k, d=d, motor=j.motor and replace(j.motor, J=1e9), hysteresis=0.0, error=0.0)

    rod = robot.rod and replace(robot.rod, k=values.get("k_rod", robot.rod.k))
    return replace(robot.with_joints(joint), rod=rod)


def tool_motion(robot: Robot, postures: Array, forces: Array) -> Array:
    """Simulate the tool after a push, (postures, samples, 3) in m from its rest."""
    plant, motions = build(robot), []
    with physics(plant):
        for posture, force in zip(postures, forces, strict=True):
            data = mujoco.MjData(plant.model)
            hold = equilibrium(plant, posture, data)
            rest, motion = data.site("tool").xpos.copy(), []
            for n in range(round(TIME_S / plant.model.opt.timestep)):
                data.qfrc_applied[:] = 0.0
                if n * plant.model.opt.timestep < PULSE_S:
                    push(plant, data, force)
                data.qfrc_applied[plant.motors] += hold
                mujoco.mj_step(plant.model, data)
                motion.append(data.site("tool").xpos - rest)
            motions.append(motion)
    return np.array(motions)


def tool_error(truth: Robot, values: Mapping[str, float], seed: int) -> float:
    """Compute the rms deviation of the tool over the rms of its motion, in %."""
    rng, n = np.random.default_rng([seed, 50]), len(truth.motors)
    postures = rng.uniform(-1.2, 1.2, (POSTURES, n))
    if truth.rod:  # the linkage keeps its branch
        postures[:, 1] = postures[:, 0] + rng.uniform(-0.6, 0.6, POSTURES)
    forces = rng.standard_normal((POSTURES, 3))
    forces /= np.linalg.norm(forces, axis=1)[:, None]
    true, estimated = (tool_motion(with_springs(truth, v), postures, forces) for v in ({}, values))
    return 100 * float(np.sqrt(np.mean((true - estimated) ** 2) / np.mean(true**2)))


def score(truth: Mapping[str, Any], estimates: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Compare the estimates of one robot with its truth; a value without std has no interval."""
    wanted = truth["scored"]
    values = {name: estimates["parameters"][name] for name in wanted if name in estimates["parameters"]}
    off = {name: 100 * abs(value / wanted[name] - 1) for name, (value, _) in values.items()}
    z = np.array([(value - wanted[name]) / std for name, (value, std) in values.items() if std])
    k_percent, d_percent = (max((e for name, e in off.items() if name[0] == c), default=None) for c in "kd")
    numbers = {name: value for name, (value, _) in values.items()}
    return {
        "k_percent": k_percent,
        "d_percent": d_percent,
        "inside": int(np.sum(np.abs(z) < 1.96)),
        "of": len(wanted),
        "error_over_std": float(np.sqrt(np.mean(z**2))) if z.size else None,
        "tool_percent": tool_error(read_robot(truth["robot"]), numbers, seed) if len(values) == len(wanted) else None,
        "cpu_s": estimates.get("cpu_s"),
        "status": estimates.get("status"),
    }


def guesses(folder: Path, seed: int) -> dict[str, Any]:
    """Return the entry `start`: the start values of the data sheet."""
    rows = {task.folder.name: {"parameters": {n: (v, 0.0) for n, v in task.sheet.truth().items()}}
            for task in tasks(folder, seed)}  # fmt: skip
    return {"entry": "start", "seed": seed, "robots": rows}


def main() -> None:
    """Print a row for each robot and one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("results", nargs="*", type=Path)
    parser.add_argument("--save", type=Path)
    args = parser.parse_args()
    results = [json.loads(p.read_text()) for p in args.results or sorted((args.folder / "results").glob("*.json"))]
    if not args.results:
        results += [guesses(args.folder, seed) for seed in sorted({r["seed"] for r in results})]
    rows = []
    for result in results:
        entry, seed = result["entry"], result["seed"]
        for name, estimates in result["robots"].items():
            truth = json.loads((args.folder / "truth" / f"seed-{seed}" / f"{name}.json").read_text())
            row = {"entry": entry, "seed": seed, "robot": name, **score(truth, estimates, seed)}
            print(json.dumps(row), flush=True)
            rows.append(row)
    if args.save:
        args.save.write_text('{"open": [\n' + ",\n".join(map(json.dumps, rows)) + "\n]}\n")
    print(json.dumps({"open": rows}))


if __name__ == "__main__":
    main()
