r"""The twin of a robot along a log: torque part by part for the measured motion, and motion simulated forwards.

.. math:: u(t) = \sum_i \tau_i(t) + e(t), \qquad
          share_i = \overline{\tau_i u} \,/\, \overline{u^2}, \qquad left = \overline{e^2} \,/\, \overline{u^2}

tau_i: the torque that a part of the model takes for the *measured* motion, so that no controller and no stability is
needed. Shares do not depend on the order of the parts, and together with that of e they sum to 1. Parts that work
against each other have more than 1 and less than 0: above an antiresonance a spring takes the link's inertia back.
Over frequency the same with spectra U, T_i of Hann's window, summed over the lines of a band (Parseval).

.. math:: error_i = \sqrt{\overline{(y_i - \hat y_i)^2}} \,/\, \sqrt{\overline{(y_i - \bar y_i)^2}}

Of the identified model, simulated forwards. What drives the twin is one of two:

`reference`: that of the robot's controller, through the same controller. Motion and torque are the twin's own.
`torque`: that of the log. A robot under a torque alone drifts, since its motors have no springs and gravity may pull it
further away; so a loop about the logged motion, slower than what is judged, holds the twin. The torque that this loop
adds is what the model lacks at low frequencies, and is shown as error of the torque.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled
from elastid.base.errors import DataError, StudyError
from elastid.experiment.simulated.plant import Plant, true_plant
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.closed_loop import Commands, Trajectory, simulate
from elastid.simulation.controller import Gains, rigid_motion, rigid_path, tune

# Parts of a model's torque, as tables and figures name them; `FRICTION`: those that a model without friction lacks.
INERTIA, GRAVITY, RIGID_BODY, ELASTICITY = "inertia", "gravity and offset", "rigid body", "elasticity"
VISCOUS, DRY = "viscous friction", "dry friction"
FRICTION = (VISCOUS, DRY)
# An octave with less of the torque's power holds noise, or what the window leaks.
MIN_POWER_SHARE = 1e-4


@dataclass(frozen=True)
class BandBalance:
    """The torque between two frequencies in Hz: power, its share of all; share of each part in it; what is left.

    left_without_friction: by the model without its friction.
    """

    low_hz: float
    high_hz: float
    power: float
    shares: tuple[float, ...]
    left: float
    left_without_friction: float


@frozen_value
class TorqueBalance:
    """The torque of one motor in one log, link side.

    place: of its motor or joint.  log: name of the record.  unit: of the torque.  rate_hz: of the samples; without a
    known rate frequencies are in units of it.  parts: names; torques (n_p, n): of each.  measured (n,).
    shares: of each part in the mean square of the torque.  left: of it by the whole model, and left_without_friction by
    the model without its friction.  bands: the same by octave, upwards.
    """

    place: str
    log: str
    unit: str
    rate_hz: float
    parts: tuple[str, ...]
    measured: FloatArray = labelled("torque as measured, link side", "{unit}", "sample")
    torques: FloatArray = labelled("torque of each part of the model", "{unit}", "parts sample")
    shares: tuple[float, ...]
    left: float
    left_without_friction: float
    bands: tuple[BandBalance, ...]
    rate_is_known: bool = True

    @property
    def worst(self) -> BandBalance:
        """The octave of which the model leaves most, of those with power."""
        return max((band for band in self.bands if band.power >= MIN_POWER_SHARE), key=lambda band: band.left)

    @property
    def residual(self) -> FloatArray:
        """Measured less modelled torque (n,)."""
        return np.asarray(self.measured - self.torques.sum(axis=0))

    def part(self, names: Sequence[str]) -> FloatArray:
        """The torque (n,) of these parts together, 0 of those that the model lacks."""
        return np.asarray(self.torques[[name in names for name in self.parts]].sum(axis=0))


def torque_balance(
    place: str,
    log: str,
    unit: str,
    rate_hz: float,
    measured: FloatArray,
    parts: Mapping[str, FloatArray],
    band_hz: tuple[float, float],
    rate_is_known: bool = True,
) -> TorqueBalance:
    """Shares of the parts (n,) in the measured torque (n,), over all and in octaves below the end of band_hz."""
    names, torques = tuple(parts), np.stack(list(parts.values()))
    dry = np.array([name not in FRICTION for name in names])
    shares, left, without = _explained(measured[None], torques[:, None], dry)
    window = np.hanning(len(measured) + 1)[:-1]
    U, T = np.fft.rfft(window * measured), np.fft.rfft(window * torques)
    octaves = list(octave_lines(band_hz, rate_hz, len(measured)))
    total = max(float(sum(np.sum(np.abs(U[inside]) ** 2) for _, _, inside in octaves)), 1e-300)
    bands = tuple(
        BandBalance(low, high, float(np.sum(np.abs(U[inside]) ** 2)) / total, *_explained(U[inside], T[:, inside], dry))
        for low, high, inside in octaves
    )
    return TorqueBalance(
        place, log, unit, rate_hz, names, measured, torques, shares, left, without, bands, rate_is_known
    )


def octave_lines(band_hz: tuple[float, float], rate_hz: float, n: int) -> Iterator[tuple[float, float, BoolArray]]:
    """Octaves below the top of band_hz, upwards, the lowest down to its bottom: ends, and lines of a DFT of n."""
    low, high = band_hz
    edges = [high]
    # Below four lines, those of the window, a band is that of a neighbour.
    while edges[-1] / 2 > max(2 * low, 4 * (rate_hz / n)):
        edges.append(edges[-1] / 2)
    if low < edges[-1]:
        edges.append(low)
    freq_hz = np.fft.rfftfreq(n, 1 / rate_hz)
    for first, last in pairwise(reversed(edges)):
        yield first, last, (freq_hz >= first) & (freq_hz < last)


def describe_balance(balance: TorqueBalance) -> str:
    """Shares of the parts in a sentence."""
    shares = ", ".join(f"{part} {share:.1%}" for part, share in zip(balance.parts, balance.shares, strict=True))
    worst, unit = balance.worst, "Hz" if balance.rate_is_known else "of the sampling rate"
    return (
        f"{balance.place}, {balance.log}: of the mean square of the torque {shares}; {balance.left:.1%} is left "
        f"(without friction {balance.left_without_friction:.1%}), most from {worst.low_hz:.3g} to {worst.high_hz:.3g} "
        f"{unit}: {worst.left:.0%} of the {worst.power:.2%} of the power there."
    )


def _explained(
    measured: FloatArray | ComplexArray, torques: FloatArray | ComplexArray, no_friction: FloatArray
) -> tuple[tuple[float, ...], float, float]:
    """Shares of torques (n_p, ...), and those of the residuals of all of them and of those without friction."""
    n_p = len(torques)
    u, parts = measured.ravel(), torques.reshape(n_p, -1)
    power = max(float(np.sum(np.abs(u) ** 2)), 1e-300)
    shares = tuple(float(share) for share in (parts @ u.conj()).real / power)
    left, without = (
        float(np.sum(np.abs(u - chosen.sum(axis=0)) ** 2)) / power for chosen in (parts, parts[no_friction])
    )
    return shares, left, without


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

    held_hz: bandwidth of the loop about the logged motion, 0 under the controller's reference.  seconds: of the log
    that were simulated.  lost: why there is no result; empty where there is.
    """

    log: str
    drive: Drive
    held_hz: float
    seconds: float
    rate_hz: float
    signals: tuple[TwinSignal, ...] = ()
    lost: str = ""

    def of(self, kind: SignalKind) -> tuple[TwinSignal, ...]:
        """The signals of a kind."""
        return tuple(signal for signal in self.signals if signal.kind == kind)


