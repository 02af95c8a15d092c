r"""Period model: the linear model of a configuration on all lines of its periods, and the arm's nonlinear torques.

.. math:: Z(s)\, q = B u - \sum_i f_i P_i \Phi_i, \qquad Z = s^2 M + s D + K, \qquad H = Z^{-1}

P_i: row of the motor angle, the link angle or the gear deflection in the model's coordinates. Along the measured
motion, a rigid arm has the torques

.. math:: \tau(\delta) = Z^T [M(q)\, \ddot q + f(q, \dot q)], \quad \varphi(q) = 0, \quad \dot q = Z \dot\delta, \qquad
          \tau_g = \tau(\delta) - \tau(0) - \left.\frac{d \tau(h \delta)}{d h}\right|_{h = 0}

tau_g is distortion of second and third order in the motion delta of the joints, also with linear springs. During a
superimposed slow motion it resembles a transmission error, which is a function of the angle, too. Z (n_q, n): motors
move with their joints, and passive joints follow the loops, whose forces do no work along Z. The result is therefore
the same in every formulation of a robot with loops.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import StudyError
from elastid.fit.problem.frf_residuals import kernel_of, linear_model
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import TORQUE_LAG, LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import factor, zoh_aliases
from elastid.model.closed_posture import open_loops
from elastid.model.drivetrain import input_matrix, spring_deflections
from elastid.model.formulation import formulate
from elastid.nonlinear.basis_functions import Place
from elastid.nonlinear.period_lines import PeriodLines
from elastid.parameters import DELAY, Parameters
from elastid.record import MOTION_ORDER, Configuration
from elastid.response import Response
from elastid.robot import Robot
from elastid.simulation.controller import feed_forward

TORQUE_BAND = 2  # highest line of the torques over the highest line of the motion


@dataclass(frozen=True, eq=False)
class DriveLines:
    """Linear model of a configuration: H (F, n, n), C (n_u, n) of the motor angles, G (F, n_u, n_u) of logged signals.

    command (F, n_u): acting over logged torque.  sensor (F, n_u): logged over true angle.  aliases (F, n_u, n_u):
    aliases of the zero-order hold, G - sensor C H B command.  joints (n_j,): driven joints.  ratios (n_j,): motor turns
    per joint turn.  places: rows (n_j, n) of motors, gears and links.  k, d, torque (n_j,): stiffness, damping and
    static torque of the gears; 1, 0, 0 for a gear without a spring of its own.  chain (P, n_x): d theta / d x of
    `kernel.parameters`.
    """

    model: LinearModel
    kernel: Kernel
    theta: FloatArray
    H: ComplexArray
    C: FloatArray
    B: FloatArray
    G: ComplexArray
    aliases: ComplexArray
    command: ComplexArray
    sensor: ComplexArray
    joints: tuple[str, ...]
    ratios: FloatArray
    places: dict[Place, FloatArray]
    k: FloatArray
    d: FloatArray
    torque: FloatArray
    chain: FloatArray

    def directions(self, place: Place, joint: int) -> FloatArray:
        """Return the row (n,) of a location at a joint (index)."""
        return np.asarray(self.places[place][joint])

    def motion(self, place: Place, joint: int, U: ComplexArray) -> ComplexArray:
        """Return the motion (F, M) of a location by the logged torques U (F, n_u, M) in the linear model."""
        q = self.H @ (self.B @ (self.command[:, :, None] * U))
        return np.tensordot(self.directions(place, joint), q, axes=(0, 1))

    def motor_row(self, joint: int) -> FloatArray:
        """Return the row (n_u,) of a motor angle in the logged angles."""
        return self.directions("motor", joint) @ np.linalg.pinv(self.C)


def elastic_joints(linearisation: Linearisation) -> tuple[str, ...]:
    """Return the names of the driven joints with a spring of their own in the gear."""
    springs = spring_deflections(linearisation.model.robot)
    return tuple(joint.name for joint in linearisation.model.robot.driven if f"k_{joint.name}" in springs)


def drive_lines(
    lines: PeriodLines, linearisation: Linearisation, response: Response, parameters: Parameters, x: FloatArray
) -> DriveLines:
    """Return the model at x (n_x,) on all lines of a period.

    response: fitted response of the same configuration, with all motors as inputs.
    """
    robot, name = linearisation.model.robot, lines.configuration.name
    theta = parameters.expand(x, name)
    motors = [response.outputs.index(location) for location in response.inputs]
    model = linear_model(linearisation, response, theta)
    kernel = kernel_of(model.with_outputs(motors), parameters, lines.freq_hz)
    M, D, K = model.matrices(theta)
    s = lines.s[:, None, None]
    H = np.asarray(np.linalg.inv(s**2 * M + s * D + K), np.complex128)
    C = model.with_outputs(motors).C
    output_factors, input_factors = kernel.model.channel_factors(theta, lines.s.astype(np.complex128))
    order = MOTION_ORDER[model.quantity]

    elements = (element for element in kernel.model.chain if element.name != TORQUE_LAG)
    lags = (element.response(lines.s, kernel.model.number(theta, element.name)) for element in elements)
    lag = np.prod([np.ones(len(lines.s), complex), *lags], axis=0)  # of the sensors
    sensor = lag[:, None] * output_factors
    command = (factor(kernel.model, theta, lines.s) / lines.s**order / lag)[:, None] * input_factors
    aliases = zoh_aliases(kernel.model, theta, lines.freq_hz) / s**order
    G = kernel.response(theta) / s**order + aliases
    springs, driven = spring_deflections(robot), robot.driven_names
    ratios = np.array([robot.ratio(joint) for joint in driven])
    rows: dict[Place, FloatArray] = {
        "motor": robot.mixing @ input_matrix(robot).T,
        "gear": np.array([springs.get(f"k_{joint}", np.zeros(len(model.Z))) for joint in driven]),
        "link": np.eye(len(model.Z))[list(robot.driven_indices)],
    }
    numbers = dict(zip(model.parameters, theta, strict=True))
    k, d = (
        np.array([numbers[f"{letter}_{joint}"] if f"k_{joint}" in springs else without for joint in driven])
        for letter, without in (("k", 1.0), ("d", 0.0))
    )
    point = equilibrium(linearisation.model, theta[: -1 if DELAY in model.parameters else None], lines.configuration)
    rows_of = {location: row @ model.Z for location, row in rows.items()}
    chain = parameters.jacobian(x, name)[kernel.places]
    joint_numbers = driven, ratios, rows_of, k, d, k * (rows["gear"] @ point.q)
    return DriveLines(model, kernel, theta, H, C, model.B, G, aliases, command, sensor, *joint_numbers, chain)


def geometric_torques(robot: Robot, point: Configuration, motion: ComplexArray, s: ComplexArray) -> ComplexArray:
    """Return tau_g (F + 1, n, M) of the driven joints, its mean and lines s (F,), by their motion (F, n, M).

    Masses and lengths are nominal values.  Raises StudyError if the loops do not close along the motion.
    """
    robot, (F, n, M) = robot.carrying(point.has_payload), motion.shape
    model = formulate(robot)
    q0 = equilibrium(model, model.theta, point).q
    states = [_signals(motion * s[:, None, None] ** order).T for order in range(3)]
    if gap := open_loops(robot, model.B.T @ q0 + states[0]):
        raise StudyError(
            "robot/loops",
            f"the loops of robot {robot.name} stay open by {gap:.2g} m along the motion of the records, so the "
            "distortion by its arm is unknown. Check the lengths of its loops, and the angles of configurations",
        )

    def tau(fraction: float) -> FloatArray:
        return feed_forward(model, q0, *(fraction * x for x in states)).T

    h = 1e-3
    distortion = (tau(1.0) - (tau(h) - tau(-h)) / (2 * h) - tau(0.0)).reshape(n, -1, M)
    line_weights = np.where(np.arange(F + 1) == 0, 1, 2)[:, None, None] / distortion.shape[1]
    return rfft(distortion, axis=1)[:, : F + 1].swapaxes(0, 1) * line_weights


def without_arm(lines: PeriodLines, drive: DriveLines, robot: Robot) -> PeriodLines:
    """Return lines with the torques tau_g of the arm, and without the motion of the angles by these torques.

    Torques tau_g at the links, and torques at the motors that explain the remaining measured angles, move the joints
    of the model `drive`.
    """
    top = int(np.flatnonzero(lines.excited)[-1]) + 1
    n_lines = min(TORQUE_BAND * top, len(lines.s))
    H, links, sensor = drive.H[:n_lines], drive.places["link"], drive.sensor[:n_lines, :, None]
    angle_map = links @ H @ drive.B @ np.linalg.inv(drive.C @ H @ drive.B)
    Y, arm = lines.Y.copy(), np.zeros((len(lines.s) + 1, len(links), lines.Y.shape[2]), complex)
    for _ in range(3):  # fixed-point iteration: motion and torques depend on each other
        motion = angle_map @ (Y[:n_lines] / sensor) - links @ H @ links.T @ arm[1 : n_lines + 1]
        motion[top:] = 0.0
        arm[: n_lines + 1] = geometric_torques(robot, lines.configuration, motion, lines.s[:n_lines])
        Y[:n_lines] = lines.Y[:n_lines] + sensor * (drive.C @ H @ links.T @ arm[1 : n_lines + 1])
    return replace(lines, Y=Y, arm=arm)


def _signals(X: ComplexArray) -> FloatArray:
    """Return signals (n, N M) of amplitudes X (F, n, M) of lines 1 to F.

    N = 8 (F + 1): products of three signals have no aliases on these lines.
    """
    F, n, M = X.shape
    N = 8 * (F + 1)
    spectrum = np.zeros((N // 2 + 1, n, M), complex)
    spectrum[1 : F + 1] = X
    return np.asarray((irfft(spectrum, N, axis=0) * (N / 2)).swapaxes(0, 1).reshape(n, -1))
