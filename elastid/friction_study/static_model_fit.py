r"""StaticLaw: sliding friction of one location in the form of the robot model; identifiable terms are added.

The law is fitted to friction torques by variable projection: linear parameters c are eliminated, eta is searched for.

.. math:: \min_\eta \| P^\perp(\eta)\, W y \|^2, \quad c = (W \Phi)^+ W y

(Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973.) W = 1 / std of each friction torque.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product, starmap

import numpy as np
from scipy.special import chdtrc, ndtri, stdtrit

from elastid.base.arrays import FloatArray, values_by_name
from elastid.base.errors import FitError
from elastid.friction.static import FALLING, Conditions, columns, slopes
from elastid.friction_study.constant_velocity import MAX_RELATIVE_STD, FrictionCurve
from elastid.friction_study.least_squares import FALSE_ALARM, Estimate, inverse_normal, minimise, terms_p_value
from elastid.friction_study.spec import LawSpec, Part
from elastid.robot.friction import (
    EXPONENT_RANGE,
    Directions,
    Friction,
    LoadDependence,
    MeasuredRange,
    TemperatureDependence,
)

# Decay of viscous friction over temperature from which a search starts, and the range of the search.
START_DECAY_K = 20.0
DECAY_RANGE_K = (1.0, 500.0)
# Of the largest speed, within which speeds are one: a line through them has its end anywhere.
SAME_SPEED_TOLERANCE = 0.1


@dataclass(frozen=True)
class Terms:
    """Parameters of a friction model: linear, nonlinear (by search), and fixed with their value."""

    linear: tuple[str, ...]
    searched: tuple[str, ...]
    fixed: Mapping[str, float]


@dataclass(frozen=True)
class StaticLaw:
    """Friction law fitted to friction torques, and the terms that are not identifiable from them.

    values: linear parameters and eta by name, SI, at the reference temperature T_0; covariance: in the order linear +
    searched.  cost: in units of the torques' variance.  If the torques show a Stribeck effect, but no speed is low
    enough for its parameters, the law includes it and `unidentified` lists it. The law is then valid at the measured
    speeds and its other parameters are unbiased, but the Stribeck parameters are extrapolations.
    """

    curve: FrictionCurve
    terms: Terms
    T_0: float
    values: Mapping[str, float]
    covariance: FloatArray
    cost: float
    dof: int
    unidentified: "tuple[UnidentifiedTerm, ...]" = ()

    @staticmethod
    def of(curve: FrictionCurve, spec: LawSpec) -> "StaticLaw":
        """Fit the law with its identifiable parts; the others get reasons, FitError if one of these is `yes`."""
        # Of speeds that are nearly one Coulomb friction alone is the whole of their torque.
        has_slope = np.ptp(curve.speed) > SAME_SPEED_TOLERANCE * curve.speed.max()
        terms = Terms(("coulomb", "viscous") if has_slope else ("coulomb",), (), {})
        fit, candidates = fit_curve(curve, terms), _candidate_terms(curve)
        reasons, extrapolated, waiting = dict[str, str](), dict[str, str](), list(candidates)
        # A part may show only after a later one: what was refused by its numbers is tried once more.
        for _ in range(2):
            reasons = dict(extrapolated)
            for term in tuple(waiting):
                wider, reason = _extended_law(curve, fit, term, getattr(spec, term.name))
                if wider is None:
                    reasons.setdefault(term.name, reason)  # the first one is the strongest
                    continue
                fit = wider
                waiting.remove(term)
                reasons.pop(term.name, None)
                if reason:
                    reasons[term.name] = extrapolated[term.name] = reason
        # Of a part that is there, a further number that does not show is no refusal.
        for name in {term.name for term in candidates if term not in waiting}:
            if reasons.get(name, "").startswith(ABSENT):
                del reasons[name]
        for name, reason in reasons.items():
            if getattr(spec, name) == "yes":
                text = f"law.{name} cannot be identified: {reason}"
                raise FitError("friction/law", text, f"friction of {curve.place}")
        fit = _add_curve_uncertainty(curve, fit, candidates[0], spec)
        return replace(fit, unidentified=tuple(starmap(UnidentifiedTerm, reasons.items())))

    @property
    def quantile_95(self) -> float:
        """Half of a 95 % interval in stds: Student's t where the scatter of the torques gave these, else normal."""
        return float(stdtrit(self.dof, 0.975) if excess(self.cost, self.dof) > 1 else ndtri(0.975))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers in the order of the covariance."""
        return (*self.terms.linear, *self.terms.searched)

    @property
    def estimate(self) -> Estimate:
        """Parameters of the law with their covariance."""
        return Estimate(self.names, np.array([self.values[name] for name in self.names]), self.covariance)

    def value_and_std(self, name: str) -> tuple[float, float]:
        """Return a parameter and its std; for stiction, the excess over Coulomb friction."""
        names = [key for key in self.names if key in (name, FALLING.get(name))]
        return self.estimate.combination({key: 1.0 if key == name else -1.0 for key in names})

    def torque(self, conditions: Conditions) -> FloatArray:
        """Return s tau_f (n,) at conditions."""
        linear = np.array([self.values[name] for name in self.terms.linear])
        return np.asarray(columns(conditions, self.terms.linear, self.values, self.T_0) @ linear)

    def torque_std(self, conditions: Conditions) -> FloatArray:
        """Return std (n,) of the torque, to first order."""
        J = derivative(conditions, self.terms, self.values, self.T_0)
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", J, self.covariance, J)))

    @property
    def measured(self) -> MeasuredRange:
        """The ranges of the conditions."""
        curve, degc = self.curve, self.curve.measured_temperatures
        load = _range(curve.load) if curve.load.any() else None
        return MeasuredRange(_range(curve.speed), load, _range(degc) if len(degc) else None)

    @property
    def has_one_speed(self) -> bool:
        """True if the torques are of one speed: Coulomb friction is then the whole torque there, and no law follows."""
        return "viscous" not in self.values

    def to_friction(self) -> tuple[Friction, float]:
        """Return the law and its viscous friction as in a robot model, without presliding."""
        return friction_of(self.values, self.T_0, self.measured)


def fit_curve(curve: FrictionCurve, terms: Terms) -> StaticLaw:
    """Fit the law to the curve in units of its std; FitError for too few torques, or searches without an optimum."""
    n_numbers = len(terms.linear) + len(terms.searched)
    if curve.n_conditions <= n_numbers:
        numbers = ", ".join((*terms.linear, *terms.searched))
        text = f"{curve.n_conditions} friction torques for {n_numbers} parameters ({numbers}). Measure more speeds, or "
        raise FitError("friction/law", f"{text}switch terms of friction.law off", f"friction of {curve.place}")
    degc = curve.measured_temperatures
    T_0 = float(degc.mean()) if len(degc) else 0.0
    search = _Search(curve, terms, T_0)
    starts, ranges = list(search.starts()), {"exponent": EXPONENT_RANGE, "temperature.decay": DECAY_RANGE_K}
    x, slow, fast = starts[0], 0.05 * float(curve.speed.min()), 3.0 * float(curve.speed.max())
    if terms.searched:
        low, high = np.log([ranges.get(name, (slow, fast)) for name in terms.searched]).T
        optima = minimise(
            lambda x: search.project(search.eta(x))[1], starts,
            jac="3-point", bounds=(low, high), x_scale=1.0, ftol=1e-12, xtol=1e-10
        )  # fmt: skip
        if not optima:
            text = "no start of the Stribeck curve leads to an optimum. Check the friction torques"
            raise FitError("friction/law", text, f"friction of {curve.place}")
        x = min(optima, key=lambda end: end.cost).x
    eta = search.eta(x)
    linear, residual = search.project(eta)
    cost, dof = float(residual @ residual), curve.n_conditions - n_numbers
    values = values_by_name(terms.linear, linear) | eta
    J = derivative(curve.conditions, terms, values, T_0) / curve.std[:, None]
    return StaticLaw(curve, terms, T_0, values, inverse_normal(J) * excess(cost, dof), cost, dof)


def excess(cost: float, dof: int) -> float:
    """Return factor of the variance by which torques scatter more than stated; 1 where chance explains it."""
    return cost / dof if chdtrc(dof, cost) < FALSE_ALARM else 1.0


def derivative(conditions: Conditions, terms: Terms, values: Mapping[str, float], T_0: float) -> FloatArray:
    """Return d s tau_f / d numbers (n, n_linear + n_searched)."""
    searched = slopes(conditions, {name: values[name] for name in terms.linear}, terms.searched, values, T_0)
    return np.hstack([columns(conditions, terms.linear, values, T_0), searched])


@dataclass(frozen=True)
class _Search:
    """The variables x: ln of each searched number; the Stribeck velocity over temperature by its ln at both ends."""

    curve: FrictionCurve
    terms: Terms
    T_0: float

    def eta(self, x: FloatArray) -> dict[str, float]:
        """Return the nonlinear numbers at their logarithms x (n,), fixed ones included."""
        eta = dict(self.terms.fixed) | values_by_name(self.terms.searched, np.exp(x))
        if "temperature.stribeck_velocity" in self.terms.searched:
            cold, hot = eta["stribeck_velocity"], eta["temperature.stribeck_velocity"]
            degc = self.curve.measured_temperatures - self.T_0
            low, high = float(degc.min()), float(degc.max())
            eta["temperature.stribeck_velocity"] = (hot - cold) / (high - low)
            eta["stribeck_velocity"] = cold - low * (hot - cold) / (high - low)
        return eta

    def project(self, eta: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return the best linear numbers (n,) at eta, and the residual (m,) over its std (variable projection)."""
        W = 1 / self.curve.std
        Q, R = np.linalg.qr(W[:, None] * columns(self.curve.conditions, self.terms.linear, eta, self.T_0))
        y = W * self.curve.torque
        projection = Q.T @ y
        return np.linalg.lstsq(R, projection, rcond=None)[0], y - Q @ projection

    def starts(self) -> Iterator[FloatArray]:
        """Yield logarithms (n,): Stribeck velocities over the speeds, exponents, one decay."""
        speeds = np.log(self.curve.speed)
        velocities = speeds.min() + np.array((0.15, 0.35, 0.6)) * np.ptp(speeds)
        choices: dict[str, tuple[float, ...]] = {
            "stribeck_velocity": tuple(velocities),
            "exponent": tuple(np.log((1.0, 2.0))),
            "load.stribeck_velocity": tuple(velocities[1:]),
            "temperature.decay": (float(np.log(START_DECAY_K)),),
        }
        names = [name for name in self.terms.searched if name != "temperature.stribeck_velocity"]
        for values in product(*(choices[name] for name in names)):
            start = dict(zip(names, values, strict=True))
            start["temperature.stribeck_velocity"] = start.get("stribeck_velocity", 0.0)
            yield np.array([start[name] for name in self.terms.searched])


