"""The `fit` section of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Literal

from elastid.base.errors import check_kind
from elastid.base.names import FileName, PartName
from elastid.base.section import section
from elastid.base.units import Frequency, Quantity
from elastid.fit.weight_spec import MaskSpec, WeightSpec, check_band
from elastid.parameters import Tie

# Whatever is more is a slip of the pen.
MOST_STARTS = 10_000
LARGEST_FACTOR = 1e3
MOST_BANDS = 20
# Below, no interval of 95 % can be read off.
FEWEST_REPETITIONS = 40


@section
class PriorSpec:
    """Normal distribution known beforehand.

    std: relative (0.1 = 10 %) for a positive parameter, else in SI. -- 0.05 to 0.1 for masses from CAD, 0.3 for
    stiffnesses of a data sheet; too small a number forces the parameter, too large a one changes nothing.
    mean: with unit; default the robot's number, as for masses that a drawing gives within a few percent. -- where the
    best knowledge is not the robot's number, which stays the start.
    """

    std: float
    mean: Quantity | None = None

    def __post_init__(self) -> None:
        """Refuse a distribution without width."""
        if not 0 < self.std < math.inf:
            raise ValueError(f"std is {self.std:g}; it must be positive, or fix the parameter (fixed: true)")


@section
class TieSpec:
    """This parameter is factor times the parameter `to`, and times the ratio `by` if one is named.

    to: a * stands for what the * of the key stands for (d_*: {tie: {to: k_*}}). -- name the parameter that is best
    determined; the other follows exactly.
    factor: multiplies the other parameter. -- other than 1 where a ratio is known from the geometry, such as the
    squared ratio of two lengths.
    by: a name under fit.ratios. -- for a ratio that is to be found, such as a loss factor common to many springs.
    at_hz: the factor is divided by 2 pi at_hz, so that a damping d = eta k / omega has the loss factor eta at that
    frequency. -- the frequency of the mode that matters most; at others the loss factor is larger above it and smaller
    below, in proportion.
    """

    to: str
    factor: float = 1.0
    by: str = ""
    at_hz: Frequency | None = None

    def __post_init__(self) -> None:
        """Refuse a frequency that cannot divide."""
        if self.at_hz is not None and not self.at_hz > 0:
            raise ValueError(f"at_hz is {self.at_hz:g}; it must be positive")

    def tie(self) -> Tie:
        """As the parameter set wants it."""
        omega = 1.0 if self.at_hz is None else 2 * math.pi * self.at_hz
        return Tie(self.to, self.factor / omega, self.by)


@section
class RatioSpec:
    """A factor of ties that is identified: a loss factor, or beta of a damping d = beta k that many springs share.

    start: in SI. -- 0.02 to 0.1 for loss factors of gears and joints; for d = beta k, start with 2 zeta / omega of the
    first mode.
    bounds: [lower, upper] (default: start / 100 to start * 100). -- narrower where physics sets an end, such as a loss
    factor below 1; a ratio at a bound is reported like a parameter.
    prior: as of a positive parameter: known beforehand, relative. -- where the same kind of joint was identified before
    and this data barely constrains damping.
    """

    start: Quantity
    bounds: tuple[Quantity, Quantity] | None = None
    prior: PriorSpec | None = None


@section
class ParameterSpec:
    """One parameter is identified (the default), fixed, or tied to another.

    start: of the search (default: the robot's number). -- give one where the robot's file has a guess and a hand
    calculation or another robot is nearer; it moves the default bounds along.
    bounds: [lower, upper] (default: for a positive one start / 100 to start * 100, for viscous friction start / 10000
    to start * 10000). -- wider where the report says at_bound and the value makes sense; narrower hides an unknown
    rather than finds it: prefer a prior.
    fixed: true keeps it at its start. -- true for what is known better than the data can tell, or what the data cannot
    tell at all; a wrong value biases all others, and modification indices then name it.
    tie: to another parameter. -- for springs that are alike by construction, or damping in proportion to stiffness;
    fewer unknowns, narrower intervals, and a misfit where the tie is wrong.
    prior: known beforehand. -- for numbers of a drawing or a data sheet; it acts as one more measurement and keeps
    ill-conditioned directions in place.
    per: `configuration` identifies it in each configuration by itself; `robot` in each robot of fit.robots; {warm: [c1,
    c2], cold: [c3]} in each of these groups (a temperature, a load), and once in all configurations that no group
    names. A configuration in which none was found has the mean of the others. The one of a group is called fm_1@warm; a
    key of that name, or a pattern such as fm_*@warm, gives it a start, bounds and a prior of its own, or fixes it. --
    where a number changes with temperature, load or posture, friction first of all; each group adds an unknown and
    needs data of its own.
    """

    start: Quantity | None = None
    bounds: tuple[Quantity, Quantity] | None = None
    fixed: bool = False
    tie: TieSpec | None = None
    prior: PriorSpec | None = None
    per: Literal["configuration", "robot"] | dict[FileName, tuple[str, ...]] | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be together."""
        if self.per is not None and (self.fixed or self.tie is not None):
            raise ValueError("per is for a parameter that is identified, neither fixed nor tied")
        beside = [name for name in ("start", "bounds", "prior") if getattr(self, name) is not None]
        if self.tie is not None and (beside or self.fixed):
            raise ValueError(
                f"a tied parameter follows {self.tie.to}: {' and '.join(beside) or 'fixed'} would not count; leave the "
                "tie or the rest out"
            )


@section
class FitSpec:
    """How the parameters are found.

    criterion: `complex` least squares, or `log` of the ratio, for comparison with published fits. -- `log` for
    comparison with published fits, or where elements span decades and their variances are not trusted; `complex`
    reaches the smallest variance and has no bias at noisy lines.
    log_first: start with `log`, finish with the criterion. -- false where the start is near, which saves one of two
    searches from each start; true widens the range of starts that reach the optimum.
    parameters: by name, or by a pattern such as k_* (default: every k_ of the springs, and every d_ of the springs and
    fm_ of the motors that is not zero). Geometry (ends of compensators, places of joints and bodies) is identified
    where it is named: pc1_cyl_z, pj_2b_z. -- name fewer where the report calls parameters ill-conditioned, more where
    modification indices ask for them; `k_*: {}` identifies the springs alone and holds all other numbers at those of
    the robot.
    ratios: factors that ties share, by a name of your own: one loss factor for many springs. -- where dampings are
    poorly determined one by one: one loss factor for all springs has a fraction of their variance.
    robots: several robots of one type in one fit, for what they share: by a name of your own, the configurations
    measured on each. Parameters that differ between them are `per: robot` (k_*: {}, fm_*: {per: robot}). -- where
    robots of one type share masses or stiffnesses but not friction; each parameter is then common unless it is `per:
    robot`.
    starts: of the multistart. -- more where few of them reach the optimum, which the report counts as hits; 1 where
    only the given start is of interest. Time grows with their number. From starts 50 % off half of all local searches
    miss, 20 at once all but never.
    start_factor: how far, as a factor, the starts spread around the given one; dampings and frictions spread over its
    square. -- larger, 5 to 10, where the robot's numbers are guesses, with more starts; 1.5 where they come from an
    earlier fit. 3 covers catalogues and numbers of similar robots.
    continuation: bands, each wider than the one before and all from the lowest line, that the first stage goes through;
    1 fits all lines at once. -- 3 or 4 where starts end far apart, as with many modes: low modes are matched before
    high ones count. Each band costs a search.
    solver: `trust_region`, or `ipopt` where that one stops early. -- `ipopt` where trust_region stops early at bounds
    or with strongly correlated parameters; both end at one optimum where both converge.
    band_hz: lines used (default: all). -- narrower where the robot has modes beyond it that the model lacks, or where
    low lines are spoilt by friction; compare the parameters of two bands before you trust either.
    mask: elements left out. -- where a channel or a band is known to be wrong, such as lines at the mains frequency;
    say why in a comment, since it hides misfit.
    weights: of the elements. -- their floor is the first number to look at where a fit ends as misfit but looks good.
    profile: names or patterns of parameters whose interval is found by profile likelihood; `auto`: of those whose
    standard deviation is too large for a symmetric one, [] of none. -- names where a decision rests on one interval;
    each costs ten to twenty evaluations. `auto` takes at most 6, those where the error of an end exceeds a tenth of the
    interval.
    bootstrap: repetitions of the fit on data drawn anew, 0 or at least 40. -- 200 where an interval must not rest on
    the covariance, as near a bound; the time is that of as many local searches.
    bootstrap_kind: `parametric`, from the measured covariance, or `residual` where that one is not known. -- `residual`
    where the measured covariance is not known, or not believed; it then contains the model error as if that were noise.
    seed: of the starts and of the bootstrap (default: that of the study). -- another one, with the same data, shows
    what depends on the draws: the optimum should not.
    """

    criterion: Literal["complex", "log"] = "complex"
    log_first: bool = True
    parameters: dict[str, ParameterSpec] = field(default_factory=dict)
    ratios: dict[PartName, RatioSpec] = field(default_factory=dict)
    robots: dict[FileName, tuple[str, ...]] = field(default_factory=dict)
    starts: int = 20
    start_factor: float = 3.0
    continuation: int = 1
    solver: Literal["trust_region", "ipopt"] = "trust_region"
    band_hz: tuple[Frequency, Frequency] | None = None
    mask: tuple[MaskSpec, ...] = ()
    weights: WeightSpec = WeightSpec()
    profile: Literal["auto"] | tuple[str, ...] = "auto"
    bootstrap: int = 0
    bootstrap_kind: Literal["parametric", "residual"] = "parametric"
    seed: int | None = None

    def __post_init__(self) -> None:
        """Refuse a multistart without starts or without end, a band upside down, a configuration of two robots."""
        check_kind(self.parameters, Mapping, "parameters", "give names, such as {'k_*': ParameterSpec()}")
        measured = [name for names in self.robots.values() for name in names]
        for name in measured:
            if measured.count(name) > 1:
                both = ", ".join(robot for robot, names in self.robots.items() if name in names)
                raise ValueError(f"robots: configuration {name} is given to {both}; give it to the one that it is of")
        if not 1 <= self.starts <= MOST_STARTS:
            raise ValueError(f"starts is {self.starts}; it must be 1 to {MOST_STARTS}, commonly 10 to 50")
        if not 1 <= self.start_factor <= LARGEST_FACTOR:
            raise ValueError(
                f"start_factor is {self.start_factor:g}; it must be 1 to {LARGEST_FACTOR:g}, commonly 2 to 10"
            )
        if not (self.bootstrap == 0 or FEWEST_REPETITIONS <= self.bootstrap <= MOST_STARTS):
            raise ValueError(f"bootstrap is {self.bootstrap}; give 0, or {FEWEST_REPETITIONS} to {MOST_STARTS}")
        if not 1 <= self.continuation <= MOST_BANDS:
            raise ValueError(
                f"continuation is {self.continuation} bands; it must be 1 to {MOST_BANDS}, commonly 1 to 4"
            )
        check_band(self.band_hz)
        if self.seed is not None and self.seed < 0:
            raise ValueError(f"seed is {self.seed}; it must not be negative")
