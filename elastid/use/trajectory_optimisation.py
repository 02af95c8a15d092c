r"""Plans of moves: each one optimal control problem, by direct collocation with splines of degree 5.

.. math:: \min_{q, u} \int \left|\frac{e(q)}{e_0}\right|^2 + \left|\frac{\dot u\, t_0}{u_0}\right|^2 dt \quad
          \text{s.t.} \quad M \ddot q + f + \tau_f + \Phi^T \lambda = B u, \quad \varphi(q) = 0, \quad
          |q_m|, |\dot q_m|, |\ddot q_m|, |\dddot q_m|, |u| \le \text{limits}

e: error of the tool from its path; every parameter of the robot is inserted. Dry friction is for steady sliding, with
tanh(v / v_s) near zero velocity. `coulomb_torque_along` integrates bristles along the reference when the torque is
written. q(t) is a spline with continuous fourth derivative, in equilibrium at both ends. The equations hold at its
knots (de Boor and Swartz, SIAM J. Numer. Anal. 10 (1973), 582); between them the error is of order h^4. The time before
and after the move lets the motors wind and unwind the springs: with passive elastic joints the inverse is not causal.
The solver is IPOPT (Wachter and Biegler, Mathematical Programming 106, 2006) with the Gauss-Newton Hessian of the tool
error. The result is the best plan within the limits, or the plan with the shortest time.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.sparse import csc_array, vstack

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import equilibrium, rigid_posture
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.linear.ports import Ports, between_ports
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import EXACT, formulate
from elastid.model.frame_tree import position, rotation, tree, turns
from elastid.model.kinematics import Poses, frame_poses
from elastid.model.loop_closure import partition
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.controller import feed_forward, rigid_motion, rigid_path, rigid_rates
from elastid.simulation.dynamics import contacts
from elastid.use.moves import LONGEST_S, MotionLimits, Move, References, evaluate_spline

# rad/s (m/s) on the link side below which the planned friction turns around: slower than a move, faster than a step.
SLIDING = 0.01
LEVER = 0.1  # m: an error of orientation counts as that of a point so far from the tool


@dataclass(frozen=True, eq=False)
class CommandedRobot:
    """A robot with numbers, about to be commanded so that a frame follows a path.

    rows: of the constraints that are independent.
    """

    robot: Robot
    model: ElasticModel
    frame: str
    rows: tuple[int, ...]
    spec: ModelSpec = EXACT

    @classmethod
    def of(cls, robot: Robot, frame: str, posture: FloatArray, spec: ModelSpec = EXACT) -> "CommandedRobot":
        """Build the model in the formulation of `spec`, minimal for elastic rods; posture (n_u,): near the motion."""
        model = formulate(robot, spec)
        if model.n_c:
            minimal = formulate(robot, ModelSpec("minimal"))
            model, spec = (minimal, ModelSpec("minimal")) if not minimal.n_c else (model, spec)
        rows = ()
        if model.n_c:
            point = equilibrium(model, model.theta, Configuration("move", posture))
            rows = tuple(partition(model, model.constraint_jacobian(point.q, model.theta).full()).rows.tolist())
        return cls(robot, model, frame, rows, spec)

    @cached_property
    def balance(self) -> ca.Function:
        """(q, v, a, lambda) -> r (n_q,), the forces that a motion takes; phi, its slope."""
        m, n = self.model, self.model.n_q
        q, v, a = (ca.SX.sym(name, n) for name in "qva")
        lambda_, rows = ca.SX.sym("lambda", len(self.rows)), list(self.rows)
        phi = m.constraint(q, m.theta)[rows]
        Phi = ca.jacobian(phi, q)
        force = m.mass(q, m.theta) @ a + m.force(q, v, m.theta) + self.friction(v) + Phi.T @ lambda_
        results = [ca.densify(expression) for expression in (force, phi, Phi)]
        return ca.Function("balance", [q, v, a, lambda_], results, {"cse": True})

    def friction(self, v: ca.SX, of_motors: bool = False) -> ca.SX:
        """Return P tau_f (n_q,) of steady sliding, by all friction models or the motors' only."""
        laws = [law for law in frictions(self.robot) if law.place in self.model.inputs or not of_motors]
        total = ca.SX(self.model.n_q, 1)
        for law, column in zip(laws, contacts(self.model, laws).P.T, strict=True):
            slip, curve = ca.dot(ca.DM(column), v), law.symbols(law.curve().tolist())
            total += ca.DM(column) * (curve.torque(slip) * ca.tanh(slip / SLIDING) + curve.growing(slip))
        return total

    @cached_property
    def tool(self) -> ca.Function:
        """(q, p, R) -> error (3,) or (6,) in m of the frame from a pose p (3,), R (9,) column by column; its slope."""
        q, p, R = ca.SX.sym("q", self.model.n_q), ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3)
        layout = tree(self.robot)
        joint_turns = turns(layout, q[: len(self.robot.joints)])
        seat = layout.named[[frame.name for frame in self.robot.frames].index(self.frame)]
        error = position(layout, joint_turns, seat) - p
        if self.model.n_u > 3:  # the orientation is followed, too
            axes = rotation(layout, joint_turns, seat)
            error = ca.vertcat(error, LEVER / 2 * sum(ca.cross(R[:, i], axes[:, i]) for i in range(3)))
        results = [ca.densify(expression) for expression in (error, ca.jacobian(error, q))]
        return ca.Function("tool", [q, p, ca.vec(R)], results, {"cse": True})

    def torque(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return torques u (N, n_u) for a motion (N, n_q); forces in loops by least squares."""
        m, n, n_r = self.model, len(q), len(self.rows)
        force, _, Phi = (values.full() for values in self.balance.map(n)(q.T, v.T, a.T, np.zeros((n_r, n))))
        carried = -Phi.reshape(n_r, n, m.n_q).transpose(1, 2, 0)
        columns = np.concatenate([np.broadcast_to(m.B, (n, *m.B.shape)), carried], axis=2)
        return np.asarray((np.linalg.pinv(columns) @ force.T[:, :, None])[:, : m.n_u, 0])

    def poses(self, q: FloatArray, robot: Robot | None = None) -> Poses:
        """Return poses of the frame at q (N, n_q), of this robot or of another of its kind."""
        return frame_poses(robot or self.robot, q[:, : len(self.robot.joints)], self.frame)

    def rigid(self, move: Move, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, v, a (N, n_q) of the robot without deflection along a move at times (N,)."""
        angles, rate, curvature = (move.at(t, order) for order in range(3))
        q = rigid_path(self.model, self.rigid_posture(angles[0]), angles[0], angles)
        return q, *rigid_rates(self.model, q, rate, curvature)[1:]

    def rest(self, angles: FloatArray) -> FloatArray:
        """Return q (n_q,) at rest under gravity with the tool where it is without deflection at angles (n_u,).

        StudyError where the robot finds no rest there.
        """
        target = self.poses(self.rigid_posture(angles)[None])
        motors = angles
        for _ in range(8):
            q = equilibrium(self.model, self.model.theta, Configuration("move", motors)).q
            R = target.rotation.transpose(0, 2, 1).reshape(9)
            error, J = (values.full() for values in self.tool(q, target.position[0], R))
            step = -np.linalg.pinv(J @ rigid_motion(self.model, q), rcond=1e-6) @ error[:, 0]
            if np.abs(step).max() < 1e-9:
                return q
            motors = motors + step
        raise StudyError(
            "robot/no-equilibrium",
            f"no posture of the motors brings frame {self.frame} at rest to where it is "
            f"without deflection at {', '.join(f'{angle:.4g}' for angle in angles)} rad; the posture is near a "
            "singular one, choose another",
            f"robot {self.robot.name}",
        )

    def rigid_posture(self, angles: FloatArray) -> FloatArray:
        """Return q (n_q,) without deflection at angles (n_u,)."""
        return rigid_posture(self.model, Configuration("move", angles))


DEGREE = 5
TOOL_M = 5e-5  # e_0
_N_END_COEFFICIENTS = 3  # coefficients at each end, which hold position at zero velocity and acceleration
_RATE_S, _RIPPLE = 0.02, 1e-5  # t_0, and the same of what differs from knot to knot


@dataclass(frozen=True, eq=False)
class Planned:
    """Trajectory q(t) (n_q,) as a spline over time in s, with the status of IPOPT and the constraint violation."""

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
    commanded: CommandedRobot, move: Move, limits: MotionLimits, margin_s: float, tool_m: float = TOOL_M,
    iterations: int = 150, knots_per_s: float = 100.0,
) -> Planned:  # fmt: skip
    """Plan the best motion within the limits from margin_s before a move to margin_s after it; tool_m: e_0.

    KeyboardInterrupt where it was interrupted; StudyError where an end finds no rest.
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
        """Return coefficients (count, n_q) of the rigid robot's motion, deflected as at rest at both ends."""
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
        # Sixth differences of coefficients: small of any smooth motion, large of one from knot to knot.
        ripple = ca.diff(coefficients, 6, 1) * (np.sqrt(self.step) / _RIPPLE)
        residual = ca.vertcat(tool, ca.vec(rate), ca.vec(ripple))
        self.nlp = {"x": x, "f": ca.sumsqr(residual), "g": g}
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.size1())
        slopes = ca.jacobian(residual, x)
        regularisation = ca.diag(ca.DM([0.0] * (sizes[0] + sizes[1]) + [1e-8] * sizes[2]))
        H = 2 * lam_f * slopes.T @ slopes + lam_f * ca.sparsify(regularisation)  # Gauss and Newton's
        arguments = [x, ca.MX(0, 1), lam_f, lam_g]
        names = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        self.hessian = ca.Function("nlp_hess_l", arguments, [ca.triu(H)], *names)
        self.high = np.concatenate([np.zeros((n_q + n_c) * n), np.ones(bounded.size1())])
        self.low = -self.high
        torque = np.tile(self.limits.torque / self.u_0, n)
        self.upper = np.concatenate([np.full(sizes[0], np.inf), torque, np.full(sizes[2], np.inf)])
        self.lower = -self.upper

    def _bounded(self, *motions: ca.MX) -> list[ca.MX]:
        """Return position to jerk of motors with finite limits over the limit; positions from mid-range."""
        limits, bounded = self.limits, []
        rows = [self.commanded.model.index(name) for name in self.commanded.model.inputs]
        middle, reach = limits.range
        reaches = reach, limits.velocity, limits.acceleration, limits.jerk
        for order, (motion, bounds) in enumerate(zip(motions, reaches, strict=True)):
            for motor in np.flatnonzero(np.isfinite(bounds)).tolist():
                value = motion[rows[motor], :] - (0.0 if order else middle[motor])
                bounded.append(ca.vec(value / bounds[motor]))
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
    """Plan by Gauss-Newton; if limits keep the tool off its path, with a larger e_0.

    Of a tool far from its path the square outweighs the torque's rate, which would leave torques that chatter.
    """
    planned = plan(commanded, move, limits, margin_s, iterations=30)
    for _ in range(2):
        away = float(planned_error(commanded, move, planned).max())
        if planned.has_converged and away < TOOL_M * 20:
            break
        planned = plan(commanded, move, limits, margin_s, max(TOOL_M, min(away, 1.0) / 40))
    return planned


