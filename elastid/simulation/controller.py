r"""The sampled joint controller that keeps the robot in its configuration or on a slow movement, and its filters.

.. math:: u_k = u_{ff,k} + e_k + k_i T_s \sum_{j<k} e_j + r_k, \qquad
          e_k = k_p (q_{ref,k} - y_k) + k_d (\dot q_{ref,k} - (y_k - y_{k-1}) / T_s)

y: reading of the motor encoder, u_ff: torque of the rigid robot on its reference, r: the injected multisine. u_k is
computed from the reading of the same sample and held until the next: there is no delay but that of the hold. With k_i
this is the cascade of robot controllers: a proportional loop of position, k_p / k_d, around a loop of velocity with
proportional gain k_d and integral time 1 / k_i. Filters may follow the feedback, e with its integral.

Filters behind the feedback of each motor: notches, a low pass, and the samples that computing takes.

.. math:: N(s) = \frac{s^2 + d\, w\, \omega s + \omega^2}{s^2 + w\, \omega s + \omega^2}, \qquad
          L(s) = \frac{\omega^2}{s^2 + \sqrt{2}\, \omega s + \omega^2}, \qquad
          s = \frac{\omega}{\tan(\omega T_s / 2)}\, \frac{1 - z^{-1}}{1 + z^{-1}}

each by Tustin's rule, exact at its own frequency omega; d: gain that a notch leaves there, w: its width between -3 dB
points over omega, of a notch with d = 0.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import StudyError
from elastid.excitation.spec import Injected
from elastid.model.closed_posture import follow_angles, rates
from elastid.model.elastic import ElasticModel
from elastid.record import JointLoop, unit_delay
from elastid.simulation.reference_path import ReferencePath
from elastid.simulation.spec import ControllerSpec, GainsSpec


def gains_of(model: ElasticModel, q: FloatArray, controller: ControllerSpec) -> JointLoop:
    """Return gains of a controller, or gains for its bandwidth in q (n_q,)."""
    if controller.gains is not None:
        return loop_of(controller.gains, model.n_u)
    return tune(model, q, controller.bandwidth_hz, controller.damping_ratio, controller.velocity_integral_time)


def loop_of(gains: GainsSpec, n_u: int) -> JointLoop:
    """Return loop of each of n_u motors with stated gains."""
    position, kd = (np.broadcast_to(gain, n_u) for gain in (gains.position_gain, gains.velocity_gain))
    ki = 0.0 if gains.integral_time is None else 1 / np.asarray(gains.integral_time)
    return JointLoop(position * kd, np.asarray(kd, float), np.broadcast_to(ki, n_u))


def filters_of(joints: Sequence[str], controller: ControllerSpec, rate_hz: float) -> "Filters | None":
    """Return filters behind the feedback of the driven joints; None without any."""
    gains = controller.gains
    sections: dict[str, list[FloatArray]] = {joint: [] for joint in joints}
    if gains is not None:
        for spec in gains.notches:
            sections[spec.joint].append(notch(spec.freq_hz, spec.width, spec.depth, rate_hz))
        corners = () if gains.low_pass_hz is None else np.broadcast_to(gains.low_pass_hz, len(joints))
        for joint, corner in zip(joints, corners, strict=False):
            sections[joint].append(low_pass(corner, rate_hz))
    if not controller.delay_samples and not any(sections.values()):
        return None
    return Filters(tuple(sections.values()), controller.delay_samples)


def feedback_of(loop: JointLoop, inject: Injected) -> JointLoop:
    """Return the gains of the feedback, without k_p if velocities are injected."""
    return replace(loop, kp=0 * loop.kp) if inject == "velocity" else loop


def sampled_responses(
    joints: Sequence[str], loop: JointLoop, controller: ControllerSpec, freq_hz: FloatArray, rate_hz: float,
    inject: Injected = "torque",
) -> tuple[ComplexArray, ComplexArray]:  # fmt: skip
    r"""Compute C_fb and C_ff F_r (F, n_u) of a controller at freq_hz (F,), whose torque is C_ff F_r x - C_fb y.

    .. math:: C_{fb} = H\, (k_p + k_d s')(1 + k_i I), \qquad C_{ff} = H\, (k_p + \alpha\, k_d s')(1 + k_i I)

    with s' and I of the sampled loop (`JointLoop.response`), H of the filters, alpha the velocity feedforward.  x: the
    injected positions in rad, velocities in rad/s (C_ff = H k_d (1 + k_i I)), or torques in Nm (1), link side.
    """
    filters, delay = filters_of(joints, controller, rate_hz), unit_delay(freq_hz, rate_hz)
    H = 1.0 if filters is None else filters.response(delay)
    C_fb = H * feedback_of(loop, inject).response(delay, rate_hz)
    if inject == "torque":
        return C_fb, np.ones_like(C_fb)
    if (spec := controller.reference) is None:
        text = f"inject: {inject} needs the path of the references into the controller; give at least its cycle"
        raise StudyError("experiment/simulated", text, "experiment.simulated.controller.reference")
    alpha, F_r = spec.velocity_feedforward, ReferencePath(spec, rate_hz).response(freq_hz)[:, None]
    forward = JointLoop(loop.kd, 0 * loop.kd, loop.ki) if inject == "velocity" else replace(loop, kd=alpha * loop.kd)
    return C_fb, H * forward.response(delay, rate_hz) * F_r


def rigid_motion(model: ElasticModel, q: FloatArray) -> FloatArray:
    """Compute T (n_q, n_u) or (n, n_q, n_u) with q' = T q_a': motion of the rigid robot.

    q (n_q,) or (n, n_q).  Motor and joint move together, passive joints as their loops require.
    """
    n_l = model.robot.n_l
    T = np.array(np.broadcast_to(model.B, (*q.shape[:-1], *model.B.shape)))
    T[..., :n_l, :] = rates(model.robot, np.atleast_2d(q)[:, :n_l]).reshape(*q.shape[:-1], n_l, model.n_u)
    return T


def rigid_path(model: ElasticModel, q0: FloatArray, start: FloatArray, position: FloatArray) -> FloatArray:
    """Compute q (n, n_q) of the rigid robot from equilibrium q0, motors at `start` (n_u,), to `position` (n, n_u)."""
    n_l = model.robot.n_l
    angles = np.vstack([start, position])
    q = np.zeros((len(angles), model.n_q))
    q[:, :n_l] = follow_angles(model.robot, angles, start)
    q[:, [model.index(location) for location in model.inputs]] = angles
    return np.asarray(q0 + q[1:] - q[0])


def tune(
    model: ElasticModel, q: FloatArray, bandwidth_hz: float, damping_ratio: float, integral_time: float | None = None
) -> JointLoop:
    """Compute gains that give each axis of the rigid robot this bandwidth and damping ratio in q (n_q,).

    kp = J omega^2, kd = 2 zeta omega J with J = diag(T^T M(q) T), links and motor together.  integral_time: of the
    velocity loop of a cascade, in s; without it there is no integral.
    """
    T = rigid_motion(model, q)
    inertia = np.diag(T.T @ model.mass(q, model.theta).full() @ T)
    omega = 2 * np.pi * bandwidth_hz
    ki = np.full(model.n_u, 0.0 if integral_time is None else 1 / integral_time)
    return JointLoop(inertia * omega**2, 2 * damping_ratio * omega * inertia, ki)


def feed_forward(
    model: ElasticModel, q0: FloatArray, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Compute the torque (n, n_u) of the rigid robot, u = T^T [M (T q_a'' + T' q_a') + f(q, T q_a')].

    position, velocity, acceleration (n, n_u): q_a and its derivatives, about the equilibrium q0 (n_q,). At rest in the
    equilibrium this is the holding torque, since T^T B = 1. Springs and the forces in loops are internal and do not
    enter; viscous friction does.
    """
    start = model.B.T @ q0
    path = rigid_path(model, q0, start, start + position)
    T, v_path, a_path = rigid_rates(model, path, velocity, acceleration)
    forces = _inverse_dynamics(model).map(len(position))(path.T, v_path.T, a_path.T).full().T
    return np.asarray((np.swapaxes(T, 1, 2) @ forces[:, :, None])[:, :, 0])


