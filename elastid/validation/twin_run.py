r"""The twin of a robot moved like its log: the identified model with and without friction, simulated forwards.

.. math:: error_i = \sqrt{\overline{(y_i - \hat y_i)^2}} \,/\, \sqrt{\overline{(y_i - \bar y_i)^2}}

over time, and by octave the same of the spectra of Hann's window. What drives the twin is one of two:

`reference`: that of the robot's controller, through the same controller. Motion and torque are the twin's own.
`torque`: that of the log. A robot under a torque alone drifts, since its motors have no springs and gravity may pull it
further away; so a loop about the logged motion, slower than what is judged, holds the twin. The torque that this loop
adds is what the model lacks at low frequencies, and is shown as error of the torque.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value, labelled
from elastid.experiment.simulated.plant import Plant, exact_plant
from elastid.linear.equilibrium import OperatingPoint
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.closed_loop import Commands, Trajectory, simulate
from elastid.simulation.controller import Gains, rigid_motion, tune
from elastid.validation.twin import MIN_POWER_SHARE, TorqueBalance, describe_balance, octave_lines

Drive: TypeAlias = Literal["reference", "torque"]
SignalKind: TypeAlias = Literal["torque", "motor angle", "link motion"]
TORQUE: Final = "torque"
MOTION: Final = "motor angle"
LINK: Final = "link motion"
_DRIVES = {"reference": "reference through its controller", "torque": "torque"}
# Of a log this much is simulated at most.
LONGEST_S = 30.0
NO_CONTROLLER = (
    "No controller of these logs is declared, so that no reference is followed and their torque alone drives the model "
    "(a study of friction declares it in experiment.recorded.controller)."
)


@dataclass(frozen=True)
class BandError:
    """Rms error over rms signal between two frequencies in Hz; power: share of the signal's that lies there.

    error_without_friction: of the twin without its friction, NaN where it has none or was lost.
    """

    low_hz: float
    high_hz: float
    power: float
    error: float
    error_without_friction: float


@frozen_value
class TwinSignal:
    """One signal (n,) of a log and of its twin, link side, in SI, at rate_hz of its run.

    frictionless (n,): of the twin without friction; (0,) where the model has none, or where it was lost.
    error, error_without_friction: rms error over the rms of the signal about its mean, the latter NaN without.
    bands: the same by octave.  ValueError where shapes disagree.
    """

    kind: SignalKind
    place: str
    unit: str
    measured: FloatArray = labelled("as measured, link side", "{unit}", "sample")
    simulated: FloatArray = labelled("of the twin", "{unit}", "sample")
    frictionless: FloatArray = labelled("of the twin without friction", "{unit}", "sample")
    error: float
    error_without_friction: float
    bands: tuple[BandError, ...]

    @property
    def worst(self) -> BandError | None:
        """The octave of the largest error, of those with power."""
        return max(
            (band for band in self.bands if band.power >= MIN_POWER_SHARE), key=lambda band: band.error, default=None
        )

    def __post_init__(self) -> None:
        """Check shapes."""
        if self.simulated.shape != self.measured.shape or len(self.frictionless) not in (0, len(self.measured)):
            raise ValueError(
                f"{self.kind} at {self.place}: measured {self.measured.shape}, simulated {self.simulated.shape}, "
                f"frictionless {self.frictionless.shape}"
            )


@dataclass(frozen=True)
class TwinRun:
    """The twin moved along one log.

    held_hz: bandwidth of the loop about the logged motion, 0 under the controller's reference.  seconds: of the log
    that were simulated.  lost: why there is no result, and lost_without_friction: why there is none of the twin without
    friction; empty where there is.
    """

    log: str
    drive: Drive
    held_hz: float
    seconds: float
    rate_hz: float
    signals: tuple[TwinSignal, ...] = ()
    lost: str = ""
    lost_without_friction: str = ""

    def of(self, kind: SignalKind) -> tuple[TwinSignal, ...]:
        """The signals of a kind."""
        return tuple(signal for signal in self.signals if signal.kind == kind)


@dataclass(frozen=True)
class TwinFindings:
    """The torque of logs part by part, and the twin moved along them."""

    balances: tuple[TorqueBalance, ...] = ()
    runs: tuple[TwinRun, ...] = ()

    @property
    def run_words(self) -> tuple[str, ...]:
        """Errors of the twin in each run, and the reason why none follows a reference where none does."""
        words = tuple(map(describe_run, self.runs))
        return (*words, NO_CONTROLLER) if words and all(run.drive == "torque" for run in self.runs) else words


NO_TWIN = TwinFindings()


def twin_signal(
    kind: SignalKind,
    place: str,
    unit: str,
    signals: tuple[FloatArray, FloatArray, FloatArray | None],
    rate_hz: float,
    band_hz: tuple[float, float],
) -> TwinSignal:
    """The errors of a signal; signals (n,) each: measured, simulated, and of the twin without friction."""
    measured, simulated, free = signals
    scale = max(float(np.std(measured)), 1e-300)
    error, without = (
        math.nan if each is None else float(np.sqrt(np.mean((measured - each) ** 2))) / scale
        for each in (simulated, free)
    )
    bands = tuple(_band_errors(signals, rate_hz, band_hz))
    free = np.zeros(0) if free is None else free
    return TwinSignal(kind, place, unit, measured, simulated, free, error, without, bands)


def _band_errors(
    signals: tuple[FloatArray, FloatArray, FloatArray | None], rate_hz: float, band_hz: tuple[float, float]
) -> Iterator[BandError]:
    measured, simulated, free = signals
    window = np.hanning(len(measured) + 1)[:-1]
    power = np.abs(np.fft.rfft(window * (measured - measured.mean()))) ** 2
    errors = [
        np.full(len(power), np.nan) if each is None else np.abs(np.fft.rfft(window * (measured - each))) ** 2
        for each in (simulated, free)
    ]
    bands = list(octave_lines(band_hz, rate_hz, len(measured)))
    total = max(sum(float(power[inside].sum()) for _, _, inside in bands), 1e-300)
    for low, high, inside in bands:
        own = float(power[inside].sum())
        both = (math.sqrt(float(each[inside].sum()) / max(own, 1e-300)) for each in errors)
        yield BandError(low, high, own / total, *both)


def describe_run(run: TwinRun) -> str:
    """Errors of the twin along its log, in two or three sentences."""
    if run.lost:
        return f"Simulated forwards on {run.log}, driven by its {_DRIVES[run.drive]}, the twin is lost: {run.lost}."
    held = f", held on the log by a loop of {run.held_hz:.2g} Hz" if run.held_hz else ""
    parts = [
        f"{kind if len(signals) == 1 else kind + 's'} {_spread([s.error for s in signals])}"
        f"{_without([s.error_without_friction for s in signals])}"
        for kind in (MOTION, TORQUE, LINK)
        if (signals := run.of(kind))
    ]
    text = (
        f"Simulated forwards over {run.seconds:.3g} s of {run.log}, driven by its {_DRIVES[run.drive]}{held}, the twin "
        f"is off by (rms error over rms signal): {'; '.join(parts)}."
    )
    if run.lost_without_friction:
        text += f" Without friction it is lost: {run.lost_without_friction}."
    pairs = [(signal, signal.worst) for signal in run.signals if signal.worst is not None]
    if not pairs:
        return f"{text} "
    signal, band = max(pairs, key=lambda pair: pair[1].error)
    return (
        f"{text} By octaves it is worst from {band.low_hz:.3g} to {band.high_hz:.3g} Hz in the {signal.kind} of "
        f"{signal.place}: {100 * band.error:.3g} % of the signal in it, which is {100 * band.power:.2g} % of its power."
    )


def _spread(errors: Sequence[float]) -> str:
    """A share, or the range of several."""
    low, high = min(errors), max(errors)
    return f"{100 * high:.3g} %" if len(errors) == 1 else f"{100 * low:.3g} to {100 * high:.3g} %"


def _without(errors: Sequence[float]) -> str:
    known = [error for error in errors if math.isfinite(error)]
    return f" (without friction {_spread(known)})" if known else ""


@dataclass(frozen=True)
class TwinPlant:
    """A robot at rest where its log begins, as equations, with exact drives and encoders and without limits."""

    plant: Plant
    point: OperatingPoint

    @classmethod
    def of(cls, robot: Robot, rate_hz: float, start: Configuration, spec: ModelSpec = EXACT) -> TwinPlant:
        """With as many steps a sample as its fastest pole takes; StudyError where it finds no rest."""
        plant, point = exact_plant(robot, spec, rate_hz, start)
        free = np.tile([-np.inf, np.inf], (plant.model.n_u, 1))
        return cls(Plant(plant.model, replace(plant.loop, limits=free)), point)

    def holding_gains(self, bandwidth_hz: float) -> Gains:
        """Of a loop about the logged motion, damped critically, so that it adds no resonance."""
        return tune(self.plant.model, self.point.q, bandwidth_hz, 1.0)

    def gains(self, moving: BoolArray, held: Gains) -> Gains:
        """Those of `held` for motors that move (n_u,), of a loop of 5 Hz for the others."""
        resting = self.holding_gains(5.0)
        return Gains(*(np.where(moving, getattr(held, name), getattr(resting, name)) for name in ("kp", "kd", "ki")))

    def moved(self, gains: Gains, commands: Commands, velocity: FloatArray, q: FloatArray | None = None) -> Trajectory:
        """From q (n_q,), or the rest of the springs, motors at this velocity (n_u,); DataError where one is lost."""
        q = self.point.q if q is None else q
        return simulate(self.plant.loop, gains, commands, q, v0=rigid_motion(self.plant.model, q) @ velocity)


@dataclass(frozen=True)
class Prediction:
    """Torque and motion along logs by a result of others.

    own: the torque by a regression of these logs themselves, as far as there is one; refused: why there is none.
    missing: reason by joint that is not predicted, in some log or all.
    """

    twin: TwinFindings = NO_TWIN
    own: tuple[TorqueBalance, ...] = ()
    refused: str = ""
    missing: Mapping[str, str] = field(default_factory=dict)

    def own_of(self, balance: TorqueBalance) -> TorqueBalance | None:
        """The same joint in the same log by the regression of these logs."""
        return next((own for own in self.own if (own.place, own.log) == (balance.place, balance.log)), None)

    @property
    def words(self) -> tuple[str, ...]:
        """The torque of each joint, then the simulations."""
        torques = [f"{describe_balance(balance)} {self.rms_words(balance)}" for balance in self.twin.balances]
        return (*torques, *([self.refused] if self.refused else []), *self.twin.run_words)

    def rms_words(self, balance: TorqueBalance) -> str:
        """The rms of what is left of a torque, compared with what a regression of the same logs leaves."""
        own = self.own_of(balance)
        compared = "" if own is None else f"; a regression of these logs themselves leaves {math.sqrt(own.left):.1%}"
        return f"As an rms {math.sqrt(balance.left):.1%} of the torque is left{compared}."


NO_PREDICTION = Prediction()
