"""Is what gears do besides being springs found from multisine records, and are stiffness and damping then right?

    python scripts/studies/gear_effects.py [--quick] [--case gap ...] [--draws 3] [--seed 1]

Outside plant (tests/plants/two_mass_gear.py, with equations and steps of its own): motor and link behind a gear, four
experiments of two periods of 2 s at 500 Hz, 200 Nm RMS, resonance at 28 Hz, 64 steps a sample, since a step over a
reversal of friction is a wrong one (with 6 k is 0.002 % off, with 24 and friction by load 0.7 std). Effects alone and
together: friction at the motor, behind the gear and by load, springs that are 30 % stiffer at the peak of the torque,
progressive, stiffer in two ranges of torque, or with a gap of 0.1 mrad to either side, empty or with 0.3 of the
stiffness, a hysteresis, a transmission error and a ripple. A linear model is fitted, then the effects are chosen and
found together with the parameters (elastid/nonlinear).

Of each case: errors of k and d of the linear fit and with the effects, effects, the largest error of a level, and the
share of 95 % intervals of k, d and levels that hold the truth. Asserted in every draw: the effects are those of the
plant and no other, levels within 3 % or 3 std, ends of ranges and gaps and what a hysteresis bends by within 2 % or 3
std, k within 0.1 %, d within 2 %; on a clean plant nothing is found. Coverage is printed and not asserted.

Found with `--draws 8 --seed 11`: in all 120 draws the effects are those of the plant; 414 of 416 intervals hold; k at
most 0.028 % off (ranges of torque), by load 0.019, all others 0.009; d 0.075 %.
"""

import json
import time
from dataclasses import dataclass, replace
from typing import Any

import study_run
import numpy as np
from plants.gear_levels import find_gear_effects
from plants.two_mass_gear import LINES, Gear, records, robot

from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record


@dataclass(frozen=True)
class Effect:
    """An effect of the plant: its level, and the end of a range or a gap or the bend of a hysteresis, rad."""

    kind: str
    level: float
    scale: float = 0.0


# Each gear, and the effects it has.
CASES: dict[str, tuple[Gear, tuple[Effect, ...]]] = {
    "none": (Gear(), ()),
    "friction at the motor": (Gear(F_m=30.0), (Effect("friction", 30.0),)),
    "friction behind the gear": (Gear(F_l=30.0), (Effect("behind", 30.0),)),
    "friction on both sides": (Gear(F_m=20.0, F_l=12.0), (Effect("friction", 20.0), Effect("behind", 12.0))),
    "hardening spring": (Gear(k_3=4e9), (Effect("cubic", 4e9),)),
    "progressive spring": (Gear(k_2s=2e7), (Effect("progressive", 2e7),)),
    "ranges of torque": (
        Gear(ranges=((100.0, 1.4), (300.0, 1.7))),
        (Effect("range", 0.4 * 2e5, 100.0 / 2e5), Effect("range", 0.3 * 2e5, 100.0 / 2e5 + 200.0 / 2.8e5)),
    ),
    "gap": (Gear(gap=1e-4), (Effect("gap", 2e5, 1e-4),)),
    "lost motion": (Gear(gap=1e-4, loose=0.3), (Effect("gap", 0.7 * 2e5, 1e-4),)),
    "lost motion and friction": (
        Gear(gap=1e-4, loose=0.3, F_m=20.0, F_l=12.0),
        (Effect("friction", 20.0), Effect("behind", 12.0), Effect("gap", 0.7 * 2e5, 1e-4)),
    ),
    "friction by load": (Gear(F_m=10.0, load=0.1), (Effect("friction", 10.0), Effect("load", 0.1))),
    "hysteresis": (Gear(hysteresis=12.0), (Effect("stop", 12.0, 2e-4),)),
    "ripple": (Gear(ripple=5.0), (Effect("ripple sine", 5.0),)),
    "transmission error": (Gear(error=5e-5), (Effect("error sine", 5e-5),)),
    "all at once": (
        Gear(F_m=20.0, F_l=12.0, k_3=2e9, error=2e-5),
        (Effect("friction", 20.0), Effect("behind", 12.0), Effect("cubic", 2e9), Effect("error sine", 2e-5)),
    ),
}
QUICK = ("hardening spring",)
SPEC = EstimatorSpec(friction="none", transient_periods=0)
MAX_K, MAX_D, MAX_LEVEL, MAX_SCALE = 1e-3, 2e-2, 0.03, 0.02
EXPERIMENTS, SUBSTEPS = 4, 64


def sets_of(gear: Gear, draws: int, seed: int) -> list[tuple[Record, ...]]:
    """Simulate the records of all random draws in one batch."""
    every = records(gear, experiments=EXPERIMENTS * draws, seed=seed, substeps=SUBSTEPS)
    return [
        tuple(replace(each, realisation=m) for m, each in enumerate(every[EXPERIMENTS * i : EXPERIMENTS * (i + 1)]))
        for i in range(draws)
    ]


