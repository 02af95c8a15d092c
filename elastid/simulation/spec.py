"""The section `controller` of a study: the joint controller, by a bandwidth or by its gains and filters."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
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
    joint: Annotated[str, Key("Name of the driven joint whose feedback is filtered.", "the axis whose sensitivity has "
        "its peak at this frequency.")]
    freq_hz: Annotated[Frequency, Key("Centre frequency of the notch.", "mean frequency of the resonance over all "
        "postures.", above=0)]
    width: Annotated[float, Key("Width w relative to the centre frequency.", "larger for a resonance that varies with "
        "posture; it costs phase at lower frequencies.", above=0)] = 1.0
    depth: Annotated[float, Key("Gain d at the centre frequency, 0 to 1.", "0.1 to 0.3; a deeper notch costs more "
        "phase.", least=0, most=1)] = 0.2
    # fmt: on


@section
class GainsSpec:
    """A cascade by its numbers: u = H K_v [e + (1 / T_i) integral of e], e = K_p (q_ref - q) + q_ref' - q'.

    q: angle of the motor on the link side, H: notches and low pass.
    """

    # fmt: off
    position_gain: Annotated[PositionGain | tuple[PositionGain, ...], Key("Gain K_p of the position loop, one number "
        "or one per driven joint.", "2 pi times the position bandwidth, a quarter of the velocity bandwidth.", above=0)]
    velocity_gain: Annotated[Damping | tuple[Damping, ...], Key("Gain K_v of the velocity loop on the link side, one "
        "number or one per driven joint.", "inertia of the axis times 2 pi times the velocity bandwidth; motor-side "
        "values are ratio^2 times smaller.", above=0)]
    integral_time: Annotated[Time | tuple[Time, ...] | None, Key("Integral time T_i of the velocity loop (default: no "
        "integral), one number or one per driven joint.", "longer if the loop oscillates slowly.", above=0)] = None
    notches: Annotated[tuple[NotchSpec, ...], Key("Notch filters in the feedback.", "one at each resonance that limits "
        "the gain.")] = ()
    low_pass_hz: Annotated[Frequency | tuple[Frequency, ...] | None, Key("Corner frequency of a second-order low-pass "
        "filter in the feedback (default: none), one number or one per driven joint.", "lower against encoder noise "
        "and high resonances; its delay is 0.23 / low_pass_hz.", above=0)] = None
    # fmt: on

    def refusals(self, joints: Sequence[str], rate_hz: float) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield keys that do not go with driven joints and a rate, and why."""
        for name in ("position_gain", "velocity_gain", "integral_time", "low_pass_hz"):
            count = np.size(getattr(self, name))  # 1 without a number
            if count not in (1, len(joints)):
                yield (name,), f"{count} numbers for {len(joints)} driven joints; give one for all or one for each"
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
class ReferencePathSpec:
    """The path of a reference from the played file to the joint controller, and the format of that file."""

    # fmt: off
    cycle: Annotated[Time, Key("Cycle at which the robot accepts references.", "the cycle of the interface, such as 4 "
        "or 12 ms; the controller's sampling time must divide it.", above=0)]
    interpolation: Annotated[Literal["hold", "linear", "spline"], Key("Interpolation between two references: `hold`, "
        "`linear` (reaches each reference one cycle later), or `spline` (cubic, with central differences as velocities "
        "at the references).", "`spline` for a joint trajectory controller, `linear` for most other "
        "interfaces.")] = "linear"
    filter_hz: Annotated[Frequency | None, Key("Corner frequency of the low pass behind the interpolation (default: no "
        "filter).", "needed if the robot smooths references: without it, the torque is lower than planned; "
        "a lookahead of T s is a filter of 1 / (2 pi T) Hz.", above=0)] = None
    filter_order: Annotated[int, Key("Order of the low pass: number of equal first-order lags in series.", "2 for a "
        "critically damped filter of second order.", least=1, most=4)] = 1
    moving_average: Annotated[Time, Key("Window of the moving average behind the interpolation.", "the jerk filter of "
        "many drives is a moving average; the band must end below 1 / moving_average.", least=0)] = 0.0
    velocity_feedforward: Annotated[float, Key("Fraction of the reference's velocity that the velocity loop receives.",
        "1 for most drives; 0 if the drive follows with a lag of 1 / K_p.", least=0, most=1)] = 1.0
    unit: Annotated[Literal["rad", "deg", "increments"], Key("Unit of the references in the file.", "`increments` for "
        "drives; experiment.simulated.noise.encoder_counts is then the number per motor turn.")] = "rad"
    side: Annotated[Literal["link", "motor"], Key("Side of the gear on which the references in the file are.",
        "`motor` for drives without a gear ratio among their parameters.")] = "link"
    # fmt: on

    def cycle_refusal(self, rate_hz: float, period_samples: int, highest_hz: float) -> str:
        """Return reason why the cycle does not fit a controller's rate, period and band; empty if it fits."""
        n = self.cycle * rate_hz
        if abs(n - round(n)) > 1e-6 * n or round(n) < 1 or period_samples % round(n):
            return f"{self.cycle:g} s is not a multiple of 1 / {rate_hz:g} s that divides the period"
        if highest_hz * self.cycle >= 0.5:
            limit = f"end the band below {0.5 / self.cycle:g} Hz"
            return f"references every {self.cycle:g} s cannot excite {highest_hz:g} Hz; {limit}"
        return ""

    def cycle_samples(self, rate_hz: float) -> int:
        """Return samples of a controller at rate_hz in a cycle."""
        return round(self.cycle * rate_hz)


