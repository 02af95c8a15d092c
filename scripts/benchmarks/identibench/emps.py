"""EMPS in free run as the benchmark identibench poses it: the friction study of elastid as a model of the position.

    uv run --with identibench python scripts/benchmarks/identibench/emps.py

`friction_study` estimates mass and friction of the carriage from the training log as a study of elastid does. The model
integrates them from 20 samples of the position, with the drive voltage of the test log as its only input: errors of the
force add up over 25 s, since no measured position corrects them. `output_error` fits the same six numbers to the
positions of the training log in free run, which is what the benchmark asks for. The last line is one JSON object: rms
error of the position in mm, of a stroke of 250 mm.
"""

import json
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from elastid.base.arrays import FloatArray
from elastid.friction_study.inverse_dynamics_regression import regress_motion
from elastid.friction_study.motion_signals import Motion

RATE_HZ, N_PER_V = 1000, 35.15065188  # of the drive (Janot, Gautier and Brunot 2019)
NUMBERS = ("inertia", "coulomb", "viscous", "directions.coulomb", "directions.viscous", "offset")
UNITS = np.array([1.0, 1.0, 10.0, 0.3, 5.0, 0.3])  # steps of the search, kg, N, N s/m


def simulate(numbers: FloatArray, u: FloatArray, y_init: FloatArray) -> FloatArray:
    """Simulate the position (N,), m, for voltage u (N,) from the first measured positions y_init."""
    J, F_c, f, dF_c, df, o = numbers.tolist()
    step_s = 1 / RATE_HZ
    v, q = float(np.polyfit(np.arange(len(y_init)), y_init, 1)[0]) * RATE_HZ, float(y_init[0])
    y = np.empty(len(u))
    for k, force in enumerate(N_PER_V * u):
        y[k] = q
        sign = np.sign(v) or np.sign(force - o)
        # Implicit in the viscous friction; Coulomb friction stops the carriage, it does not reverse it.
        following = (v + step_s / J * (force - o - sign * F_c - dF_c)) / (1 + step_s / J * (f + sign * df))
        v = following if following * sign > 0 else 0.0
        q += step_s * v
    return y


def friction_study(u: FloatArray, y: FloatArray) -> FloatArray:
    """Estimate the six parameters from voltage u (N,) and position y (N,) by the regression of a friction study."""
    regression = regress_motion(Motion("joint 1", RATE_HZ, y, N_PER_V * u, slides=True)).regression
    return np.array([regression[name] if name in regression.names else 0.0 for name in NUMBERS])


def output_error(u: FloatArray, y: FloatArray) -> FloatArray:
    """Fit the six parameters to the simulated position y (N,), with start values from the friction study."""
    start = friction_study(u, y)

    def errors_mm(x: FloatArray) -> FloatArray:
        return 1e3 * (simulate(start + x * UNITS, u, y[:20]) - y)

    return start + least_squares(errors_mm, np.zeros(len(start)), max_nfev=15, diff_step=1e-3).x * UNITS


def model_by(identify: Callable[[FloatArray, FloatArray], FloatArray], context: Any) -> Callable[..., FloatArray]:
    """Return a model for identibench, (u (N, 1), y_init, attributes) -> y (N, 1), fitted to the training log."""
    log = next(iter(context.get_train_valid_sequences()))
    numbers = identify(np.ravel(log[0]), np.ravel(log[1]))
    return lambda u, y_init, *_: simulate(numbers, np.ravel(u), np.ravel(y_init))[:, None]


def main() -> None:
    """Run the evaluation of identibench for both models, then print one JSON line."""
    from identibench import BenchmarkEMPS_Simulation, run_benchmark

    scores = {
        f"{identify.__name__}_mm": run_benchmark(BenchmarkEMPS_Simulation, partial(model_by, identify))["metric_score"]
        for identify in (friction_study, output_error)
    }
    print(json.dumps({name: round(float(score), 2) for name, score in scores.items()}))


if __name__ == "__main__":
    main()
