"""Write the records of the open benchmark, and their truth beside them.

    uv run --all-groups python scripts/benchmarks/open/make.py FOLDER [--seed 0] [--secret WORD] [--robots ...]

The documentation describes the layout of the files (scripts/docs/pages/howto/neighbours.rst). Public seeds are 0 to 9.
A judge who wants records that nobody has seen gives a secret word: it changes all seeds and appears in no file.
"""

import hashlib
import itertools
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from engine import LINES, PERIOD_S, PERIODS, RATES_HZ, Controller, Plant, controller, simulate
from entry import options
from robots import ROWS, TOLERANCES, Array, Row, draw, mjcf, postures

UNITS = {"r": "N*m", "u": "N*m", "q": "rad", "sensor": "N*m", "joint": "rad"}


def write(folder: Path, row: Row, seed: int, secret: str) -> None:
    """Simulate all experiments of a robot; a realisation has as many as there are motors, with orthogonal signs."""
    key = int.from_bytes(hashlib.sha256(f"{secret}{seed}".encode()).digest()[:4]) if secret else seed
    true, sheet, torque = draw(row, key)
    plant, rng, n = Plant(true), np.random.default_rng([key, 77, ROWS.index(row)]), len(torque)
    law = controller(row, torque, rng)
    place, truth = folder / f"seed-{seed}" / row.name, folder / "truth" / f"seed-{seed}"
    for each in (place / "logs", truth):
        each.mkdir(parents=True, exist_ok=True)
    public = describe(row, law, torque)
    with h5py.File(place / "logs.h5", "w") as store:
        for file in public["files"]:
            if file["experiment"] == 0:
                phases = np.exp(1j * rng.uniform(0, 2 * np.pi, (len(LINES), n)))
            signs = np.exp(2j * np.pi * file["experiment"] * np.arange(n) / n)
            logs = simulate(row, plant, law, np.array(public["postures"][file["posture"]]), phases * signs, torque, rng)
            columns = {"time": np.arange(len(logs["q"])) / public["rate_hz"]}
            columns |= {f"{c}_{i + 1}": logs[c][:, i] for c in public["channels"] for i in range(n)}
            path, table = place / "logs" / file["file"], np.column_stack([*columns.values()])
            np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
            for column, values in columns.items():
                store[f"{path.stem}/{column}"] = values.astype(np.float32 if column[0] in "us" else np.float64)
    tolerances = {} if row.sheet == "exact" else TOLERANCES
    delays = {"reference_delay_s": law.reference_delay, "torque_delay_s": law.torque_delay - 0.5 / law.hz}
    scored = {"scored": true.parameters, **(delays if row.route != "torque" else {}), "robot": asdict(true)}
    (place / "robot.xml").write_text(mjcf(sheet))
    (place / "robot.json").write_text(json.dumps(asdict(sheet) | {"tolerances": tolerances}, indent=1))
    (place / "experiment.json").write_text(json.dumps(public, indent=1))
    (truth / f"{row.name}.json").write_text(json.dumps(scored, indent=1))


def describe(row: Row, law: Controller, torque: Array) -> dict[str, Any]:
    """Return the public description of the experiments."""
    names = UNITS if row.effect == "sensors" else "rq" if row.route == "command" else "ruq"
    channels = {name: {"unit": UNITS[name], "side": "motor" if name == "q" else "link"} for name in names}
    channels["r"]["unit"] = "N*m" if row.route == "torque" else "rad"
    n, gains = len(torque), {"position_gain": law.kp.tolist(), "velocity_gain": law.kd.tolist()}
    logs = itertools.product(postures(row), range(3 if n == 2 else 2), range(n))
    files = [{"file": f"{q}-{m}-{i}.csv", "posture": q, "realisation": m, "experiment": i} for q, m, i in logs]
    return {
        "route": row.route, "rate_hz": RATES_HZ[row.route], "period_s": PERIOD_S, "settling_periods": 1,
        "periods": PERIODS, "lines_hz": (LINES / PERIOD_S).tolist(), "postures": postures(row),
        "torque_rms": torque.tolist(), "carrier_rad": row.carrier,
        "controller": gains | {"velocity": "difference of two encoder positions"},
        "reference_path": "linear, each reference reached one cycle later" if row.route == "position" else "hold",
        "channels": channels, "files": files,
    }  # fmt: skip


if __name__ == "__main__":
    arguments = options(secret="")
    for row in (row for row in ROWS if row.name in (arguments.robots or [row.name])):
        write(arguments.folder, row, arguments.seed, arguments.secret)
        print(row.name, flush=True)
