r"""Equilibrium under gravity: the operating point of a configuration, and the preload of nonlinear springs.

.. math:: \partial V / \partial q + \Phi^T \lambda = B u, \qquad \varphi(q) = 0, \qquad q_m = q_{m0}

The motors are at their measured angles; elastic joints deflect until springs, gravity and constraint forces of the
loops balance. For redundant constraints lambda is the smallest solution.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, IntArray, frozen_value
from elastid.base.errors import Note, StudyError
from elastid.model.closed_posture import assemble
from elastid.model.drivetrain import deflections, tangents
from elastid.model.elastic import ElasticModel
from elastid.model.loop_closure import motions, null_space
from elastid.record import Configuration

# Limits of Newton's method, and of an equilibrium.
MAX_STEPS = 60
MAX_STEP = 0.3  # rad or m, so that a soft spring does not lead to another branch of the solution
CONVERGED_STEP = 1e-12  # rad or m; convergence is quadratic, the remaining error is far below
ROUNDING_STEP = 1e-6  # rad or m, below which rounding errors dominate the slope of V
HALVINGS = 30
ROUNDING_GAP = 1e-9  # m or rad, largest residual of a constraint that rounding errors explain
MAX_DEFLECTION = 1.0  # rad or m, above which a spring has tipped over
MIN_INERTIA = 1e-12  # largest eigenvalue of M, scaled to a unit diagonal, that rounding errors explain
FLANK_WIDTHS = 2.0  # number of flank widths beyond a gap, after which its spring has 95 % of its stiffness


@frozen_value
class OperatingPoint:
    """Coordinates q (n_q,), multipliers lambda_ (n_c,) and motor torques u (n_u,) in equilibrium, link side, SI."""

    configuration: Configuration
    q: FloatArray
    lambda_: FloatArray
    u: FloatArray


def equilibrium(model: ElasticModel, theta: FloatArray, configuration: Configuration) -> OperatingPoint:
    """Solve statics by Newton's method with the exact stiffness, from the posture of a rigid robot.

    theta (n_theta,): model.parameters, SI.  configuration.angles (n_u,): of the motors, link side, rad or m.
    StudyError for a wrong number of angles, no equilibrium, a joint that tips over or a coordinate without inertia.
    The last solutions are cached, because several functions need the equilibrium of one configuration.
    """
    numbers = np.asarray(theta, dtype=float).tobytes()
    point = _equilibrium(model, numbers, configuration.angles.tobytes(), configuration.name, configuration.has_payload)
    return replace(point, configuration=configuration)


@lru_cache(maxsize=64)
def _equilibrium(model: ElasticModel, numbers: bytes, angles: bytes, name: str, has_payload: bool) -> OperatingPoint:
    """Solve `equilibrium` for hashable arguments: theta and angles as bytes."""
    theta, configuration = np.frombuffer(numbers), Configuration(name, np.frombuffer(angles), has_payload)
    free, theta = free_coordinates(model), model.with_payload(theta, configuration.has_payload)
    q = rigid_posture(model, configuration, theta)
    rigid = q.copy()
    state = _balance(model, theta, q, free)
    gravity = model.potential_gradient(q, theta).full()[:, 0]
    bad = np.flatnonzero(~np.isfinite(np.column_stack([gravity, state.K])).all(axis=1))
    if bad.size:
        text = "a parameter of the robot is not finite, or a gas spring is at its end, without a gas column left"
        text = f"the torque on {model.coordinates[bad[0]]} is not a finite number; {text}"
        raise StudyError("robot/no-equilibrium", text, f"configuration {configuration.name}")
    for _ in range(MAX_STEPS):
        # A full step that closes the loops, then a descent step of V along them.
        Z, K = null_space(state.Phi[:, free]), state.K[np.ix_(free, free)]
        close = np.linalg.lstsq(state.Phi[:, free], -state.phi)[0]
        pull = Z.T @ (state.torque[free] + K @ close)
        along = _descent_step(Z.T @ K @ Z, pull, 1e-9 * np.abs(gravity).max())
        back, step = np.zeros(model.n_q), np.zeros(model.n_q)
        back[free], step[free] = close, Z @ along
        largest = np.abs(back + step).max(initial=0.0)
        scale = min(1.0, MAX_STEP / max(largest, CONVERGED_STEP))
        q, state = _shorten_step(model, theta, q + scale * back, scale * step, scale * float(pull @ along), free)
        if largest <= CONVERGED_STEP:
            break
    for fault in _faults(model, theta, free, q, rigid, state, np.abs(gravity).max()):
        raise StudyError("robot/no-equilibrium", fault, f"configuration {configuration.name}")
    return OperatingPoint(configuration, q, state.lambda_, model.B.T @ state.torque)


@dataclass(frozen=True)
class _Balance:
    """torque (n_q,) = dV/dq + Phi^T lambda, K its Jacobian, phi (n_c,), Phi (n_c, n_q), lambda_ (n_c,)."""

    torque: FloatArray
    K: FloatArray
    phi: FloatArray
    Phi: FloatArray
    lambda_: FloatArray


def _balance(model: ElasticModel, theta: FloatArray, q: FloatArray, free: IntArray) -> _Balance:
    """Return the balance at q (n_q,), with the smallest multipliers that minimise the torque on free coordinates."""
    gravity = model.potential_gradient(q, theta).full()[:, 0]
    if not model.n_c:
        none = np.zeros(0)
        return _Balance(gravity, model.stiffness(q, none, theta).full(), none, np.zeros((0, model.n_q)), none)
    Phi = model.constraint_jacobian(q, theta).full()
    lambda_ = np.linalg.lstsq(Phi[:, free].T, -gravity[free])[0]
    K = model.stiffness(q, lambda_, theta).full()
    return _Balance(gravity + Phi.T @ lambda_, K, model.constraint(q, theta).full()[:, 0], Phi, lambda_)


@lru_cache(maxsize=64)
def free_coordinates(model: ElasticModel) -> IntArray:
    """Return the free coordinates (n_f,): all except the motors' coordinates."""
    return np.setdiff1d(np.arange(model.n_q), [model.index(motor) for motor in model.inputs])


