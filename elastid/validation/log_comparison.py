"""LogComparison: torque balances of logs and simulations along them, as values and sentences."""

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
# Names of the components of a model's torque; FRICTION: those that a model without friction lacks.
INERTIA, GRAVITY, RIGID_BODY, ELASTICITY = "inertia", "gravity and offset", "rigid body", "elasticity"
VISCOUS, DRY = "viscous friction", "dry friction"
FRICTION = (VISCOUS, DRY)
# Least fraction of the torque's power in an octave; smaller ones contain noise, or leakage of the window.
MIN_POWER_SHARE = 1e-4


@dataclass(frozen=True)
class BandBalance:
    """Torque balance between two frequencies in Hz, with the fraction of the power (see `TorqueBalance`)."""

    low_hz: float
    high_hz: float
    power: float
    fractions: tuple[float, ...]
    unexplained_fraction: float
    unexplained_without_friction: float


@frozen_value
class TorqueBalance:
    """Torque of one motor in one log, link side, and its components by the model.

    place: motor or joint.  log: name of the record.  rate_hz: unit of frequencies if the rate is unknown.  fractions:
    of each of the `parts` in the mean square of the torque.  unexplained_fraction: of the residual in the mean square;
    unexplained_without_friction: with the model without its friction.  bands: by octave, upwards.
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
        """Contributions of the components as a sentence."""
        pairs = zip(self.parts, self.fractions, strict=True)
        fractions = ", ".join(f"{component} {fraction:.1%}" for component, fraction in pairs)
        band, unit = self.worst, "Hz" if self.has_rate else "of the sampling rate"
        return (
            f"{self.place}, {self.log}: contributions to the mean-square torque: {fractions}. Unexplained: "
            f"{self.unexplained_fraction:.1%}, at most "
            f"{band.unexplained_fraction:.0%} from {band.low_hz:.3g} to {band.high_hz:.3g} {unit}."
        )

    @property
    def residual(self) -> FloatArray:
        """Measured minus modelled torque (n,)."""
        return np.asarray(self.measured - self.torques.sum(axis=0))

    def torque_sum(self, names: Sequence[str]) -> FloatArray:
        """Return the sum (n,) of these components; 0 for components that the model lacks."""
        return np.asarray(self.torques[[name in names for name in self.parts]].sum(axis=0))


@frozen_value
class ComparedSignal:
    """Signal (n,) of a log and of its simulation, link side, SI, at the rate of the simulation."""

    kind: SignalKind
    place: str
    unit: str
    measured: FloatArray = labelled("as measured, link side", "{unit}", "sample")
    simulated: FloatArray = labelled("simulated", "{unit}", "sample")

    @property
    def error(self) -> float:
        """Rms error over the standard deviation of the signal."""
        rms = float(np.sqrt(np.mean((self.measured - self.simulated) ** 2)))
        return rms / max(float(np.std(self.measured)), 1e-300)


@dataclass(frozen=True)
class LogSimulation:
    """Simulation along one log.

    tracking_bandwidth_hz: of the loop about the logged motion, 0 with the controller's reference.  seconds: simulated
    duration.  lost: reason of a missing result.
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
        """Simulation errors along the log as a sentence."""
        drive = f"with the logged {_DRIVES[self.drive]} as input"
        if self.lost:
            return f"Simulation of record {self.log} {drive}: diverged, {self.lost}."
        loop_hz = self.tracking_bandwidth_hz
        loop = f". A slow position loop ({loop_hz:.2g} Hz) keeps the model at the logged positions" if loop_hz else ""
        errors = {kind: [100 * signal.error for signal in self.of(kind)] for kind in (MOTION, TORQUE, LINK)}
        of_loop = ""
        if loop_hz and (values := errors.pop(TORQUE)):
            of_loop = f" The torque of the position loop is at most {max(values):.3g} % of the logged torque (rms)."
        phrases = [f"{kind} at most {max(values):.3g} %" for kind, values in errors.items() if values]
        return (
            f"Simulation of {self.seconds:.3g} s of record {self.log} {drive}{loop}. Rms errors in percent "
            f"of the rms signal: {', '.join(phrases)}.{of_loop}"
        )


@dataclass(frozen=True)
class LogComparison:
    """Torque balances of logs and simulations along them; missing: joints without a prediction, and the reason."""

    balances: tuple[TorqueBalance, ...] = ()
    runs: tuple[LogSimulation, ...] = ()
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences on the torque of each joint, then on the simulations."""
        return (*(balance.sentence for balance in self.balances), *(run.sentence for run in self.runs))


NO_COMPARISON = LogComparison()
