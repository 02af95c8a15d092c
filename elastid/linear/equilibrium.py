"""Rest under gravity: the operating point of a configuration, and preload of nonlinear springs there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, IntArray, frozen_value
from elastid.base.errors import StudyError
from elastid.base.note import Note
from elastid.model.elastic import ElasticModel
from elastid.model.parallel_linkage.closed_posture import assembled
from elastid.model.parallel_linkage.loop_closure import motions, null_space
from elastid.model.springs import deflections, tangents
from elastid.record import Configuration

MAX_STEPS = 60
MAX_STEP = 0.3  # rad or m: a soft spring must not throw the arm onto another branch
CONVERGED_STEP = 1e-12  # rad or m: convergence is quadratic, the error left is far below
ROUNDING_STEP = 1e-8  # rad or m: below, rounding decides whether a step leads downhill
MAX_HALVINGS = 30
MAX_GAP = 1e-9  # m or rad: residual of a constraint that rounding explains
MAX_DEFLECTION = 1.0  # rad or m: no spring of a robot gives by so much, it has tipped over
ROUNDING_INERTIA = 1e-12  # eigenvalue of M, scaled to a unit diagonal, that rounding explains


@frozen_value
class OperatingPoint:
    """Coordinates q (n_q,), multipliers lambda_ (n_c,) and holding torques u (n_u,) at rest, link side, SI."""

    configuration: Configuration
    q: FloatArray
    lambda_: FloatArray
    u: FloatArray


def equilibrium(model: ElasticModel, theta: FloatArray, configuration: Configuration) -> OperatingPoint:
    """Statics by Newton's method with the exact stiffness, from the posture that a rigid robot would have.

    theta (n_theta,): model.parameters, SI.  configuration.angles (n_u,): the motors' angles, link side (or m).
    StudyError for a wrong number of angles, a joint that finds no rest, tips over under gravity or moves no inertia.
    """
    free = free_coordinates(model)
    q = rigid_posture(model, configuration, theta)
    rigid = q.copy()
    now = _balance(model, theta, q, free)
    gravity = model.potential_gradient(q, theta).full()[:, 0]
    _check_finite(model, configuration, np.column_stack([gravity, now.K]))
    for _ in range(MAX_STEPS):
        # Back onto the loops, and downhill along them.
        Z, K = null_space(now.Phi[:, free]), now.K[np.ix_(free, free)]
        close = np.linalg.lstsq(now.Phi[:, free], -now.phi)[0]
        pull = Z.T @ (now.torque[free] + K @ close)
        step = np.zeros(model.n_q)
        step[free] = close + Z @ _downhill(Z.T @ K @ Z, pull, 1e-9 * np.abs(gravity).max())
        largest = np.abs(step).max(initial=0.0)
        step *= min(1.0, MAX_STEP / max(largest, CONVERGED_STEP))
        q, now = _shortened(model, theta, q, now, step, free)
        if largest <= CONVERGED_STEP:
            break
    rounding = 1e-8 * np.abs(gravity).max() + 1e-12 * np.abs(now.K).max()
    _check_closed(model, configuration, now.phi)
    _check_rest(model, configuration, free, now.torque, rounding)
    _check_stable(model, configuration, free, now.K, now.Phi)
    _check_deflections(model, configuration, q - rigid)
    _check_inertia(model, configuration, model.mass(q, theta).full(), motions(model, now.Phi))
    return OperatingPoint(configuration, q, now.lambda_, model.B.T @ now.torque)


@dataclass(frozen=True)
class _Balance:
    """torque (n_q,) = dV/dq + Phi^T lambda, K its Jacobian, phi (n_c,), Phi (n_c, n_q), lambda_ (n_c,)."""

    torque: FloatArray
    K: FloatArray
    phi: FloatArray
    Phi: FloatArray
    lambda_: FloatArray


def _balance(model: ElasticModel, theta: FloatArray, q: FloatArray, free: IntArray) -> _Balance:
    """At q (n_q,), with the multipliers of the least torque on the free coordinates; of many, the smallest."""
    gravity = model.potential_gradient(q, theta).full()[:, 0]
    if not model.n_c:
        none = np.zeros(0)
        return _Balance(gravity, model.stiffness(q, none, theta).full(), none, np.zeros((0, model.n_q)), none)
    Phi = model.constraint_jacobian(q, theta).full()
    lambda_ = np.linalg.lstsq(Phi[:, free].T, -gravity[free])[0]
    K = model.stiffness(q, lambda_, theta).full()
    return _Balance(gravity + Phi.T @ lambda_, K, model.constraint(q, theta).full()[:, 0], Phi, lambda_)


def free_coordinates(model: ElasticModel) -> IntArray:
    """The free coordinates (n_f,): all but the motors', which are held."""
    return np.setdiff1d(np.arange(model.n_q), [model.index(motor) for motor in model.inputs])


