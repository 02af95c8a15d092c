"""Does a filter follow friction that warms up through stops, with bands that hold, and what when its joint is wrong?

60 s at 1 kHz, 16-bit encoder, torque noise of 5 % of F_c, gravity off by 10 % of F_c, viscous friction that halves and
Coulomb friction that falls by 15 % within 20 s; figures after 10 s. Recursive least squares on filtered derivatives
stand beside it. The filter takes what it holds for exact; bands with the errors of that: filter_honesty.py. Full size:
50 runs, some 3 CPU minutes.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace

import numpy as np
from scipy.signal import butter, lfilter

from elastid.base.arrays import FloatArray
from elastid.friction_study.extended_kalman_filter import (
    FilterNoise,
    FollowedJoint,
    KalmanFilter,
    Track,
    first_estimate,
)
from elastid.friction_study.follow import consistency
from tests.plants.warm_joint import (
    COUNT,
    FOLLOWED,
    RATE_HZ,
    TORQUE_STD,
    WarmRun,
    rich,
    simulate,
    stops_and_moves,
)

SURE = replace(FOLLOWED, tolerances={})
DRIFT = {"Fc": 6e-3, "f": 25e-3, "offset": 1e-3}
NOISE = FilterNoise(angle=COUNT / np.sqrt(12), torque=TORQUE_STD, drift=DRIFT)
SETTLED_S = 10.0
SLIDING = 5.0  # rad/s
# Hz of the filter of derivatives, and s that least squares remember.
RLS_BAND, RLS_MEMORY = 30.0, 5.0
WRONG = {
    "gear 10 % stiffer": {"stiffness": 1.1},
    "bristles twice as stiff": {"bristle_stiffness": 2.0},
    "motor inertia + 5 %": {"motor_inertia": 1.05},
}


def torque_error(coulomb: FloatArray, viscous: FloatArray, run: WarmRun) -> float:
    """Of sliding friction after settling, % of its rms."""
    moves = (np.abs(run.velocity) > SLIDING) & (np.arange(len(run.velocity)) > SETTLED_S * RATE_HZ)
    true = run.coulomb * np.sign(run.velocity) + run.viscous * run.velocity
    found = coulomb * np.sign(run.velocity) + viscous * run.velocity
    return float(100 * np.sqrt(np.mean((found - true)[moves] ** 2) / np.mean(true[moves] ** 2)))


def nees(track: Track, name: str, truth: FloatArray) -> float:
    """Mean of error^2 / variance of a logarithm after settling."""
    i = track.joint.states.index(name)
    errors = (track.x[:, i] - np.log(truth)) / track.std[:, i]
    return float(np.mean(errors[round(SETTLED_S * RATE_HZ) :] ** 2))


def judged(joint: FollowedJoint, runs: list[WarmRun], noise: FilterNoise) -> dict[str, float]:
    """Means over runs."""
    kalman = KalmanFilter(joint, RATE_HZ)
    rows = []
    for run in runs:
        began = time.process_time()
        track = kalman.run(run.samples, noise, first_estimate(joint, float(run.samples.angle[0])))
        cost = 1e6 * (time.process_time() - began) / len(run.velocity)
        found = consistency(track, SETTLED_S)
        rows.append(
            {
                "torque_percent": torque_error(track.values("Fc"), track.values("f"), run),
                "nees_Fc": nees(track, "Fc", run.coulomb),
                "nees_f": nees(track, "f", run.viscous),
                "nis": found.nis,
                "nis_at_stops": found.nis_at_stops,
                "us_per_step": cost,
            }
        )
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def least_squares(runs: list[WarmRun]) -> float:
    """Torque error of recursive least squares with forgetting, on derivatives through a causal filter."""
    b, a = butter(2, RLS_BAND / (RATE_HZ / 2))
    forget = np.exp(-1 / (RLS_MEMORY * RATE_HZ))
    errors = []
    for run in runs:
        q, u = lfilter(b, a, run.samples.angle), lfilter(b, a, run.samples.torque)
        v = np.gradient(q) * RATE_HZ
        inertia = FOLLOWED.motor_inertia + FOLLOWED.link_inertia
        y = u - inertia * np.gradient(v) * RATE_HZ
        x = np.stack([np.sign(v), v, np.ones_like(v)], axis=1)
        x[np.abs(v) < SLIDING] = 0.0
        estimate, P = np.zeros(3), np.eye(3) * 1e4
        track = np.empty((len(y), 3))
        for k in range(len(y)):
            if x[k, 2]:
                gain = P @ x[k] / (forget + x[k] @ P @ x[k])
                estimate = estimate + gain * (y[k] - x[k] @ estimate)
                P = (P - np.outer(gain, x[k] @ P)) / forget
            track[k] = estimate
        errors.append(torque_error(track[:, 0], track[:, 1], run))
    return float(np.mean(errors))


def main() -> None:
    """Print a table, then one JSON line; assert the figures that texts quote."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--quick", action="store_true", help="2 runs")
    options = parser.parse_args()
    count = 2 if options.quick else options.runs
    stops = [simulate(stops_and_moves(60), seed) for seed in range(count)]
    moving = [simulate(rich(60), seed) for seed in range(count)]
    found = {
        "stops": judged(SURE, stops, NOISE),
        "rich": judged(SURE, moving, NOISE),
        "stops, bristle taken for certain": judged(SURE, stops[:3], replace(NOISE, slip=0.0)),
    }
    for name, factors in WRONG.items():
        wrong = replace(SURE, **{key: getattr(SURE, key) * factor for key, factor in factors.items()})
        found[f"rich, {name}"] = judged(wrong, moving[:5], NOISE)
    found["least squares"] = {
        "stops_torque_percent": least_squares(stops[:3]),
        "rich_torque_percent": least_squares(moving[:3]),
    }
    for name, row in found.items():
        print(f"{name:36}" + "".join(f"  {key} {value:.3g}" for key, value in row.items()))
    for name in ("stops", "rich"):
        row = found[name]
        assert row["torque_percent"] <= 0.4, (name, row)
        assert max(row["nees_Fc"], row["nees_f"]) <= 1.2, (name, row)
        assert 0.9 <= row["nis"] <= 1.1, (name, row)
    assert found["stops, bristle taken for certain"]["nees_Fc"] > 10
    assert found["least squares"]["stops_torque_percent"] > 3 * found["stops"]["torque_percent"]
    print(json.dumps({"runs": count, **found}))


if __name__ == "__main__":
    main()
