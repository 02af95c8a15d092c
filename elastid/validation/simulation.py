r"""Simulation of a robot along a log, driven by the logged torque or by the reference of its controller.

.. math:: error_i = \sqrt{\overline{(y_i - \hat y_i)^2}} \,/\, \sqrt{\overline{(y_i - \bar y_i)^2}}

With the input `reference`, motion and torque are simulated with the same controller. With the input `torque` a model
would drift, because motors have no springs and gravity may be destabilising. A slow position loop therefore keeps it at
the logged positions. The torque of this loop is the model error at low frequencies and counts as torque error.

Signals of a periodic record are compared at all lines of the response's band in its last valid period. The bandwidth of
the position loop is a fifth of the lowest line: it changes the amplitude of an error at this line by 4 %, at higher
lines by less. The torque has the record's hold between samples. Its mean is the holding torque of the model, because
responses do not determine the mean of a log.
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
from elastid.validation.torque_balance import last_period, last_valid

LONGEST_S = 30.0  # longest simulation of a log


def simulate_log(
    empty: LogSimulation, robot: Robot, start: Configuration, spec: SimulatedSpec,
    signals_of: Callable[[Plant], Iterable[ComparedSignal]]
) -> LogSimulation:  # fmt: skip
    """Return the simulation of a robot along a log, or the reason of its failure.

    empty: result without signals, at the rate of the samples.  spec: equations and controller of the plant.
    signals_of: signals of this plant, which starts at rest and has no limits.
    """
    try:
        return replace(empty, signals=tuple(signals_of(true_plant(robot, spec, empty.rate_hz, start, is_free=True))))
    except (DataError, StudyError) as error:
        return replace(empty, lost=str(error))


def tracking_gains(plant: Plant, bandwidth_hz: float) -> JointLoop:
    """Return the gains of a critically damped loop about the logged motion, which adds no resonance."""
    return tune(plant.model, plant.point.q, bandwidth_hz, 1.0)


def simulate_tracking(
    plant: Plant, commands: Commands, moving: BoolArray, loop: JointLoop, position: FloatArray, velocity: FloatArray
) -> Trajectory:
    """Simulate a trajectory from position and velocity (n_u,) of the motors; DataError if it diverges.

    loop: gains (n_u,) of the moving motors; a loop of 5 Hz holds the others.
    """
    model, point, holding = plant.model, plant.point, tracking_gains(plant, 5.0)
    gains = loop.gain_derivatives(lambda gain, gain_at_rest: np.where(moving, gain, gain_at_rest), holding)
    (q,) = rigid_path(model, point.q, point.configuration.angles, position[None])
    return simulate(plant.loop, gains, commands, q, v0=rigid_motion(model, q) @ velocity)


def simulate_record(
    record: Record, robot: Robot, band_hz: tuple[float, float], delay_s: float = 0.0, spec: ModelSpec = EXACT
) -> tuple[LogSimulation, ...]:
    """Simulate a robot along a record with its torque as input, compared within band_hz; empty without a rate.

    robot: with its fitted elasticity and friction.  delay_s: of the torques.  spec: formulation of the equations.  Of a
    record without a period, the first LONGEST_S are simulated.
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
    """Yield the signals of a plant with the repeated torque of a record's last period, in a loop about its motion."""
    model, angles, chain = plant.model, record.configuration.angles, plant.model.robot.chain
    N, motors = record.period_samples, [model.inputs.index(location) for location in record.inputs]
    half_waves = 2 if record.half_wave else 1
    last = last_valid(record.n_periods, {index // half_waves for index in record.discarded_periods})
    period = slice(last * N, (last + 1) * N)
    position = np.tile(angles, (N, 1))
    for i, location in zip(motors, record.inputs, strict=True):
        if (location, "position") in zip(record.outputs, record.quantities, strict=True):
            y = record.y[period, [record.outputs.index(location)]]
            position[:, i] = before_channels(y, record.rate_hz, chain.at("y", [location]))[:, 0]
    # The same difference quotient as the loop's, so that its torque depends on the error alone.
    velocity = (position - np.roll(position, 1, axis=0)) * record.rate_hz
    if not record.is_periodic:
        velocity[0] = velocity[1]
    torque = np.tile(plant.point.u, (N, 1))
    u = before_channels(record.u[period], record.rate_hz, chain.at("u", record.inputs))
    torque[:, motors] += equivalent_zoh_input(record, u)
    period_s = N / record.rate_hz
    # A critically damped loop reduces an initial error to a thousandth in one and a half of its periods.
    lead = min(max(0, math.floor(LONGEST_S / period_s) - 1), math.ceil(1.5 / tracking_hz / period_s))
    lead = lead if record.is_periodic else 0  # periods before the compared period
    zeros = np.zeros(((lead + 1) * N, model.n_u))
    path, rate, input_torque = (np.tile(signal, (lead + 1, 1)) for signal in (position, velocity, torque))
    commands = Commands(path, rate, input_torque, zeros, zeros)
    moving, loop = np.isin(np.arange(model.n_u), motors), tracking_gains(plant, tracking_hz)
    trajectory = simulate_tracking(plant, commands, moving, loop, position[0], velocity[0])
    return _in_band(record, band_hz, delay_s, plant, trajectory)


def _logged(record: Record, plant: Plant, trajectory: Trajectory) -> Record:
    """Return the last period of a trajectory as a record with the sensors and channels of the measured one."""
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
    """Return a zero-order-hold torque (N, n_u) that is equivalent to one period of u with its hold, without mean."""
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
    delay = np.exp(-2j * np.pi * line_frequencies(lines, record.rate_hz, N) * delay_s)[:, None]

    def in_time(log: Record, factor: ComplexArray | float) -> FloatArray:
        (Y,), (U,) = last_period(log, lines, "position")
        return synthesise(lines, np.hstack([U, factor * Y]), N)

    kinds = [TORQUE] * len(record.inputs)
    kinds += [MOTION if output in record.inputs else LINK for output in record.outputs]
    units = *record.units_of_inputs, *(motion_unit("position", output in record.sliding) for output in record.outputs)
    measured, simulated = in_time(record, 1.0).T, in_time(_logged(record, plant, trajectory), delay).T
    rows = zip(kinds, (*record.inputs, *record.outputs), units, measured, simulated, strict=True)
    yield from starmap(ComparedSignal, rows)