def _downhill(K: FloatArray, torque: FloatArray, rounding: float) -> FloatArray:
    """Newton's step where K is positive definite, else a step of descent.

    A joint with neither spring nor gravity has no stiffness and stays where it is; one whose spring is inside its gap
    has none either, but a torque beyond rounding.
    """
    if not torque.size:
        return torque
    stiffness, modes = np.linalg.eigh(K)
    pull, size = modes.T @ torque, np.abs(stiffness)
    floor = 1e-13 * size.max() or 1.0
    moving = (size > floor) | (np.abs(pull) > rounding)
    return np.asarray(-modes @ np.where(moving, pull / np.maximum(size, floor), 0.0))


def _shortened(
    model: ElasticModel, theta: FloatArray, q: FloatArray, now: _Balance, step: FloatArray, free: IntArray
) -> tuple[FloatArray, _Balance]:
    """q and balance after the step, halved until the slope of V along it is not nearly as steep uphill at its end."""
    slope = float(now.torque @ step)
    for halving in range(MAX_HALVINGS):
        moved = q + 0.5**halving * step
        now = _balance(model, theta, moved, free)
        if float(now.torque @ step) <= -0.9 * slope or np.abs(step).max(initial=0.0) < ROUNDING_STEP:
            break
    return moved, now


def rigid_posture(model: ElasticModel, configuration: Configuration, theta: FloatArray | None = None) -> FloatArray:
    """q (n_q,) without deflection: driven joints at their motors' angles, elastic ones at 0, loops closed.

    theta (n_theta,): model.parameters, of which the geometry counts; default the robot's own.
    StudyError where the configuration does not give one angle for each motor, or the loops do not close there.
    """
    if refused := model.robot.count_refusal(configuration.angles.size):
        raise StudyError(f"configuration {configuration.name}: {refused}")
    q = np.zeros(model.n_q)
    try:
        q[: len(model.robot.joints)] = assembled(
            model.robot_at(model.theta if theta is None else theta), configuration.angles
        )
    except StudyError as error:
        raise StudyError(f"configuration {configuration.name}: {error}") from None
    for motor, angle in zip(model.inputs, configuration.angles, strict=True):
        q[model.index(motor)] = angle
    return q


def _check_finite(model: ElasticModel, configuration: Configuration, numbers: FloatArray) -> None:
    bad = np.flatnonzero(~np.isfinite(numbers).all(axis=1))
    if bad.size:
        raise StudyError(
            f"configuration {configuration.name}: the torque on {model.coordinates[bad[0]]} is not a finite number; "
            "a parameter of the robot is not finite, or a gas spring is at its end, without a gas column left"
        )


def _check_rest(
    model: ElasticModel, configuration: Configuration, free: IntArray, torque: FloatArray, rounding: float
) -> None:
    left = np.abs(torque[free])
    if left.size and not left.max() <= rounding:
        worst = free[int(np.argmax(left))]
        unit = "N" if model.robot.slides(model.coordinates[worst]) else "N*m"
        raise StudyError(
            f"configuration {configuration.name}: {model.coordinates[worst]} finds no rest under gravity, "
            f"{torque[worst]:.3g} {unit} stay unbalanced after {MAX_STEPS} Newton steps; its springs are too soft for "
            "the weight they carry, or the joint has no spring"
        )


def _check_closed(model: ElasticModel, configuration: Configuration, phi: FloatArray) -> None:
    if np.abs(phi).max(initial=0.0) > MAX_GAP:
        raise StudyError(
            f"configuration {configuration.name}: the loops of robot {model.robot.name} stay open by "
            f"{np.abs(phi).max():.3g} m at rest under gravity; its springs are too soft for the weight they carry"
        )


def _check_stable(
    model: ElasticModel, configuration: Configuration, free: IntArray, K: FloatArray, Phi: FloatArray
) -> None:
    Z = null_space(Phi[:, free])
    if not Z.size:
        return
    stiffness, modes = np.linalg.eigh(Z.T @ K[np.ix_(free, free)] @ Z)
    modes = Z @ modes
    if stiffness[0] < -1e-9 * np.abs(K).max():
        worst = free[int(np.argmax(np.abs(modes[:, 0])))]
        unit = "N/m" if model.robot.slides(model.coordinates[worst]) else "N*m/rad"
        raise StudyError(
            f"configuration {configuration.name}: {model.coordinates[worst]} tips over, springs and gravity together "
            f"have a stiffness of {stiffness[0]:.3g} {unit} there with the motors held; raise its stiffness, or let a "
            "joint without spring hang down"
        )


