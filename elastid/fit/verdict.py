"""Verdict: status, residual test and causes of a fit as sentences for console and page."""

import math
from dataclasses import dataclass

import numpy as np

from elastid.base.display import Display, capitalise, digits, format_interval, number, percent
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95, max_cost_ratio
from elastid.fit.fit_values import FitValues
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
    Meaning,
)

ROUNDING = 1e-9  # contribution to a std, relative to the std, below which it is zero


@dataclass(frozen=True)
class ResidualTest:
    """Test of the residuals against the noise: verdict, and ratio with its limit, empty if the noise is unknown."""

    verdict: str
    ratio: str = ""

    def __str__(self) -> str:
        return f"{self.verdict}: residuals {self.ratio}" if self.ratio else self.verdict


class Verdict(FitValues):
    """Values of a fit with sentences that interpret them."""

    @property
    def display(self) -> Display:
        """Status and message, and each free parameter with its interval."""
        values, std = self.values, self.std
        columns: dict[str, dict[str, float]] = {}
        for kind, stds in self.std_contributions.items():
            columns[kind] = {name: s if math.isinf(s) or s > ROUNDING * std[name] else 0.0 for name, s in stds.items()}
        columns = {kind: stds for kind, stds in columns.items() if any(stds.values())}
        columns["std" if self.noise_is_known else "std, of the residuals"] = std
        rows = []
        for p in self.parameters.of_interest:
            n_digits = digits(values[p.name], std[p.name])
            cells = [number(column[p.name], 2) for column in columns.values()]
            ends = " to ".join(format_interval(self.interval(p.name), n_digits))
            rows.append((p.name, number(values[p.name], n_digits), *cells, ends, p.unit))
        return Display(f"Fit: {self.message}", ("parameter", "value", *columns, "95 % interval", "unit"), rows)

    @property
    def meaning(self) -> Meaning:
        """The meaning of the status for the parameters, with the next action."""
        if self.status == "misfit" and self.required_value:
            return CONTRADICTED
        if self.status != "converged":
            return MEANING[self.status]
        bias = ", some biased (see their verdicts)" if BIASED in "".join(self.verdicts) else ""
        remark = capitalise(self.cause.fault) or self.coverage
        return Meaning(f"{self._counts}{bias}; {self.residual_test.verdict}", remark)

    @property
    def _counts(self) -> str:
        """Sentence on the numbers of identified, prior-limited and weakly identifiable parameters."""
        codes, n = [note.code for note in self.notes], len(self.parameters.of_interest)
        n_weak = codes.count("fit/weakly-identifiable")
        by_prior = [name for name, verdict in zip(self, self.verdicts, strict=False) if verdict == BY_PRIOR]
        n_identified = n - n_weak - len(by_prior)
        if len(by_prior) == n:
            return f"all {n} parameters limited by tolerances of the robot model"
        counts = [f"{'all' if n_identified == n else f'{n_identified} of'} {n} parameters identified"]
        if by_prior:
            counts.append(f"{len(by_prior)} limited by tolerances of the robot model ({', '.join(by_prior)})")
        if n_weak:
            counts.append(f"{n_weak} weakly identifiable")
        return ", ".join(counts)

    @property
    def coverage(self) -> str:
        """The errors that the intervals include, in a sentence without its full stop."""
        errors = ["measured noise"]
        if self.exceeds_noise and self.model_error > TYPICAL_MODEL_ERROR:
            errors.append(f"the assumed model error of {percent(self.model_error)} of each FRF")
        elif np.any(1 - self.averaging_fraction - self.persistent_fraction > 0.01):
            is_friction = not (self.has_tolerances or self.model_error or DISTORTED in self.verdicts)
            errors.append("errors of the friction compensation" if is_friction else "small model errors")
        assumption = ". They assume that the fixed values of the robot model are exact"
        if self.has_tolerances:
            errors.append("the tolerances of the robot model")
            assumption = ""
        errors[-2:] = [" and ".join(errors[-2:])]
        return f"The intervals cover {', '.join(errors)}{assumption}"

    @property
    def residual_test(self) -> ResidualTest:
        """Residual test in words: verdict, ratio of residuals to noise, and limit."""
        if not self.noise_is_known:
            return ResidualTest("no residual test, because the noise is unknown")
        if self.exceeds_noise and self.model_error > TYPICAL_MODEL_ERROR:
            verdict = "passed" if self.is_within_declared else "failed"
            error = f"{number(self.error_ratio, 3)} times noise and assumed model error together"
            return ResidualTest(f"residual test {verdict}", f"{error} (rms; fixed limit {LARGE:g})")
        verdict, ratio = "failed" if self.exceeds_noise else "passed", number(self.residual_ratio, 3)
        limit = f"limit {math.sqrt(max_cost_ratio(self.cost_dof)):.3g}, false-alarm rate 0.14 %"
        return ResidualTest(f"residual test {verdict}", f"{ratio} times the noise (rms; {limit})")

    @property
    def converged_starts(self) -> str:
        """Sentence on the number of searches from random start values that ended at the best optimum."""
        counts = f"{self.n_converged_starts} of {len(self.starts)} searches"
        return f"{counts} from random start values ended at this optimum"

    @property
    def base_remarks(self) -> dict[str, str]:
        """Sentence, by name, on each stiffness whose bias by a typical base exceeds its interval."""
        limits, remarks = (QUANTILE_95 * self.std_of_x).tolist(), {}
        for base in self.assumed_rigid:
            stiffness = f"{base.stiffness:.2g} N*m/rad {base.name.removeprefix('base ')}"
            for p, change, limit in zip(self.parameters.of_interest, base.changes.tolist(), limits, strict=False):
                if p.name.startswith("k") and -change > limit:
                    remarks[p.name] = (
                        f"{p.name} is estimated for a rigid base. If the base has a typical stiffness ({stiffness}), "
                        f"{p.name} is {percent(-math.expm1(change))} too low"
                    )
        return remarks

    @property
    def cause(self) -> Note:
        """First cause of a model error with its remedy; a note without texts if no cause is known."""
        causes = [note for note in self.notes if note.code in CAUSES]
        if self.exceeds_noise and not self.is_within_declared:
            causes.append(Note("fit/likely-cause", NO_CAUSE, remedy=self.test_of_causes))
        return min(causes, key=lambda note: note.text.startswith(NO_CAUSE), default=Note("fit/likely-cause", ""))

    @property
    def has_cause(self) -> bool:
        """True if the fit names a cause of its model error."""
        return not (self.cause.text or NO_CAUSE).startswith(NO_CAUSE)

    @property
    def required_value(self) -> str:
        """Value in words that the fit used instead of the value of the robot model; else empty."""
        _, is_required, value = self.cause.text.partition(f"{REQUIRED} ")
        return value.partition(";")[0] if is_required else ""

    @property
    def shown_notes(self) -> tuple[Note, ...]:
        """Notes to print: the note on all tolerances is omitted if a note names one likely cause."""
        is_named = any(note.code == "fit/likely-cause" and NO_CAUSE not in note.text for note in self.notes)
        return tuple(note for note in self.notes if not (is_named and note.code == "fit/tolerances"))

    @property
    def test_of_causes(self) -> str:
        """Next action if no cause explains the residuals."""
        return OTHER_AMPLITUDE if self.status == "converged" else OTHER_JOINTS
