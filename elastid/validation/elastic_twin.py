r"""The torque of a multisine, part by part: what the fitted model takes for the measured motion of the motors.

.. math:: \hat U = G_m^{-1} Y_m, \qquad G_m: \text{torques of the motors to their own motion}

of three models with the fitted numbers: springs left out and no viscous friction (rigid body), with springs (elasticity
is the difference), and with viscous friction (the same). Dry friction is what the estimator took out of the torque. At
the lines of the response, in the last period of the steady state, where this is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.fitted_robot import FittedRobot
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.record import Record
from elastid.robot import Robot
from elastid.robot.simplified import elastic_coordinates, stiffened
from elastid.validation.replay import last_period, settled_periods, signals_of
from elastid.validation.twin import DRY, ELASTICITY, RIGID_BODY, VISCOUS, TorqueBalance, torque_balance


@dataclass(frozen=True, eq=False)
class ModelParts:
    """Models of the motors' own motion in one configuration, each with its numbers (n_theta,).

    whole: as fitted.  frictionless: without viscous friction.  rigid: without springs either.
    """

    whole: tuple[LinearModel, FloatArray]
    frictionless: tuple[LinearModel, FloatArray]
    rigid: tuple[LinearModel, FloatArray]


def rigid_linearisation(fitted: FittedRobot, spec: ModelSpec = EXACT) -> Linearisation:
    """The fitted robot without its springs, to be linearised; StudyError where it cannot be without them."""
    names = [coordinate.name for coordinate in elastic_coordinates(fitted.robot)]
    return Linearisation.of_robot(stiffened(fitted.robot, names), spec, fitted.result.parameters.names)


def model_parts(fitted: FittedRobot, rigid: Linearisation, configuration: str) -> ModelParts | None:
    """The models of one configuration; None where the motion of a motor was not measured."""
    model, theta = fitted.at(configuration), fitted.theta_of(configuration)
    if not set(model.inputs) <= set(model.outputs):
        return None
    motors = model.with_outputs([model.outputs.index(place) for place in model.inputs])
    numbers = dict(zip(model.parameters, theta.tolist(), strict=True))
    free = numbers | dict.fromkeys(_viscous(fitted.robot), 0.0)
    known = {name: value for name, (value, _) in rigid.model.robot.parameters().items()} | free
    rigid_theta = np.array([known[name] for name in (*rigid.model.parameters, DELAY)])
    alone = rigid.at(model.configuration, rigid_theta[:-1], motors.outputs, motors.quantity)
    columns = [alone.inputs.index(place) for place in motors.inputs]
    alone = replace(alone, B=alone.B[:, columns], inputs=motors.inputs, hold=motors.hold)
    return ModelParts(
        (motors, theta), (motors, np.array([free[name] for name in model.parameters])), (alone, rigid_theta)
    )


def elastic_balances(
    record: Record, net: Record, parts: ModelParts, freq_hz: FloatArray, spec: EstimatorSpec
) -> tuple[TorqueBalance, ...]:
    """Of each motor in a record, at the lines freq_hz (F,); none where fewer than two periods are settled.

    net: the record without the dry friction that was taken out.
    """
    if settled_periods(record, spec) < 2:
        return ()
    motors, N = parts.whole[0], record.period_samples
    lines = np.rint(freq_hz * N / record.rate_hz).astype(np.int64)
    (Y,), (U,) = last_period(record, lines, motors.quantity)
    (_,), (U_net,) = last_period(net, lines, motors.quantity)
    Y_m = Y[:, [record.outputs.index(place) for place in motors.outputs]]
    whole, frictionless, rigid = (
        signals_of(_torque(Y_m, *one, freq_hz), lines, N) for one in (parts.whole, parts.frictionless, parts.rigid)
    )
    measured, dry = signals_of(U, lines, N), signals_of(U - U_net, lines, N)
    torques = {RIGID_BODY: rigid, ELASTICITY: frictionless - rigid, VISCOUS: whole - frictionless, DRY: dry}
    band_hz = float(freq_hz[0]), float(freq_hz[-1]) * (1 + 1e-9)
    return tuple(
        torque_balance(
            place, record.name, record.units_of_inputs[i], record.rate_hz, measured[:, i],
            {name: torque[:, i] for name, torque in torques.items() if np.any(torque)}, band_hz, record.rate_is_known,
        )
        for i, place in enumerate(motors.inputs)
    )  # fmt: skip


def _torque(Y: ComplexArray, model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    """U (F, n_u) that moves the motors by Y (F, n_u)."""
    return np.asarray(np.linalg.solve(frequency_response(model, theta, freq_hz), Y[..., None])[..., 0])


def _viscous(robot: Robot) -> list[str]:
    """Names of the viscous frictions of motors and joints."""
    return [name for name, (_, path) in robot.numbers.items() if path[-1] == "viscous"]
