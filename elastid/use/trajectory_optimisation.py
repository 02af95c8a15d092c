r"""Trajectory optimisation of moves: optimal control by direct collocation with splines of degree 5.

.. math:: \min_{q, u} \int \left|\frac{e(q)}{e_0}\right|^2 + \left|\frac{\dot u\, t_0}{u_0}\right|^2 dt \quad
          \text{s.t.} \quad M \ddot q + f + \tau_f + \Phi^T \lambda = B u, \quad \varphi(q) = 0, \quad
          |q_m|, |\dot q_m|, |\ddot q_m|, |\dddot q_m|, |u| \le \text{limits}

e: distance of the tool from its path. tau_f: dry friction in steady sliding, with tanh(v / v_s) near zero velocity; the
sampled torque has the friction of `coulomb_torque_along` instead. q(t) is a spline with continuous fourth derivative,
in equilibrium at both ends. The equations are satisfied at its knots (de Boor and Swartz, SIAM J. Numer. Anal. 10
(1973), 582); between knots the error is of order h^4. The motors need time before and after the move to load and unload
the springs: with passive elastic joints the inverse is not causal. The solver is IPOPT (Wachter and Biegler,
Mathematical Programming 106, 2006) with the Gauss-Newton Hessian.
"""

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.sparse import csc_array, vstack

from elastid.base.arrays import FloatArray
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.linear.ports import Ports, between_ports
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.controller import feed_forward
from elastid.use.commanded_robot import CommandedRobot, coulomb_torque_along
from elastid.use.moves import LONGEST_S, MotionLimits, Move, References, evaluate_spline

DEGREE = 5
TOOL_M = 5e-5  # e_0
_N_END_COEFFICIENTS = 3  # fixed coefficients at each end, for zero velocity and acceleration
_RATE_S, _RIPPLE = 0.02, 1e-5  # t_0, and the scale of oscillations from knot to knot


@dataclass(frozen=True, eq=False)
class Planned:
    """Trajectory q(t) (n_q,) as a spline over time in s, with the status of IPOPT and the constraint violation."""

    q: BSpline
    status: str
    violation: float

    @property
    def is_feasible(self) -> bool:
        """True if all equations and limits are satisfied."""
        return self.violation < 1e-4

    @property
    def has_converged(self) -> bool:
        """True at an optimum."""
        return self.is_feasible and self.status in ("Solve_Succeeded", "Solved_To_Acceptable_Level")


