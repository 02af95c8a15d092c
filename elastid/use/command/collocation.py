r"""The move of an elastic robot as one optimal control problem, by direct collocation with splines of degree 5.

.. math:: \min_{q, u} \int \left|\frac{e(q)}{e_0}\right|^2 + \left|\frac{\dot u\, t_0}{u_0}\right|^2 dt \quad
          \text{s.t.} \quad M \ddot q + f + \tau_f + \Phi^T \lambda = B u, \quad \varphi(q) = 0, \quad
          |q_m|, |\dot q_m|, |\ddot q_m|, |\dddot q_m|, |u| \le \text{limits}

e: of the tool from its path. q(t) is a spline with continuous fourth derivative, at rest in equilibrium at both ends;
the equations hold at its knots (de Boor and Swartz, SIAM J. Numer. Anal. 10 (1973), 582): between them the error is of
order h^4. The time before and after the move lets the motors wind and unwind the springs: of robots with elastic joints
that no motor drives the inverse does not depend on the past alone. IPOPT (Wachter and Biegler, Mathematical Programming
106, 2006) with the Gauss-Newton Hessian of the tool's error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline

from elastid.base.arrays import FloatArray
from elastid.use.command.equations import CommandedRobot
from elastid.use.command.moves import MotionLimits, Move

DEGREE = 5
_HELD = 3  # coefficients at each end, which hold position at zero velocity and acceleration


@dataclass(frozen=True)
class Settings:
    """Weights and mesh: tool_m e_0, rate_s t_0, knots in a second, tolerance and iterations of IPOPT."""

    tool_m: float = 5e-5
    rate_s: float = 0.02
    ripple: float = 1e-5
    knots_per_s: float = 100.0
    tolerance: float = 1e-6
    iterations: int = 150


SETTINGS = Settings()


@dataclass(frozen=True, eq=False)
class Planned:
    """A motion q(t) (n_q,) as a spline over time in s; status: of IPOPT.  violation: of its constraints."""

    q: BSpline
    status: str
    violation: float

    @property
    def is_feasible(self) -> bool:
        """True if all equations and limits hold."""
        return self.violation < 1e-4

    @property
    def has_converged(self) -> bool:
        """True at an optimum."""
        return self.is_feasible and self.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")


def plan(
    commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float, settings: Settings = SETTINGS
) -> Planned:
    """The best motion within the limits from margin_s before a move to margin_s after it.

    KeyboardInterrupt where it was interrupted; StudyError where an end finds no rest.
    """
    problem = _Problem(commanded, move, limits, margin_s, settings)
    options: dict[str, Any] = {
        "print_time": False, "no_nlp_grad": True, "calc_lam_p": False, "show_eval_warnings": False,
        "hess_lag": problem.hessian, "ipopt.sb": "yes", "ipopt.print_level": 0,
        "ipopt.tol": settings.tolerance, "ipopt.max_iter": settings.iterations, "ipopt.mu_strategy": "adaptive",
        "ipopt.nlp_scaling_method": "none", "ipopt.acceptable_tol": 1e-4, "ipopt.acceptable_iter": 5,
        "ipopt.bound_relax_factor": 0.0, "ipopt.mu_init": 1e-3,
    }  # fmt: skip
    solver = ca.nlpsol("plan", "ipopt", problem.nlp, options)
    solution = solver(x0=problem.start, lbx=problem.lower, ubx=problem.upper, lbg=problem.low, ubg=problem.high)
    status = str(solver.stats()["return_status"])
    # Ctrl-C inside IPOPT does not raise; it returns this status.
    if status == "NonIpopt_Exception_Thrown":
        raise KeyboardInterrupt
    g = solution["g"].full()[:, 0]
    violation = float(np.maximum(problem.low - g, g - problem.high).max(initial=0.0))
    return Planned(problem.spline(solution["x"].full()[:, 0]), status, violation)


class _Problem:
    """Variables x = [spline coefficients, torques u / u_0, multipliers], each knot by knot; constraints g likewise."""

    def __init__(
        self, commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float, settings: Settings
    ) -> None:
        model, N = commanded.model, max(12, round((move.duration + 2 * margin_s) * settings.knots_per_s))
        self.commanded, self.limits, self.settings = commanded, limits, settings
        times, self.step = np.linspace(-margin_s, move.duration + margin_s, N + 1, retstep=True)
        self.knots = np.pad(times, DEGREE, mode="edge")
        self.n, self.n_q, self.n_u, self.n_c = N - 1, model.n_q, model.n_u, len(commanded.rows)
        self.ends = [commanded.rest(angles) for angles in move.ends]
        self.count = N + DEGREE  # of coefficients
        splines = BSpline(self.knots, np.eye(self.count), DEGREE)
        self.bases = [np.asarray(splines(times[1:-1], order)) for order in range(4)]
        self.inner = slice(_HELD, self.count - _HELD)
        self.target = commanded.poses(commanded.rigid(move, times[1:-1])[0])
        still = np.zeros((2, self.n_q))
        self.holding = commanded.torque(np.array(self.ends), still, still)
        guess = self._guess(move)
        u = commanded.torque(*(basis @ guess for basis in self.bases[:3]))
        peak = np.abs(np.vstack([u, self.holding])).max(axis=0)
        self.u_0 = np.maximum(np.where(np.isfinite(limits.torque), np.minimum(limits.torque, peak), peak), 1e-6)
        self.force_0 = float(self.u_0.max())
        clipped = np.clip(u, -limits.torque, limits.torque) / self.u_0
        self.start = np.concatenate([guess[self.inner].ravel(), clipped.ravel(), np.zeros(self.n_c * self.n)])
        self._build()

    def _guess(self, move: Move) -> FloatArray:
        """Coefficients (count, n_q) of the rigid robot's motion, deflected as at rest at both ends."""
        fine = np.linspace(self.knots[0], self.knots[-1], 2 * (self.n + 1) + 1)
        rigid, share = self.commanded.rigid(move, fine)[0], np.clip(fine / move.duration, 0, 1)[:, None]
        deflected = (1 - share) * (self.ends[0] - rigid[0]) + share * (self.ends[1] - rigid[-1])
        c = np.array(make_lsq_spline(fine, rigid + deflected, self.knots, DEGREE).c)
        c[:_HELD], c[-_HELD:] = self.ends
        return c

    def _build(self) -> None:
        n, n_q, n_u, n_c, s = self.n, self.n_q, self.n_u, self.n_c, self.settings
        sizes = n_q * n, n_u * n, n_c * n
        x = ca.MX.sym("x", sum(sizes))
        C_x, U_x, L_x = ca.vertsplit(x, np.cumsum([0, *sizes]).tolist()) if n_c else (*ca.vertsplit(
            x, [0, sizes[0], sizes[0] + sizes[1]]), ca.MX(0, 1))  # fmt: skip
        C, U, L = ca.reshape(C_x, n_q, n), ca.reshape(U_x, n_u, n), ca.reshape(L_x, n_c, n)
        inner = [ca.sparsify(ca.DM(basis[:, self.inner])) for basis in self.bases]
        outer = [
            np.outer(self.ends[0], basis[:, :_HELD].sum(axis=1)) + np.outer(self.ends[1], basis[:, -_HELD:].sum(axis=1))
            for basis in self.bases
        ]
        Q, V, A, jerk = (C @ inside.T + ca.DM(fixed) for inside, fixed in zip(inner, outer, strict=True))
        B = ca.DM(self.commanded.model.B) @ ca.diag(ca.DM(self.u_0))
        force, phi, _ = self.commanded.balance.map(n)(Q, V, A, L * self.force_0)
        dynamics = (force - B @ U) / self.force_0
        bounded = ca.vertcat(*self._bounded(Q, V, A, jerk))
        g = ca.vertcat(ca.vec(dynamics), ca.vec(phi), bounded)
        R = self.target.rotation.transpose(0, 2, 1).reshape(-1, 9)
        error, _ = self.commanded.tool.map(n)(Q, self.target.position.T, R.T)
        tool = ca.vec(error) / s.tool_m * np.sqrt(self.step)
        held = [ca.DM(u / self.u_0) for u in self.holding]
        rate = ca.diff(ca.horzcat(held[0], U, held[1]), 1, 1) * (s.rate_s / np.sqrt(self.step))
        # Sixth differences of coefficients: small of any smooth motion, large of one from knot to knot.
        ripple = np.diff(np.eye(self.count), 6, axis=0) * (np.sqrt(self.step) / s.ripple)
        whole = ca.horzcat(
            *(ca.DM(self.ends[0]) for _ in range(_HELD)), C, *(ca.DM(self.ends[1]) for _ in range(_HELD))
        )
        residual = ca.vertcat(tool, ca.vec(rate), ca.vec(whole @ ca.sparsify(ca.DM(ripple)).T))
        self.nlp = {"x": x, "f": ca.sumsqr(residual), "g": g}
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.size1())
        slopes = ca.jacobian(residual, x)
        few = ca.diag(ca.DM([0.0] * (sizes[0] + sizes[1]) + [1e-8] * sizes[2]))
        H = 2 * lam_f * slopes.T @ slopes + lam_f * ca.sparsify(few)  # Gauss and Newton's
        arguments = [x, ca.MX(0, 1), lam_f, lam_g]
        names = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        self.hessian = ca.Function("nlp_hess_l", arguments, [ca.triu(H)], *names)
        equal = np.zeros((n_q + n_c) * n)
        self.high = np.concatenate([equal, np.ones(bounded.size1())])
        self.low = -self.high
        torque = np.tile(self.limits.torque / self.u_0, n)
        self.upper = np.concatenate([np.full(sizes[0], np.inf), torque, np.full(sizes[2], np.inf)])
        self.lower = -self.upper

    def _bounded(self, *motions: ca.MX) -> list[ca.MX]:
        """Position to jerk of the motors with a finite limit, about its middle, over its reach."""
        limits, bounded = self.limits, []
        rows = [self.commanded.model.index(name) for name in self.commanded.model.inputs]
        middle, reach = limits.range
        reaches = reach, limits.velocity, limits.acceleration, limits.jerk
        for order, (motion, bounds) in enumerate(zip(motions, reaches, strict=True)):
            for motor in np.flatnonzero(np.isfinite(bounds)).tolist():
                value = motion[rows[motor], :] - (0.0 if order else middle[motor])
                bounded.append(ca.vec(value / bounds[motor]))
        return bounded

    def spline(self, x: FloatArray) -> BSpline:
        """q(t) of the variables."""
        c = np.empty((self.count, self.n_q))
        c[:_HELD], c[-_HELD:] = self.ends
        c[self.inner] = x[: self.n_q * self.n].reshape(self.n, self.n_q)
        return BSpline(self.knots, c, DEGREE)