@section
class ControllerSpec:
    """The joint controller that closes the loop: position and velocity feedback of the motor, gravity feed-forward."""

    # fmt: off
    bandwidth_hz: Annotated[Frequency, Key("Bandwidth of the position loop.", "below a third of the first "
        "antiresonance, so that the loop does not suppress the excitation.", above=0)] = 1.5
    damping_ratio: Annotated[float, Key("Damping ratio of the position loop.", "0.7 to 1; 0.8 overshoots by less than "
        "2 %.", above=0)] = 0.8
    kind: Annotated[Literal["pd", "cascade"], Key("Structure of the controller: `pd`, or `cascade` (proportional "
        "position loop around a PI velocity loop).", "`cascade` for an industrial controller, whose integral action "
        "removes steady-state errors of friction.")] = "pd"
    integral_time: Annotated[Time | None, Key("Integral time of the cascade's velocity loop (default: three times 1 / "
        "[2 pi bandwidth_hz]).", "shorter values remove errors of friction and gravity sooner; Routh's criterion gives "
        "the lower limit.")] = None
    gains: Annotated[GainsSpec | None, Key("Gains and filters of the cascade (default: computed from bandwidth_hz, "
        "damping_ratio and integral_time).", "if the drive parameters are known, or as written by `elastid "
        "loops`.")] = None
    delay_samples: Annotated[int, Key("Delay from encoder sampling to torque, in samples.", "1 for most industrial "
        "controllers; each sample costs phase and bandwidth.", least=0, most=MAX_DELAY_SAMPLES)] = 0
    reference: Annotated[ReferencePathSpec | None, Key("Path of the references into the controller (default: none, "
        "torque is injected).", "give it with excitation.inject: position or velocity.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.kind == "pd" and (self.integral_time, self.gains) != (None, None):
            raise ValueError("integral_time and gains belong to kind: cascade. Give bandwidth_hz and damping_ratio")
        if self.gains is not None:
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

    def scaled(self, position: float, velocity: float) -> "ControllerSpec":
        """Return controller with K_p times `position` and K_v times `velocity`, the integral time unchanged."""
        if (gains := self.gains) is not None:
            K_p, K_v = gains.position_gain, gains.velocity_gain
            K_p, K_v = (tuple((np.atleast_1d(K) * x).tolist()) for K, x in ((K_p, position), (K_v, velocity)))
            return replace(self, gains=replace(gains, position_gain=K_p, velocity_gain=K_v))
        bandwidth_hz, ratio = self.bandwidth_hz * math.sqrt(position * velocity), math.sqrt(velocity / position)
        numbers = bandwidth_hz, self.damping_ratio * ratio, self.velocity_integral_time
        return replace(self, bandwidth_hz=numbers[0], damping_ratio=numbers[1], integral_time=numbers[2])

    @property
    def velocity_integral_time(self) -> float | None:
        """T_i in s, or None without integral action."""
        if self.kind == "pd":
            return None
        return 3 / (2 * math.pi * self.bandwidth_hz) if self.integral_time is None else self.integral_time
