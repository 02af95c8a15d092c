"""How fast the fit is: the kernel against bare solves, a whole fit against other solvers and libraries, in one run.

    python scripts/benchmarks/fit.py [--quick] [--passes]

20 configurations x 200 lines, 18 coordinates, 6 inputs and outputs, 40 logarithmic parameters (12 stiffnesses, 12
dampings, 6 motor frictions, 4 joint frictions, 6 rotor inertias), weights from a full 36 x 36 covariance at every line:
288 000 real residuals. One process, one BLAS thread. The same start, the same residuals and, but for finite
differences, the same Jacobian; every fit must reach the same cost. `floor` is the useful work of one evaluation,
96 kflop a line, at the rate of a zgemm on this machine. least_squares of SciPy is given residuals and Jacobian as small
as elastid's own, 21 complex residuals of 36 and columns of rank one, from several starts: median and worst ratio.
CasADi (MX, automatic differentiation, LAPACK) works out residuals, Jacobian and normal matrix of one configuration.
--passes: the first table alone. The last line is one JSON object with
the numbers; last_run.json has those of the last run of each part. How time and memory grow is in growth.py.

Measured (CPU time, medians in turn, a machine of two cores that worked at something else beside): with loops in C one
evaluation takes 0.9 (evaluation_over_solve) times the bare solves and 3.7 (evaluation_over_floor) times the floor, with
NumPy alone 3.6 (numpy_evaluation_over_solve) and 15.4 (numpy_evaluation_over_floor) times; CasADi takes 103
(casadi_over_evaluation) times as long for one. With ten inertial parameters more, which move the robot under gravity
with every stiffness, it is 7.0 (inertial_evaluation_over_floor) times the floor, with NumPy 30.6
(numpy_inertial_evaluation_over_floor), and linearised again at every point, as the search for them must, 20.9
(relinearised_evaluation_over_floor). A whole fit is 36 (faster_than_same_jacobian) times faster than
least_squares with the same Jacobian, at worst 29 (faster_than_same_jacobian_at_worst) times, 62
(faster_than_finite_differences) times faster than with finite differences and 121 (faster_than_casadi) times faster
than with CasADi's derivatives.
"""

import json
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from unittest.mock import patch

import timing
import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from elastid.base.arrays import FloatArray
from elastid.base.kernels import is_compiled
from elastid.fit.frf_problem import Assembly
from elastid.fit.parameter_selection import choose
from elastid.fit.problem.frf_residuals import ElasticFit, FrfResiduals
from elastid.fit.problem.least_squares import Evaluation, LeastSquares, as_real
from elastid.fit.problem.weights import vec
from elastid.fit.solve.solvers import solve
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring

NOISE = 0.02
COMPRESSED, DIFFERENCES = "least_squares, same Jacobian", "least_squares, finite differences"
CASADI = "CasADi MX, AD"
# Single passes: the key in the JSON line and the row of the table.
PASSES = {
    "solve": "numpy.linalg.solve alone",
    "floor": "96 kflop a line by zgemm (floor)",
    "evaluation": "cost, gradient, normal matrix",
    "numpy_evaluation": "the same, NumPy alone",
    "double": "the same, normal matrix in double",
    "inertial_evaluation": "ten inertial parameters more",
    "numpy_inertial_evaluation": "the same, NumPy",
    "relinearised_evaluation": "the same, compiled, linearised again",
}
IDENTIFIED = ("k_*", "d_*", "fm_*", "Jm_*", "f_1", "f_2", "f_3", "f_4")
# Together they make the linearisation local: with m c^2 in M, every stiffness moves the robot under gravity, too.
INERTIAS = ("m_3", "m_4", "m_5", "m_6", "c_3_x", "c_4_z", "c_5_z", "I_3_xx", "I_4_yy", "I_6_zz")


