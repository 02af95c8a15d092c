r"""Rest under gravity: the operating point of a configuration.

.. math:: \partial V / \partial q + \Phi^T \lambda = B u, \qquad \varphi(q) = 0, \qquad q_m = q_{m0}

The motors stand where they were measured; links and further elastic joints give way until springs, gravity and the
forces in the loops balance. Redundant constraints leave lambda open by what does no work; the least one is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.arrays import FloatArray, IntArray, frozen
from elastid.errors import StudyError
from elastid.model.elastic import ElasticModel
from elastid.model.parallel_linkage.assembly import assembled
from elastid.model.parallel_linkage.partition import motions, null_space
from elastid.record import Configuration

MAX_STEPS = 60
LARGEST_STEP = 0.3  # rad: a soft spring must not throw the arm onto another branch
SINGULAR = 1e-12  # smallest eigenvalue of M, scaled to a unit diagonal, that rounding cannot explain
CLOSED = 1e-9  # m or rad: what rounding may leave of a constraint
SMALLEST_STEP = 1e-12  # rad: convergence is quadratic, the error left is far below


@dataclass(frozen=True)
class OperatingPoint:
    """Coordinates q (n_q,), multipliers lambda_ (n_c,) and holding torques u (n_u,) at rest, link side."""

    configuration: Configuration
    q: FloatArray
    lambda_: FloatArray
    u: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("q", "lambda_", "u"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def equilibrium(model: ElasticModel, theta: FloatArray, configuration: Configuration) -> OperatingPoint:
    """Statics by Newton's method with the exact stiffness, from the posture that a rigid robot would have.

    theta (n_theta,): model.parameters, SI.  configuration.angles (n_u,): the motors' angles, link side.
    StudyError where the number of angles is wrong, a joint finds no rest, gives way under gravity or moves no inertia.
    """
    held = np.array([model.index(motor) for motor in model.inputs])
    free = np.setdiff1d(np.arange(model.n_q), held)
    q, lambda_ = rigid_posture(model, configuration), np.zeros(model.n_c)
    torque, K, phi, Phi = _balance(model, theta, q, lambda_)
    gravity = torque
    _check_finite(model, configuration, np.column_stack([torque, K]))
    for _ in range(MAX_STEPS):
        step, lambda_step = _newton(K[np.ix_(free, free)], Phi[:, free], torque[free], phi)
        largest = np.abs(step).max(initial=0.0)
        part = min(1.0, LARGEST_STEP / max(largest, SMALLEST_STEP))
        q[free] += part * step
        lambda_ += part * lambda_step
        torque, K, phi, Phi = _balance(model, theta, q, lambda_)
        if largest <= SMALLEST_STEP:
            break
    rounding = 1e-8 * np.abs(gravity).max() + 1e-12 * np.abs(K).max()
    _check_closed(model, configuration, phi)
    _check_rest(model, configuration, free, torque, rounding)
    _check_stable(model, configuration, free, K, Phi)
    Z = motions(model, Phi)
    _check_inertia(model, configuration, model.mass(q, theta).full(), Z)
    return OperatingPoint(configuration, q, lambda_, model.B.T @ torque)


def _balance(
    model: ElasticModel, theta: FloatArray, q: FloatArray, lambda_: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """What is left of dV/dq + Phi^T lambda (n_q,), its Jacobian K (n_q, n_q), phi (n_c,) and Phi (n_c, n_q)."""
    torque, K = model.potential_gradient(q, theta).full()[:, 0], model.stiffness(q, lambda_, theta).full()
    if not model.n_c:
        return torque, K, np.zeros(0), np.zeros((0, model.n_q))
    Phi = model.constraint_jacobian(q, theta).full()
    return torque + Phi.T @ lambda_, K, model.constraint(q, theta).full()[:, 0], Phi


def _newton(K: FloatArray, Phi: FloatArray, torque: FloatArray, phi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The step of q and lambda; the constraints scaled to the size of K.

    Least squares: a joint with neither spring nor gravity has no stiffness and stays where it is.
    """
    n, scale = len(K), np.abs(K).max(initial=0.0) if Phi.size else 1.0
    saddle = np.block([[K, scale * Phi.T], [scale * Phi, np.zeros((len(Phi), len(Phi)))]])
    step = np.linalg.lstsq(saddle, -np.concatenate([torque, scale * phi]))[0]
    return step[:n], scale * step[n:]


def rigid_posture(model: ElasticModel, configuration: Configuration) -> FloatArray:
    """q (n_q,) without deflection: driven joints at their motors' angles, elastic ones at 0, loops closed.

    StudyError where the configuration does not give one angle for each motor, or the loops do not close there.
    """
    if configuration.angles.shape != (model.n_u,):
        driven = ", ".join(joint.name for joint in model.robot.driven)
        raise StudyError(
            f"configuration {configuration.name}: {configuration.angles.size} angles are given, but robot "
            f"{model.robot.name} has {model.n_u} driven joints ({driven}); give one angle for each"
        )
    q = np.zeros(model.n_q)
    try:
        q[: len(model.robot.joints)] = assembled(model.robot, configuration.angles)
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
            "a parameter of the robot is not finite"
        )


def _check_rest(
    model: ElasticModel, configuration: Configuration, free: IntArray, torque: FloatArray, rounding: float
) -> None:
    left = np.abs(torque[free])
    if left.size and not left.max() <= rounding:
        worst = free[int(np.argmax(left))]
        raise StudyError(
            f"configuration {configuration.name}: {model.coordinates[worst]} finds no rest under gravity, "
            f"{torque[worst]:.3g} N*m stay unbalanced after {MAX_STEPS} Newton steps; its springs are too soft for the "
            "weight they carry, or the joint has no spring"
        )


def _check_closed(model: ElasticModel, configuration: Configuration, phi: FloatArray) -> None:
    if np.abs(phi).max(initial=0.0) > CLOSED:
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
        raise StudyError(
            f"configuration {configuration.name}: {model.coordinates[worst]} tips over, springs and gravity together "
            f"have a stiffness of {stiffness[0]:.3g} N*m/rad there with the motors held; raise its stiffness, or let a "
            "joint without spring hang down"
        )


def _check_inertia(model: ElasticModel, configuration: Configuration, M: FloatArray, Z: FloatArray) -> None:
    M = Z.T @ M @ Z
    scale = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
    eigenvalues, modes = np.linalg.eigh(M / np.outer(scale, scale))
    share = np.linalg.norm(Z @ modes[:, eigenvalues <= SINGULAR], axis=1)
    names = ", ".join(name for name, part in zip(model.coordinates, share, strict=True) if part > 0.1)
    if not names:
        return
    raise StudyError(
        f"configuration {configuration.name}: the mass matrix is singular, motion of {names} moves no inertia; give "
        "the bodies that it moves a mass off the joint's axis or an inertia about it"
    )
