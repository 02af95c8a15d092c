r"""The twin of an elastic study: a multisine's torque part by part, and a record simulated forwards.

.. math:: \hat U = G_m^{-1} Y_m, \qquad G_m: \text{torques of the motors to their own motion}

of three models with the fitted numbers: springs left out and no viscous friction (rigid body), with springs (elasticity
is the difference), and with viscous friction (the same). Dry friction is what the estimator took out of the torque. At
the lines of the response, in the last period of the steady state, where this is exact.

Signals are compared at all lines between the lowest and the highest of the response, in the last period that counts.
Below them the twin is held on the log by a loop of a fifth of the lowest line; an error at that line is changed by 4 %
in its amplitude, higher ones by less. The torque between samples is that of the record's hold; its mean is the holding
torque of the model, since that of a log contains what no response shows.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.excitation.multisine import synthesise
from elastid.experiment.simulated.hardware import filter_motions, logged_quantity, sense
from elastid.experiment.simulated.plant import Plant
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.fitted_robot import FittedRobot
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, unit_scale
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.record import Motion, Record, motion_unit
from elastid.robot import Robot
from elastid.robot.simplified import elastic_coordinates, stiffened
from elastid.simulation.closed_loop import Commands, Trajectory
from elastid.validation.twin import (
    DRY,
    ELASTICITY,
    LINK,
    LONGEST_S,
    MOTION,
    RIGID_BODY,
    TORQUE,
    VISCOUS,
    SignalKind,
    TorqueBalance,
    TwinRun,
    TwinSignal,
    follow,
    holding_gains,
    run_along,
    torque_balance,
)

# Models of the motors' own motion in one configuration, each with its numbers (n_theta,): as fitted, without viscous
# friction, and without springs either.
ModelParts: TypeAlias = tuple[
    tuple[LinearModel, FloatArray], tuple[LinearModel, FloatArray], tuple[LinearModel, FloatArray]
]


def rigid_linearisation(fitted: FittedRobot, spec: ModelSpec = EXACT) -> Linearisation:
    """The fitted robot without its springs, to be linearised; StudyError where it cannot be without them."""
    names = [coordinate.name for coordinate in elastic_coordinates(fitted.robot)]
    return Linearisation.of_robot(stiffened(fitted.robot, names), spec, fitted.result.parameters.names)


def model_parts(fitted: FittedRobot, rigid: Linearisation, configuration: str) -> ModelParts | None:
    """The models of one configuration; None where the motion of a motor was not measured."""
    model, theta = fitted.at(configuration).linear, fitted.theta_of(configuration)
    if not set(model.inputs) <= set(model.outputs):
        return None
    motors = model.with_outputs([model.outputs.index(place) for place in model.inputs])
    numbers = dict(zip(model.parameters, theta.tolist(), strict=True))
    free = numbers | {name: 0.0 for name, (_, path) in fitted.robot.numbers.items() if path[-1] == "viscous"}
    known = {name: value for name, (value, _) in rigid.model.robot.parameters().items()} | free
    rigid_theta = np.array([known[name] for name in (*rigid.model.parameters, DELAY)])
    alone = rigid.at(model.configuration, rigid_theta[:-1], motors.outputs, motors.quantity)
    columns = [alone.inputs.index(place) for place in motors.inputs]
    alone = replace(alone, B=alone.B[:, columns], inputs=motors.inputs, hold=motors.hold)
    return (motors, theta), (motors, np.array([free[name] for name in model.parameters])), (alone, rigid_theta)


def elastic_balances(
    record: Record, net: Record, parts: ModelParts, freq_hz: FloatArray, spec: EstimatorSpec
) -> tuple[TorqueBalance, ...]:
    """Balances of each motor at freq_hz (F,), none of fewer than two settled periods; net: without dry friction."""
    # Periods that count: neither dropped by the study nor left out by the repair of the log.
    dropped = 0 if spec.transient_periods == "auto" else spec.transient_periods
    if len({*range(dropped, record.n_samples // record.repeat_samples)} - {*record.left_out}) < 2:
        return ()
    (motors, _), N = parts[0], record.period_samples
    lines = np.rint(freq_hz * N / record.rate_hz).astype(np.int64)
    (Y,), (U,) = last_period(record, lines, motors.quantity)
    (_,), (U_net,) = last_period(net, lines, motors.quantity)
    Y_m = Y[:, [record.outputs.index(place) for place in motors.outputs]]
    modelled = (frequency_response(*part, freq_hz) for part in parts)
    torques_of_models = (np.asarray(np.linalg.solve(G, Y_m[..., None])[..., 0]) for G in modelled)
    full, frictionless, rigid = (synthesise(lines, torque, N) for torque in torques_of_models)
    measured, dry = synthesise(lines, U, N), synthesise(lines, U - U_net, N)
    torques = {RIGID_BODY: rigid, ELASTICITY: frictionless - rigid, VISCOUS: full - frictionless, DRY: dry}
    band_hz = float(freq_hz[0]), float(freq_hz[-1]) * (1 + 1e-9)
    return tuple(
        torque_balance(
            place, record.name, record.units_of_inputs[i], record.rate_hz, measured[:, i],
            {name: torque[:, i] for name, torque in torques.items() if np.any(torque)}, band_hz, record.rate_is_known,
        )
        for i, place in enumerate(motors.inputs)
    )  # fmt: skip


def elastic_runs(
    record: Record, robot: Robot, band_hz: tuple[float, float], delay_s: float = 0.0, spec: ModelSpec = EXACT
) -> tuple[TwinRun, ...]:
    """The run along a record, driven by its torque and compared within band_hz; none without a rate.

    robot: with its fitted elasticity and friction.  delay_s: of its torques.  spec: the equations that it has.  Of a
    record without a period at most LONGEST_S from its beginning are simulated.
    """
    if not record.rate_is_known:
        return ()
    n = round(LONGEST_S * record.rate_hz)
    if not record.is_periodic and record.n_samples > n:
        record = replace(record, u=record.u[:n], y=record.y[:n], r=None, period_samples=n)
    held_hz = 0.2 * band_hz[0]
    empty = TwinRun(record.name, "torque", held_hz, record.period_samples / record.rate_hz, record.rate_hz)
    moved = partial(_signals, record, held_hz, band_hz, delay_s)
    return (run_along(empty, robot, record.configuration, SimulatedSpec(model=spec), moved),)


def _signals(
    record: Record, held_hz: float, band_hz: tuple[float, float], delay_s: float, plant: Plant
) -> Iterator[TwinSignal]:
    """Signals of a plant under the torque of the last period of a record, over and over, held on its motion."""
    model, angles, chain = plant.model, record.configuration.angles, plant.model.robot.chain
    N, motors = record.period_samples, [model.inputs.index(place) for place in record.inputs]
    last = _last(record.n_periods, {index // (2 if record.half_wave else 1) for index in record.left_out})
    period = slice(last * N, (last + 1) * N)
    position = np.tile(angles, (N, 1))
    for i, place in zip(motors, record.inputs, strict=True):
        if (place, "position") in zip(record.outputs, record.quantities, strict=True):
            position[:, i] = record.y[period, record.outputs.index(place)] / chain.gain("y", place)
    # As the loop differentiates what it reads, so that its torque is of the error alone.
    velocity = (position - np.roll(position, 1, axis=0)) * record.rate_hz
    if not record.is_periodic:
        velocity[0] = velocity[1]
    torque = np.tile(plant.point.u, (N, 1))
    torque[:, motors] += _held(record, record.u[period]) / [chain.gain("u", place) for place in record.inputs]
    period_s = N / record.rate_hz
    # A critically damped loop leaves a thousandth of an error at the start after one and a half of its periods.
    lead = min(max(0, math.floor(LONGEST_S / period_s) - 1), math.ceil(1.5 / held_hz / period_s))
    lead = lead if record.is_periodic else 0  # periods before the one that is compared
    still = np.zeros(((lead + 1) * N, model.n_u))
    path, rate, driving = (np.tile(signal, (lead + 1, 1)) for signal in (position, velocity, torque))
    commands = Commands(path, rate, driving, still, still)
    moving, held = np.isin(np.arange(model.n_u), motors), holding_gains(plant, held_hz)
    return _compared(record, band_hz, delay_s, plant, follow(plant, commands, moving, held, position[0], velocity[0]))


def _last(periods: int, left_out: Collection[int]) -> int:
    """The last period that is not left out; the last one where all are."""
    return max((p for p in range(periods) if p not in left_out), default=periods - 1)


def _logged(record: Record, plant: Plant, moved: Trajectory) -> Record:
    """The last period of a trajectory as it would be logged."""
    N, model, chain = record.period_samples, plant.model, plant.model.robot.chain
    y = sense(moved.q, moved.reading, model, plant.point.q, record.outputs, record.rate_hz, N)
    y = filter_motions(model.robot, y, record.rate_hz) * [chain.gain("y", place) for place in record.outputs]
    motors = [model.inputs.index(place) for place in record.inputs]
    u = moved.u[:, motors] * [chain.gain("u", place) for place in record.inputs]
    return replace(
        record, u=u[-N:], y=y[-N:], r=None, left_out=(), hold="zero-order", hold_samples=(),
        quantities=tuple(logged_quantity(place) for place in record.outputs), sampled=(True,) * len(record.outputs),
    )  # fmt: skip


def _held(record: Record, u: FloatArray) -> FloatArray:
    """The command (N, n_u), held from sample to sample, whose torque acts as that of one period u does; no mean."""
    N = record.period_samples
    freq_hz = line_frequencies(np.arange(N // 2 + 1), record.rate_hz, N)
    held = replace(record, hold="zero-order", hold_samples=())
    factor = record.hold_response(freq_hz) / held.hold_response(freq_hz)
    factor[0] = 0.0
    return np.asarray(np.fft.irfft(np.fft.rfft(u, axis=0) * factor, N, axis=0))


def _compared(
    record: Record, band_hz: tuple[float, float], delay_s: float, plant: Plant, moved: Trajectory
) -> Iterator[TwinSignal]:
    """Torques and motions of the last period, at the lines within the band."""
    N = record.period_samples
    lines = grid_lines("odd" if record.half_wave else "full", band_hz, record.rate_hz, N)
    late = np.exp(-2j * np.pi * line_frequencies(lines, record.rate_hz, N) * delay_s)[:, None]

    def in_time(log: Record, factor: ComplexArray | float) -> FloatArray:
        (Y,), (U,) = last_period(log, lines, "position")
        return synthesise(lines, np.hstack([U, factor * Y]), N)

    kinds: list[SignalKind] = [TORQUE] * len(record.inputs)
    kinds += [MOTION if place in record.inputs else LINK for place in record.outputs]
    units = *record.units_of_inputs, *(motion_unit("position", place in record.sliding) for place in record.outputs)
    measured, simulated = in_time(record, 1.0).T, in_time(_logged(record, plant, moved), late).T
    for row in zip(kinds, (*record.inputs, *record.outputs), units, measured, simulated, strict=True):
        yield TwinSignal(*row)


def last_period(record: Record, lines: IntArray, quantity: Motion) -> tuple[ComplexArray, ComplexArray]:
    """Y (1, F, n_y), U (1, F, n_u) of the last period of a record that was not left out."""
    last = [_last(record.n_samples // record.repeat_samples, record.left_out)]
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    spectra, n_y = RecordSpectra(record), len(record.outputs)
    Y, U = (spectra.amplitudes(role, lines)[last] for role in ("y", "u"))
    scale = unit_scale(record, freq_hz, quantity)
    return Y * scale[:, :n_y], U * scale[:, n_y:]