def plan(
    commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float, tool_m: float = TOOL_M,
    iterations: int = 150, knots_per_s: float = 100.0,
) -> Planned:  # fmt: skip
    """Plan the best motion within the limits, from margin_s before a move to margin_s after it; tool_m: e_0.

    Raises KeyboardInterrupt when interrupted, StudyError for an end without an equilibrium.
    """
    problem = _CollocationProblem(commanded, move, limits, margin_s, tool_m, knots_per_s)
    options: dict[str, Any] = {
        "print_time": False, "no_nlp_grad": True, "calc_lam_p": False, "show_eval_warnings": False,
        "hess_lag": problem.hessian, "ipopt.sb": "yes", "ipopt.print_level": 0,
        "ipopt.tol": 1e-6, "ipopt.max_iter": iterations, "ipopt.mu_strategy": "adaptive",
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
    return Planned(BSpline(problem.knots, problem.coefficients(solution["x"]).full().T, DEGREE), status, violation)


class _CollocationProblem:
    """Variables x = [spline coefficients, torques u / u_0, multipliers], each knot by knot; constraints g likewise."""

    def __init__(
        self, commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float, tool_m: float,
        knots_per_s: float,
    ) -> None:  # fmt: skip
        model, N = commanded.model, max(12, round((move.duration + 2 * margin_s) * knots_per_s))
        self.commanded, self.limits, self.tool_m = commanded, limits, tool_m
        times, self.step = np.linspace(-margin_s, move.duration + margin_s, N + 1, retstep=True)
        self.knots = np.pad(times, DEGREE, mode="edge")
        self.n, self.n_q, self.n_u, self.n_c = N - 1, model.n_q, model.n_u, len(commanded.rows)
        self.ends = [commanded.rest(angles) for angles in move.ends]
        self.count = N + DEGREE  # of coefficients
        splines = BSpline(self.knots, np.eye(self.count), DEGREE)
        chunks = np.array_split(times[1:-1], 1 + N // 200)  # dense matrices of few rows at a time
        self.bases = [vstack([csc_array(splines(chunk, order)) for chunk in chunks], "csc") for order in range(4)]
        self.target = commanded.poses(commanded.rigid(move, times[1:-1])[0])
        zeros = np.zeros((2, self.n_q))
        self.holding = commanded.torque(np.array(self.ends), zeros, zeros)
        guess = self._guess(move)
        u = commanded.torque(*(basis @ guess for basis in self.bases[:3]))
        peak = np.abs(np.vstack([u, self.holding])).max(axis=0)
        self.u_0 = np.maximum(np.where(np.isfinite(limits.torque), np.minimum(limits.torque, peak), peak), 1e-6)
        self.force_0 = float(self.u_0.max())
        clipped = np.clip(u, -limits.torque, limits.torque) / self.u_0
        self.start = np.concatenate(
            [guess[_N_END_COEFFICIENTS:-_N_END_COEFFICIENTS].ravel(), clipped.ravel(), np.zeros(self.n_c * self.n)]
        )
        self._build()

    def _guess(self, move: Move) -> FloatArray:
        """Return coefficients (count, n_q) of the rigid robot's motion plus the interpolated static deflection."""
        fine = np.linspace(self.knots[0], self.knots[-1], 2 * (self.n + 1) + 1)
        rigid, fraction = self.commanded.rigid(move, fine)[0], np.clip(fine / move.duration, 0, 1)[:, None]
        deflected = (1 - fraction) * (self.ends[0] - rigid[0]) + fraction * (self.ends[1] - rigid[-1])
        c = np.array(make_lsq_spline(fine, rigid + deflected, self.knots, DEGREE).c)
        c[:_N_END_COEFFICIENTS], c[-_N_END_COEFFICIENTS:] = self.ends
        return c

    def _build(self) -> None:
        n, n_q, n_u, n_c = self.n, self.n_q, self.n_u, self.n_c
        sizes = n_q * n, n_u * n, n_c * n
        x = ca.MX.sym("x", sum(sizes))
        C_x, U_x, L_x = ca.vertsplit(x, np.cumsum([0, *sizes]).tolist())
        C, U, L = ca.reshape(C_x, n_q, n), ca.reshape(U_x, n_u, n), ca.reshape(L_x, n_c, n)
        first, last = (ca.repmat(ca.DM(end), 1, _N_END_COEFFICIENTS) for end in self.ends)
        coefficients = ca.horzcat(first, C, last)
        self.coefficients = ca.Function("coefficients", [x], [coefficients])
        Q, V, A, jerk = (coefficients @ ca.DM(basis).T for basis in self.bases)
        B = ca.DM(self.commanded.model.B) @ ca.diag(ca.DM(self.u_0))
        force, phi, _ = self.commanded.balance.map(n)(Q, V, A, L * self.force_0)
        dynamics = (force - B @ U) / self.force_0
        bounded = ca.vertcat(*self._bounded(Q, V, A, jerk))
        g = ca.vertcat(ca.vec(dynamics), ca.vec(phi), bounded)
        R = self.target.rotation.transpose(0, 2, 1).reshape(-1, 9)
        error, _ = self.commanded.tool.map(n)(Q, self.target.position.T, R.T)
        tool = ca.vec(error) / self.tool_m * np.sqrt(self.step)
        end_inputs = [ca.DM(u / self.u_0) for u in self.holding]
        rate = ca.diff(ca.horzcat(end_inputs[0], U, end_inputs[1]), 1, 1) * (_RATE_S / np.sqrt(self.step))
        # Sixth differences of coefficients: small for a smooth motion, large for oscillations from knot to knot.
        ripple = ca.diff(coefficients, 6, 1) * (np.sqrt(self.step) / _RIPPLE)
        residual = ca.vertcat(tool, ca.vec(rate), ca.vec(ripple))
        self.nlp = {"x": x, "f": ca.sumsqr(residual), "g": g}
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.size1())
        slopes = ca.jacobian(residual, x)
        regularisation = ca.diag(ca.DM([0.0] * (sizes[0] + sizes[1]) + [1e-8] * sizes[2]))
        H = 2 * lam_f * slopes.T @ slopes + lam_f * ca.sparsify(regularisation)  # Gauss-Newton
        arguments = [x, ca.MX(0, 1), lam_f, lam_g]
        names = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        self.hessian = ca.Function("nlp_hess_l", arguments, [ca.triu(H)], *names)
        self.high = np.concatenate([np.zeros((n_q + n_c) * n), np.ones(bounded.size1())])
        self.low = -self.high
        torque = np.tile(self.limits.torque / self.u_0, n)
        self.upper = np.concatenate([np.full(sizes[0], np.inf), torque, np.full(sizes[2], np.inf)])
        self.lower = -self.upper

    def _bounded(self, *motions: ca.MX) -> list[ca.MX]:
        """Return position (from mid-range), velocity, acceleration and jerk of motors over their finite limits."""
        limits, bounded = self.limits, []
        rows = [self.commanded.model.index(name) for name in self.commanded.model.inputs]
        middle, reach = limits.range
        reaches = reach, limits.velocity, limits.acceleration, limits.jerk
        for order, (motion, bounds) in enumerate(zip(motions, reaches, strict=True)):
            for motor in np.flatnonzero(np.isfinite(bounds)).tolist():
                bounded.append(ca.vec((motion[rows[motor], :] - (0.0 if order else middle[motor])) / bounds[motor]))
        return bounded


def margin_of(commanded: CommandedRobot, move: Move) -> float:
    """Return half a period, s, of the slowest mode with locked motors at both ends, 0.02 to 0.3 s."""
    m, halves = commanded.model, [0.0]
    for angles in move.ends:
        linear = linearise(m, Configuration("end", angles), m.theta, m.inputs, "position")
        locked = modes(between_ports(linear, Ports.at_frames(linear, ()), "locked", None), linear.theta_ref)
        halves += (0.5 / locked.freq_hz[:1]).tolist()
    return float(np.clip(max(halves), 0.02, 0.3))


def best_plan(commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float) -> Planned:
    """Plan a move; if limits keep the tool away from its path, with a larger e_0.

    A large tool error would outweigh the rate of the torque, whose plan would then oscillate.
    """
    planned = plan(commanded, move, limits, margin_s, iterations=30)
    for _ in range(2):
        error_m = float(planned_error(commanded, move, planned).max())
        if planned.has_converged and error_m < TOOL_M * 20:
            break
        planned = plan(commanded, move, limits, margin_s, max(TOOL_M, min(error_m, 1.0) / 40))
    return planned


def planned_error(commanded: CommandedRobot, move: Move, planned: Planned) -> FloatArray:
    """Return the distance (N,) of the tool from its path at the knots, m."""
    t = np.unique(planned.q.t)
    target = commanded.poses(commanded.rigid(move, t)[0]).position
    return np.asarray(np.linalg.norm(commanded.poses(planned.q(t)).position - target, axis=1))


def shortest(
    commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float, error_m: float
) -> Move | None:
    """Find the time-optimal move with a tool path error of at most error_m; None if the search fails."""

    def can(duration: float) -> bool:
        if duration > LONGEST_S:
            return False
        motion = move.in_time(duration)
        planned = plan(commanded, motion, limits, margin_s, iterations=30)
        return planned.is_feasible and bool(planned_error(commanded, motion, planned).max() <= error_m)

    # The elastic robot needs about as much time as the rigid one.
    duration = first_duration(commanded, move, limits)
    is_feasible = can(duration)
    step = 1 / 1.25 if is_feasible else 1.25
    for _ in range(12):
        if can(duration * step) != is_feasible:
            break
        duration *= step
    else:
        return None
    low, high = sorted((duration, duration * step))
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if can(middle) else (middle, high)
    return move.in_time(high)


def first_duration(commanded: CommandedRobot, move: Move, limits: MotionLimits) -> float:
    """Return a duration, s, in which the rigid robot keeps the limits; 0 for a robot without any."""
    t = np.linspace(0, 1, 201)
    unit = move.in_time(1.0)
    bounds = enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1)
    times = [float((np.abs(unit.at(t, order)) / bound).max() ** (1 / order)) for order, bound in bounds]
    path, a, start = unit.at(t) - unit.ends[0], unit.at(t, 2), commanded.rigid_posture(unit.ends[0])
    slow, quick = (feed_forward(commanded.model, start, path, 0 * path, x) for x in (0 * a, a))
    room = np.maximum(limits.torque - np.abs(slow), 0.05 * limits.torque)
    times.append(math.sqrt((np.abs(quick - slow) / room).max()))
    return 1.1 * max(times)


