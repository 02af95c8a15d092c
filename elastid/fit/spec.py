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
    factor: Annotated[float, Key("Factor of the weight; 0 excludes the elements.", "0 for a faulty channel or band "
        "such as the mains frequency, 0.1 for unreliable elements, 10 for important ones.", least=0)]
    configurations: Annotated[tuple[str, ...], Key("Names of the configurations (default: all).",
        "the configurations in which the model must be most accurate.")] = ()
    output: Annotated[str, Key("Location of the output such as `motor 1` (default: all).", "for an output with many "
        "precise lines that would dominate the fit, such as an accelerometer at the tool.")] = ""
    input: Annotated[str, Key("Motor of the input, such as `motor 1` (default: all).", "lower the weight of motors "
        "whose torque is small compared with friction.")] = ""
    band_hz: Annotated[tuple[Frequency, Frequency] | None, Key("Lowest and highest frequency (default: all lines).",
        "the bandwidth of the later controller, or low lines with friction.", least=0, rising=True)] = None
    # fmt: on


def find_unknown_names(
    spec: FactorSpec, names: Mapping[str, Collection[str]]
) -> Iterator[tuple[tuple[str | int, ...], str, str]]:
    """Yield key path, noun and name of each unknown name in a factor.  names: existing names by key.

    Outputs are not checked as long as none is known.
    """
    for i, name in enumerate(spec.configurations):
        if name not in names["configurations"]:
            yield ("configurations", i), "configuration", name
    for key, name in (("output", spec.output), ("input", spec.input)):
        if name and names[key] and name not in names[key]:
            yield (key,), key, name


# Model error of a search, and of responses without measured noise, if the study declares none; the residuals alone
# never set a larger one.
TYPICAL_MODEL_ERROR = 0.01


@section
class WeightSpec:
    """Weights are inverse variances: var = smoothed variance of G + (model_error |G|)^2, times the factors."""

    # fmt: off
    model_error: Annotated[float | None, Key("Expected model error relative to |G|, included in weights and intervals "
        "(default: estimated from the residuals, at most 0.01; without measured noise, or with uncompensated friction, "
        "0.01).", "0.03 with strong friction, 0.1 for a rough model; with 0 the noise alone determines the "
        "weights, and resonances dominate.", least=0)] = None
    covariance: Annotated[Literal["auto", "diagonal"], Key("Correlations in the weights: `auto` uses the inverse "
        "smoothed covariance of all elements if it was measured and is regular; `diagonal` uses variances only, as "
        "criterion `log` always does.", "`diagonal` for correlations from very few realisations, or to compare with "
        "older fits; it is less efficient if outputs share noise.")] = "auto"
    factors: Annotated[tuple[FactorSpec, ...], Key("Additional factors of the weights of some elements.", "0.1 to 10 "
        "for elements that are less or more reliable than their variance, 0 to exclude them.")] = ()
    loss: Annotated[Loss, Key("Loss function of the residuals: `square`, or `huber` for robustness to outliers "
        "(iteratively reweighted least squares).", "`huber` for single faulty lines, at a small loss of efficiency; "
        "exclude faulty bands or channels by a factor of 0.")] = "square"
    # fmt: on


@section
class PriorSpec:
    """Normal distribution known beforehand."""

    # fmt: off
    std: Annotated[float, Key("Standard deviation of the Gaussian prior, relative (0.1 = 10 %) for a positive "
        "parameter, else in SI.", "0.05 to 0.1 for masses from CAD, 0.3 for stiffnesses from a data sheet.", above=0)]
    mean: Annotated[Quantity | None, Key("Mean of the prior, with unit (default: value of the robot model).",
        "if a better value than the robot model's is available.")] = None
    # fmt: on


@section
class RatioSpec:
    """A factor of ties that is identified: a loss factor, or beta of a damping d = beta k that many springs share."""

    # fmt: off
    start: Annotated[Quantity, Key("Start value of the search in SI.", "0.02 to 0.1 for loss factors of gears and "
        "joints; for d = beta k start with 2 zeta / omega of the first mode.")]
    bounds: Annotated[tuple[Quantity, Quantity] | None, Key("Bounds [lower, upper] (default: start / 100 to start * "
        "100).", "narrower for a physical limit, such as a loss factor below 1.")] = None
    prior: Annotated[PriorSpec | None, Key("Relative Gaussian prior of the ratio (default: no prior).", "if the ratio "
        "of similar joints was identified before.")] = None
    # fmt: on