def _descent_step(K: FloatArray, torque: FloatArray, rounding: float) -> FloatArray:
    """Return Newton's step for a positive definite K, else a step of descent.

    A coordinate without stiffness moves only if its torque exceeds rounding errors, as inside the gap of a spring.
    """
    if not torque.size:
        return torque
    stiffness, modes = np.linalg.eigh(K)
    pull, size = modes.T @ torque, np.abs(stiffness)
    floor = 1e-13 * size.max() or 1.0
    return -modes @ np.where((size > floor) | (np.abs(pull) > rounding), pull / np.maximum(size, floor), 0.0)


def _shorten_step(
    model: ElasticModel, theta: FloatArray, q: FloatArray, step: FloatArray, slope: float, free: IntArray
) -> tuple[FloatArray, _Balance]:
    """Halve the step until V does not increase steeply at its end. Return q and balance there.

    slope: magnitude of the slope of V at the beginning of the step.
    """
    for halving in range(HALVINGS):
        q_new = q + 0.5**halving * step
        state = _balance(model, theta, q_new, free)
        if float(state.torque @ step) <= -0.9 * slope or np.abs(step).max(initial=0.0) < ROUNDING_STEP:
            break
    return q_new, state


def rigid_posture(model: ElasticModel, configuration: Configuration, theta: FloatArray | None = None) -> FloatArray:
    """Return q (n_q,) without deflection: driven joints at their motors' angles, elastic joints at 0, loops closed.

    theta (n_theta,): model.parameters, for the geometry; by default of the robot.
    StudyError for a wrong number of angles, or if the loops cannot be closed.
    """
    if refusal := model.robot.count_refusal(configuration.angles.size):
        raise StudyError("robot/no-equilibrium", refusal, f"configuration {configuration.name}")
    q = np.zeros(model.n_q)
    try:
        angles, joints = configuration.angles, model.robot.joint_positions(configuration.angles)
        if model.robot.loops:  # the geometry moves no joint of a tree
            joints = assemble(model.robot_at(model.theta if theta is None else theta), angles)
        q[: len(joints)] = joints
    except StudyError as error:
        raise StudyError("robot/no-equilibrium", str(error), f"configuration {configuration.name}") from None
    for motor, angle in zip(model.inputs, configuration.angles, strict=True):
        q[model.index(motor)] = angle
    return q


