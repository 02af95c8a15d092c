"""How fast the fit is: the kernel against bare solves, a whole fit against scipy.optimize.least_squares, in one run.

    python scripts/bench_fit.py [--quick]

15 configurations x 150 lines, 18 coordinates, 6 inputs and outputs, 40 logarithmic parameters (12 stiffnesses, 12
dampings, 6 motor frictions, 6 rotor inertias, 4 masses): 162 000 real residuals. One process, one BLAS thread. The
same start, the same residuals and, but for finite differences, the same Jacobian; every fit must reach the same cost.
The last line is one JSON object with the numbers of the table.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from elastid.arrays import FloatArray
from elastid.fit.assembly import Assembly
from elastid.fit.choose import choose
from elastid.fit.elastic import ElasticFit, Part
from elastid.fit.residuals import RESIDUALS, as_real
from elastid.fit.solvers import solve
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.transfer import to_response
from elastid.model.serial import serial
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring

NOISE = 0.02
IDENTIFIED = ("k_*", "d_*", "fm_*", "Jm_*", "f_1", "f_2", "f_3", "f_4")


def build_robot() -> Robot:
    """Six driven elastic joints, each followed by an elastic rotation: 18 coordinates."""
    driven, further = "zyyxyx", "xxzyzy"
    stiffness = np.array([9e5, 8e5, 5e5, 1.5e5, 1.2e5, 6e4])
    bodies = []
    for i in range(6):
        scale = 0.5**i
        joints = (
            Joint(
                f"{i + 1}",
                driven[i],
                Spring(stiffness[i], stiffness[i] / 500),
                Motor(3e-3 * 0.75**i, 120.0, 2e-3 * 0.75**i),
                viscous=10.0,
            ),
            Joint(f"{i + 1}e", further[i], Spring(2 * stiffness[i], stiffness[i] / 300)),
        )
        bodies.append(
            Body(
                f"{i + 1}",
                "base" if i == 0 else f"{i}",
                Placement((0.25 if i == 1 else 0.0, 0.0, (0.4, 0.4, 0.9, 0.5, 0.5, 0.15)[i])),
                joints,
                mass=200 * scale,
                center_of_mass=(0.1, 0.05, 0.2),
                inertia=(14 * scale, 12 * scale, 9 * scale),
            )
        )
    return Robot("18 coordinates", tuple(bodies))


def measured(robot: Robot, n_configurations: int, freq_hz: FloatArray) -> list[FrequencyResponse]:
    """Responses of the robot with relative noise, configurations drawn at random."""
    rng = np.random.default_rng(0)
    model = serial(robot)
    linearisation = Linearisation.of(model)
    responses = []
    for i in range(n_configurations):
        configuration = Configuration(f"{i + 1}", rng.uniform(-1.2, 1.2, 6))
        linear = linearisation.at(configuration, model.theta, robot.motor_locations, "acceleration")
        exact = to_response(linear, np.append(model.theta, 0.0), freq_hz)
        deviation = NOISE * np.abs(exact.G) + 1e-3 * NOISE * np.abs(exact.G).max(axis=0)
        noise = deviation / np.sqrt(2) * (rng.standard_normal(exact.G.shape) + 1j * rng.standard_normal(exact.G.shape))
        responses.append(replace(exact, G=exact.G + noise, noise=Covariance(deviation**2, np.inf)))
    return responses


def assemble(n_configurations: int, n_lines: int) -> tuple[ElasticFit, FloatArray]:
    """The fit, and a start some 20 % off in every parameter."""
    robot = build_robot()
    responses = measured(robot, n_configurations, np.linspace(2.0, 100.0, n_lines))
    spec = FitSpec(parameters={name: ParameterSpec() for name in IDENTIFIED}, weights=WeightSpec(floor=0.0))
    parameters = choose(spec, robot)
    fit = Assembly.of(responses, robot, spec, parameters).at(parameters.x, "complex")
    return fit, parameters.x + 0.2 * np.random.default_rng(1).standard_normal(len(parameters.x))


def residual_only(fit: ElasticFit, x: FloatArray) -> FloatArray:
    """The residuals without their Jacobian, as a solver without J^T J wants them most of the time."""
    theta = fit.parameters.expand(x)

    def of(part: Part) -> FloatArray:
        e, _ = RESIDUALS[part.criterion](part.measured, part.kernel.response(theta))
        used = np.repeat((part.gain > 0).ravel(), 2)
        return as_real(part.gain * e).ravel()[used]

    return np.concatenate([of(part) for part in fit.parts])


def bare_solves(fit: ElasticFit) -> Callable[[], None]:
    """numpy.linalg.solve of the same systems Z X = B, the matrices ready made."""
    systems = []
    for part in fit.parts:
        model, s = part.kernel.model, 2j * np.pi * part.kernel.freq_hz[:, None, None]
        systems.append((s**2 * model.M + s * model.D + model.K, model.B.astype(complex)))

    def run() -> None:
        for Z, B in systems:
            np.linalg.solve(Z, B)

    return run


def seconds(function: Callable[[], object], repeats: int) -> float:
    """Median wall time of a call."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        function()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def kernel_times(fit: ElasticFit, repeats: int) -> dict[str, float]:
    """Seconds for one pass over all configurations."""
    theta, x = fit.parameters.theta, fit.parameters.x
    return {
        "numpy.linalg.solve alone": seconds(bare_solves(fit), repeats),
        "responses": seconds(lambda: [part.kernel.response(theta) for part in fit.parts], repeats),
        "responses and derivatives": seconds(lambda: [part.kernel.evaluate(theta) for part in fit.parts], repeats),
        "cost, gradient, normal matrix": seconds(lambda: fit.evaluate(x), repeats),
        "stacked residual and Jacobian": seconds(lambda: fit.residual(x), max(1, repeats // 3)),
    }


def fit_times(fit: ElasticFit, x0: FloatArray, repeats: int) -> tuple[dict[str, float], dict[str, float]]:
    """Seconds and final costs of a whole fit by three solvers from the same start."""
    costs: dict[str, float] = {}

    def elastid() -> None:
        costs["elastid"] = solve(fit.problem, x0).cost

    def scipy_fit(name: str, jac: object) -> None:
        answer = least_squares(lambda x: residual_only(fit, x), x0, jac=jac, bounds=fit.parameters.x_bounds)
        costs[name] = 2 * answer.cost

    analytic, differences = "least_squares, same Jacobian", "least_squares, finite differences"
    times = {
        "elastid": seconds(elastid, repeats),
        analytic: seconds(lambda: scipy_fit(analytic, lambda x: fit.residual(x)[1]), max(1, repeats // 2)),
        differences: seconds(lambda: scipy_fit(differences, "2-point"), 1),
    }
    return times, costs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small problem, to see that it runs")
    quick = parser.parse_args().quick
    Q, F = (2, 12) if quick else (15, 150)
    fit, x0 = assemble(Q, F)
    n, n_x = fit.parts[0].kernel.model.n, len(x0)
    print(f"Q = {Q}, F = {F}, n = {n}, P = {n_x}, {fit.n_residuals} real residuals, one BLAS thread\n")

    kernel = kernel_times(fit, 3 if quick else 15)
    bare = kernel["numpy.linalg.solve alone"]
    print(f"{'one pass over all configurations':<38}{'ms':>10}{'x solve':>10}")
    for name, value in kernel.items():
        print(f"{name:<38}{1e3 * value:>10.1f}{value / bare:>10.1f}")

    times, costs = fit_times(fit, x0, 1 if quick else 5)
    print(f"\n{'a whole fit':<38}{'s':>10}{'x elastid':>10}{'V':>16}")
    for name, value in times.items():
        print(f"{name:<38}{value:>10.2f}{value / times['elastid']:>10.1f}{costs[name]:>16.3f}")

    spread = max(costs.values()) / min(costs.values()) - 1
    ratios = [value / times["elastid"] for value in times.values()]
    print(f"\ncosts agree within {spread:.1e}; goals: at least 3 and 10 times faster\n")
    print(
        json.dumps(
            {
                "Q": Q,
                "F": F,
                "n": n,
                "P": n_x,
                "kernel_over_solve": round(kernel["responses and derivatives"] / bare, 2),
                "evaluation_over_solve": round(kernel["cost, gradient, normal matrix"] / bare, 2),
                "faster_than_same_jacobian": round(ratios[1], 2),
                "faster_than_finite_differences": round(ratios[2], 2),
                "cost_spread": spread,
            }
        )
    )


if __name__ == "__main__":
    main()