def rigid_rates(
    model: ElasticModel, q: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute T (n, n_q, n_u), q' and q'' (n, n_q) of the rigid robot at q (n, n_q) from its motors' (n, n_u)."""
    T = rigid_motion(model, q)
    v, a = ((T @ rate[:, :, None])[:, :, 0] for rate in (velocity, acceleration))
    if model.robot.loops:
        step_s = 1e-4  # of the central difference
        q_before, q_after = (rigid_motion(model, q + sign * step_s * v) for sign in (-1, 1))
        a += ((q_after - q_before) / (2 * step_s) @ velocity[:, :, None])[:, :, 0]
    return T, v, a


@lru_cache(maxsize=4)
def _inverse_dynamics(model: ElasticModel) -> ca.Function:
    """Build (q, v, a) -> M(q) a + f(q, v), built once in a process."""
    q, v, a = model.symbols("q", "v", "a")
    return ca.Function("inverse_dynamics", [q, v, a], [model.mass(q, model.theta) @ a + model.force(q, v, model.theta)])


def notch(freq_hz: float, width: float, depth: float, rate_hz: float) -> FloatArray:
    """Design section (6,), numerator before denominator in z^-1, of a notch N."""
    omega = 2 * np.pi * freq_hz
    return _discretise((1.0, depth * width * omega, omega**2), (1.0, width * omega, omega**2), omega, rate_hz)


def low_pass(freq_hz: float, rate_hz: float) -> FloatArray:
    """Design section (6,), numerator before denominator in z^-1, of a Butterworth filter L of second order."""
    omega = 2 * np.pi * freq_hz
    return _discretise((0.0, 0.0, omega**2), (1.0, math.sqrt(2) * omega, omega**2), omega, rate_hz)


def _discretise(b: Sequence[float], a: Sequence[float], omega: float, rate_hz: float) -> FloatArray:
    """Design section (6,) of (b_0 s^2 + b_1 s + b_2) / (a_0 s^2 + a_1 s + a_2), exact at omega."""
    K = omega / math.tan(omega / (2 * rate_hz))
    section = [(p * K**2 + q * K + r, 2 * (r - p * K**2), p * K**2 - q * K + r) for p, q, r in (b, a)]
    return np.ravel(section) / section[1][0]


@dataclass(frozen=True, eq=False)
class Filters:
    """Second-order sections (6,) of each of n_u motors, as SciPy has them: numerator, denominator in powers of 1 / z.

    delay: samples after which their torque acts.
    """

    sections: tuple[Sequence[FloatArray], ...]
    delay: int = 0

    def response(self, z_inverse: ComplexArray) -> ComplexArray:
        """Compute H (..., n_u) at the frequencies of a `unit_delay` (...)."""
        H = np.repeat((z_inverse**self.delay)[..., None], len(self.sections), axis=-1)
        for j, chain in enumerate(self.sections):
            for b_0, b_1, b_2, a_0, a_1, a_2 in chain:
                above, below = b_0 + z_inverse * (b_1 + z_inverse * b_2), a_0 + z_inverse * (a_1 + z_inverse * a_2)
                H[..., j] *= above / below
        return H

    @property
    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A (n, n), B (n, n_u), C (n_u, n), D (n_u, n_u): x_(k+1) = A x_k + B e_k, u_k = C x_k + D e_k."""
        sizes, n_u = [2 * len(chain) + self.delay for chain in self.sections], len(self.sections)
        n = sum(sizes)
        A, B, C, D = np.zeros((n, n)), np.zeros((n, n_u)), np.zeros((n_u, n)), np.zeros((n_u, n_u))
        for j, (end, size, chain) in enumerate(zip(np.cumsum(sizes), sizes, self.sections, strict=True)):
            rows = slice(end - size, end)
            A[rows, rows], B[rows, j], C[j, rows], D[j, j] = self._of_motor(chain)
        return A, B, C, D

    def _of_motor(self, sections: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Realise a chain of sections in controller canonical form and of delays, each fed by the previous one."""
        n, D = 2 * len(sections) + self.delay, 1.0
        A, B, C = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        for i, section in zip(range(0, n, 2), sections, strict=False):
            b, a = section[:3] / section[3], section[3:] / section[3]
            A[i], B[i], A[i + 1, i] = C, D, 1.0
            A[i, i : i + 2] = -a[1:]
            C, D = b[0] * C, b[0] * D
            C[i : i + 2] = b[1:] - b[0] * a[1:]
        for i in range(2 * len(sections), n):
            A[i], B[i] = C, D
            C, D = np.eye(n)[i], 0.0
        return A, B, C, D