def build_robot() -> Robot:
    """Return six driven elastic joints, each followed by an elastic rotation: 18 coordinates."""
    stiffness, bodies = np.array([9e5, 8e5, 5e5, 1.5e5, 1.2e5, 6e4]), []
    for i, (axis, further, height) in enumerate(zip("zyyxyx", "xxzyzy", (0.4, 0.4, 0.9, 0.5, 0.5, 0.15), strict=True)):
        scale, k, place = 0.5**i, stiffness[i], Placement((0.25 if i == 1 else 0.0, 0.0, height))
        motor = Motor(3e-3 * 0.75**i, 120.0, 2e-3 * 0.75**i)
        gear = Joint(f"{i + 1}", axis, Spring(k, k / 500), motor, viscous=10.0)
        bearing = Joint(f"{i + 1}e", further, Spring(2 * k, k / 300))
        inertia = (14 * scale, 12 * scale, 9 * scale)
        parent = f"{i}" if i else "base"
        bodies.append(Body(f"{i + 1}", parent, place, (gear, bearing), 200 * scale, (0.1, 0.05, 0.2), inertia))
    return Robot("18 coordinates", tuple(bodies))


def measure(robot: Robot, n_configurations: int, freq_hz: FloatArray, full: bool = True) -> list[Response]:
    """Return responses of the robot in random configurations with relative noise."""
    rng = np.random.default_rng(0)
    model = serial(robot)
    linearisation = Linearisation.of(model)
    responses = []
    n = model.n_u
    mixing = rng.standard_normal((n**2, 2 * n**2)) + 1j * rng.standard_normal((n**2, 2 * n**2))
    root = np.linalg.cholesky(mixing @ mixing.conj().T / (4 * n**2))
    for i in range(n_configurations):
        configuration = Configuration(f"{i + 1}", rng.uniform(-1.2, 1.2, n))
        linear = linearisation.at(configuration, model.theta, robot.motor_locations, "acceleration")
        exact = to_response(linear, np.append(model.theta, 0.0), freq_hz)
        deviation = NOISE * np.abs(exact.G) + 1e-3 * NOISE * np.abs(exact.G).max(axis=0)
        white = rng.standard_normal((len(freq_hz), n**2, 1)) + 1j * rng.standard_normal((len(freq_hz), n**2, 1))
        lower = vec(deviation)[:, :, None] * root
        noise = (lower @ white / np.sqrt(2))[:, :, 0].reshape(-1, n, n).swapaxes(1, 2)
        matrix = lower @ lower.conj().swapaxes(1, 2) if full else None
        variance = np.sum(np.abs(lower) ** 2, axis=2).reshape(-1, n, n).swapaxes(1, 2)
        responses.append(replace(exact, G=exact.G + noise, noise=Covariance(variance, np.inf, matrix=matrix)))
    return responses


def assemble(Q: int, F: int, names: Sequence[str] = IDENTIFIED) -> tuple[Assembly, ElasticFit]:
    """Return the fit of Q responses with F lines before and after linearisation."""
    robot = build_robot()
    spec = FitSpec(parameters={name: ParameterSpec() for name in names}, weights=WeightSpec(model_error=0.0))
    parameters = choose(spec, robot)
    assembly = Assembly.of(measure(robot, Q, np.linspace(2.0, 100.0, F)), robot, spec, parameters)
    return assembly, assembly.at(parameters.x, "complex")


def bare_solves(fit: ElasticFit) -> Callable[[], None]:
    """Prepare numpy.linalg.solve of the same systems Z X = B with precomputed matrices."""
    systems = []
    for part in fit.frfs:
        model, s = part.kernel.model, 2j * np.pi * part.kernel.freq_hz[:, None, None]
        systems.append((s**2 * model.M + s * model.D + model.K, model.B.astype(complex)))

    def run() -> None:
        for Z, B in systems:
            np.linalg.solve(Z, B)

    return run


def flop_floor(n_points: int) -> Callable[[], None]:
    """Prepare matrix products with 96 kflop per point; a product of 96 x 96 complex matrices has 8 * 96^3 flop."""
    A = np.random.default_rng(0).standard_normal((96, 96)) + 0j
    products = max(1, round(n_points * 96e3 / (8 * 96**3)))

    def run() -> None:
        for _ in range(products):
            A @ A

    return run


