"""The section `controller` of a study: the joint controller, by a bandwidth or by its gains and filters."""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

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
        "postures.", above=0)]
    width: Annotated[float, Key("Width w over the frequency.", "wider for a resonance that moves with posture or is "
        "barely known; it costs phase below.", above=0)] = 1.0
    depth: Annotated[float, Key("Gain d that is left at the frequency, 0 to 1.", "0.1 to 0.3; deeper costs more phase "
        "and gains little.", least=0, most=1)] = 0.2
    # fmt: on


@section
class GainsSpec:
    """A cascade by its numbers: u = H K_v [e + (1 / T_i) integral of e], e = K_p (q_ref - q) + q_ref' - q'.

    q: angle of the motor on the link side, H: notches and low pass.
    """

    # fmt: off
    position_gain: Annotated[PositionGain | tuple[PositionGain, ...], Key("Gain K_p of the position loop, one number "
        "or one for each driven joint.", "2 pi times the bandwidth that the axis is to have, a quarter of that of its "
        "velocity loop.", above=0)]
    velocity_gain: Annotated[Damping | tuple[Damping, ...], Key("Gain K_v of the velocity loop on the link side, one "
        "number or one for each driven joint.", "the inertia of the axis times 2 pi times the bandwidth of the "
        "velocity loop; the motor's side has ratio^2 times less.", above=0)]
    integral_time: Annotated[Time | tuple[Time, ...] | None, Key("Integral time T_i of the velocity loop (default: no "
        "integral), one number or one for each driven joint.", "longer where the loop swings slowly.", above=0)] = None
    notches: Annotated[tuple[NotchSpec, ...], Key("Notches behind the feedback.", "one at a resonance that limits the "
        "gain.")] = ()
    low_pass_hz: Annotated[Frequency | tuple[Frequency, ...] | None, Key("Corner of a low pass of second order behind "
        "the feedback (default: none), one number or one for each driven joint.", "lower against noise of the encoder "
        "and fast resonances; it delays by 0.23 / low_pass_hz.", above=0)] = None
    # fmt: on

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
        for i, notch in enumerate(self.notches):
            if notch.joint not in joints:
                yield ("notches", i, "joint"), f"no driven joint '{notch.joint}'; there are {', '.join(joints)}"
            if notch.freq_hz >= rate_hz / 2:
                yield ("notches", i, "freq_hz"), _too_fast(notch.freq_hz, rate_hz)
        if self.low_pass_hz is not None and (fastest := float(np.max(self.low_pass_hz))) >= rate_hz / 2:
            yield ("low_pass_hz",), _too_fast(fastest, rate_hz)


def _too_fast(freq_hz: float, rate_hz: float) -> str:
    return f"{freq_hz:g} Hz is not below half the controller's rate of {rate_hz:g} Hz; lower it, or leave it out"


@section
class ControllerSpec:
    """The joint controller that closes the loop: position and velocity feedback of the motor, gravity feed-forward."""

    # fmt: off
    bandwidth_hz: Annotated[Frequency, Key("Bandwidth of the position loop about the configuration.", "low, so that "
        "the plant and not the loop is excited: below a third of the first antiresonance. Higher holds posture against "
        "friction, and takes low lines out of the motion. 1.5 Hz is a third of 4.5 Hz, about where a large axis has "
        "its first antiresonance.", above=0)] = 1.5
    damping_ratio: Annotated[float, Key("Damping ratio of the position loop.", "0.7 to 1; less lets the robot swing at "
        "bandwidth_hz, more makes the end of a reference slow. 0.8 overshoots by less than 2 %.", above=0)] = 0.8
    kind: Annotated[Literal["pd", "cascade"], Key("Structure of the controller: `pd`, or the `cascade` of robot "
        "controllers, a proportional position loop around a velocity loop.", "`cascade` where the rig stands for an "
        "industrial controller, whose integral ends the error of friction; `pd` has two numbers and no memory, so that "
        "nothing but the robot rings.")] = "pd"
    integral_time: Annotated[Time | None, Key("Integral time of the cascade's velocity loop (default: three times 1 / "
        "(2 pi bandwidth_hz)).", "shorter removes the error of friction and gravity sooner and costs stability: the "
        "study is refused below the limit of Routh's criterion.")] = None
    gains: Annotated[GainsSpec | None, Key("Gains and filters of the cascade by their numbers, in place of those that "
        "follow from bandwidth_hz, damping_ratio and integral_time.", "where the drives' parameters are known, or as "
        "`elastid loops` writes them.")] = None
    delay_samples: Annotated[int, Key("Samples that pass between the reading of the encoders and the torque that "
        "answers it.", "1 for most industrial controllers; each takes phase, and bandwidth.",
        least=0, most=MAX_DELAY_SAMPLES)] = 0
    # fmt: on

    def __post_init__(self) -> None:
        if self.kind == "pd" and self.integral_time is not None:
            raise ValueError("integral_time belongs to kind: cascade; a pd controller has none")
        if self.gains is not None:
            if self.kind == "pd":
                raise ValueError("gains belong to kind: cascade; a pd controller has bandwidth_hz and damping_ratio")
            if self.integral_time is not None:
                raise ValueError("integral_time is one of gains; drop it beside them")
            return
        # Routh's criterion for J s^3 + k_d s^2 + (k_p + k_d / T_i) s + k_p / T_i.
        omega, zeta = 2 * math.pi * self.bandwidth_hz, self.damping_ratio
        least = (1 - 4 * zeta**2) / (2 * zeta * omega)
        if self.velocity_integral_time is not None and not self.velocity_integral_time > max(0.0, least):
            raise ValueError(
                f"integral_time is {self.velocity_integral_time:g} s; the loop is stable above {max(0.0, least):.3g} s"
            )

    @property
    def velocity_integral_time(self) -> float | None:
        """T_i in s, or None where there is no integral."""
        if self.kind == "pd":
            return None
        return 3 / (2 * math.pi * self.bandwidth_hz) if self.integral_time is None else self.integral_time
