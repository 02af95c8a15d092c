"""The fit of `fit.py` by other libraries: residuals, Jacobian and normal matrix with CasADi and JAX."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.least_squares import Evaluation, LeastSquares
from elastid.fit.problem.part import Part


def casadi_sums(part: Part, lines: int) -> Callable[[FloatArray], tuple[float, FloatArray, FloatArray]]:
    """V, J^T r, J^T J of the first `lines` lines of one configuration at x, by automatic differentiation in MX."""
    model, wanted = part.kernel.model, part.kernel.wanted
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
    given = ca.DM(np.concatenate([flat.real, flat.imag], axis=1).T)
    omega = ca.DM(2 * np.pi * part.kernel.freq_hz[:lines]).T

    def evaluated(here: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        V, g, A = (found.full() for found in every(ca.repmat(ca.DM(here), 1, lines), omega, W_r, given))
        return float(V.sum()), g.sum(axis=1), A.reshape(len(here), lines, len(here)).sum(axis=1)

    return evaluated


def casadi_problem(fit: ElasticFit) -> LeastSquares:
    """The whole fit with CasADi instead of the kernel; the solver is the same."""
    parts = [casadi_sums(part, len(part.measured)) for part in fit.parts]

    def evaluate(x: FloatArray) -> Evaluation:
        found = [part(x) for part in parts]
        V, g, A = (sum(one[i] for one in found) for i in range(3))
        return Evaluation(V, 2 * g, 2 * A)

    return LeastSquares(fit.parameters, fit.n_residuals, evaluate)


def jax_evaluation(fit: ElasticFit) -> Callable[[], object] | None:
    """The same with JAX for all lines of one configuration; None where it is not installed."""
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        return None
    jax.config.update("jax_enable_x64", True)
    part = fit.parts[0]
    model, wanted = part.kernel.model, part.kernel.wanted
    theta0 = jnp.array([model.theta_ref[model.parameters.index(name)] for name in wanted])
    zero = np.zeros((model.n, model.n))
    slopes = [
        jnp.array([zero if (m := getattr(model.slopes[name], letter)) is None else m for name in wanted])
        for letter in "MDK"
    ]
    omega = jnp.array(2 * np.pi * part.kernel.freq_hz)[:, None, None]
    W = jnp.array(part.mixing * part.gain.reshape(len(part.gain), 1, -1))
    data = jnp.array(part.measured.reshape(len(part.gain), -1, 1))

    def residual(x: object) -> object:
        change = jnp.exp(x) - theta0
        M, D, K = (a + jnp.tensordot(change, b, 1) for a, b in zip((model.M, model.D, model.K), slopes, strict=True))
        Z = K - omega**2 * M + 1j * omega * D
        X = jnp.linalg.solve(Z, jnp.broadcast_to(model.B + 0j, (len(omega), *model.B.shape)))
        r = W @ (data + (omega**2 * (model.C @ X)).reshape(len(omega), -1, 1))
        return jnp.concatenate([r.real.ravel(), r.imag.ravel()])

    @jax.jit
    def evaluation(x: object) -> object:
        r, J = residual(x), jax.jacfwd(residual)(x)
        return r @ r, J.T @ r, J.T @ J

    return lambda: jax.block_until_ready(evaluation(jnp.log(theta0)))