def run(gear: Gear, measured: tuple[Record, ...]) -> dict[str, Any]:
    """Return errors of k and d without and with effects, stds, and effects: kind, level, std, scale and its std."""
    response = estimate(measured, SPEC, LINES)
    parameters = dict.fromkeys(("k_*", "d_*", "fm_*"), ParameterSpec())
    spec = FitSpec(parameters=parameters, weights=WeightSpec(model_error=0.0), starts=1)
    linear = identify([response], robot(replace(gear, k=1.5e5, d=80.0, f=20.0)), spec)
    began = time.process_time()
    result = find_gear_effects([measured], [response], linear, robot(gear))
    numbers = linear.parameters.as_dict(result.x)
    names = linear.parameters.free_names
    std = np.sqrt(np.diag(result.covariance))
    values = zip(result.effects, *np.array([result.magnitudes, result.std, result.scale_std]).tolist(), strict=True)
    return {
        "linear": [linear.values["k_1"] / gear.k - 1, linear.values["d_1"] / gear.d - 1],
        "status": linear.status,
        "found": [numbers["k_1"] / gear.k - 1, numbers["d_1"] / gear.d - 1],
        "std": [float(std[names.index("k_1")]), float(std[names.index("d_1")])],
        "effects": sorted([e.kind, level, of_level, e.scale, of_scale] for e, level, of_level, of_scale in values),
        "cpu_s": time.process_time() - began,
    }


def check(name: str, expected: tuple[Effect, ...], one: dict[str, Any]) -> tuple[float, list[float]]:
    """Assert the limits. Return the largest error of a level, and errors of k, d and levels relative to their stds."""
    effects = [effect for effect in one["effects"] if not effect[0].endswith("cosine")]
    cosine = max((abs(effect[1]) for effect in one["effects"] if effect[0].endswith("cosine")), default=0.0)
    expected = tuple(sorted(expected, key=lambda each: (each.kind, each.level)))
    kinds = [effect[0] for effect in effects]
    assert kinds == [each.kind for each in expected], f"{name}: found {kinds}"
    error = next((each.level for each in expected if each.kind.endswith("sine")), 1.0)
    assert cosine < 2 * MAX_LEVEL * error, f"{name}: error turned by {cosine}"
    worst, z = 0.0, [error / std for error, std in zip(one["found"], one["std"], strict=True)]
    for (kind, level, std, scale, scale_std), true in zip(effects, expected, strict=True):
        off = level - true.level
        limit = max(MAX_LEVEL * true.level, 3 * std)
        assert abs(off) < limit, f"{name}: {kind} {level:.4g} +- {std:.2g} for {true.level:.4g}"
        worst = max(worst, abs(off) / true.level)
        z.append(off / std)
        if true.scale:
            within = max(MAX_SCALE * true.scale, 3 * scale_std)
            assert abs(scale - true.scale) < within, f"{name}: {kind} to {scale:.4g} for {true.scale:.4g} rad"
    k, d = one["found"]
    assert abs(k) < MAX_K, f"{name}: k {100 * k:.3f} %"
    assert abs(d) < MAX_D, f"{name}: d {100 * d:.2f} %"
    return worst, z


def coverage(z: FloatArray, results: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the coverage of 95 % intervals and the means of z (draws, 2 + n_f); std of a mean: 1 / sqrt(draws)."""
    holds, means = np.abs(z) < QUANTILE_95, z.mean(axis=0).round(2).tolist()
    worst = [100 * float(np.abs([one["found"][i] for one in results]).max()) for i in (0, 1)]
    return {"holds": int(holds.sum()), "of": int(holds.size), "mean_deviations": means, "largest_percent": worst}


def main() -> None:
    quick = "one draw of one case, to see that it runs"
    options = study_run.options(__doc__, quick, case=tuple(CASES), draws=3, seed=1)
    names, draws = (QUICK, 1) if options.quick else (options.case, options.draws)
    results: dict[str, list[dict[str, Any]]] = {}
    covered: dict[str, dict[str, Any]] = {}
    for name in names:
        gear, expected = CASES[name]
        z, results[name] = list[list[float]](), list[dict[str, Any]]()
        for measured in sets_of(gear, draws, options.seed):
            one = run(gear, measured)
            worst, deviations = check(name, expected, one)
            print(name, json.dumps(one | {"largest_level_error": worst}), flush=True)
            results[name].append(one)
            z.append(deviations)
        covered[name] = coverage(np.array(z), results[name])
        print(name, json.dumps(covered[name]), flush=True)
    print(json.dumps({"gear_effects": results, "covered": covered, "draws": draws}))


if __name__ == "__main__":
    main()
