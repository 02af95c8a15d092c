"""Is an effect of a gear that was not seen smaller than its bound, and are clean gears left without a word?

    python scripts/studies/gear_bounds.py [--quick] [--draws 10] [--seed 1]

Outside plant (tests/plants/two_mass_gear.py): motor and link behind a gear, four experiments, 200 Nm RMS. In turn one
effect has a level about the least that can be seen, drawn evenly in its logarithm: friction at the motor and behind the
gear 0.01 to 1 Nm, a spring that stiffens by 1e-5 to 1e-3 at the peak of the torque, a transmission error of 1e-8 to
3e-6 rad; and a clean gear. The linear fit, then the sheet (elastid/nonlinear/gear_sheet.py).

Counted: draws in which the effect was seen; of those in which it was not, how many have it below its 95 % bound;
effects that were seen and are not there; refusals, and warnings of any kind. The last line is one JSON object.
Asserted: at least 90 % of the unseen are below their bound, and no clean gear has an effect, a warning or a refusal.

Found, 2 draws of each (`--draws 2`): friction at the motor and behind the gear seen in all four, from 0.02 Nm on, a
transmission error in one of two; the three unseen effects below their bounds; nothing but what is there in any draw.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.two_mass_gear import LINES, Gear, records, robot

from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.gear_result import GearResult
from elastid.nonlinear.gear_sheet import open_gears
from elastid.nonlinear.spec import GearsSpec

SPEC = EstimatorSpec(friction="none", transient_periods=0)
PEAK = 650.0  # Nm of the gear, of which a stiffening is a share
# Of each case: the field of the plant, its lowest and highest level, and the number of the sheet that has it.
CASES: dict[str, tuple[str, float, float, str]] = {
    "friction at the motor": ("F_m", 0.01, 1.0, "Fc_m1"),
    "friction behind the gear": ("F_l", 0.01, 1.0, "Fb_1"),
    "stiffening": ("k_3", 1e-5, 1e-3, "h_1"),
    "transmission error": ("error", 1e-8, 3e-6, "e1_1"),
    "clean": ("", 0.0, 0.0, ""),
}
FROM_SPRINGS = ("k_1", "d_1", "K1_1", "K2_1", "K3_1", "Hw_1")


def sheet(gear: Gear, seed: int) -> GearResult:
    """The gear of a draw, laid open beside its linear fit."""
    measured = records(gear, seed=seed)
    response = estimate(measured, SPEC, LINES)
    wanted = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
    spec = FitSpec(parameters=wanted, weights=WeightSpec(floor=0.0), starts=1)
    linear = identify([response], robot(replace(gear, k=1.5e5, d=80.0, f=20.0)), spec)
    return open_gears([measured], [response], linear, robot(gear), SPEC, GearsSpec(), planned=LINES)


def one(name: str, level: float, seed: int) -> dict[str, object]:
    """Whether it was seen, below its bound, and what else was."""
    field, _, _, number = CASES[name]
    # A stiffening is given as a share of k at the peak; the plant has k_3.
    changed = {field: level * 2e5 / (PEAK / 2e5) ** 2 if field == "k_3" else level} if field else {}
    found = sheet(replace(Gear(), **changed), seed)
    numbers = {each.name: each for each in found.numbers}
    others = [each.name for each in found.numbers if each.is_seen and each.name not in (*FROM_SPRINGS, number)]
    own = numbers.get(number)
    return {
        "level": level,
        "seen": own is not None and own.is_seen,
        "bound": None if own is None or own.is_seen else own.bound,
        "others": others,
        "refused": found.refused,
        "warnings": [str(note) for note in found.notes if note.severity == "warning"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one draw without an effect, to see that it runs")
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    random = np.random.default_rng(given.seed)
    results: dict[str, list[dict[str, object]]] = {}
    print(f"{'case':<26}{'draws':>6}{'seen':>6}{'unseen below bound':>20}{'others seen':>13}{'warnings':>10}")
    for name in ["clean"] if given.quick else list(CASES):
        _, low, high, _ = CASES[name]
        for draw in range(1 if given.quick else given.draws):
            level = float(np.exp(random.uniform(np.log(low), np.log(high)))) if high else 0.0
            results.setdefault(name, []).append(one(name, level, given.seed + draw))
        rows = results[name]
        unseen = [row for row in rows if row["bound"] is not None]
        below = sum(float(row["level"]) < float(row["bound"]) for row in unseen)  # type: ignore[arg-type]
        others, warnings = (sum(bool(row[key]) for row in rows) for key in ("others", "warnings"))
        seen = sum(bool(row["seen"]) for row in rows)
        print(
            f"{name:<26}{len(rows):>6}{seen:>6}{f'{below} of {len(unseen)}':>20}{others:>13}{warnings:>10}", flush=True
        )
    every = [row for rows in results.values() for row in rows]
    unseen = [row for row in every if row["bound"] is not None]
    below = sum(float(row["level"]) < float(row["bound"]) for row in unseen)  # type: ignore[arg-type]
    assert not any(row["refused"] for row in every), "a gear was refused"
    assert not any(row["others"] or row["warnings"] for row in results["clean"]), "a clean gear has an effect"
    assert below >= 0.9 * len(unseen), f"{below} of {len(unseen)} unseen effects are below their bound"
    print(json.dumps({"gear_bounds": results, "below": below, "unseen": len(unseen)}))


if __name__ == "__main__":
    main()