def kernel_times(
    fit: ElasticFit, plain: ElasticFit, inertial: Sequence[LeastSquares], repeats: int
) -> dict[str, float]:
    """Return the CPU seconds of one pass over all configurations by kind of pass.

    plain: fit without compiled loops.  inertial: fits that also have free INERTIAS: compiled, without compiled loops,
    and compiled with a new linearisation at every x, as in the search.
    """
    x, more = fit.parameters.x, inertial[0].parameters.x
    points = sum(len(part.measured) for part in fit.frfs)
    passes: dict[str, Callable[[], object]] = {
        "solve": bare_solves(fit),
        "floor": flop_floor(points),
        "evaluation": lambda: fit.rough(x),
        "numpy_evaluation": lambda: plain.rough(x),
        "double": lambda: fit.evaluate(x),
    }
    for name, problem in zip(list(PASSES)[5:], inertial, strict=True):
        passes[name] = partial(problem.evaluate, more)
    return timing.in_turn(passes, repeats)


def small_jacobian(fit: ElasticFit, plain: ElasticFit, x: FloatArray) -> FloatArray:
    """Return the smallest possible J: 21 compressed residuals of 36, columns of rank one (`normal_equations`).

    plain: the same fit with R as matrices.
    """
    slopes = []
    for part, with_R in zip(fit.frfs, plain.frfs, strict=True):
        columns, theta, data = part.normal.columns, part.theta(fit.parameters, x), with_R.normal.residuals.compressed
        pieces, T = columns.pieces, part.chain(fit.parameters, x)
        scale = np.ones(pieces.base.max() + 1)
        for block in columns.at(theta):
            V = data.R.R[block.block] @ block.columns(scale, np.float64)
            powers = block.s[:, None] ** np.arange(3)
            dr = (V[:, :, pieces.base] * powers[:, None, pieces.power]) @ (pieces.sigma @ T)
            slopes.append(np.concatenate([dr.real[:, :, None], dr.imag[:, :, None]], axis=2).reshape(-1, len(x)))
    return np.concatenate(slopes)


def small_residual(fit: ElasticFit, plain: ElasticFit, x: FloatArray) -> FloatArray:
    """Return the compressed residuals without their Jacobian."""
    residuals = []
    for part, with_R in zip(fit.frfs, plain.frfs, strict=True):
        data, (rows, columns) = with_R.normal.residuals.compressed, part.normal.columns.elements
        G = part.kernel.response(part.theta(fit.parameters, x))[:, rows, columns]
        R = data.R.R  # (F, n_e, n_e), or its diagonal
        r = data.q - (R * G if R.ndim == 2 else (R @ G[:, :, None])[:, :, 0])
        residuals.append(as_real(r).ravel())
    return np.concatenate(residuals)


def fit_times(
    fit: ElasticFit, plain: ElasticFit, starts: Sequence[FloatArray]
) -> tuple[dict[str, list[float]], dict[str, float]]:
    """Return CPU seconds of whole fits by method from each start (slow methods: the first only), and final costs."""
    costs: dict[str, float] = {}
    constant = sum(float(part.normal.residuals.compressed.constant.sum()) for part in plain.frfs)
    casadi = casadi_problem(fit)

    def by_scipy(name: str, x0: FloatArray, residual: Callable[..., FloatArray], jac: object) -> None:
        answer = least_squares(residual, x0, jac=jac, bounds=fit.parameters.x_bounds)
        costs.setdefault(name, 2 * answer.cost + constant)

    def elastid(x0: FloatArray, name: str = "elastid", problem: LeastSquares = fit.problem) -> None:
        costs.setdefault(name, solve(problem, x0).cost)

    solvers: dict[str, Callable[[FloatArray], None]] = {
        "elastid": elastid,
        COMPRESSED: lambda x0: by_scipy(
            COMPRESSED, x0, lambda x: small_residual(fit, plain, x), lambda x: small_jacobian(fit, plain, x)
        ),
        DIFFERENCES: lambda x0: by_scipy(DIFFERENCES, x0, lambda x: small_residual(fit, plain, x), "2-point"),
        CASADI: lambda x0: elastid(x0, CASADI, casadi),
    }
    elastid(starts[0])
    times: dict[str, list[float]] = {name: [] for name in solvers}
    for number, x0 in enumerate(starts):
        for name, solver in solvers.items():
            if number == 0 or name in ("elastid", COMPRESSED):
                begin = time.process_time()
                solver(x0)
                times[name].append(time.process_time() - begin)
    return times, costs


