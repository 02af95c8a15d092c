"""GearResult: estimated gear effects and parameters, and the characteristics of each gear; the fit with this result."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95
from elastid.fit.result import Result
from elastid.fit.status_terms import CODES_WITH_CAUSE, DISTORTED, Status
from elastid.nonlinear.basis_functions import GearEffect

# Gear effects explain the misfit of the linear fit if their residual is smaller than this fraction of its residual: 5
# correct models have at most 0.014, 4 wrong models at least 0.6 (scripts/studies/results.csv).
MAX_UNEXPLAINED = 0.25
NOT_EXPLAINED = "the estimated gear effects do not explain it"
NOT_OPENED = "the effects of the gears were not estimated (see the line `gears`)"
# Manufacturers' units: 1 rad is this number of arcmin and arcsec.
ARCMIN, ARCSEC = 180 * 60 / math.pi, 180 * 3600 / math.pi
_MAKERS: dict[str, tuple[str, float]] = {
    "stiffness": ("N*m/arcmin", 1 / ARCMIN), "angle": ("arcmin", ARCMIN), "error": ("arcsec", ARCSEC),
    "share": ("%", 100.0),
}  # fmt: skip


@dataclass(frozen=True)
class GearNumber:
    """Gearbox characteristic with its std or, if insignificant, its upper 95 % bound; SI units, link side.

    name: k_1.  kind: `stiffness`, `damping`, `angle`, `error`, `torque` or `share`.  order: per motor revolution,
    with the phase of the sine in rad and its std; 0 if not periodic.  rated_fraction: value or bound over the joint's
    rated torque.  linear: value of the linear fit.  NaN: does not apply.
    """

    name: str
    meaning: str
    kind: str
    unit: str
    value: float = math.nan
    std: float = math.nan
    bound: float = math.nan
    order: float = 0.0
    phase: float = math.nan
    phase_std: float = math.nan
    rated_fraction: float = math.nan
    linear: float = math.nan

    @property
    def is_significant(self) -> bool:
        """False for a characteristic with an upper bound only."""
        return math.isfinite(self.value)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval; its lower end is at least 0 for a magnitude."""
        low, high = self.value - QUANTILE_95 * self.std, self.value + QUANTILE_95 * self.std
        return (low if self.kind in ("stiffness", "damping") else max(low, 0.0)), high

    @property
    def sentence(self) -> str:
        """Sentence such as `k_1 = 1.5e5 N*m/rad, std 20, 1.49996e5 to 1.50004e5 (stiffness at zero torque)`."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        if not self.is_significant:
            return f"{self.name} below {self.bound:.3g}{unit}, not significant ({self.meaning})"
        low, high = self.interval
        turn = f", phase {self.phase:.3g} rad" if self.order else ""
        ends = f"std {self.std:.3g}, {low:.6g} to {high:.6g}"
        return f"{self.name} = {self.value:.9g}{unit}{turn}, {ends} ({self.meaning})"

    @property
    def maker_unit(self) -> str:
        """Unit in manufacturers' data sheets; empty if it is the SI unit."""
        return _MAKERS.get(self.kind, ("", 1.0))[0] if "rad" in self.unit or self.kind == "share" else ""

    @property
    def factor(self) -> float:
        """Factor from SI to the manufacturers' unit."""
        return _MAKERS[self.kind][1] if self.maker_unit else 1.0


@frozen_value
class GearSheet:
    """Characteristics of one joint's gear, and its torsion over torque in a closed loop.

    peak: largest torque of the gear in the records, Nm.  torque, torsion, torsion_std (n,): loop up to this torque.
    """

    joint: str
    numbers: tuple[GearNumber, ...]
    peak: float
    torque: FloatArray = labelled("torque of the gear, a loop", "N*m")
    torsion: FloatArray = labelled("torsion of the gear", "rad")
    torsion_std: FloatArray = labelled("its standard deviation", "rad")

    def number(self, name: str) -> GearNumber | None:
        """Return the characteristic of this name, or None."""
        return next((number for number in self.numbers if number.name == name), None)


