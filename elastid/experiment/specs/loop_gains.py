"""Gains, notches and low passes of a controller, axis by axis, as `elastid loops` finds them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated

import numpy as np

from elastid.base.section import Key, section
from elastid.base.units import Damping, Frequency, InUnit, Time

PositionGain = Annotated[float, InUnit("1/s")]
MAX_DELAY_SAMPLES = 20  # beyond, a controller is not sampled but waits


@section
class NotchSpec:
    """A notch (s^2 + d w o s + o^2) / (s^2 + w o s + o^2) behind the feedback of a motor, o = 2 pi freq_hz."""

    # fmt: off
    joint: Annotated[str, Key("Name of the driven joint whose feedback it filters.", "the axis whose sensitivity "
        "peaks at this frequency; another one only loses phase.")]
    freq_hz: Annotated[Frequency, Key("Frequency of the notch.", "in the middle of where the resonance is over all "
        "postures.")]
    width: Annotated[float, Key("Width w over the frequency.", "wider for a resonance that moves with posture or is "
        "barely known; it costs phase below.")] = 1.0
    depth: Annotated[float, Key("Gain d that is left at the frequency, 0 to 1.", "0.1 to 0.3; deeper costs more phase "
        "and gains little.")] = 0.2
    # fmt: on

    def __post_init__(self) -> None:
        if not self.freq_hz > 0 or not self.width > 0 or not 0 <= self.depth <= 1:
            raise ValueError(
                f"freq_hz {self.freq_hz:g} and width {self.width:g} must be positive, and depth {self.depth:g} from 0 "
                "to 1"
            )


@section
class GainsSpec:
    """A cascade by its numbers: u = H K_v [e + (1 / T_i) integral of e], e = K_p (q_ref - q) + q_ref' - q'.

    q: angle of the motor on the link side, H: notches and low pass.
    """

    # fmt: off
    position_gain: Annotated[PositionGain | tuple[PositionGain, ...], Key("Gain K_p of the position loop, one number "
        "or one for each driven joint.", "2 pi times the bandwidth that the axis is to have, a quarter of that of its "
        "velocity loop.")]
    velocity_gain: Annotated[Damping | tuple[Damping, ...], Key("Gain K_v of the velocity loop on the link side, one "
        "number or one for each driven joint.", "the inertia of the axis times 2 pi times the bandwidth of the "
        "velocity loop; the motor's side has ratio^2 times less.")]
    integral_time: Annotated[Time | tuple[Time, ...] | None, Key("Integral time T_i of the velocity loop (default: no "
        "integral), one number or one for each driven joint.", "longer where the loop swings slowly.")] = None
    notches: Annotated[tuple[NotchSpec, ...], Key("Notches behind the feedback.", "one at a resonance that limits the "
        "gain.")] = ()
    low_pass_hz: Annotated[Frequency | tuple[Frequency, ...] | None, Key("Corner of a low pass of second order behind "
        "the feedback (default: none), one number or one for each driven joint.", "lower against noise of the encoder "
        "and fast resonances; it delays by 0.23 / low_pass_hz.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        for name, values in self._numbers():
            if not len(values) or not np.all(values > 0):
                raise ValueError(f"{name} is {getattr(self, name)}; a loop has positive numbers")

    def _numbers(self) -> Iterator[tuple[str, np.ndarray]]:
        for name in ("position_gain", "velocity_gain", "integral_time", "low_pass_hz"):
            if getattr(self, name) is not None:
                yield name, np.atleast_1d(np.asarray(getattr(self, name), float))

    def refusals(self, joints: Sequence[str], rate_hz: float) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Keys that do not go with driven joints and a rate, and why."""
        for name, values in self._numbers():
            if len(values) not in (1, len(joints)):
                yield (
                    (name,),
                    f"{len(values)} numbers for {len(joints)} driven joints; give one for all or one for each",
                )
        for i, own in enumerate(self.notches):
            if own.joint not in joints:
                yield ("notches", i, "joint"), f"no driven joint is called '{own.joint}'; there are {', '.join(joints)}"
            if own.freq_hz >= rate_hz / 2:
                yield ("notches", i, "freq_hz"), _too_fast(own.freq_hz, rate_hz)
        if self.low_pass_hz is not None and (fastest := float(np.max(self.low_pass_hz))) >= rate_hz / 2:
            yield ("low_pass_hz",), _too_fast(fastest, rate_hz)


def _too_fast(freq_hz: float, rate_hz: float) -> str:
    return f"{freq_hz:g} Hz is not below half the controller's rate of {rate_hz:g} Hz; lower it, or leave it out"
