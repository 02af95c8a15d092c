"""LogComparison: a log compared with the model, its torque part by part and its simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled

Drive: TypeAlias = Literal["reference", "torque"]
SignalKind: TypeAlias = Literal["torque", "motor angle", "link motion"]
TORQUE: Final = "torque"
MOTION: Final = "motor angle"
LINK: Final = "link motion"
_DRIVES = {"reference": "reference through its controller", "torque": "torque"}
# Parts of a model's torque, as tables and figures name them; `FRICTION`: those that a model without friction lacks.
INERTIA, GRAVITY, RIGID_BODY, ELASTICITY = "inertia", "gravity and offset", "rigid body", "elasticity"
VISCOUS, DRY = "viscous friction", "dry friction"
FRICTION = (VISCOUS, DRY)
# An octave with less of the torque's power holds noise, or what the window leaks.
MIN_POWER_SHARE = 1e-4


@dataclass(frozen=True)
class BandBalance:
    """Torque balance between two frequencies in Hz: power, its fraction of the total, fractions of each term, and
    residual.

    unexplained_without_friction: by the model without its friction.
    """

    low_hz: float
    high_hz: float
    power: float
    fractions: tuple[float, ...]
    unexplained_fraction: float
    unexplained_without_friction: float


@frozen_value
class TorqueBalance:
    """The torque of one motor in one log, link side.

    place: of its motor or joint.  log: name of the record.  unit: of the torque.  rate_hz: of the samples; without a
    known rate frequencies are in units of it.  parts: names; torques (n_p, n): of each.  measured (n,).
    fractions: of each part in the mean square of the torque.  unexplained_fraction: of it by the whole model.
    unexplained_without_friction: by the model without its friction.  bands: the same by octave, upwards.
    """

    place: str
    log: str
    unit: str
    rate_hz: float
    parts: tuple[str, ...]
    measured: FloatArray = labelled("torque as measured, link side", "{unit}", "sample")
    torques: FloatArray = labelled("torque of each part of the model", "{unit}", "parts sample")
    fractions: tuple[float, ...]
    unexplained_fraction: float
    unexplained_without_friction: float
    bands: tuple[BandBalance, ...]
    has_rate: bool = True

    @property
    def worst(self) -> BandBalance:
        """Octave with the largest residual fraction among octaves with power."""
        bands = [band for band in self.bands if band.power >= MIN_POWER_SHARE]
        return max(bands, key=lambda band: band.unexplained_fraction)

    @property
    def sentence(self) -> str:
        """Shares of the parts in a sentence."""
        pairs = zip(self.parts, self.fractions, strict=True)
        fractions = ", ".join(f"{component} {fraction:.1%}" for component, fraction in pairs)
        worst, unit = self.worst, "Hz" if self.has_rate else "of the sampling rate"
        return (
            f"{self.place}, {self.log}: contributions to the mean-square torque: {fractions}. Unexplained: "
            f"{self.unexplained_fraction:.1%}, at most "
            f"{worst.unexplained_fraction:.0%} from {worst.low_hz:.3g} to {worst.high_hz:.3g} {unit}."
        )

    @property
    def residual(self) -> FloatArray:
        """Measured less modelled torque (n,)."""
        return np.asarray(self.measured - self.torques.sum(axis=0))

    def torque_sum(self, names: Sequence[str]) -> FloatArray:
        """Return the torque (n,) of these parts together, 0 of those that the model lacks."""
        return np.asarray(self.torques[[name in names for name in self.parts]].sum(axis=0))


@frozen_value
class ComparedSignal:
    """One signal (n,) of a log and of its simulation, link side, in SI, at rate_hz of its run."""

    kind: SignalKind
    place: str
    unit: str
    measured: FloatArray = labelled("as measured, link side", "{unit}", "sample")
    simulated: FloatArray = labelled("simulated", "{unit}", "sample")

    @property
    def error(self) -> float:
        """Rms error over the rms of the signal about its mean."""
        rms = float(np.sqrt(np.mean((self.measured - self.simulated) ** 2)))
        return rms / max(float(np.std(self.measured)), 1e-300)


@dataclass(frozen=True)
class LogSimulation:
    """Simulation along one log.

    tracking_bandwidth_hz: of the loop about the logged motion, 0 under the controller's reference.  seconds: simulated
    duration of the log.  lost: why there is no result; empty where there is.
    """

    log: str
    drive: Drive
    tracking_bandwidth_hz: float
    seconds: float
    rate_hz: float
    signals: tuple[ComparedSignal, ...] = ()
    lost: str = ""

    def of(self, kind: SignalKind) -> tuple[ComparedSignal, ...]:
        """Return the signals of a kind."""
        return tuple(signal for signal in self.signals if signal.kind == kind)

    @property
    def sentence(self) -> str:
        """Simulation errors along the log, in one sentence."""
        driven = f"with the logged {_DRIVES[self.drive]} as input"
        if self.lost:
            return f"Simulation of record {self.log} {driven}: diverged, {self.lost}."
        held_hz = self.tracking_bandwidth_hz
        aid = f". A slow position loop ({held_hz:.2g} Hz) keeps the model at the logged positions" if held_hz else ""
        errors = {kind: [100 * signal.error for signal in self.of(kind)] for kind in (MOTION, TORQUE, LINK)}
        loop = errors.pop(TORQUE) if aid else []
        phrases = [f"{kind} at most {max(values):.3g} %" for kind, values in errors.items() if values]
        of_loop = ""
        if loop:
            of_loop = f" The torque of the position loop is at most {max(loop):.3g} % of the logged torque (rms)."
        return (
            f"Simulation of {self.seconds:.3g} s of record {self.log} {driven}{aid}. Rms errors in percent "
            f"of the rms signal: {', '.join(phrases)}.{of_loop}"
        )


@dataclass(frozen=True)
class LogComparison:
    """Torque of logs part by part, and simulations along them; missing: joints not predicted there, and why."""

    balances: tuple[TorqueBalance, ...] = ()
    runs: tuple[LogSimulation, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The torque of each joint, then the simulations."""
        return (*(balance.sentence for balance in self.balances), *(run.sentence for run in self.runs))


NO_COMPARISON = LogComparison()
