r"""Closed-loop responses of motions to references: sampled joint controllers around the responses to torques.

.. math:: T = Y S C_{ff}, \quad S = (I + C_{fb} P)^{-1}, \quad Y = H (G_y + aliases), \quad
          P = H (G_m + aliases)

G_y, G_m: outputs and motor angles by torques, with aliases of the hold H of the controllers, which make P the exact
pulse response. C_fb, C_ff: diagonal feedback and feedforward. Derivatives have the same factors as those of G,

.. math:: dT = (dG_y - L\, dG_m)\, A, \qquad L = Y S C_{fb}, \qquad A = H S C_{ff}

and to the gain g of a motor j, :math:`dT = (Y S)_{:j} (dC_{ff,j} e_j^T - dC_{fb,j} (P S C_{ff})_{j:})`.
"""

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable
from elastid.linear.linear_model import TORQUE_LAG, LinearModel
from elastid.record import ReferenceLoop, ZohTorque, zero_order_hold
from elastid.robot import channel_name

GAINS = ("kp", "kd")  # as in gain_kp_motor_1


def open_loops(model: LinearModel) -> tuple[LinearModel, LinearModel]:
    """Return the models from motor torques of `model.controller` to its outputs, and to the angles of its motors."""
    loop = model.controller
    assert loop is not None  # of models whose inputs are references
    plain = replace(model.by_torques, channel_numbers=())
    slopes = {name: replace(slope, C=None, T=None, B=None) for name, slope in model.slopes.items()}
    motors = replace(
        plain, C=model.B.T, T=np.zeros_like(model.B.T), outputs=loop.motors, quantity="position", slopes=slopes,
        chain=tuple(element for element in model.chain if element.name == TORQUE_LAG),
        hold=ZohTorque((loop.rate_hz,) * len(loop.motors), (True,) * len(loop.motors)),
    )  # fmt: skip
    return plain, motors


def close_loop(
    model: LinearModel, theta: FloatArray, freq_hz: FloatArray, plain: ComplexArray, motors: ComplexArray,
    plain_aliases: ComplexArray | float = 0.0, motor_aliases: ComplexArray | float = 0.0,
) -> "ClosedLoop":  # fmt: skip
    """Close the loops around the responses of `open_loops` at freq_hz (F,).

    plain_aliases, motor_aliases: aliases of G_y and G_m, 0 if the responses include them.
    """
    assert model.controller is not None
    loop, names = model.controller.at(freq_hz), model.controller.motors
    H = zero_order_hold(freq_hz / loop.rate_hz)[:, None, None]
    of_outputs, of_inputs = model.channel_factors(theta, laplace_variable(freq_hz))
    gains = [[channel_name("gain", role, motor) for motor in names] for role in GAINS]
    numbers = np.array([[model.number(theta, n) if n in model.channel_numbers else 1.0 for n in row] for row in gains])
    feedback, feedforward = (np.einsum("gm,gfm->fm", numbers, C) for C in (loop.feedback, loop.feedforward))
    plain, plain_aliases = (of_outputs[..., :, None] * factor for factor in (plain, plain_aliases))
    Y, P = H * (plain + plain_aliases), H * (motors + motor_aliases)
    S = np.linalg.inv(np.eye(len(names)) + feedback[:, :, None] * P)
    columns = [names.index(motor) for motor in model.driven]
    driven, by_torque = (S * feedforward[:, None, :])[:, :, columns] * of_inputs[..., None, :], Y @ S
    entering = loop.feedforward[:, :, columns] * of_inputs
    responses = plain, motors, Y @ driven, by_torque * feedback[:, None, :], H * driven
    return ClosedLoop(loop, columns, *responses, by_torque, P @ driven, entering)


@dataclass(frozen=True)
class ClosedLoop:
    """T (F, n_y, n_r) of a block of lines with the factors of its derivatives, including channel errors.

    plain (F, n_y, n_m), motors (F, n_m, n_m): G_y and G_m without hold and aliases.  L (F, n_y, n_m), A (F, n_m, n_r).
    by_torque (F, n_y, n_m): Y S.  motion (F, n_m, n_r): of the motors.  loop: at these lines.  columns (n_r,): motors
    of the references.  entering (2, F, n_r): contributions of k_p and k_d to C_ff.
    """

    loop: ReferenceLoop
    columns: list[int]
    plain: ComplexArray
    motors: ComplexArray
    T: ComplexArray
    L: ComplexArray
    A: ComplexArray
    by_torque: ComplexArray
    motion: ComplexArray
    entering: ComplexArray

    def change(self, plain: ComplexArray, motors: ComplexArray) -> ComplexArray:
        """Return dT (F, n_y, n_r) caused by changes of G_y (F, n_y, n_m), channels included, and G_m (F, n_m, n_m)."""
        return (plain - self.L @ motors) @ self.A

    def of_gain(self, gain: int, motor: str) -> ComplexArray:
        """Return dT by the factor of a gain, 0 of k_p and 1 of k_d, of the loop of a motor."""
        j = self.loop.motors.index(motor)
        is_column = np.array(self.columns) == j
        torque = is_column * self.entering[gain] - self.loop.feedback[gain, :, j, None] * self.motion[:, j]
        return np.asarray(self.by_torque[:, :, j, None] * torque[:, None, :])
