"""The `fit` section of a study: parameters, criterion, solver, weights."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import field
from typing import Annotated, Literal, TypeAlias

from elastid.base.names import FileName, PartName
from elastid.base.section import Key, section
from elastid.base.units import Frequency, Quantity
from elastid.parameters import Tie

Loss: TypeAlias = Literal["square", "huber"]


@section
class FactorSpec:
    """Multiplies the weight of elements that match all of the other keys given; several factors multiply."""

    # fmt: off
    factor: Annotated[float, Key("Factor of the weight; 0 leaves the elements out.", "0 for a channel "
        "or a band that is known to be wrong, such as lines at the mains frequency, with a comment that says why, "
        "since it hides misfit; 0.1 for elements that deserve less trust than their variance says, 10 for those that "
        "matter most; the intervals still count the noise as it was measured.", least=0)]
    configurations: Annotated[tuple[str, ...], Key("Names of the configurations (default: all).", "the postures of the "
        "robot's daily work, where the model has to be best there.")] = ()
    output: Annotated[str, Key("Place of the output such as `motor 1` (default: all).", "an accelerometer at the tool "
        "among encoders, whose many precise lines would decide alone.")] = ""
    input: Annotated[str, Key("Motor of the input, such as `motor 1` (default: all).", "motors whose torque is small "
        "compared with friction get less.")] = ""
    band_hz: Annotated[tuple[Frequency, Frequency] | None, Key("Lowest and highest frequency (default: all lines).",
        "the control band, where the model will be used there; lower weight below it lets friction spoil less.",
        least=0, rising=True)] = None
    # fmt: on


def misnamed(
    spec: FactorSpec, known: Mapping[str, Collection[str]]
) -> Iterator[tuple[tuple[str | int, ...], str, str]]:
    """The names that a factor has wrong: key path, noun, name.  known: by the key, those that exist.

    Outputs are not checked as long as none is known.
    """
    for i, name in enumerate(spec.configurations):
        if name not in known["configurations"]:
            yield ("configurations", i), "configuration", name
    for key, name in (("output", spec.output), ("input", spec.input)):
        if name and known[key] and name not in known[key]:
            yield (key,), key, name


@section
class WeightSpec:
    """Weights are inverse variances: var = smoothed variance of G + (model_error |G|)^2, times the factors."""

    # fmt: off
    model_error: Annotated[float | None, Key("Expected model error relative to |G|, which the intervals then include "
        "(default: 0 where the residuals show no more than the measured noise, otherwise as much as they show, at most "
        "0.01, which sensors and a good linear model commonly leave; 0.01 where no noise was measured, and where dry "
        "friction was left in the responses, whose error no residual shows).", "about 0.03 "
        "where friction is strong, 0.1 for a rough model; 0 trusts the noise alone, and lines at resonances then "
        "decide.", least=0)] = None
    covariance: Annotated[Literal["auto", "diagonal"], Key("Correlations in the weights: `auto` weighs with the "
        "inverse covariance of all elements where the measurement gave correlations and they are regular, `diagonal` "
        "element by element, as `log` always does. All are smoothed: noise of the outputs, and of torques that pass "
        "through the robot, by levels common to all lines, and over neighbouring lines for what remains, until 24 "
        "degrees of freedom lie behind each, which costs 2 % of standard deviation.", "`diagonal` where correlations "
        "come from so few realisations that they are not believed, or to compare with older fits; parameters scatter "
        "more where outputs share their noise.")] = "auto"
    factors: Annotated[tuple[FactorSpec, ...], Key("Further factors of the weights of some elements.", "where one "
        "deserves less trust than its variance says; 0.1 to 10, and 0 for none at all.")] = ()
    loss: Annotated[Loss, Key("Loss of a residual: `huber` gives outliers less influence than their "
        "square, in iteratively reweighted least squares: for single lines that are wrong by factors.", "for single "
        "lines that are wrong by factors; good data lose a little of their precision. Whole bands or channels that are "
        "wrong need a factor of 0.")] = "square"
    # fmt: on


@section
class PriorSpec:
    """Normal distribution known beforehand."""

    # fmt: off
    std: Annotated[float, Key("Standard deviation, relative (0.1 = 10 %) for a positive parameter, else in SI.",
        "0.05 to 0.1 for masses from CAD, 0.3 for stiffnesses of a data sheet; too small a number forces the "
        "parameter, too large a one changes nothing.", above=0)]
    mean: Annotated[Quantity | None, Key("Mean with unit; default the robot's number, as for masses that a drawing "
        "gives within a few percent.", "where the best knowledge is not the robot's number, which stays the "
        "start.")] = None
    # fmt: on


@section
class RatioSpec:
    """A factor of ties that is identified: a loss factor, or beta of a damping d = beta k that many springs share."""

    # fmt: off
    start: Annotated[Quantity, Key("Start of the search in SI.", "0.02 to 0.1 for loss factors of gears and joints; "
        "for d = beta k, start with 2 zeta / omega of the first mode.")]
    bounds: Annotated[tuple[Quantity, Quantity] | None, Key("Bounds [lower, upper] (default: start / 100 to start * "
        "100).", "narrower where physics sets an end, such as a loss factor below 1; a ratio at a bound is reported "
        "like a parameter.")] = None
    prior: Annotated[PriorSpec | None, Key("Prior knowledge of the ratio, relative, as of a positive parameter.",
        "where the same kind of joint was identified before and this data barely constrains damping.")] = None
    # fmt: on


@section
class ParameterSpec:
    """One parameter is identified (the default), fixed, or tied to another."""

    # fmt: off
    start: Annotated[Quantity | None, Key("Start of the search (default: the robot's number; of motor "
        "friction that its file lacks, that which stops the rotor within 1 s).", "give one where the "
        "robot's file has a guess and a hand calculation or another robot is nearer; it moves the default bounds "
        "along.")] = None
    bounds: Annotated[tuple[Quantity, Quantity] | None, Key("Bounds [lower, upper] (default: for a positive one start "
        "/ 100 to start * 100, for viscous friction start / 10000 to start * 10000).", "wider where the report says "
        "at_bound and the value makes sense; narrower hides an unknown rather than finds it: prefer a prior.")] = None
    fixed: Annotated[bool, Key("The parameter is kept at its start if true.", "true for what is known better than from "
        "the data, or not constrained by the data at all; a wrong value biases all others, and modification indices "
        "then name it.")] = False
    tie: Annotated[Tie | None, Key("Tie to another parameter.", "for springs that are equal by construction, or "
        "damping in proportion to stiffness; fewer unknowns, narrower intervals, and a misfit where the tie is "
        "wrong.")] = None
    prior: Annotated[PriorSpec | None, Key("Prior knowledge of the parameter.", "for numbers of a drawing or a data "
        "sheet; it acts as one more measurement and keeps ill-conditioned directions in place.")] = None
    per: Annotated[Literal["configuration", "robot"] | dict[FileName, tuple[str, ...]] | None, Key("Groups of "
        "configurations in which the parameter has its own value: `configuration` identifies it in each configuration "
        "by itself; `robot` in each robot of fit.robots; {warm: [c1, c2], cold: [c3]} in each of these groups (a "
        "temperature, a load), and once in all configurations that no group names. A configuration in which none was "
        "found has the mean of the others. The one of a group is called fm_1@warm.", "where a number changes with "
        "temperature, load or posture, friction first of all; each group adds an unknown and needs data of its "
        "own.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.per is not None and (self.fixed or self.tie is not None):
            raise ValueError("per is for a parameter that is identified, neither fixed nor tied")
        further = [name for name in ("start", "bounds", "prior") if getattr(self, name) is not None]
        if self.tie is not None and (further or self.fixed):
            raise ValueError(
                f"a tied parameter follows {self.tie.to}: {' and '.join(further) or 'fixed'} would not count; leave "
                "the tie or the rest out"
            )


@section
class FitSpec:
    """Identification of the parameters."""

    # fmt: off
    criterion: Annotated[Literal["complex", "log"], Key("Criterion of the fit: `complex` least squares, or `log` of "
        "the ratio, for comparison with published fits.", "`log` for comparison with published fits, or where elements "
        "span decades and their variances are not trusted; `complex` reaches the smallest variance and has no bias at "
        "noisy lines.")] = "complex"
    parameters: Annotated[dict[str, ParameterSpec], Key("Parameters that are identified, by name, or by a pattern such "
        "as k_* (default: every k_ of the springs, and every d_ of the springs and fm_ of the motors that is not "
        "zero). Geometry (ends of compensators, places of joints and bodies) is identified where it is named: "
        "pc1_cyl_z, pj_2b_z.", "name fewer where the report calls parameters ill-conditioned, more where modification "
        "indices ask for them; `k_*: {}` identifies the springs alone and holds all other numbers at those of the "
        "robot.")] = field(default_factory=dict)
    focus: Annotated[tuple[str, ...], Key("Parameters that the study is about, by name or pattern: its status is "
        "theirs, and each parameter has a verdict of its own.", "[k_*] where dampings are by-products; a friction "
        "coefficient that a wrong model moves then leaves the status alone.")] = ("k_*", "d_*")
    ratios: Annotated[dict[PartName, RatioSpec], Key("Factors that several ties share, by a name of your own: one loss "
        "factor for many springs.", "where dampings are poorly determined one by one: one loss factor for all springs "
        "has a fraction of their variance.")] = field(default_factory=dict)
    robots: Annotated[dict[FileName, tuple[str, ...]], Key("Several robots of one type in one fit, for their common "
        "parameters: by a name of your own, the configurations measured on each. Parameters that differ between them "
        "are `per: robot` (k_*: {}, fm_*: {per: robot}).", "where robots of one type share masses or stiffnesses but "
        "not friction; each parameter is then common unless it is `per: robot`.")] = field(default_factory=dict)
    starts: Annotated[int, Key("Number of starts of the search.", "more where few of them reach the optimum, which the "
        "report counts as hits; 1 where only the given start is of interest. Time grows with their number. From starts "
        "50 % off half of all local searches miss, 20 at once all but never.", least=1, most=10_000)] = 20
    start_factor: Annotated[float, Key("Spread of the starts around the given one, as a factor; dampings and frictions "
        "spread over its square.", "larger, 5 to 10, where the robot's numbers are guesses, with more starts; 1.5 "
        "where they come from an earlier fit. 3 covers catalogues and numbers of similar robots.",
        least=1, most=1_000)] = 3.0
    solver: Annotated[Literal["trust_region", "ipopt"], Key("Solver of the least-squares problem: `trust_region`, or "
        "`ipopt` where that one stops early.", "`ipopt` where trust_region stops early at bounds or with strongly "
        "correlated parameters; both end at one optimum where both converge.")] = "trust_region"
    band_hz: Annotated[tuple[Frequency, Frequency] | None, Key("Band of the lines that are fitted (default: all).",
        "narrower where the robot has modes beyond it that the model lacks, or where low lines are spoilt by friction; "
        "compare the parameters of two bands before you trust either.", least=0, rising=True)] = None
    weights: Annotated[WeightSpec, Key("Weights of the responses' elements.", "their floor is the first number to look "
        "at where a fit ends as misfit but looks good.")] = WeightSpec()
    profile: Annotated[Literal["auto"] | tuple[str, ...], Key("Names or patterns of parameters whose interval is found "
        "by profile likelihood; `auto`: of those whose standard deviation is too large for a symmetric one, [] of "
        "none.", "names where a decision rests on one interval; each costs ten to twenty evaluations. `auto` takes at "
        "most 6, those where the error of an end exceeds a tenth of the interval.")] = "auto"
    bootstrap: Annotated[int, Key("Number of bootstrap repetitions, fits of data that are drawn again: 0 or at least "
        "40.", "200 where an interval must not rest on the covariance, as near a bound; the time is that of as many "
        "local searches.", most=10_000)] = 0
    seed: Annotated[int | None, Key("Seed of the starts and of the bootstrap (default: that of the study).", "another "
        "one, with the same data, shows what depends on the draws: the optimum should not.", least=0)] = None
    # fmt: on

    def __post_init__(self) -> None:
        measured = [name for names in self.robots.values() for name in names]
        for name in measured:
            if measured.count(name) > 1:
                both = ", ".join(robot for robot, names in self.robots.items() if name in names)
                raise ValueError(f"robots: configuration {name} is given to {both}; give it to the one that it is of")
        if not (self.bootstrap == 0 or self.bootstrap >= 40):  # fewer have no interval of 95 %
            raise ValueError(f"bootstrap is {self.bootstrap}; give 0, or 40 and more")
