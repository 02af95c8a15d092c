"""Is a misfit that effects of gears explain told from one with another cause?

    python scripts/studies/gear_misfits.py [--quick] [--seed 1]

Outside plant (tests/plants/two_mass_gear.py): motor and link behind a gear, four experiments, 200 Nm RMS. Right models:
friction on both sides, alone and with a spring that hardens, a gap, a hysteresis, a transmission error. Wrong ones: the
robot's file has the link or the motor 5 % too heavy, or the torque acts a sample (2 ms) later than it was logged; each
without friction and with it. The linear fit, then the gears laid open; counted is the motion that is left, over that of
the linear fit, by which `explains_misfit` judges (elastid/nonlinear/gear_result.py, EXPLAINED).

The last line is one JSON object. Asserted: of every right model less than EXPLAINED and a converged fit, of every wrong
one more, or a refusal, and a fit that is none.
Found: right models 0.005 to 0.014; a link too heavy 1.8, with friction 0.77; a motor 1.4 and 0.61; late torque refused.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.two_mass_gear import LINES, Gear, records, robot

from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.gear_result import EXPLAINED, with_gears
from elastid.nonlinear.gear_sheet import open_gears
from elastid.nonlinear.spec import GearsSpec
from elastid.nonlinear.take_out import estimate_without_friction
from elastid.record import Record

SPEC = EstimatorSpec(friction="none", transient_periods=0)
RUBS = Gear(F_m=20.0, F_l=12.0)
RIGHT = {
    "friction": RUBS,
    "hardening": replace(RUBS, k_3=2e9),
    "gap": replace(RUBS, gap=1e-4, loose=0.3),
    "hysteresis": replace(RUBS, hysteresis=10.0),
    "transmission error": replace(RUBS, error=3e-5),
}
# Numbers of the robot's file over those of the plant, and the samples by which the torque acts late.
WRONG: dict[str, tuple[dict[str, float], int]] = {
    "link": ({"J_l": 1.05}, 0), "motor": ({"J_m": 1.05}, 0), "late": ({}, 1)
}  # fmt: skip


def late(record: Record, samples: int) -> Record:
    """With the torque logged as much too early."""
    whole = record.n_periods * record.period_samples
    return replace(record, u=np.roll(record.u[:whole], -samples, axis=0), y=record.y[:whole])


def judged(gear: Gear, seed: int, factors: Mapping[str, float] | None = None, samples: int = 0) -> dict[str, Any]:
    """Motion left over that of the linear fit, the statuses of the fit before and after, and a refusal."""
    logs = tuple(late(record, samples) for record in records(gear, seed=seed))
    file = robot(replace(gear, **{name: getattr(gear, name) * factor for name, factor in (factors or {}).items()}))
    response = estimate_without_friction(logs, None, SPEC, LINES, robot=file)
    free = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
    result = identify([response], file, FitSpec(parameters=free, starts=1))
    gears = open_gears([logs], [response], result, file, SPEC, GearsSpec(), planned=LINES)
    share = None if gears.refused else gears.after / gears.before
    final = with_gears(result, gears).status
    return {"left": share, "linear": result.status, "status": final, "refused": gears.refused}


def main() -> None:
    """The table and its JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one right model and one wrong one, to see that it runs")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    right = {name: (gear, None, 0) for name, gear in RIGHT.items()}
    wrong = {
        f"{name}{' with friction' if gear.F_m else ''}": (gear, *fault)
        for name, fault in WRONG.items()
        for gear in (Gear(), RUBS)
    }
    if given.quick:
        right, wrong = {"friction": right["friction"]}, {"link with friction": wrong["link with friction"]}
    results = {}
    for name, (gear, factors, samples) in (right | wrong).items():
        one = results[name] = judged(gear, given.seed, factors, samples)
        print(f"{name:<24}{one['left'] or math.nan:>8.3f}  {one['linear']} -> {one['status']} {one['refused'][:50]}")
    for name, one in results.items():
        is_right = name in right
        assert (one["status"] == "converged") == is_right, f"{name}: {one}"
        assert one["left"] is None or (one["left"] < EXPLAINED) == is_right, f"{name}: {one}"
    print(json.dumps({"gear_misfits": results, "seed": given.seed}))


if __name__ == "__main__":
    main()
