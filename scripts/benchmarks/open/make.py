"""Write the records of the open benchmark, and their truth beside them.

    uv run --all-groups python scripts/benchmarks/open/make.py FOLDER [--seed 0] [--secret WORD] [--robots ...]

Below FOLDER/seed-<seed>/<robot>:

- robot.json: the data sheet. Bodies with their joints, link side; stiffnesses and dampings are rough guesses.
- robot.xml: the same for MuJoCo; `m1` is the angle of motor 1, `s1` the twist of its gear.
- experiment.json: rate, period, postures (motor angles in rad), controller, channels with units and sides, and the list
  of files. Each log begins at rest; its first period settles.
- logs/*.csv: a column a channel; logs.h5: the same numbers, one group a log.

FOLDER/truth/seed-<seed>/<robot>.json contains the scored parameters and all other true values. Public seeds are 0 to 9.
A judge who wants records that nobody has seen gives a secret word: it changes all seeds and appears in no file.
"""

import argparse
import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import h5py
import numpy as np
from engine import LINES, PERIOD_S, PERIODS, RATES_HZ, Array, build, controller, multisine, simulate
from robots import ROWS, TOLERANCES, Row, draw, mjcf, postures

UNITS = {"r": "N*m", "u": "N*m", "q": "rad", "sensor": "N*m", "joint": "rad"}


def channels(row: Row) -> list[str]:
    """Signals that the logs of a robot have."""
    if row.effect == "sensors":
        return ["r", "u", "q", "sensor", "joint"]
    return ["r", "q"] if row.route == "command" else ["r", "u", "q"]


def write(folder: Path, row: Row, seed: int, secret: str) -> None:
    """Simulate all experiments of a robot; a realisation has as many as there are motors, with orthogonal signs."""
    key = int.from_bytes(hashlib.sha256(f"{secret}{seed}".encode()).digest()[:4]) if secret else seed
    true, sheet, torque = draw(row, key)
    plant, rng = build(true), np.random.default_rng([key, 77, ROWS.index(row)])
    law, n = controller(row, plant, torque, rng), len(torque)
    place = folder / f"seed-{seed}" / row.name
    (place / "logs").mkdir(parents=True, exist_ok=True)
    files, rate = [], RATES_HZ[row.route]
    with h5py.File(place / "logs.h5", "w") as store:
        for name, posture in postures(row).items():
            for realisation in range(3 if n == 2 else 2):
                phases = rng.uniform(0, 2 * np.pi, (len(LINES), n))
                for experiment in range(n):
                    signs = np.exp(2j * np.pi * experiment * np.arange(n) / n)
                    amplitudes = multisine(row, law, torque, phases, signs)
                    logs = simulate(row, plant, law, np.array(posture), amplitudes, torque, rng)
                    file = f"{name}-{realisation}-{experiment}.csv"
                    files.append({"file": file, "posture": name, "realisation": realisation, "experiment": experiment})
                    columns = {f"{c}_{i + 1}": logs[c][:, i] for c in channels(row) for i in range(n)}
                    times = np.arange(len(logs["q"])) / rate
                    table = np.column_stack([times, *columns.values()])
                    heading = ",".join(["time", *columns])
                    np.savetxt(place / "logs" / file, table, fmt="%.9g", delimiter=",", header=heading, comments="")
                    group = store.create_group(file.removesuffix(".csv"))
                    for column, values in {"time": times, **columns}.items():
                        group[column] = values.astype(np.float32 if column[0] in "us" else np.float64)
    experiment = describe(row, law.kp, law.kd, torque) | {"files": files}
    (place / "robot.json").write_text(json.dumps(asdict(sheet) | {"tolerances": tolerances(row)}, indent=1))
    (place / "robot.xml").write_text(mjcf(sheet))
    (place / "experiment.json").write_text(json.dumps(experiment, indent=1))
    truth = folder / "truth" / f"seed-{seed}"
    truth.mkdir(parents=True, exist_ok=True)
    delays = {"reference_delay_s": law.reference_delay, "torque_delay_s": law.torque_delay - 0.5 / law.hz}
    scored = {"scored": true.truth(), **(delays if row.route != "torque" else {}), "robot": asdict(true)}
    (truth / f"{row.name}.json").write_text(json.dumps(scored, indent=1))


def tolerances(row: Row) -> dict[str, float]:
    """Standard deviations of the data sheet; empty for an exact one."""
    return {} if row.sheet == "exact" else TOLERANCES


def describe(row: Row, kp: list[float], kd: list[float], torque: Array) -> dict[str, object]:
    """Return the public description of the experiments."""
    units = UNITS | ({} if row.route == "torque" else {"r": "rad"})
    sides = {"q": "motor"}
    return {
        "route": row.route,
        "rate_hz": RATES_HZ[row.route],
        "period_s": PERIOD_S,
        "settling_periods": 1,
        "periods": PERIODS,
        "lines_hz": (LINES / PERIOD_S).tolist(),
        "postures": postures(row),
        "torque_rms": torque.tolist(),
        "carrier_rad": row.carrier,
        "controller": {"position_gain": kp, "velocity_gain": kd, "velocity": "difference of two encoder positions"},
        "reference_path": "linear, each reference reached one cycle later" if row.route == "position" else "hold",
        "channels": {c: {"unit": units[c], "side": sides.get(c, "link")} for c in channels(row)},
    }


def main() -> None:
    """Write the robots that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--secret", default="")
    parser.add_argument("--robots", nargs="+", choices=[row.name for row in ROWS], default=[row.name for row in ROWS])
    options = parser.parse_args()
    for row in ROWS:
        if row.name in options.robots:
            write(options.folder, row, options.seed, options.secret)
            print(row.name, flush=True)


if __name__ == "__main__":
    main()