@section
class ParameterSpec:
    """One parameter is identified (the default), fixed, or tied to another."""

    # fmt: off
    start: Annotated[Quantity | None, Key("Start value of the search (default: value of the robot model; for missing "
        "motor friction, the value that stops the rotor within 1 s).", "give it if a calculation or another robot is "
        "closer than the robot model; default bounds move with it.")] = None
    bounds: Annotated[tuple[Quantity, Quantity] | None, Key("Bounds [lower, upper] (default: for a positive one start "
        "/ 100 to start * 100, for viscous friction start / 10000 to start * 10000).", "wider if the status is "
        "at_bound at a plausible value; instead of narrower bounds use a prior.")] = None
    fixed: Annotated[bool, Key("If true, the parameter is fixed at its start value.", "true for a parameter known "
        "better than from the data; an error biases all others, which modification indices reveal.")] = False
    tie: Annotated[Tie | None, Key("Tie to another parameter (default: independent parameter).", "for springs that are "
        "equal by construction, or damping proportional to stiffness.")] = None
    prior: Annotated[PriorSpec | None, Key("Gaussian prior of the parameter (default: no prior).", "for data from a "
        "drawing or data sheet; it acts as an additional measurement.")] = None
    per: Annotated[Literal["configuration", "robot"] | dict[FileName, tuple[str, ...]] | None, Key("Groups of "
        "configurations with separate values (default: one value for all): `configuration`, `robot` (of fit.robots), "
        "or named groups `{warm: [c1, c2], cold: [c3]}`. A value is then called fm_1@warm.", "for parameters that vary "
        "with temperature, load or posture, mostly friction; each group needs data that identify its value.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if self.per is not None and (self.fixed or self.tie is not None):
            raise ValueError("per is for a parameter that is identified, neither fixed nor tied")
        keys = [name for name in ("start", "bounds", "prior") if getattr(self, name) is not None]
        if self.tie is not None and (keys or self.fixed):
            raise ValueError(
                f"a tied parameter follows {self.tie.to}: {' and '.join(keys) or 'fixed'} would not count; leave "
                "the tie or the rest out"
            )


@section
class FitSpec:
    """Identification of the parameters."""

    # fmt: off
    criterion: Annotated[Literal["complex", "log"], Key("Criterion of the fit: `complex` least squares, or `log` "
        "(least squares of the logarithmic ratio).", "`log` to compare with published fits, or for unreliable "
        "variances; `complex` is efficient and unbiased at noisy lines.")] = "complex"
    parameters: Annotated[dict[str, ParameterSpec], Key("Identified parameters by name or pattern such as k_*; "
        "geometry such as pc1_cyl_z or pj_2b_z only by name (default: all spring stiffnesses, and all spring dampings "
        "and motor frictions that are not zero).", "fewer if parameters are ill-conditioned, more if modification "
        "indices propose them; `k_*: {}` identifies springs only.")] = field(default_factory=dict)
    focus: Annotated[tuple[str, ...], Key("Parameters of interest, by name or pattern (default: all stiffnesses and "
        "dampings). They determine the status of the study.", "[k_*] if dampings and friction are nuisance "
        "parameters.")] = ("k_*", "d_*")
    ratios: Annotated[dict[PartName, RatioSpec], Key("Ratios that several ties share, by name, such as one loss factor "
        "for many springs.", "if single dampings are poorly identifiable: the variance of a common loss factor is much "
        "smaller.")] = field(default_factory=dict)
    robots: Annotated[dict[FileName, tuple[str, ...]], Key("Several robots of one type in one fit: configurations "
        "measured on each robot, by a name of the robot; parameters with `per: robot` differ between robots.", "if "
        "robots share masses or stiffnesses but not friction, as in `k_*: {}, fm_*: {per: "
        "robot}`.")] = field(default_factory=dict)
    starts: Annotated[int, Key("Number of starts of the search.", "more if few starts converge to the optimum, 1 for a "
        "local search; the time is proportional.", least=1, most=10_000)] = 20
    start_factor: Annotated[float, Key("Spread of the starts as a factor around the given start; damping and friction "
        "use its square.", "5 to 10 for rough robot models, with more starts; 1.5 for values of an earlier "
        "fit.", least=1, most=1_000)] = 3.0
    solver: Annotated[Literal["trust_region", "ipopt"], Key("Solver of the least-squares problem: `trust_region` or "
        "`ipopt`.", "`ipopt` if trust_region stops early at bounds or for strongly correlated "
        "parameters.")] = "trust_region"
    band_hz: Annotated[tuple[Frequency, Frequency] | None, Key("Frequency band of the fitted lines (default: all).",
        "narrower if the robot has modes that the model lacks, or friction distorts low lines; compare the parameters "
        "of two bands.", least=0, rising=True)] = None
    weights: Annotated[WeightSpec, Key("Weights of the responses.", "if a fit has status misfit although its residuals "
        "are small, check model_error first.")] = WeightSpec()
    profile: Annotated[Literal["auto"] | tuple[str, ...], Key("Parameters with intervals by profile likelihood, by "
        "name or pattern. `auto`: up to 6 parameters with an inaccurate symmetric interval.", "name parameters on "
        "whose interval a decision depends; each costs ten to twenty evaluations.")] = "auto"
    bootstrap: Annotated[int, Key("Number of bootstrap repetitions: 0 or at least 40.", "200 for intervals that do not "
        "rely on the covariance, such as near a bound; the cost is as many local searches.", most=10_000)] = 0
    seed: Annotated[int | None, Key("Seed of the starts and of the bootstrap (default: seed of the study).",
        "another seed must give the same optimum.", least=0)] = None
    # fmt: on

    def __post_init__(self) -> None:
        measured = [name for names in self.robots.values() for name in names]
        for name in measured:
            if measured.count(name) > 1:
                double = ", ".join(robot for robot, names in self.robots.items() if name in names)
                raise ValueError(f"robots: configuration {name} is given to {double}; give it to the one that it is of")
        if not (self.bootstrap == 0 or self.bootstrap >= 40):  # fewer have no interval of 95 %
            raise ValueError(f"bootstrap is {self.bootstrap}; give 0, or 40 and more")
