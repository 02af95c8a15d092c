"""How fast friction is identified: the law through levels, a LuGre law by shooting.

    python scripts/benchmarks/friction.py [--quick]

Law: twelve numbers from 240 levels of a published joint (Bittencourt et al., IROS 2010), by variable projection from
twelve starts, beside scipy.optimize.least_squares on all twelve numbers at once with the same residuals and an analytic
Jacobian: from the same starts, their linear numbers at the optimum there, and from guesses of all numbers.
Shooting: six numbers of a LuGre law from 8 s of a motor's angle and torque at 1 kHz through an elastic joint, from a
start that is wrong by up to two. Study: the template of a friction study, from its design to its report.
CPU time, medians. Both laws must be the same, every search of variable projection must arrive, and the LuGre numbers
must be as near as the noise allows. The last line is one JSON object.

Found at full size, on a busy machine of two cores: 5.6 ms a search by variable projection and 5.0 ms by least_squares,
which arrives from all starts and all guesses as well, but needs guesses of the linear numbers. Shooting takes 5.5 s,
the study 11 s.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.lugre_joint import JOINT, TRUTH, joint_log, wrong_start
from plants.published_friction import TERMS, drawn, published_levels

from elastid.base.arrays import FloatArray
from elastid.friction.static import columns
from elastid.friction_study.levels import Levels
from elastid.friction_study.lugre_shooting import fit_lugre
from elastid.friction_study.stribeck import START_DECAY_K, derivative, fit_curve, reference_temperature
from elastid.robot.friction import EXPONENT_RANGE

# A search has arrived where its cost is within this share of the best.
SAME_COST = 1e-6
# Of sigma_0, sigma_1, and of the three numbers of the Stribeck curve.
MAX_ERRORS = {"sigma_0": 0.02, "sigma_1": 0.06, "coulomb": 0.02, "stiction": 0.02, "stribeck_velocity": 0.02}
# All twelve numbers of a guess are wrong by up to this factor.
GUESS = 2.5


def cpu_seconds(function: Callable[[], object], repeats: int) -> float:
    """Median CPU time of one call."""
    times = []
    for _ in range(repeats):
        begun = time.process_time()
        function()
        times.append(time.process_time() - begun)
    return statistics.median(times)


def peer_starts(levels: Levels) -> list[FloatArray]:
    """All twelve numbers at the starts of variable projection, the linear ones optimal there."""
    T_0, speeds = reference_temperature(levels), np.log(levels.speed)
    velocities = np.exp(speeds.min() + np.array([0.15, 0.35, 0.6]) * np.ptp(speeds))
    starts = []
    for nu_s, a, nu_l in product(velocities, (1.0, 2.0), velocities[1:]):
        eta = dict(zip(TERMS.searched, (nu_s, 0.0, a, nu_l, START_DECAY_K), strict=True))
        Phi = columns(levels.conditions, TERMS.linear, eta, T_0) / levels.std[:, None]
        linear = np.linalg.lstsq(Phi, levels.torque / levels.std, rcond=None)[0]
        starts.append(np.concatenate([linear, list(eta.values())]))
    return starts


def peer(levels: Levels, start: FloatArray) -> float:
    """The cost that least_squares reaches on all numbers at once; inf where it fails."""
    T_0, names = reference_temperature(levels), (*TERMS.linear, *TERMS.searched)

    def residual(x: FloatArray) -> FloatArray:
        values = dict(zip(names, x.tolist(), strict=True))
        Phi = columns(levels.conditions, TERMS.linear, values, T_0)
        return np.asarray((Phi @ x[: len(TERMS.linear)] - levels.torque) / levels.std)

    def jacobian(x: FloatArray) -> FloatArray:
        values = dict(zip(names, x.tolist(), strict=True))
        return derivative(levels.conditions, TERMS, values, T_0) / levels.std[:, None]

    low, high = np.full((2, len(names)), [[-np.inf], [np.inf]])
    fast = 3 * levels.speed.max()
    for name, ends in {
        "stribeck_velocity": (0.05, fast), "load.stribeck_velocity": (0.05, fast), "exponent": EXPONENT_RANGE,
        "temperature.decay": (1.0, 500.0),
    }.items():  # fmt: skip
        low[names.index(name)], high[names.index(name)] = ends
    try:
        end = least_squares(residual, start, jacobian, (low, high), x_scale="jac", ftol=1e-12, xtol=1e-10)
    except (ValueError, np.linalg.LinAlgError):
        return float("inf")
    return 2 * float(end.cost)


def law(repeats: int, guesses: int) -> dict[str, float]:
    levels = drawn(published_levels(), 0)
    fit = fit_curve(levels, TERMS)
    starts = peer_starts(levels)
    costs = np.array([peer(levels, start) for start in starts])
    of_projection = cpu_seconds(lambda: fit_curve(levels, TERMS), repeats) / fit.starts
    of_peer = cpu_seconds(lambda: [peer(levels, start) for start in starts], repeats) / len(starts)
    truth, rng = np.array([fit.values[name] for name in fit.names]), np.random.default_rng(1)
    guessed = [peer(levels, truth * GUESS ** rng.uniform(-1, 1, len(truth))) for _ in range(guesses)]
    lucky = int(np.sum(np.array(guessed) < fit.cost * (1 + SAME_COST)))
    arrived = int(np.sum(costs < fit.cost * (1 + SAME_COST)))
    print(f"law of 12 numbers, 240 levels: {1e3 * of_projection:.1f} ms a search, {fit.hits} of {fit.starts} arrive")
    print(f"least_squares on all of them:  {1e3 * of_peer:.1f} ms a search, {arrived} of {len(starts)} arrive")
    print(f"the same from all numbers wrong by up to {GUESS:g}: {lucky} of {guesses} arrive")
    assert fit.hits == fit.starts
    assert fit.cost < costs.min() * (1 + SAME_COST)
    return {"law_ms": 1e3 * of_projection, "peer_ms": 1e3 * of_peer, "peer_arrives": lucky / guesses}


def shooting() -> dict[str, float]:
    log = joint_log(0)
    begun = time.process_time()
    fit = fit_lugre(log, JOINT, wrong_start(0))
    seconds = time.process_time() - begun
    errors = {name: abs(fit.values[name] / TRUTH[name] - 1) for name in MAX_ERRORS}
    print(f"LuGre by shooting, 8 s at {log.rate_hz:g} Hz: {seconds:.1f} s, {fit.iterations} iterations")
    print("errors: " + ", ".join(f"{name} {error:.2%}" for name, error in errors.items()))
    assert all(errors[name] < most for name, most in MAX_ERRORS.items())
    return {"shooting_s": seconds, **{f"error_{name}": error for name, error in errors.items()}}


def whole_study(options: list[str]) -> dict[str, float]:
    """`elastid run` of the template: design, 31 motions on the rig, levels, law, report."""
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "axis"
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        for command in (["new", str(study), "--template", "friction"], ["run", str(study / "study.yml"), *options]):
            subprocess.run([sys.executable, "-m", "elastid", *command], cwd=folder, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"a whole study of one axis: {seconds:.1f} s")
    return {"study_s": seconds}


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true")
    given = options.parse_args()
    few = ["--set", "friction.passes={count: 5, repeat: 1}"] if given.quick else []
    found = law(1 if given.quick else 15, 10 if given.quick else 60) | shooting() | whole_study(few)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