def _check_deflections(model: ElasticModel, configuration: Configuration, moved: FloatArray) -> None:
    for joint in model.robot.joints:
        place = f"joint {joint.name}"
        by = moved[model.index(place)]
        if joint.spring is not None and abs(by) > MAX_DEFLECTION:
            raise StudyError(
                f"configuration {configuration.name}: {place} tips over, it comes to rest {by:.3g} {joint.unit} from "
                "where its motor holds it; its springs are too soft for the weight they carry, raise their stiffness"
            )


def _check_inertia(model: ElasticModel, configuration: Configuration, M: FloatArray, Z: FloatArray) -> None:
    M = Z.T @ M @ Z
    scale = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
    eigenvalues, modes = np.linalg.eigh(M / np.outer(scale, scale))
    share = np.linalg.norm(Z @ modes[:, eigenvalues <= ROUNDING_INERTIA], axis=1)
    names = ", ".join(name for name, part in zip(model.coordinates, share, strict=True) if part > 0.1)
    if not names:
        return
    raise StudyError(
        f"configuration {configuration.name}: the mass matrix is singular, motion of {names} moves no inertia; give "
        "the bodies that it moves a mass off the joint's axis or an inertia about it"
    )


# Beyond b + FLANK e the flank of a gap has 95 % of its stiffness.
FLANK = 2.0


@frozen_value
class Preload:
    """The springs at rest, in the order of `joints`: deflection (rad, m), tangent (Nm/rad, N/m), (n_s,) each."""

    joints: tuple[str, ...]
    deflection: FloatArray
    tangent: FloatArray


def preloads(model: ElasticModel, theta: FloatArray, points: Sequence[OperatingPoint]) -> tuple[Preload, ...]:
    """The springs of a robot at each operating point; theta (n_theta,): model.parameters, SI."""
    q, symbols = ca.SX.sym("q", model.n_q), ca.SX.sym("theta", len(model.parameters))
    named = dict(zip(model.parameters, ca.vertsplit(symbols), strict=True))
    deflection, tangent = deflections(model.robot, q), tangents(model.robot, q, named)
    function = ca.Function("preload", [q, symbols], [ca.vertcat(*deflection.values()), ca.vertcat(*tangent.values())])
    at_points = (function(point.q, theta) for point in points)
    return tuple(Preload(tuple(deflection), x.full().ravel(), k.full().ravel()) for x, k in at_points)


def spring_notes(model: ElasticModel, theta: FloatArray, points: Sequence[OperatingPoint]) -> tuple[Note, ...]:
    """A note for each joint that rests inside its backlash or whose spring is unstable, with the configurations."""
    if all(joint.spring is None or joint.spring.is_linear for joint in model.robot.joints):
        return ()
    values = dict(zip(model.parameters, np.asarray(theta, dtype=float).tolist(), strict=True))
    names = [point.configuration.name for point in points]
    loads = preloads(model, theta, points)
    notes: list[Note] = []
    for i, joint in enumerate(loads[0].joints if loads else ()):
        x, k = (np.array([getattr(load, what)[i] for load in loads]) for what in ("deflection", "tangent"))
        notes += [*_in_the_gap(model, joint, values, names, x, k), *_unstable(model, joint, names, x, k)]
    return tuple(notes)


def _in_the_gap(
    model: ElasticModel, joint: str, values: dict[str, float], names: list[str], x: FloatArray, k: FloatArray
) -> Iterator[Note]:
    b = values.get(f"b_{joint}", 0.0)
    e = values.get(f"e_{joint}", 0.0) * b
    inside = np.flatnonzero(np.abs(x) < b + FLANK * e)
    if inside.size:
        unit = model.robot.parameters()[f"b_{joint}"][1]
        found = ", ".join(f"{names[i]} (deflected by {x[i]:.2g} {unit})" for i in inside)
        share = k[inside] / values[f"k_{joint}"]
        yield (
            Note(
                "inside-backlash",
                f"joint {joint} rests inside its backlash of +-{b:.2g} {unit} in {found}: the response depends on the "
                f"amplitude there, and the stiffness of {share.min():.0%} to {share.max():.0%} of k_{joint} that the "
                "model has at rest describes none; take configurations in which gravity presses the joint onto one "
                "flank, or leave these out",
            )
        )


def _unstable(model: ElasticModel, joint: str, names: list[str], x: FloatArray, k: FloatArray) -> Iterator[Note]:
    unit = model.robot.parameters()[f"k_{joint}"][1]
    for i in np.flatnonzero(k < 0):
        yield (
            Note(
                "unstable-spring",
                f"the spring of joint {joint} is unstable in {names[i]}: deflected by {x[i]:.2g} it pulls further, "
                f"with {k[i]:.3g} {unit}; bound its quadratic terms so that quadratic^2 < 3 k cubic",
            )
        )
