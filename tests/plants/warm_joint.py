"""A joint in closed loop whose friction warms up, simulated: what a filter is held against."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction.dynamic import Bristle
from elastid.friction.static import Curve
from elastid.friction_study.extended_kalman_filter import FollowedJoint, JointSamples
from elastid.model.formulation import ElasticJoint
from elastid.simulation.dynamics import runge_kutta_step

RATE_HZ = 1000.0
COUNT = 2 * np.pi / 2**16
TORQUE_STD = 0.05
COULOMB, STICTION_RATIO, STRIBECK_VELOCITY, VISCOUS = 1.0, 1.4, 3.0, 8e-3
SIGMA_0, SIGMA_1 = 250.0, 0.8
JOINT = ElasticJoint(motor_inertia=8e-3, link_inertia=12e-3, stiffness=47.0, damping=0.05)
# A PI velocity and P position controller.
K_P, K_V, K_I = 12.0, 0.5, 6.0

FOLLOWED = FollowedJoint(
    motor_inertia=JOINT.motor_inertia,
    link_inertia=JOINT.link_inertia,
    stiffness=JOINT.stiffness,
    damping=JOINT.damping,
    coulomb=COULOMB,
    viscous=VISCOUS,
    stiction_ratio=STICTION_RATIO,
    stribeck_velocity=STRIBECK_VELOCITY,
    bristle_stiffness=SIGMA_0,
    bristle_damping=SIGMA_1,
)


@dataclass(frozen=True)
class WarmRun:
    """What a filter is given, and the true numbers: F_c, f, friction torque, motor velocity (n,)."""

    samples: JointSamples
    coulomb: FloatArray
    viscous: FloatArray
    friction: FloatArray
    velocity: FloatArray


def simulate(reference: FloatArray, seed: int, offset: float = 0.1, stiction_ratio: float = STICTION_RATIO) -> WarmRun:
    """A motor that follows a velocity (n,), rad/s; friction falls while it warms up, gravity is off by `offset`."""
    n = len(reference)
    rng = np.random.default_rng(seed)
    time = np.arange(n) / RATE_HZ
    warmth = 1 - np.exp(-time / 20)
    coulomb, viscous = COULOMB * (1 - 0.15 * warmth), VISCOUS * (1 - 0.5 * warmth)
    noise = TORQUE_STD * rng.standard_normal(n)
    run = _loop(stiction_ratio, n)(
        np.zeros(6), reference[None, :], np.cumsum(reference)[None, :] / RATE_HZ, coulomb[None, :], viscous[None, :],
        noise[None, :], np.full((1, n), offset),
    )  # fmt: skip
    states, torque, friction = (part.full() for part in run)
    angle = np.round(states[0] / COUNT) * COUNT
    return WarmRun(JointSamples(torque.ravel(), np.zeros(n), angle), coulomb, viscous, friction.ravel(), states[1])


def stops_and_moves(seconds: float) -> FloatArray:
    """Pick and place: moves there and back of 60 rad/s, between stops of two seconds."""
    move = np.concatenate([np.linspace(0, 60, 300), np.full(400, 60.0), np.linspace(60, 0, 300), np.zeros(2000)])
    cycle = np.concatenate([move, -move])
    return np.resize(cycle, int(seconds * RATE_HZ))


def rich(seconds: float) -> FloatArray:
    """Reversals at many speeds."""
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    return 30 * np.sin(2 * np.pi * 0.7 * t) + 20 * np.sin(2 * np.pi * 0.23 * t + 1) + 8 * np.sin(2 * np.pi * 2.1 * t)


def _loop(stiction_ratio: float, n: int) -> ca.Function:
    """(x (5 + integral,), velocity, position, F_c, f, noise, offset) -> states, logged torque, friction."""
    step = _step(stiction_ratio)
    x = ca.SX.sym("x", 6)
    v_r, q_r, F_c, f, noise, offset = (ca.SX.sym(name) for name in ("v_r", "q_r", "F_c", "f", "noise", "offset"))
    error = v_r + K_P * (q_r - x[0]) - x[1]
    torque = K_V * error + K_I * x[5]
    following, friction = step(x[:5], torque + noise, F_c, f, offset)
    state = ca.vertcat(following, x[5] + error / RATE_HZ)
    one = ca.Function("one", [x, v_r, q_r, F_c, f, noise, offset], [state, torque, friction])
    return one.mapaccum("loop", n, 1)


def _step(stiction_ratio: float) -> ca.Function:
    """One sample with a load torque at the link, in four Runge-Kutta steps; the friction torque at its end."""
    x, u, F_c, f, offset = ca.SX.sym("x", 5), ca.SX.sym("u"), ca.SX.sym("F_c"), ca.SX.sym("f"), ca.SX.sym("offset")
    law, curve = Bristle(SIGMA_0, SIGMA_1), Curve(F_c, stiction_ratio * F_c, 1 / STRIBECK_VELOCITY)

    def acceleration(q: ca.SX, v: ca.SX, z: ca.SX, torque: ca.SX) -> ca.SX:
        spring = JOINT.stiffness * (q[0] - q[1]) + JOINT.damping * (v[0] - v[1])
        motor = torque - law.torque(v[0], z, curve) - f * v[0] - spring
        return ca.vertcat(motor / JOINT.motor_inertia, (spring - offset) / JOINT.link_inertia)

    def advanced(z: ca.SX, v: ca.SX, dt: float) -> ca.SX:
        return law.advanced(v[0], z, curve, dt)

    q, v, z = ca.vertcat(x[0], x[2]), ca.vertcat(x[1], x[3]), x[4]
    for _ in range(4):
        q, v, z = runge_kutta_step(acceleration, advanced, q, v, z, [u] * 4, 1 / RATE_HZ / 4)
    friction = law.torque(v[0], z, curve) + f * v[0]
    return ca.Function("sample", [x, u, F_c, f, offset], [ca.vertcat(q[0], v[0], q[1], v[1], z), friction])
