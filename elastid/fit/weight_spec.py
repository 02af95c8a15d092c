"""Weights of a fit: which elements count, and how much."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Literal, TypeAlias

from elastid.base.section import Key, section
from elastid.base.units import Frequency

Loss: TypeAlias = Literal["square", "huber", "soft_l1"]


def check_band(band_hz: tuple[float, float] | None) -> None:
    """Refuse a band that is empty or upside down; ValueError."""
    if band_hz is not None and not 0 <= band_hz[0] < band_hz[1]:
        raise ValueError(f"band_hz is [{band_hz[0]:g}, {band_hz[1]:g}]; give [lowest, highest]")


@section
class FactorSpec:
    """Multiplies the weight of elements that match all of the other keys given; several factors multiply."""

    # fmt: off
    factor: Annotated[float, Key("Factor of the weight; 0 leaves the elements out.", "0 for a channel "
        "or a band that is known to be wrong, such as lines at the mains frequency, with a comment that says why, "
        "since it hides misfit; 0.1 for elements that deserve less trust than their variance says, 10 for those that "
        "matter most; the intervals still count the noise as it was measured.")]
    configurations: Annotated[tuple[str, ...], Key("Names of the configurations (default: all).", "the postures of the "
        "robot's daily work, where the model has to be best there.")] = ()
    output: Annotated[str, Key("Place of the output such as `motor 1` (default: all).", "an accelerometer at the tool "
        "among encoders, whose many precise lines would decide alone.")] = ""
    input: Annotated[str, Key("Motor of the input, such as `motor 1` (default: all).", "motors whose torque is small "
        "compared with friction get less.")] = ""
    band_hz: Annotated[tuple[Frequency, Frequency] | None, Key("Lowest and highest frequency (default: all lines).",
        "the control band, where the model will be used there; lower weight below it lets friction spoil less.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse a negative factor and a band upside down."""
        if not 0 <= self.factor < math.inf:
            raise ValueError(f"factor is {self.factor:g}; it multiplies a weight: 0 or more, commonly 0.1 to 10")
        check_band(self.band_hz)


def misnamed(
    spec: FactorSpec, known: Mapping[str, Collection[str]]
) -> Iterator[tuple[tuple[str | int, ...], str, str]]:
    """The names that a factor has wrong: key path, noun, name.  known: by the key, those that exist.

    Outputs that nobody knows yet are not checked.
    """
    for i, name in enumerate(spec.configurations):
        if name not in known["configurations"]:
            yield ("configurations", i), "configuration", name
    for key, name in (("output", spec.output), ("input", spec.input)):
        if name and known[key] and name not in known[key]:
            yield (key,), key, name


@section
class WeightSpec:
    """Weights are inverse variances: var = smoothed variance of G + (floor |G|)^2, times the factors."""

    # fmt: off
    floor: Annotated[float, Key("Expected model error relative to |G|, which the intervals then include.", "about 0.03 "
        "where friction is strong, 0.1 for a rough model; 0 trusts the noise alone, and lines at resonances then "
        "decide. 0.01 is the error that sensors and a good linear model commonly leave.")] = 0.01
    smooth: Annotated[int, Key("Number of lines over which a variance from few periods or realisations is averaged; 0 "
        "chooses it from the degrees of freedom.", "fewer where the noise has narrow peaks; more where the weights of "
        "neighbouring lines scatter. 0 averages until 24 degrees of freedom lie behind each, which costs 2 % of "
        "standard deviation.")] = 0
    covariance: Annotated[Literal["auto", "diagonal", "full"], Key("Correlations in the weights: `full` weighs with "
        "the inverse covariance of all elements together, `diagonal` element by element, `auto` with the full one "
        "where the measurement gave correlations. All are smoothed: noise of the outputs, and of torques that pass "
        "through the robot, by levels common to all lines, and neighbouring lines for what remains.", "`diagonal` "
        "where correlations come from so few realisations that they are not believed, or to compare with older fits; "
        "parameters scatter more where outputs share their noise.")] = "auto"
    factors: Annotated[tuple[FactorSpec, ...], Key("Further factors of the weights of some elements.", "where one "
        "deserves less trust than its variance says; 0.1 to 10, and 0 for none at all.")] = ()
    loss: Annotated[Loss, Key("Loss of a residual: `huber` and `soft_l1` give outliers less influence than their "
        "square, in iteratively reweighted least squares: for single lines that are wrong by factors.", "for single "
        "lines that are wrong by factors; good data lose a little of their precision. Whole bands or channels that are "
        "wrong need a factor of 0.")] = "square"
    loss_scale: Annotated[float, Key("Standard deviations of real and imaginary part beyond which an element is an "
        "outlier.", "lower, about 1.3, where many lines are wrong; higher comes back to the square. At 2 all but 5 % "
        "of good data count with their square.")] = 2.0
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse negative settings."""
        if self.floor < 0 or self.smooth < 0:
            raise ValueError("floor and smooth must not be negative")
        if not 0 < self.loss_scale < math.inf:
            raise ValueError(f"loss_scale is {self.loss_scale:g} standard deviations; give about 2")
