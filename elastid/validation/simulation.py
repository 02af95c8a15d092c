r"""The twin of a robot moved along a log, simulated forwards, by its torque or under its controller.

.. math:: error_i = \sqrt{\overline{(y_i - \hat y_i)^2}} \,/\, \sqrt{\overline{(y_i - \bar y_i)^2}}

What drives the twin is one of two:

`reference`: that of the robot's controller, through the same controller. Motion and torque are the twin's own.
`torque`: that of the log. A robot under a torque alone drifts, since its motors have no springs and gravity may pull it
further away; so a loop about the logged motion, slower than what is judged, holds the twin. The torque that this loop
adds is what the model lacks at low frequencies, and is shown as error of the torque.

Along a record signals are compared at all lines between the lowest and the highest of the response, in the last period
that counts. Below them the twin is held by a loop of a fifth of the lowest line; an error at that line is changed by
4 % in its amplitude, higher ones by less. The torque between samples is that of the record's hold; its mean is the
holding torque of the model, since that of a log contains what no response shows.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled
from elastid.base.errors import DataError, StudyError
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.excitation.multisine import synthesise
from elastid.experiment.simulated.hardware import filter_motions, logged_quantity, sense
from elastid.experiment.simulated.plant import Plant, true_plant
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.record import Configuration, JointLoop, Record, motion_unit
from elastid.robot import Robot, before_channels, logged
from elastid.simulation.closed_loop import Commands, Trajectory, simulate
from elastid.simulation.controller import rigid_motion, rigid_path, tune
from elastid.validation.torque_balance import TorqueBalance, last_counted, last_period

Drive: TypeAlias = Literal["reference", "torque"]
SignalKind: TypeAlias = Literal["torque", "motor angle", "link motion"]
TORQUE: Final = "torque"
MOTION: Final = "motor angle"
LINK: Final = "link motion"
_DRIVES = {"reference": "reference through its controller", "torque": "torque"}
# Of a log this much is simulated at most.
LONGEST_S = 30.0


@frozen_value
class TwinSignal:
    """One signal (n,) of a log and of its twin, link side, in SI, at rate_hz of its run."""

    kind: SignalKind
    place: str
    unit: str
    measured: FloatArray = labelled("as measured, link side", "{unit}", "sample")
    simulated: FloatArray = labelled("of the twin", "{unit}", "sample")

    @property
    def error(self) -> float:
        """Rms error over the rms of the signal about its mean."""
        rms = float(np.sqrt(np.mean((self.measured - self.simulated) ** 2)))
        return rms / max(float(np.std(self.measured)), 1e-300)


@dataclass(frozen=True)
class TwinRun:
    """The twin moved along one log.

    tracking_bandwidth_hz: of the loop about the logged motion, 0 under the controller's reference.  seconds: simulated
    duration of the log.  lost: why there is no result; empty where there is.
    """

    log: str
    drive: Drive
    tracking_bandwidth_hz: float
    seconds: float
    rate_hz: float
    signals: tuple[TwinSignal, ...] = ()
    lost: str = ""

    def of(self, kind: SignalKind) -> tuple[TwinSignal, ...]:
        """The signals of a kind."""
        return tuple(signal for signal in self.signals if signal.kind == kind)

    @property
    def words(self) -> str:
        """Simulation errors along the log, in one sentence."""
        driven = f"with the logged {_DRIVES[self.drive]} as input"
        if self.lost:
            return f"Simulation of record {self.log} {driven}: diverged, {self.lost}."
        held_hz = self.tracking_bandwidth_hz
        held = f". A slow position loop ({held_hz:.2g} Hz) keeps the model at the logged positions" if held_hz else ""
        errors = {kind: [100 * signal.error for signal in self.of(kind)] for kind in (MOTION, TORQUE, LINK)}
        loop = errors.pop(TORQUE) if held else []
        parts = [f"{kind} at most {max(values):.3g} %" for kind, values in errors.items() if values]
        of_loop = (
            f" The torque of the position loop is at most {max(loop):.3g} % of the logged torque (rms)." if loop else ""
        )
        return (
            f"Simulation of {self.seconds:.3g} s of record {self.log} {driven}{held}. Rms errors in percent "
            f"of the rms signal: {', '.join(parts)}.{of_loop}"
        )


@dataclass(frozen=True)
class TwinFindings:
    """The torque of logs part by part, and the twin moved along them; missing: joints not predicted there, and why."""

    balances: tuple[TorqueBalance, ...] = ()
    runs: tuple[TwinRun, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def words(self) -> tuple[str, ...]:
        """The torque of each joint, then the simulations."""
        return (*(balance.words for balance in self.balances), *(run.words for run in self.runs))


NO_TWIN = TwinFindings()


def run_along(
    empty: TwinRun,
    robot: Robot,
    start: Configuration,
    spec: SimulatedSpec,
    moved: Callable[[Plant], Iterable[TwinSignal]],
) -> TwinRun:
    """The run of a robot along a log, or why it is lost; empty: without its signals, at the rate of the samples.

    spec: equations and controller of its plant.  moved: the signals of that, without limits, at rest at the start.
    """
    try:
        plant = true_plant(robot, spec, empty.rate_hz, start, is_free=True)
        return replace(empty, signals=tuple(moved(plant)))
    except (DataError, StudyError) as error:
        return replace(empty, lost=str(error))


def holding_gains(plant: Plant, bandwidth_hz: float) -> JointLoop:
    """Gains of a loop about the logged motion, damped critically, so that it adds no resonance."""
    return tune(plant.model, plant.point.q, bandwidth_hz, 1.0)


def follow(
    plant: Plant, commands: Commands, moving: BoolArray, held: JointLoop, position: FloatArray, velocity: FloatArray
) -> Trajectory:
    """Trajectory from position and velocity (n_u,) of the motors; DataError where one is lost.

    held: gains of motors that move (n_u,); others are held by a loop of 5 Hz.
    """
    model, point, resting = plant.model, plant.point, holding_gains(plant, 5.0)
    gains = held.each(lambda moved, rested: np.where(moving, moved, rested), resting)
    (q,) = rigid_path(model, point.q, point.configuration.angles, position[None])
    return simulate(plant.loop, gains, commands, q, v0=rigid_motion(model, q) @ velocity)


def elastic_runs(
    record: Record, robot: Robot, band_hz: tuple[float, float], delay_s: float = 0.0, spec: ModelSpec = EXACT
) -> tuple[TwinRun, ...]:
    """The run along a record, driven by its torque and compared within band_hz; none without a rate.

    robot: with its fitted elasticity and friction.  delay_s: of its torques.  spec: the equations that it has.  Of a
    record without a period at most LONGEST_S from its beginning are simulated.
    """
    if not record.has_rate:
        return ()
    n = round(LONGEST_S * record.rate_hz)
    if not record.is_periodic and record.n_samples > n:
        record = replace(record, u=record.u[:n], y=record.y[:n], r=None, period_samples=n)
    held_hz = 0.2 * band_hz[0]
    empty = TwinRun(record.name, "torque", held_hz, record.period_samples / record.rate_hz, record.rate_hz)
    moved = partial(_along_record, record, held_hz, band_hz, delay_s)
    return (run_along(empty, robot, record.configuration, SimulatedSpec(model=spec), moved),)


def _along_record(
    record: Record, held_hz: float, band_hz: tuple[float, float], delay_s: float, plant: Plant
) -> Iterator[TwinSignal]:
    """Signals of a plant under the torque of the last period of a record, over and over, held on its motion."""
    model, angles, chain = plant.model, record.configuration.angles, plant.model.robot.chain
    N, motors = record.period_samples, [model.inputs.index(place) for place in record.inputs]
    last = last_counted(record.n_periods, {index // (2 if record.half_wave else 1) for index in record.left_out})
    period = slice(last * N, (last + 1) * N)
    position = np.tile(angles, (N, 1))
    for i, place in zip(motors, record.inputs, strict=True):
        if (place, "position") in zip(record.outputs, record.quantities, strict=True):
            y = record.y[period, [record.outputs.index(place)]]
            position[:, i] = before_channels(y, record.rate_hz, chain.at("y", [place]))[:, 0]
    # As the loop differentiates what it reads, so that its torque is of the error alone.
    velocity = (position - np.roll(position, 1, axis=0)) * record.rate_hz
    if not record.is_periodic:
        velocity[0] = velocity[1]
    torque = np.tile(plant.point.u, (N, 1))
    u = before_channels(record.u[period], record.rate_hz, chain.at("u", record.inputs))
    torque[:, motors] += _held(record, u)
    period_s = N / record.rate_hz
    # A critically damped loop leaves a thousandth of an error at the start after one and a half of its periods.
    lead = min(max(0, math.floor(LONGEST_S / period_s) - 1), math.ceil(1.5 / held_hz / period_s))
    lead = lead if record.is_periodic else 0  # periods before the one that is compared
    still = np.zeros(((lead + 1) * N, model.n_u))
    path, rate, driving = (np.tile(signal, (lead + 1, 1)) for signal in (position, velocity, torque))
    commands = Commands(path, rate, driving, still, still)
    moving, held = np.isin(np.arange(model.n_u), motors), holding_gains(plant, held_hz)
    return _in_band(record, band_hz, delay_s, plant, follow(plant, commands, moving, held, position[0], velocity[0]))


def _logged(record: Record, plant: Plant, moved: Trajectory) -> Record:
    N, model, chain = record.period_samples, plant.model, plant.model.robot.chain
    y = sense(moved.q, moved.reading, model, plant.point.q, record.outputs, record.rate_hz, N)
    y = logged(filter_motions(model.robot, y, record.rate_hz), record.rate_hz, chain.at("y", record.outputs))
    motors = [model.inputs.index(place) for place in record.inputs]
    u = logged(moved.u[:, motors], record.rate_hz, chain.at("u", record.inputs))
    return replace(
        record, u=u[-N:], y=y[-N:], r=None, left_out=(), hold="zero-order", hold_samples=(),
        quantities=tuple(logged_quantity(place) for place in record.outputs), sampled=(True,) * len(record.outputs),
    )  # fmt: skip


def _held(record: Record, u: FloatArray) -> FloatArray:
    """Command (N, n_u) with zero-order hold equivalent to one period u, without mean."""
    N = record.period_samples
    freq_hz = line_frequencies(np.arange(N // 2 + 1), record.rate_hz, N)
    held = replace(record, hold="zero-order", hold_samples=())
    factor = record.hold_response(freq_hz) / held.hold_response(freq_hz)
    factor[0] = 0.0
    return np.fft.irfft(np.fft.rfft(u, axis=0) * factor, N, axis=0)


def _in_band(
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