def planned_error(commanded: CommandedRobot, move: Move, planned: Planned) -> FloatArray:
    """Return distance (N,) of the tool from its path at the knots, m."""
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

    # The rigid robot, which is not far from the elastic one, needs about this.
    duration = first_duration(commanded, move, limits)
    works = can(duration)
    step = 1 / 1.25 if works else 1.25
    for _ in range(12):
        if can(duration * step) != works:
            break
        duration *= step
    else:
        return None
    low, high = sorted((duration, duration * step))
    while high > 1.01 * low:  # then the shortest one is known
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
    # In place of the friction that it is planned with, which turns around gradually.
    symbols = ca.SX.sym("v", m.n_q)
    planned_with = ca.Function("friction", [symbols], [ca.densify(commanded.friction(symbols, of_motors=True))])
    torque -= (np.linalg.pinv(m.B) @ planned_with.map(n + 1)(state[1].T).full()).T
    return References(time_s, q, v, a, jerk, torque)


def coulomb_torque_along(robot: Robot, model: ElasticModel, velocity: FloatArray, rate_hz: float) -> FloatArray:
    """Return dry friction (N, n_u) of motors along velocities (N, n_u), link side, from rest, bristles included.

    Friction behind the spring of a gear is not included: the joint moves differently from its motor.
    """
    laws = [law for law in frictions(robot) if law.place in model.inputs]
    placed = contacts(model, laws)
    if not laws:
        return np.zeros_like(velocity)
    v, z = ca.SX.sym("v", model.n_q), ca.SX.sym("z", placed.n_states)
    curves = ca.SX(placed.curves)
    step = ca.Function("friction", [z, v], [placed.advanced(v, z, curves, 1 / rate_hz), placed.torque(v, z, curves)])
    _, torque = step.mapaccum(len(velocity))(np.zeros(placed.n_states), model.B @ velocity.T)
    return np.asarray((np.linalg.pinv(model.B) @ torque.full()).T)


def rigid_references(robot: Robot, commanded: CommandedRobot, move: Move, time_s: FloatArray) -> References:
    """Return the rigid robot's feedforward along a move at even times (n,), s: inverse dynamics and motor friction."""
    rate_hz = float(1 / np.diff(time_s).mean())
    model = commanded.model
    q0 = commanded.rigid_posture(move.ends[0])
    middle = time_s + 0.5 / rate_hz
    path = [move.at(middle, order) for order in range(3)]
    torque = feed_forward(model, q0, path[0] - move.ends[0], path[1], path[2])
    torque += coulomb_torque_along(robot, model, path[1], rate_hz)
    q, v, a, jerk = (move.at(time_s, order) for order in range(4))
    return References(time_s, q, v, a, jerk, torque)