def sample_plan(commanded: CommandedRobot, planned: Planned, rate_hz: float, until_s: float) -> References:
    """Sample a plan at even times up to until_s after its end, at rest there."""
    low, high = planned.q.t[0], planned.q.t[-1]
    n = math.ceil((high + until_s - low) * rate_hz)
    time_s = low + np.arange(n + 1) / rate_hz
    m = commanded.model
    q, v, a, jerk = (evaluate_spline(planned.q, time_s, order) @ m.B for order in range(4))
    state = [evaluate_spline(planned.q, time_s + 0.5 / rate_hz, order) for order in range(3)]
    torque = commanded.torque(*state) + coulomb_torque_along(commanded.robot, m, state[1] @ m.B, rate_hz)
    # Replaces the smoothed friction of the plan.
    symbols = ca.SX.sym("v", m.n_q)
    planned_with = ca.Function("friction", [symbols], [ca.densify(commanded.friction(symbols, of_motors=True))])
    torque -= (np.linalg.pinv(m.B) @ planned_with.map(n + 1)(state[1].T).full()).T
    return References(time_s, q, v, a, jerk, torque)


def rigid_references(robot: Robot, commanded: CommandedRobot, move: Move, time_s: FloatArray) -> References:
    """Return the rigid robot's references at even times (N,), s, with torque by inverse dynamics and motor friction."""
    rate_hz = float(1 / np.diff(time_s).mean())
    model = commanded.model
    q0 = commanded.rigid_posture(move.ends[0])
    middle = time_s + 0.5 / rate_hz
    path = [move.at(middle, order) for order in range(3)]
    torque = feed_forward(model, q0, path[0] - move.ends[0], path[1], path[2])
    torque += coulomb_torque_along(robot, model, path[1], rate_hz)
    q, v, a, jerk = (move.at(time_s, order) for order in range(4))
    return References(time_s, q, v, a, jerk, torque)
