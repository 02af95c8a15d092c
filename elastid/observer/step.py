r"""One sample of an extended Kalman filter, as a CasADi function.

.. math::
   x^- = a(x, u, g), \quad P^- = F P F^T + Q, \qquad
   K = P^- h / S, \quad S = h^T P^- h + R, \quad e = y - h^T x^-, \\
   x^+ = x^- + K e, \qquad P^+ = (I - K h^T) P^- (I - K h^T)^T + K R K^T

with F the Jacobian of a and h that of the measured angle; the update is Joseph's, which keeps P positive. Q has the
noise of the torques, through the step's own Jacobian, the drift of what is followed, and the slip of the bristle:
(slip z_s)^2 l e^-l, l = |v| T_s / z_s, z_s = F_c / sigma_0: a joint that creeps does not take its bristle for certain,
while one that slides by more than z_s in a sample has it at its end.
"""

from __future__ import annotations

import casadi as ca

from elastid.observer.joint import FollowedJoint


def filter_step(joint: FollowedJoint, rate_hz: float) -> ca.Function:
    """(x (n,), P (n, n), u, g, y, noise (5 + n_followed,)) -> (x, P, innovation e, its variance S).

    u, g: torque of the motor and of the load, held from the sample before.  y: angle now.  noise: FilterNoise.vector.
    """
    names = joint.states
    n = len(names)
    x, P = ca.SX.sym("x", n), ca.SX.sym("P", n, n)
    u, g, y = ca.SX.sym("u"), ca.SX.sym("g"), ca.SX.sym("y")
    noise = ca.SX.sym("noise", 5 + len(joint.followed))
    predicted = joint.step(rate_hz)(x, u, g)
    F = ca.jacobian(predicted, x)
    spread = _symmetric(F @ _symmetric(P) @ F.T + _process_noise(joint, rate_hz, predicted, x, u, g, noise))
    S = spread[0, 0] + noise[0]
    gain = spread[:, 0] / S
    e = y - predicted[0]
    kept = ca.SX.eye(n)
    kept[:, 0] -= gain
    joseph = _symmetric(kept @ spread @ kept.T + noise[0] * gain @ gain.T)
    return ca.Function(
        "filter_step",
        [x, P, u, g, y, noise],
        [predicted + gain * e, joseph, e, S],
        ["x", "P", "u", "g", "y", "noise"],
        ["x_next", "P_next", "innovation", "variance"],
        {"cse": True},
    )


def _process_noise(
    joint: FollowedJoint, rate_hz: float, predicted: ca.SX, x: ca.SX, u: ca.SX, g: ca.SX, noise: ca.SX
) -> ca.SX:
    """Q (n, n)."""
    names = joint.states
    by_u, by_g = ca.jacobian(predicted, u), ca.jacobian(predicted, g)
    coulomb = ca.exp(x[names.index("Fc")]) if "Fc" in names else joint.coulomb
    z_s = coulomb / joint.bristle_stiffness
    slipped = ca.fabs(x[names.index("v_m")]) / rate_hz / z_s
    own = ca.SX.zeros(len(names))
    own[names.index("z")] = noise[4] * z_s**2 * slipped * ca.exp(-slipped)
    if "w" in names:
        own[names.index("w")] = noise[2]
    for i, name in enumerate(joint.followed):
        own[names.index(name)] = noise[5 + i]
    return noise[1] * by_u @ by_u.T + noise[3] * by_g @ by_g.T + ca.diag(own)


def _symmetric(A: ca.SX) -> ca.SX:
    """The lower triangle and its mirror, so that half of the entries are computed."""
    return ca.tril2symm(ca.tril(A))