def _faults(
    model: ElasticModel, theta: FloatArray, free: IntArray, q: FloatArray, rigid: FloatArray, balance: _Balance,
    load: float,
) -> Iterator[str]:  # fmt: skip
    """Yield reasons why q (n_q,) is no equilibrium.  rigid (n_q,): without deflection.  load: largest gravity load."""
    slides, names, K = model.robot.slides, model.coordinates, balance.K
    soft = "under gravity; raise the stiffness of its springs, or let a joint without spring hang down"
    if (gap := np.abs(balance.phi).max(initial=0.0)) > ROUNDING_GAP:
        yield f"the loops of robot {model.robot.name} stay open by {gap:.3g} m {soft}"
    residual = np.abs(balance.torque[free])
    if residual.size and not residual.max() <= 1e-8 * load + 1e-12 * np.abs(K).max():
        worst = free[int(np.argmax(residual))]
        unit = "N" if slides(names[worst]) else "N*m"
        yield f"{names[worst]} stays unbalanced by {balance.torque[worst]:.3g} {unit} {soft}"
    Z = null_space(balance.Phi[:, free])
    if Z.size:
        stiffness, modes = np.linalg.eigh(Z.T @ K[np.ix_(free, free)] @ Z)
        if stiffness[0] < -1e-9 * np.abs(K).max():
            worst = free[int(np.argmax(np.abs((Z @ modes)[:, 0])))]
            unit = "N/m" if slides(names[worst]) else "N*m/rad"
            yield f"{names[worst]} tips over with a stiffness of {stiffness[0]:.3g} {unit} {soft}"
    for joint in model.robot.joints:
        deflection = (q - rigid)[model.index(f"joint {joint.name}")]
        if joint.spring is not None and abs(deflection) > MAX_DEFLECTION:
            yield f"joint {joint.name} tips over, {deflection:.3g} {joint.unit} from where its motor holds it, {soft}"
    Z = motions(model, balance.Phi)
    M = Z.T @ model.mass(q, theta).full() @ Z
    scale = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
    eigenvalues, modes = np.linalg.eigh(M / np.outer(scale, scale))
    participation = np.linalg.norm(Z @ modes[:, eigenvalues <= MIN_INERTIA], axis=1)
    if massless := ", ".join(name for name, fraction in zip(names, participation, strict=True) if fraction > 0.1):
        yield (
            f"the mass matrix is singular: {massless} moves no inertia. Give a body on this joint a mass off the "
            "joint's axis or an inertia about it"
        )


def preloads(
    model: ElasticModel, theta: FloatArray, points: Sequence[OperatingPoint]
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Return the joints with springs, and their deflections, rad or m, and tangent stiffnesses (n_s, P) at P points."""
    q, symbols = model.symbols("q", "theta")
    by_name = dict(zip(model.parameters, ca.vertsplit(symbols), strict=True))
    deflection = deflections(model.robot, q)
    laws = ca.vertcat(*deflection.values()), ca.vertcat(*tangents(deflection, by_name).values())
    at_points = ca.Function("preload", [q, symbols], [ca.densify(law) for law in laws]).map(len(points))
    x, k = at_points(np.transpose([point.q for point in points]), np.tile(theta[:, None], len(points)))
    return tuple(deflection), x.full(), k.full()


def spring_notes(model: ElasticModel, theta: FloatArray, at: Iterable[OperatingPoint]) -> tuple[Note, ...]:
    """Return a note for each joint that rests inside its backlash in any configuration; theta (n_theta,), SI."""
    if all(joint.spring is None or joint.spring.is_linear for joint in model.robot.joints):
        return ()
    points = tuple(at)
    values = dict(zip(model.parameters, np.asarray(theta, dtype=float).tolist(), strict=True))
    notes = []
    for joint, x, k in zip(*preloads(model, theta, points), strict=True):
        b = values.get(f"b_{joint}", 0.0)
        inside = np.flatnonzero(np.abs(x) < b + FLANK_WIDTHS * (values.get(f"e_{joint}", 0.0) * b))
        if inside.size:
            angle = model.robot.parameters()[f"b_{joint}"][1]
            names = ", ".join(
                f"{points[i].configuration.name} (deflected by {x[i]:.2g} {angle})" for i in inside.tolist()
            )
            ratio = k[inside] / values[f"k_{joint}"]
            text = (
                f"joint {joint} rests inside its backlash of +-{b:.2g} {angle} in {names}: the response depends on "
                f"the amplitude there, and the stiffness of {ratio.min():.0%} to {ratio.max():.0%} of k_{joint} that "
                "the model has at rest describes none; take configurations in which gravity presses the joint onto "
                "one flank, or leave these out"
            )
            notes.append(Note("robot/operating-point", text))
    return tuple(notes)