@dataclass(frozen=True)
class TwinFindings:
    """The torque of logs part by part, and the twin moved along them; missing: joints not predicted there, and why."""

    balances: tuple[TorqueBalance, ...] = ()
    runs: tuple[TwinRun, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def run_words(self) -> tuple[str, ...]:
        """Errors of the twin in each run."""
        return tuple(map(describe_run, self.runs))

    @property
    def words(self) -> tuple[str, ...]:
        """The torque of each joint, then the simulations."""
        return (*map(describe_balance, self.balances), *self.run_words)


NO_TWIN = TwinFindings()


def describe_run(run: TwinRun) -> str:
    """Errors of the twin along its log, in a sentence or two."""
    if run.lost:
        return f"Simulated forwards on {run.log}, driven by its {_DRIVES[run.drive]}, the twin is lost: {run.lost}."
    held = f", held on the log by a loop of {run.held_hz:.2g} Hz" if run.held_hz else ""
    errors = {kind: [100 * signal.error for signal in run.of(kind)] for kind in (MOTION, TORQUE, LINK)}
    parts = [f"{kind} at most {max(values):.3g} %" for kind, values in errors.items() if values]
    return (
        f"Simulated forwards over {run.seconds:.3g} s of {run.log}, driven by its {_DRIVES[run.drive]}{held}, the twin "
        f"is off by (rms error over rms signal): {'; '.join(parts)}."
    )


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


def holding_gains(plant: Plant, bandwidth_hz: float) -> Gains:
    """Gains of a loop about the logged motion, damped critically, so that it adds no resonance."""
    return tune(plant.model, plant.point.q, bandwidth_hz, 1.0)


def follow(
    plant: Plant, commands: Commands, moving: BoolArray, held: Gains, position: FloatArray, velocity: FloatArray
) -> Trajectory:
    """Trajectory from position and velocity (n_u,) of the motors; DataError where one is lost.

    held: gains of motors that move (n_u,); others are held by a loop of 5 Hz.
    """
    model, point, resting = plant.model, plant.point, holding_gains(plant, 5.0)
    gains = Gains(*(np.where(moving, getattr(held, name), getattr(resting, name)) for name in ("kp", "kd", "ki")))
    (q,) = rigid_path(model, point.q, point.configuration.angles, position[None])
    return simulate(plant.loop, gains, commands, q, v0=rigid_motion(model, q) @ velocity)