def friction_of(value: Mapping[str, float], reference: float, measured: MeasuredRange | None) -> tuple[Friction, float]:
    """Return friction model and viscous friction from parameters by name, about a reference temperature in degC."""
    fields = {
        prefix: {name.removeprefix(prefix): x for name, x in value.items() if name.startswith(prefix)}
        for prefix in ("load.", "temperature.", "directions.")
    }
    load, heat, apart = fields.values()
    heat |= {"viscous": max(0.0, heat["viscous"])} if "viscous" in heat else {}  # no law grows with heat
    friction = Friction(
        value["coulomb"], value.get("stiction"), value.get("stribeck_velocity"),
        max(0.0, value.get("quadratic", 0.0)), value.get("exponent", 2.0),
        load=LoadDependence(max(0.0, load.pop("coulomb", 0.0)), **load) if load else None,
        temperature=TemperatureDependence(reference, **heat) if set(heat) - {"decay"} else None,
        directions=Directions(**apart) if apart else None, measured=measured
    )  # fmt: skip
    return friction, max(0.0, value.get("viscous", 0.0))


def _range(values: FloatArray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


# Reasons of parts that are not missing: they were not asked for, or the data show that they are absent.
NOT_ASKED, ABSENT = "not asked for", "the friction torques show no such effect"
# Temperatures closer than this are the same condition.
TEMPERATURE_STEP_K = 2.0
# Numbers of temperature that are positive: viscous friction falls with heat.
COOLING = ("temperature.viscous", "temperature.decay")
# Speeds that a Stribeck curve with viscous friction needs, and the part of nu_s that the lowest must reach.
MIN_SPEEDS, LOWEST_SPEED = 5, 1 / 3
# Exponents of Stribeck curves (the last is the default), and the excess cost above which an exponent is excluded.
EXPONENTS: tuple[float, ...] = (1.0, 1.4, 2.0)
MAX_COST = 4.0
# Ends of the names of numbers that change friction below some speed alone.
STRIBECK_NUMBERS = ("stiction", "stribeck_velocity", "exponent")


@dataclass(frozen=True)
class UnidentifiedTerm:
    """Term of the friction model that is not identified: the reason, and the required data."""

    term: str
    reason: str


def identified_names(names: Iterable[str], unidentified: Iterable[UnidentifiedTerm]) -> tuple[str, ...]:
    """Return the names without Stribeck numbers if the Stribeck effect is an extrapolation."""
    is_extrapolated = any(term.term == "stribeck" for term in unidentified)
    return tuple(name for name in names if not (is_extrapolated and name.endswith(STRIBECK_NUMBERS)))


@dataclass(frozen=True)
class _Term:
    """Numbers that come together, if the terms have `after`, and the reason why the conditions cannot identify them.

    name: key of the part in a study's law.  refusal: that reason, "" without one.  fixed: until they are searched for.
    is_tested: by F.  Not so a number that would otherwise be held at one that was not measured: it is free where it can
    be identified at all, since the intervals of the others would not hold the truth.
    """

    name: str
    refusal: str
    linear: tuple[str, ...] = ()
    searched: tuple[str, ...] = ()
    after: str = ""
    fixed: Mapping[str, float] = field(default_factory=dict)
    is_tested: bool = True

    def added(self, terms: Terms) -> Terms:
        if self.after and self.after not in (*terms.linear, *terms.searched):
            return terms
        fixed = {name: value for name, value in {**terms.fixed, **self.fixed}.items() if name not in self.searched}
        return Terms((*terms.linear, *self.linear), (*terms.searched, *self.searched), fixed)


def _extended_law(curve: FrictionCurve, fit: StaticLaw, part: _Term, key: Part) -> tuple[StaticLaw | None, str]:
    """Return the law with a part, or the reason why not; both if the part is an extrapolation below the speeds."""
    if key == "no":
        return None, NOT_ASKED
    if part.refusal:
        return None, part.refusal
    terms = part.added(fit.terms)
    if terms == fit.terms:
        return None, "this term needs a Stribeck curve, which is not identifiable"
    try:
        wider = fit_curve(curve, terms)
    except FitError as error:
        return None, str(error)
    new = [name for name in wider.names if name not in fit.names]
    chance = terms_p_value(fit.cost, wider.cost, len(new), wider.dof)
    if part.is_tested and chance > FALSE_ALARM and key == "auto":
        return None, f"{ABSENT} (p-value {chance:.2g}); more runs or less noise may reveal it"
    wide, lowest = _widest(wider, new), float(curve.speed.min())
    nu_s = wider.values["stribeck_velocity"] if "stribeck_velocity" in new else np.inf
    if lowest <= LOWEST_SPEED * nu_s:
        return (wider, "") if wide is None else (None, wide)
    text, (coulomb, std) = above_stribeck(lowest, nu_s), wider.value_and_std("coulomb")
    is_significant = std < MAX_RELATIVE_STD * coulomb and wider.value_and_std("stiction")[0] > 0
    return (wider, text) if is_significant and chance <= FALSE_ALARM else (None, f"{text}; {extrapolates(lowest)}")


def above_stribeck(lowest: float, nu_s: float) -> str:
    """Return the reason why speeds show no stiction."""
    return (
        f"the lowest speed of {lowest:.3g} is above a third of the Stribeck velocity (about {nu_s:.3g}); "
        f"measure at {LOWEST_SPEED * nu_s:.2g} and below"
    )


def _add_curve_uncertainty(curve: FrictionCurve, fit: StaticLaw, stribeck: _Term, spec: LawSpec) -> StaticLaw:
    """Return fit with the difference to other Stribeck curves that the torques do not exclude in its covariance.

    These are of another exponent where it is held, and, where there is none, below the lowest speed.
    """
    has_curve, changes = "stribeck_velocity" in fit.names, [np.zeros(len(fit.names))]
    is_free = "exponent" in fit.names or (has_curve and spec.exponent == "no")
    if is_free or spec.stribeck == "no" or stribeck.refusal:
        return fit
    terms = fit.terms if has_curve else stribeck.added(fit.terms)
    exponent_used = terms.fixed["exponent"]
    allowed = [a for a in EXPONENTS if a == exponent_used or spec.exponent != "no"]
    for exponent in (a for a in allowed if a != exponent_used or not has_curve):
        try:
            trial = fit_curve(curve, replace(terms, fixed={**terms.fixed, "exponent": exponent}))
        except FitError:
            continue
        would_show = not has_curve and curve.speed.min() <= LOWEST_SPEED * trial.values["stribeck_velocity"]
        if trial.cost < fit.cost + MAX_COST and trial.value_and_std("stiction")[0] > 0 and not would_show:
            changes.append(np.array([trial.values[name] - fit.values[name] for name in fit.names]))
    change = max(changes, key=lambda shift: float(abs(shift[fit.names.index("coulomb")])))
    return replace(fit, covariance=fit.covariance + np.outer(change, change))


def extrapolates(lowest: float) -> str:
    """Return the end of a reason why a law has no Stribeck effect; lowest: speed that was measured."""
    return f"F_c is extrapolated to zero from speeds of {lowest:.2g} and above, and friction below may be larger"


def _widest(fit: StaticLaw, names: list[str]) -> str | None:
    """Return the reason why a number of the new part is unknown; a slope over temperature or direction may be zero."""
    for name in names:
        if name.startswith("directions") or (name.startswith("temperature") and name not in COOLING):
            continue
        value, std = fit.value_and_std(name)
        if not std < 0.5 * abs(value) or value <= 0:  # a 95 % interval with 0
            return f"{name} would be {value:.3g} +- {std:.2g}, which is not significant; measure at more speeds"
    return None


def _candidate_terms(curve: FrictionCurve) -> tuple[_Term, ...]:
    speeds = _distinct(np.log(curve.speed), 0.05)
    temperatures = _distinct(curve.measured_temperatures, TEMPERATURE_STEP_K)
    loads = _distinct(curve.load / max(float(curve.load.max()), 1e-300), 0.05)

    def shortage(count: int, needed: int, what: str, advice: str) -> str:
        return "" if count >= needed else f"{needed} {what} are needed, and these runs have {count}; {advice}"

    stribeck = shortage(speeds, MIN_SPEEDS, "speeds", extrapolates(float(curve.speed.min())))
    uneven = (
        "the difference between the directions does not change with speed beyond chance, and a constant one cannot be "
        "distinguished from an offset of the torque"
    )
    uneven = shortage(speeds, 4, "speeds", "record them both ways") or uneven  # four show a difference of slopes
    uneven = "" if {1.0, -1.0} <= set(curve.direction.tolist()) else uneven
    one_load, two_loads = (shortage(loads, n, "loads", "measure in more postures or with payloads") for n in (2, 3))
    one_T, two_T = (shortage(temperatures, n, "temperatures", "measure cold and warm, with its log") for n in (2, 3))
    by_speed = shortage(speeds, 2, "speeds", "at one speed the whole torque changes")
    return (
        _Term("stribeck", stribeck, ("stiction",), ("stribeck_velocity",), fixed={"exponent": EXPONENTS[-1]}),
        _Term("directions", uneven, ("directions.coulomb", "directions.viscous")),
        _Term("load", one_load, ("load.coulomb",)),
        _Term("load", one_load, ("load.stiction",), after="stribeck_velocity"),
        _Term("load", two_loads, (), ("load.stribeck_velocity",), "load.stiction"),
        _Term("temperature", one_T or by_speed, ("temperature.viscous",), fixed={"temperature.decay": START_DECAY_K}),
        _Term("temperature", one_T, ("temperature.stiction",), ("temperature.stribeck_velocity",), "stribeck_velocity"),
        _Term("temperature", two_T, (), ("temperature.decay",), "temperature.viscous", is_tested=False),
        _Term("exponent", stribeck, (), ("exponent",), "stribeck_velocity", is_tested=False),
        _Term("temperature", one_T, ("temperature.coulomb",)),
        _Term("quadratic", stribeck, ("quadratic",)),
    )


def _distinct(values: FloatArray, step: float) -> int:
    """Return the number of values that are apart by more than the step, counted upwards."""
    count, last = 0, -np.inf
    for value in np.sort(values).tolist():
        if value > last + step:
            count, last = count + 1, value
    return count