def with_inertias(Q: int, F: int) -> tuple[LeastSquares, LeastSquares]:
    """Return fits that also have free INERTIAS, linearised once, and at every x; both evaluated once as preparation."""
    assembly, fit = assemble(Q, F, (*IDENTIFIED, *INERTIAS))
    fit.rough(fit.parameters.x)
    return fit.problem, assembly.search_problem(fit)


def without_compiled_loops(Q: int, F: int) -> tuple[ElasticFit, LeastSquares]:
    """Return the fit in NumPy, and the same with free INERTIAS."""
    with patch("elastid.linear.response.kernel.is_compiled", return_value=False):
        _, plain = assemble(Q, F)
        plain.rough(plain.parameters.x)
        inertial, _ = with_inertias(Q, F)
    return plain, inertial


def casadi_sums(part: FrfResiduals, lines: int) -> Callable[[FloatArray], tuple[float, FloatArray, FloatArray]]:
    """Return V, J^T r, J^T J of the first `lines` lines of one configuration by CasADi's automatic differentiation."""
    model, wanted = part.kernel.model, part.kernel.parameters
    x, s = ca.MX.sym("x", len(wanted)), ca.MX.sym("omega")
    theta0 = [model.theta_ref[model.parameters.index(name)] for name in wanted]
    M, D, K = (ca.MX(matrix) for matrix in (model.M, model.D, model.K))
    for i, name in enumerate(wanted):
        change = ca.exp(x[i]) - theta0[i]
        slope = model.slopes[name]
        M = M if slope.M is None else M + change * slope.M
        D = D if slope.D is None else D + change * slope.D
        K = K if slope.K is None else K + change * slope.K
    Z, C = K - s**2 * M, s * D
    X = ca.solve(ca.vertcat(ca.horzcat(Z, -C), ca.horzcat(C, Z)), ca.vertcat(model.B, 0 * model.B), "lapacklu")
    G = -(s**2) * ca.vertcat(model.C @ X[: model.n, :], model.C @ X[model.n :, :])
    W, data = ca.MX.sym("W", 72, 72), ca.MX.sym("data", 72)
    r = W @ (data - ca.vertcat(ca.vec(G[:6, :].T), ca.vec(G[6:, :].T)))
    J = ca.jacobian(r, x)
    every = ca.Function("line", [x, s, W, data], [r.T @ r, J.T @ r, J.T @ J]).map(lines)
    W_c = part.mixing[:lines] * part.gain[:lines].reshape(lines, 1, -1)
    W_r = ca.DM(np.concatenate([np.block([[w.real, -w.imag], [w.imag, w.real]]) for w in W_c], axis=1))
    flat = part.measured[:lines].reshape(lines, -1)
    measured = ca.DM(np.concatenate([flat.real, flat.imag], axis=1).T)
    omega = ca.DM(2 * np.pi * part.kernel.freq_hz[:lines]).T

    def evaluated(here: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        V, g, A = (sums.full() for sums in every(ca.repmat(ca.DM(here), 1, lines), omega, W_r, measured))
        return float(V.sum()), g.sum(axis=1), A.reshape(len(here), lines, len(here)).sum(axis=1)

    return evaluated


def casadi_problem(fit: ElasticFit) -> LeastSquares:
    """Return the whole fit with CasADi instead of the kernel, for the same solver."""
    parts = [casadi_sums(part, len(part.measured)) for part in fit.frfs]

    def evaluate(x: FloatArray) -> Evaluation:
        sums = [part(x) for part in parts]
        V, g, A = (sum(one[i] for one in sums) for i in range(3))
        return Evaluation(V, 2 * g, 2 * A)

    return LeastSquares(fit.parameters, fit.n_residuals, evaluate)


def print_table(title: str, headings: Sequence[str], rows: dict[str, Sequence[str]]) -> None:
    """Print a heading and a row for each name, with right-aligned numbers."""
    for name, cells in {title: headings, **rows}.items():
        print(f"{name:<38}" + "".join(f"{cell:>14}" for cell in cells))
    print()


def compare(Q: int, F: int, quick: bool, passes_only: bool) -> dict[str, float]:
    """Print the kernel and, if not alone, single lines and whole fits beside their peers; what texts quote of them."""
    _, fit = assemble(Q, F)
    x0 = fit.parameters.x + 0.2 * np.random.default_rng(1).standard_normal(len(fit.parameters.x))  # 20 % errors
    n, n_x = fit.frfs[0].kernel.model.n, len(x0)
    print(f"Q = {Q}, F = {F}, n = {n}, P = {n_x}, {fit.n_residuals} real residuals, one BLAS thread")
    print(f"{timing.machine()}\n")

    plain, plain_inertial = without_compiled_loops(Q, F)
    inertial, relinearised = with_inertias(Q, F)
    kernel = kernel_times(fit, plain, (inertial, plain_inertial, relinearised), 3 if quick else 15)
    rows = {
        PASSES[name]: (f"{1e3 * value:.1f}", f"{value / kernel['solve']:.1f}", f"{value / kernel['floor']:.1f}")
        for name, value in kernel.items()
    }
    print_table("one pass over all configurations", ("ms", "x solve", "x floor"), rows)
    results = {"Q": Q, "F": F, "n": n, "P": n_x, "compiled": is_compiled()}
    for name in [name for name in PASSES if name.endswith("evaluation")]:
        results |= {f"{name}_over_{peer}": round(kernel[name] / kernel[peer], 2) for peer in ("solve", "floor")}
    if passes_only:
        return results

    lines = 4 if quick else 40
    sums, per_line_s = casadi_sums(fit.frfs[0], lines), kernel["evaluation"] / (Q * F)
    casadi = timing.cpu_seconds(lambda: sums(fit.parameters.x), 3) / lines / per_line_s
    print(f"one line by {CASADI}, over that of elastid: {casadi:.1f}\n")

    rng = np.random.default_rng(2)
    starts = [x0, *(x0 + 0.1 * rng.standard_normal(n_x) for _ in range(1 if quick else 4))]
    times, costs = fit_times(fit, plain, starts)
    ratios = {
        name: sorted(one / own for one, own in zip(each, times["elastid"], strict=False))
        for name, each in times.items()
    }
    fits = {
        name: (f"{statistics.median(each):.1f}", f"{each[0]:.1f}", f"{costs[name]:.3f}")
        for name, each in ratios.items()
    }
    print_table("a whole fit, x elastid", ("median", "worst", "V"), fits)
    spread = max(costs.values()) / min(costs.values()) - 1
    return results | {
        "casadi_over_evaluation": round(casadi, 1),
        "faster_than_same_jacobian": round(statistics.median(ratios[COMPRESSED]), 1),
        "faster_than_same_jacobian_at_worst": round(ratios[COMPRESSED][0], 1),
        "faster_than_finite_differences": round(ratios[DIFFERENCES][0], 1),
        "faster_than_casadi": round(ratios[CASADI][0], 1),
        "cost_spread": spread,
    }


def main() -> None:
    """Run the benchmark. Print its tables, then one JSON line."""
    arguments = timing.options(__doc__, "a small problem, to see that it runs", passes=False)
    Q, F = (2, 12) if arguments.quick else (20, 200)
    print(json.dumps(compare(Q, F, arguments.quick, arguments.passes)))


if __name__ == "__main__":
    main()
