"""Result: estimate, covariance and status of a fit, and its predictions in any posture."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value, labelled
from elastid.base.display import Display, as_html, as_text, capital, digits, interval_of, number, percent
from elastid.base.errors import Named, Note, StudyError, UnknownNameError, did_you_mean, index_of, installed
from elastid.base.names import matching
from elastid.base.statistics import QUANTILE_95, correlation_of
from elastid.fit.load_tests import StaticAgreement, ToolAgreement
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.residual_test import exceeds_noise, max_cost_ratio
from elastid.fit.result_rows import NO_NUMBERS, NO_PAIRS, NO_TABLE, Estimate, ModificationIndex, Presliding, RigidPart
from elastid.fit.spec import TYPICAL_MODEL_ERROR
from elastid.fit.status_terms import (
    BIASED,
    BY_PRIOR,
    CAUSES,
    CONTRADICTED,
    DISTORTED,
    LARGE,
    MEANING,
    NO_CAUSE,
    OTHER_AMPLITUDE,
    OTHER_JOINTS,
    REQUIRED,
    Status,
)
from elastid.linear.fitted_model import Axes, FittedModel, ModelErrorFactor
from elastid.linear.linear_model import LinearModel
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import Configuration, Motion, Motors
from elastid.robot import Frame, Payload, Robot

if TYPE_CHECKING:
    from elastid.fit.posture import Family, Posture, PredictionPorts  # equations, which a page does without


def covariance_by_noise(C: FloatArray, n: int) -> FloatArray:
    """Return C_xx - C_xn C_nn^-1 C_nx (n, n), the conditional covariance of the first n variables given the others."""
    cross = C[:n, n:]
    if not np.isfinite(C).all():  # parameters that the data do not reach
        return C[:n, :n].copy()
    return C[:n, :n] - cross @ np.linalg.solve(C[n:, n:], cross.T)


ROUNDING = 1e-9  # of a std, below which a contribution to it is zero
CORRELATED = 0.99  # beyond which two parameters cannot be distinguished


def correlated(names: Sequence[str], covariance: FloatArray) -> Iterator[Note]:
    """Return a note for each indistinguishable pair.  covariance: by noise, since errors of a robot model move all."""
    correlation = np.triu(np.nan_to_num(correlation_of(covariance)), 1)
    for i, j in np.argwhere(np.abs(correlation) > CORRELATED):
        text = f"{names[i]} and {names[j]} are indistinguishable (correlation {correlation[i, j]:.4f}). Fix one of them"
        yield Note("fit/correlated", text)


# Std of an error that would explain a misfit over its step, and the explained fraction from which on a cause is alone:
# scripts/studies/prediction_anywhere.py has the fraction of intervals that contain the true values.
DOUBT, LONE_CAUSE = 0.6, 0.95


@frozen_value
class Result:
    """The estimate x (n_x,) with the covariance (n_x, n_x) of its variables, and where they came from.

    parameters: names, units, scale, bounds and starts.  covariance: of x, the largest of several estimates
    (`estimate_uncertainty`); infinite variances where the data do not reach.  cost: V.  cost_expected: the V that the
    measured noise alone would leave; 2 / cost_dof is the relative variance of V over it for a true model, NaN where no
    noise was measured.  singular_values: of the Jacobian with columns scaled to unit length, largest
    first.  starts: sorted by V.  n_converged_starts: of them that reached the best V.
    profile95, bootstrap95 (n_x, 2): further intervals in SI, NaN for parameters without, no rows where none has one.
    indices: of fixed numbers, in sequence and alone, if V exceeds the noise.
    assumed_rigid: parts assumed rigid, whose elasticity no response shows; empty without a diagnosis.
    presliding: friction of motors that was estimated, too; the covariance includes it.
    verdicts (n,): on each parameter of interest, in words; empty if the fit ended without an optimum.
    model_error: relative to abs(G) in weights and covariance, the largest of the responses.
    configurations, information_fraction (Q, n_x), information_band_hz (n_x, 2), averaging_fraction (n_x,),
    persistent_fraction (n_x,): as `Uncertainty`.
    linear: the model of each configuration, linearised at the estimate; empty where models are only compared.
    robot, equations: those that were fitted, for postures that were not measured.
    static, tool: static load tests, and responses at the tool, next to the responses of the motors; None without any.

    Examples
    --------
    >>> from elastid import Body, Joint, Motor, Robot, Spring, estimate, identify, simulate
    >>> joint = Joint("1", spring=Spring(100.0, damping=0.1), motor=Motor(0.01))
    >>> robot = Robot("bench", (Body("load", joints=(joint,), inertia=0.02),))
    >>> excitation = {"rate_hz": 500, "period": 1, "band_hz": [5, 50], "torque_rms": [1]}
    >>> experiment = {"configurations": {"bench": [0]}, "simulated": {"noise": {"torque_std": 0.01}}}
    >>> result = identify(estimate(simulate(robot, excitation=excitation, experiment=experiment)), robot, starts=2)
    >>> low, high = result.interval("k_1")  # N*m/rad
    >>> low < result["k_1"].value < high, result.status
    (True, 'converged')
    """

    parameters: Parameters
    x: FloatArray = labelled("estimate as the variable of the solver (ln p where log)", "", "free_names")
    covariance: FloatArray = labelled("covariance of x", "", "free_names free_names")
    cost: float
    dof: int
    cost_expected: float
    status: Status
    message: str
    starts: tuple[LocalOptimum, ...] = labelled(rows=True)
    n_converged_starts: int
    at_bound: BoolArray = labelled("estimates at a bound", "", "free_names")
    singular_values: FloatArray = labelled("singular values of the Jacobian, columns scaled")
    criterion: str
    notes: tuple[Note, ...] = ()
    profile95: FloatArray = labelled(
        "95 % interval by profile likelihood", "SI", "free_names end", default_factory=NO_PAIRS
    )
    bootstrap95: FloatArray = labelled("95 % interval by bootstrap", "SI", "free_names end", default_factory=NO_PAIRS)
    configurations: tuple[str, ...] = ()
    information_fraction: FloatArray = labelled(
        "fraction of the information", "", "configurations free_names", default_factory=NO_TABLE
    )
    information_band_hz: FloatArray = labelled(
        "middle half of that information", "", "free_names end", default_factory=NO_PAIRS
    )
    cost_dof: float = math.nan
    model_error: float = 0.0
    indices: tuple[ModificationIndex, ...] = labelled(rows=True, default=())
    assumed_rigid: tuple[RigidPart, ...] = labelled(rows=True, default=())
    presliding: tuple[Presliding, ...] = labelled(rows=True, default=())
    verdicts: tuple[str, ...] = ()
    linear: tuple[LinearModel, ...] = labelled(entry="configuration.name", default=())
    averaging_fraction: FloatArray = labelled(
        "fraction of the variance that averages out", "", "free_names", default_factory=NO_NUMBERS
    )
    persistent_fraction: FloatArray = labelled(
        "fraction of the variance that no data reduce", "", "free_names", default_factory=NO_NUMBERS
    )
    robot: Robot | None = None
    equations: ModelSpec | None = None
    static: StaticAgreement | None = None
    tool: ToolAgreement | None = None

    def __post_init__(self) -> None:
        n_x = len(self.parameters.free)
        if self.x.shape != (n_x,) or self.covariance.shape != (n_x, n_x) or self.at_bound.shape != (n_x,):
            raise ValueError(f"a fit of {n_x} free parameters has x {self.x.shape}, covariance {self.covariance.shape}")

    __repr__, _repr_html_ = as_text, as_html

    @property
    def presliding_stiffness(self) -> dict[str, float]:
        """Stiffness of the presliding friction of each motor that has any, N m/rad (N/m)."""
        return {friction.place: friction.stiffness for friction in self.presliding}

    @property
    def display(self) -> Display:
        """Status and message, and each free parameter with its interval."""
        values, std = self.values, self.std
        rows, least = [], {name: ROUNDING * number for name, number in std.items()}
        parts = {kind: part for kind, part in self.std_contributions.items() if any(part[p] > least[p] for p in part)}
        for p in self.parameters.of_interest:
            places = digits(values[p.name], std[p.name])
            ends = " to ".join(interval_of(self.interval(p.name), places))
            each = (stds_of[p.name] for stds_of in (*parts.values(), std))
            stds = [number(part if part > least[p.name] else 0.0, 2) for part in each]
            rows.append((p.name, number(values[p.name], places), *stds, ends, p.unit))
        std_of = "std" if self.noise_is_known else "std, of the residuals"
        headings = ("parameter", "value", *parts, std_of, "95 % interval", "unit")
        return Display(f"Fit: {self.message}", headings, rows)

    @property
    def meaning(self) -> str:
        """The meaning of the status for the parameters, with the next action."""
        if self.status == "misfit" and self.cause[0].startswith(REQUIRED):
            return CONTRADICTED
        if self.status != "converged":
            return MEANING[self.status]
        but = ", some biased (see their verdicts)" if BIASED in "".join(self.verdicts) else ""
        test = self.residual_test.partition(":")[0]
        return f"{self._counts}{but}; {test}. {capital(self.cause[0]) or self.coverage}"

    @property
    def _counts(self) -> str:
        """Numbers of the parameters that data, and prior alone, identify, and of the weakly identifiable, in words."""
        n, weak = len(self.parameters.of_interest), sum(note.code == "fit/weakly-identifiable" for note in self.notes)
        by_prior = [name for name, verdict in zip(self, self.verdicts, strict=False) if verdict == BY_PRIOR]
        good = n - weak - len(by_prior)
        if len(by_prior) == n:
            return f"all {n} parameters limited by tolerances of the robot model"
        parts = [f"{f'all {n}' if good == n else f'{good} of {n}'} parameters identified"]
        parts += [f"{len(by_prior)} limited by tolerances of the robot model ({', '.join(by_prior)})"] * bool(by_prior)
        return ", ".join([*parts, *[f"{weak} weakly identifiable"] * bool(weak)])

    @property
    def coverage(self) -> str:
        """The errors that the intervals include, in a sentence without its full stop."""
        errors = ["measured noise"]
        if self.exceeds_noise and self.model_error > TYPICAL_MODEL_ERROR:
            errors.append(f"the assumed model error of {percent(self.model_error)} of each FRF")
        elif np.any(1 - self.averaging_fraction - self.persistent_fraction > 0.01):
            is_friction = not (self.has_tolerances or self.model_error or DISTORTED in self.verdicts)
            errors.append("errors of the friction compensation" if is_friction else "small model errors")
        errors += ["the tolerances of the robot model"] * self.has_tolerances
        fixed = "" if self.has_tolerances else ". They assume that the fixed values of the robot model are exact"
        return f"The intervals cover {', '.join(errors[:-1])}{' and ' * (len(errors) > 1)}{errors[-1]}{fixed}"

    @property
    def residual_test(self) -> str:
        """Verdict of the residual test, the ratio of the residuals, and its limit."""
        if not self.noise_is_known:
            return "no residual test, because the noise is unknown"
        limit, ratio = math.sqrt(max_cost_ratio(self.cost_dof)), self.residual_ratio
        if self.exceeds_noise and self.model_error > TYPICAL_MODEL_ERROR:
            verdict = "passed" if self.is_within_declared else "failed"
            error = f"{number(self.error_ratio, 3)} times noise and assumed model error together"
            return f"residual test {verdict}: residuals {error} (rms; fixed limit {LARGE:g})"
        verdict = "failed" if self.exceeds_noise else "passed"
        words = f"residuals {number(ratio, 3)} times the noise (rms; limit {limit:.3g}, false-alarm rate 0.14 %)"
        return f"residual test {verdict}: {words}"

    @property
    def converged_starts(self) -> str:
        """Number of the searches from random start values that ended at the best optimum, in words."""
        return (
            f"{self.n_converged_starts} of {len(self.starts)} searches from random start values ended at this optimum"
        )

    @property
    def base_remarks(self) -> dict[str, str]:
        """For each stiffness that a typical base lowers beyond its interval: by how much."""
        limits, remarks = QUANTILE_95 * self.std_of_x, {}
        for part in self.assumed_rigid:
            for p, change, limit in zip(
                self.parameters.of_interest, part.changes.tolist(), limits.tolist(), strict=False
            ):
                if p.name.startswith("k") and -change > limit:
                    remarks[p.name] = (
                        f"{p.name} is estimated for a rigid base. If the base has a typical stiffness "
                        f"({part.stiffness:.2g} N*m/rad {part.name.removeprefix('base ')}), {p.name} is "
                        f"{percent(-math.expm1(change))} too low"
                    )
        return remarks

    @property
    def cause(self) -> tuple[str, str, str]:
        """The first cause of a model error, the full stop, and its remedy; empty texts if no cause is known."""
        notes = [str(note) for note in self.notes if note.code in CAUSES]
        if self.exceeds_noise and not self.is_within_declared:
            notes.append(f"{NO_CAUSE}. {self.test_of_causes}")
        return min(notes, key=lambda text: text.startswith(NO_CAUSE), default="").partition(". ")

    @property
    def shown_notes(self) -> tuple[Note, ...]:
        """Notes for a reader: without the sum of all tolerances if one value is named."""
        is_named = any(note.code == "fit/likely-cause" and NO_CAUSE not in note.text for note in self.notes)
        return tuple(note for note in self.notes if not (is_named and note.code == "fit/tolerances"))

    @property
    def test_of_causes(self) -> str:
        """The action where no cause explains the residuals."""
        return OTHER_AMPLITUDE if self.status == "converged" else OTHER_JOINTS

    @property
    def noise_is_known(self) -> bool:
        """True if noise was measured; otherwise residuals are compared with nothing."""
        return math.isfinite(self.cost_dof)

    @property
    def exceeds_noise(self) -> bool:
        """True if V exceeds the limit of noise alone (false-alarm rate 1/700)."""
        return self.noise_is_known and exceeds_noise(self.cost, self.cost_expected, self.cost_dof)

    @property
    def is_within_declared(self) -> bool:
        """True if the residuals exceed the noise, but not 1.5 times noise and declared model error (above 1 %)."""
        return self.exceeds_noise and self.model_error > TYPICAL_MODEL_ERROR and self.error_ratio < LARGE

    @property
    def error_ratio(self) -> float:
        """Ratio of residuals to noise and model error, root mean square."""
        return math.sqrt(self.cost / max(self.dof, 1))

    @property
    def residual_ratio(self) -> float:
        """Ratio of residuals to noise, root mean square."""
        return math.sqrt(self.cost / max(self.cost_expected, 1e-300))

    @property
    def inflation_factor(self) -> float:
        """Factor by which residuals above the noise widen the intervals, at least 1."""
        return max(1.0, self.residual_ratio)

    @property
    def values(self) -> dict[str, float]:
        """The estimate by name, in SI."""
        return self.parameters.as_dict(self.x)

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the free parameters in SI (first order for logarithmic ones)."""
        free = zip(self.parameters.free, self.x, self.std_of_x, strict=True)
        return Named("free parameter", {p.name: float(s * (np.exp(xi) if p.log else 1.0)) for p, xi, s in free})

    @property
    def std_of_x(self) -> FloatArray:
        """Standard deviations of x (n_x,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def has_tolerances(self) -> bool:
        """True if numbers of the robot's file moved within their tolerances."""
        return len(self.parameters.of_interest) < len(self.x)

    @property
    def std_noise(self) -> dict[str, float]:
        """Contribution to `std` of the measurement noise: the scatter of repeated measurements of one robot.

        Compare dates, or robots of one type, by this contribution: they share the errors of the robot model.
        """
        return self._part(self._shared(self.averaging_fraction, 1.0))

    @property
    def std_prior(self) -> dict[str, float]:
        """Contribution to `std` of the robot model's tolerances that no amount of data reduces."""
        return self._part(self._shared(self.persistent_fraction, 0.0))

    @property
    def std_systematic(self) -> dict[str, float]:
        """Remaining contribution: std^2 = std_noise^2 + std_prior^2 + std_systematic^2.

        Errors that repeated measurements share: the assumed model error, residuals above the noise, tolerances that
        more data narrow, errors of the friction compensation, and unexplained distortion.
        """
        return self._part(self._shared(1 - self.averaging_fraction - self.persistent_fraction, 0.0))

    @property
    def std_contributions(self) -> dict[str, dict[str, float]]:
        """The contributions to `std` by name; none for an exact robot model."""
        names = ("std_noise", "std_prior", "std_systematic") if self.has_tolerances else ()
        return {name: getattr(self, name) for name in names}

    @property
    def std_with_base(self) -> dict[str, float]:
        """`std` of each parameter of interest, including the uncertainty of an unmodelled base of typical stiffness."""
        n = len(self.parameters.of_interest)
        base = sum((part.changes**2 for part in self.assumed_rigid), np.zeros(n))
        return self._part(np.diag(self.covariance)[:n] + base)

    def _shared(self, fraction: FloatArray, without: float) -> FloatArray:
        """Return contributions (n_asked,) to the variance by `fraction`, else `without`; infinite if unidentifiable."""
        variance = np.diag(self.covariance)[: len(self.parameters.of_interest)]
        part = fraction[: len(variance)] if len(fraction) else np.full(len(variance), without)
        return np.where(np.isinf(variance), np.inf if without else 0.0, np.nan_to_num(variance, posinf=0.0) * part)

    def _part(self, variance: FloatArray) -> dict[str, float]:
        of_interest, std = self.parameters.of_interest, np.sqrt(np.maximum(variance, 0.0))
        scale = [math.exp(x) if p.log else 1.0 for p, x in zip(of_interest, self.x, strict=False)]
        return Named("parameter", {p.name: float(s * e) for p, s, e in zip(of_interest, std, scale, strict=True)})

    def interval(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of a free parameter in SI, by profile likelihood if computed, else symmetric in x.

        Symmetric in x is positive for a logarithmic one.  UnknownNameError for a name that was not identified, with
        those that were.
        """
        names = self.parameters.free_names
        if name not in names:
            why = "is fixed or tied" if name in self.values else "is no parameter of this fit"
            raise UnknownNameError(f"{name} {why}; {did_you_mean(name, names)}")
        i = names.index(name)
        if len(self.profile95) and not np.isnan(self.profile95[i]).any():
            return float(self.profile95[i, 0]), float(self.profile95[i, 1])
        reach = QUANTILE_95 * float(np.sqrt(self.covariance[i, i]))
        low, high = float(self.x[i]) - reach, float(self.x[i]) + reach
        with np.errstate(over="ignore"):
            return (float(np.exp(low)), float(np.exp(high))) if self.parameters.free[i].log else (low, high)

    def __len__(self) -> int:
        return len(self.keys())

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def keys(self) -> tuple[str, ...]:
        """Return the names of the identified parameters of interest: a result maps them to estimates."""
        return tuple(p.name for p in self.parameters.of_interest)

    def __contains__(self, name: object) -> bool:
        return name in self.parameters.free_names

    def __getitem__(self, name: str) -> Any:
        """Estimate of a parameter, or of a pattern (`k_*`); UnknownNameError for others."""
        if name not in self and (names := matching(name, self.keys())):
            return {key: self[key] for key in names}
        low, high = self.interval(name)
        return Estimate(name, self.values[name], self.std[name], low, high, self.parameters[name].unit)

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` in SI: value, std and its three contributions, low, high, unit, free.

        std and the 95 % interval are NaN for fixed and tied parameters, contributions also for an exact robot model.
        ElastidError if pandas is not installed.
        """
        values, std, free = self.values, self.std, self.parameters.free_names
        ends = {name: self.interval(name) for name in free}
        nan, names = math.nan, ("std_noise", "std_prior", "std_systematic")
        columns = ["value", *names, "std", "low", "high", "unit", "free"]
        parts = [self.std_contributions.get(name, {}) for name in names]
        rows = {
            p.name: (
                values[p.name], *(each.get(p.name, nan) for each in (*parts, std)), *ends.get(p.name, (nan, nan)),
                p.unit, p.name in free,
            )
            for p in self.parameters
        }  # fmt: skip
        return installed("pandas", "notebook").DataFrame.from_dict(rows, orient="index", columns=columns)

    def model(self, configuration: Configuration | str) -> FittedModel:
        """Return the fitted model in one configuration that was fitted, by its name: response, modes, state space.

        UnknownNameError names the configurations there are; ValueError for a result without models.
        """
        if not self.linear:
            raise ValueError("this result holds no models: it only compares fits, or was written by an older elastid")
        names = [linear.configuration.name for linear in self.linear]
        name = configuration.name if isinstance(configuration, Configuration) else str(configuration)
        linear = self.linear[index_of(name, names, "fitted model of configuration")]
        return FittedModel.of(linear, self.parameters, self.x, self.covariance)

    def at(
        self,
        posture: "Posture",
        inputs: Sequence[str] = (),
        outputs: Sequence[str] = (),
        *,
        motors: Motors = "locked",
        payload: Payload | Literal[False] | None = None,
        frame: Frame | str | None = None,
        axes: Axes = "own",
        quantity: Motion | None = None,
        controller: Any = None,
    ) -> FittedModel:
        """Return the fitted robot in any posture, in equilibrium under gravity: its responses, modes and stiffness.

        posture: angles of the driven joints (n_u,) in rad or m, a mapping from their names, or the name of a
        configuration that was fitted.  inputs: `force tool x`, `torque tool z` at any frame or body, `motor 1`; default
        the forces at the frame.  outputs: `frame tool x`, `accelerometer tool x`, `joint 1`, `motor 1`; default the
        motion of the frame.  motors: locked (brakes), free, or controlled by `controller`, a `ControllerSpec` or a
        `JointLoop`.  payload: another one, or False for none.  frame: of stiffness and of defaults; `tool`, else the
        last one, else the last body's centre of mass.  axes: of frames, their `own` or those of the base
        (world).  quantity: of outputs; positions, accelerations with accelerometers.  StudyError for places or angles
        that the robot lacks, and where it finds no rest.
        """
        from elastid.fit.posture import PredictionPorts, as_configuration

        ports = PredictionPorts(tuple(inputs), tuple(outputs), motors, payload, frame, axes, quantity, controller)
        family = self.family(ports, posture if isinstance(posture, str) else getattr(posture, "name", ""))
        return family.at(as_configuration(posture, family.robot, [linear.configuration for linear in self.linear]))

    def family(self, ports: "PredictionPorts", where: str = "") -> "Family":
        """Return the family of many postures. where: configuration whose group parameters apply."""
        from elastid.fit.posture import Family

        spec = self.equations or ModelSpec()
        estimates = self.parameters, self.x, self.covariance_of_prediction
        return Family.of(self.known_robot, spec, *estimates, ports, where, self.doubts)

    @property
    def known_robot(self) -> Robot:
        """The robot with the numbers of its file; StudyError of a result without one."""
        if self.robot is None:
            raise StudyError(
                "fit/no-robot",
                "this result holds no robot, as one that was written by an older elastid does; fit again (`elastid run "
                "STUDY fit`), or `elastid.identify(...)`",
            )
        return self.robot

    def with_parameters(self, **values: float) -> "Result":
        """Return the result with some numbers (SI) in place of its own: result.with_parameters(k_1=3e5).at("folded").

        They count as exact, all others keep their values and covariances.  UnknownNameError for a name that is none,
        TypeError if a value is not a number, ValueError for a tied number or a value out of range.
        """
        x, free = self.x.copy(), self.parameters.free_names
        is_free = np.array([name not in values for name in free])
        for name, value in values.items():
            p = self.parameters[name]
            if p.tie is not None:
                raise ValueError(f"{name} is tied to {p.tie.to}; change {p.tie.to} instead")
            if not math.isfinite(value) or (p.log and value <= 0):
                raise ValueError(f"{name} = {value:g}: give a finite {'positive ' if p.log else ''}number in {p.unit}")
            if name in free:
                x[free.index(name)] = p.to_x(value)
        return replace(
            self,
            parameters=self.parameters.with_values({name: v for name, v in values.items() if name not in free}),
            x=x,
            covariance=np.where(is_free[:, None] & is_free, self.covariance, 0.0),
            profile95=np.where(is_free[:, None], self.profile95, np.nan) if len(self.profile95) else self.profile95,
            indices=tuple(replace(index, effects=np.where(is_free, index.effects, 0.0)) for index in self.indices),
            message=f"{self.message}; by hand: {', '.join(f'{name} = {value:.6g}' for name, value in values.items())}",
        )

    @property
    def covariance_of_prediction(self) -> FloatArray:
        """`covariance`, including the disagreement between postures and bands if no single cause explains a misfit.

        Then it counts times the square of residuals over their noise.
        """
        is_unexplained = self.exceeds_noise and not self.has_lone_cause
        return self.covariance * self.inflation_factor**2 if is_unexplained else self.covariance

    @property
    def has_lone_cause(self) -> bool:
        """True if one cause explains the residuals beyond the noise."""
        return any(index.place == 1 and index.explained_fraction > LONE_CAUSE for index in self.indices)

    @property
    def doubts(self) -> tuple[ModelErrorFactor, ...]:
        """Numbers that would explain the model error, with errors of `DOUBT` times their steps."""
        if not self.exceeds_noise:
            return ()
        # A step explains the whole misfit: the 95 % interval of such an error contains it with a sixth to spare.
        leading = [index for index in self.indices if index.place] or list(self.indices[:1])
        return tuple(
            ModelErrorFactor(
                DOUBT * np.nan_to_num(index.effects, posinf=0.0, neginf=0.0), index.members,
                tuple((DOUBT * index.steps).tolist()), index.log,
            )
            for index in leading
        )  # fmt: skip

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix (n_x, n_x); rows of unreachable parameters are NaN off the diagonal."""
        return correlation_of(self.covariance)
