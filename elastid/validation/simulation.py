r"""Simulation of a robot along a log, driven by the logged torque or by the reference of its controller.

.. math:: error_i = \sqrt{\overline{(y_i - \hat y_i)^2}} \,/\, \sqrt{\overline{(y_i - \bar y_i)^2}}

The input is one of two:

`reference`: logged reference, through the same controller. Motion and torque are simulated.
`torque`: that of the log. A robot under a torque alone drifts, since its motors have no springs and gravity may pull it
further away; so a slow position loop keeps the model at the logged positions. The torque that this loop
adds is what the model lacks at low frequencies, and is shown as error of the torque.

Along a record signals are compared at all lines between the lowest and the highest of the response, in the last period
that counts. The bandwidth of the position loop is a fifth of the lowest line; it changes an error at that line by
4 % in its amplitude, higher ones by less. The torque between samples is that of the record's hold; its mean is the
holding torque of the model, since that of a log contains what no response shows.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import starmap

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.excitation.multisine import synthesise
from elastid.experiment.simulated.hardware import filter_motions, logged_quantity, sense
from elastid.experiment.simulated.plant import Plant, true_plant
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.record import Configuration, JointLoop, Record, motion_unit
from elastid.robot import Robot, before_channels, log_signal
from elastid.simulation.closed_loop import Commands, Trajectory, simulate
from elastid.simulation.controller import rigid_motion, rigid_path, tune
from elastid.validation.log_comparison import LINK, MOTION, TORQUE, ComparedSignal, LogSimulation
from elastid.validation.torque_balance import last_counted, last_period

# Of a log this much is simulated at most.
LONGEST_S = 30.0


def simulate_log(
    empty: LogSimulation,
    robot: Robot,
    start: Configuration,
    spec: SimulatedSpec,
    signals_of: Callable[[Plant], Iterable[ComparedSignal]],
) -> LogSimulation:
    """Return the run of a robot along a log, or why it is lost; empty: without its signals, at the rate of the samples.

    spec: equations and controller of its plant.  signals_of: the signals of that plant without limits, from rest.
    """
    try:
        return replace(empty, signals=tuple(signals_of(true_plant(robot, spec, empty.rate_hz, start, is_free=True))))
    except (DataError, StudyError) as error:
        return replace(empty, lost=str(error))


def tracking_gains(plant: Plant, bandwidth_hz: float) -> JointLoop:
    """Return gains of a loop about the logged motion, damped critically, so that it adds no resonance."""
    return tune(plant.model, plant.point.q, bandwidth_hz, 1.0)


def simulate_tracking(
    plant: Plant, commands: Commands, moving: BoolArray, loop: JointLoop, position: FloatArray, velocity: FloatArray
) -> Trajectory:
    """Return trajectory from position and velocity (n_u,) of the motors; DataError where one is lost.

    loop: gains of motors that move (n_u,); others are held by a loop of 5 Hz.
    """
    model, point, resting = plant.model, plant.point, tracking_gains(plant, 5.0)
    gains = loop.gain_derivatives(lambda moved, rested: np.where(moving, moved, rested), resting)
    (q,) = rigid_path(model, point.q, point.configuration.angles, position[None])
    return simulate(plant.loop, gains, commands, q, v0=rigid_motion(model, q) @ velocity)


def simulate_record(
    record: Record, robot: Robot, band_hz: tuple[float, float], delay_s: float = 0.0, spec: ModelSpec = EXACT
) -> tuple[LogSimulation, ...]:
    """Return the run along a record, driven by its torque and compared within band_hz; none without a rate.

    robot: with its fitted elasticity and friction.  delay_s: of its torques.  spec: the equations that it has.  Of a
    record without a period at most LONGEST_S from its beginning are simulated.
    """
    if not record.has_rate:
        return ()
    n = round(LONGEST_S * record.rate_hz)
    if not record.is_periodic and record.n_samples > n:
        record = record.part(slice(n), period_samples=n)
    tracking_hz = 0.2 * band_hz[0]
    empty = LogSimulation(record.name, "torque", tracking_hz, record.period_samples / record.rate_hz, record.rate_hz)
    signals_of = partial(_along_record, record, tracking_hz, band_hz, delay_s)
    return (simulate_log(empty, robot, record.configuration, SimulatedSpec(model=spec), signals_of),)


def _along_record(
    record: Record, tracking_hz: float, band_hz: tuple[float, float], delay_s: float, plant: Plant
) -> Iterator[ComparedSignal]:
    """Yield signals of a plant under the torque of the last period of a record, over and over, held on its motion."""
    model, angles, chain = plant.model, record.configuration.angles, plant.model.robot.chain
    N, motors = record.period_samples, [model.inputs.index(location) for location in record.inputs]
    half_waves = 2 if record.half_wave else 1
    last = last_counted(record.n_periods, {index // half_waves for index in record.discarded_periods})
    period = slice(last * N, (last + 1) * N)
    position = np.tile(angles, (N, 1))
    for i, location in zip(motors, record.inputs, strict=True):
        if (location, "position") in zip(record.outputs, record.quantities, strict=True):
            y = record.y[period, [record.outputs.index(location)]]
            position[:, i] = before_channels(y, record.rate_hz, chain.at("y", [location]))[:, 0]
    # As the loop differentiates what it reads, so that its torque is of the error alone.
    velocity = (position - np.roll(position, 1, axis=0)) * record.rate_hz
    if not record.is_periodic:
        velocity[0] = velocity[1]
    torque = np.tile(plant.point.u, (N, 1))
    u = before_channels(record.u[period], record.rate_hz, chain.at("u", record.inputs))
    torque[:, motors] += equivalent_zoh_input(record, u)
    period_s = N / record.rate_hz
    # A critically damped loop leaves a thousandth of an error at the start after one and a half of its periods.
    lead = min(max(0, math.floor(LONGEST_S / period_s) - 1), math.ceil(1.5 / tracking_hz / period_s))
    lead = lead if record.is_periodic else 0  # periods before the one that is compared
    zeros = np.zeros(((lead + 1) * N, model.n_u))
    path, rate, driving = (np.tile(signal, (lead + 1, 1)) for signal in (position, velocity, torque))
    commands = Commands(path, rate, driving, zeros, zeros)
    moving, loop = np.isin(np.arange(model.n_u), motors), tracking_gains(plant, tracking_hz)
    trajectory = simulate_tracking(plant, commands, moving, loop, position[0], velocity[0])
    return _in_band(record, band_hz, delay_s, plant, trajectory)


def _logged(record: Record, plant: Plant, trajectory: Trajectory) -> Record:
    N, model, chain = record.period_samples, plant.model, plant.model.robot.chain
    y = sense(trajectory.q, trajectory.reading, model, plant.point.q, record.outputs, record.rate_hz, N)
    y = log_signal(filter_motions(model.robot, y, record.rate_hz), record.rate_hz, chain.at("y", record.outputs))
    motors = [model.inputs.index(motor) for motor in record.inputs]
    u = log_signal(trajectory.u[:, motors], record.rate_hz, chain.at("u", record.inputs))
    return replace(
        record, u=u[-N:], y=y[-N:], r=None, discarded_periods=(), hold="zero-order", hold_samples=(),
        quantities=tuple(logged_quantity(motor) for motor in record.outputs), sampled=(True,) * len(record.outputs)
    )  # fmt: skip


def equivalent_zoh_input(record: Record, u: FloatArray) -> FloatArray:
    """Return command (N, n_u) with zero-order hold equivalent to one period u, without mean."""
    N = record.period_samples
    freq_hz = line_frequencies(np.arange(N // 2 + 1), record.rate_hz, N)
    zoh_record = replace(record, hold="zero-order", hold_samples=())
    factor = record.hold_response(freq_hz) / zoh_record.hold_response(freq_hz)
    factor[0] = 0.0
    return np.fft.irfft(np.fft.rfft(u, axis=0) * factor, N, axis=0)


def _in_band(
    record: Record, band_hz: tuple[float, float], delay_s: float, plant: Plant, trajectory: Trajectory
) -> Iterator[ComparedSignal]:
    """Yield torques and motions of the last period, at the lines within the band."""
    N = record.period_samples
    lines = grid_lines("odd" if record.half_wave else "full", band_hz, record.rate_hz, N)
    late = np.exp(-2j * np.pi * line_frequencies(lines, record.rate_hz, N) * delay_s)[:, None]

    def in_time(log: Record, factor: ComplexArray | float) -> FloatArray:
        (Y,), (U,) = last_period(log, lines, "position")
        return synthesise(lines, np.hstack([U, factor * Y]), N)

    kinds = [TORQUE] * len(record.inputs)
    kinds += [MOTION if place in record.inputs else LINK for place in record.outputs]
    units = *record.units_of_inputs, *(motion_unit("position", place in record.sliding) for place in record.outputs)
    measured, simulated = in_time(record, 1.0).T, in_time(_logged(record, plant, trajectory), late).T
    rows = zip(kinds, (*record.inputs, *record.outputs), units, measured, simulated, strict=True)
    yield from starmap(ComparedSignal, rows)