@frozen_value
class GearResult:
    """Estimate of the fit's parameters x (n_x,) and of the magnitudes (n_f,) of effects, link side.

    covariance (n_x + n_f, n_x + n_f).  Stiffness is at zero torque.  sheets: one for each gear.  refused: reason why no
    effects were estimated; x is then the fit's, and there are no sheets.  before, after: unexplained fraction of the
    motors' motion at the excited lines, of the linear fit and with the effects.  notes: on gears without an estimate.
    """

    x: FloatArray = labelled("estimate as the variable of the solver")
    covariance: FloatArray = labelled("covariance of x and the magnitudes")
    effects: tuple[GearEffect, ...] = ()
    magnitudes: FloatArray = labelled("magnitude of each effect, link side", default_factory=lambda: np.zeros(0))
    sheets: tuple[GearSheet, ...] = labelled(entry="joint", default=())
    refused: str = ""
    before: float = math.nan
    after: float = math.nan
    notes: tuple[Note, ...] = ()

    @property
    def explains_misfit(self) -> bool:
        """True if the effects explain most of the linear fit's residual, which then does not limit them."""
        return bool(self.effects) and self.after < MAX_UNEXPLAINED * self.before

    def unanswered_notes(self, notes: Iterable[Note]) -> tuple[Note, ...]:
        """Return the notes of a fit and its responses whose cause the effects do not explain."""
        return tuple(note for note in notes if not (self.explains_misfit and note.code in CODES_WITH_CAUSE))

    def magnitude(self, kind: str, joint: str) -> float:
        """Return the sum of the magnitudes of a kind of effect at a joint; 0 without any."""
        mask = [(effect.kind, effect.joint) == (kind, joint) for effect in self.effects]
        return float(self.magnitudes[np.array(mask, bool)].sum())

    @property
    def numbers(self) -> tuple[GearNumber, ...]:
        """Characteristics of all gears."""
        return tuple(number for sheet in self.sheets for number in sheet.numbers)


def with_gears(result: Result, gears: GearResult | None) -> Result:
    """Return the fit with the estimate of the gears, and without status misfit if the effects explain the misfit.

    The excess of its V over the noise then decreases with the square of the unexplained motion. A misfit by
    contradicting load tests remains. If no effects were estimated, the fit is unchanged except for a misfit's message.
    """
    if gears is None or gears.refused:
        is_reported = gears is None or result.status != "misfit"
        return result if is_reported else replace(result, message=f"{result.message}; {NOT_OPENED}")
    n, empty = len(gears.x), np.zeros((0, 2))
    final = replace(result, x=gears.x, covariance=gears.covariance[:n, :n], profile95=empty, bootstrap95=empty)
    is_misfit = result.status == "misfit"
    if (result.static is not None and result.static.disagrees) or not gears.explains_misfit:
        return replace(final, message=f"{result.message}; {NOT_EXPLAINED}") if is_misfit else final
    if not is_misfit and DISTORTED not in result.verdicts and not result.exceeds_noise:
        return final
    message = f"{result.message.partition('. ')[0].partition(', but ')[0]} with the effects of the gears"
    if is_misfit:
        status: Status = "converged" if result.noise_is_known else "noise_unknown"
        final = replace(final, status=status, at_bound=np.zeros_like(result.at_bound))
        message = (
            "the effects of the gears explain the misfit of the linear fit: they leave "
            f"{100 * gears.after:.2g} % of the position signal unexplained, the linear fit {100 * gears.before:.2g} %"
        )
    excess = max(result.cost - result.cost_expected, 0.0) * (gears.after / gears.before) ** 2
    notes, cost = gears.unanswered_notes(result.notes), result.cost_expected + excess
    return replace(final, message=message, cost=cost, indices=(), verdicts=(), notes=notes)
