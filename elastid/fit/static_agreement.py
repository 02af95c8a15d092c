"""StaticAgreement, ToolAgreement: load tests and responses at the tool next to what motor responses alone predict."""

from __future__ import annotations

import math
from dataclasses import dataclass

from elastid.base.arrays import labelled


@dataclass(frozen=True)
class LoadReading:
    """One reading of a load test, and the deflection that the responses alone predict.

    direction (3,): in the axes of the base.  std: of the reading.  by_responses_std: of that prediction.
    """

    configuration: str
    frame: str
    direction: tuple[float, float, float]
    measured: float = labelled("measured deflection", "m")
    std: float = labelled("its standard deviation", "m")
    by_responses: float = labelled("deflection that the responses alone predict", "m")
    by_responses_std: float = labelled("its standard deviation", "m")


@dataclass(frozen=True)
class StaticAgreement:
    """Deflections of load tests over those of the responses alone, and whether both can be of one robot.

    ratio, ratio_std: of the deflections, NaN where the responses predict none.  chi_square, dof: of all readings.
    cause: the likeliest one in words where they disagree by more than chance, else empty.
    """

    readings: tuple[LoadReading, ...] = labelled(rows=True)
    ratio: float = math.nan
    ratio_std: float = math.nan
    chi_square: float = 0.0
    dof: int = 0
    cause: str = ""

    @property
    def disagrees(self) -> bool:
        """True if static and dynamic stiffness differ by more than chance."""
        return bool(self.cause)

    @property
    def words(self) -> str:
        """The comparison in a sentence."""
        rms = math.sqrt(self.chi_square / max(self.dof, 1))
        text = f"{len(self.readings)} readings of load tests are {rms:.3g} times their std from the responses, rms"
        if math.isfinite(self.ratio):
            text += f", {self.ratio:.4g} +- {self.ratio_std:.2g} times as large"
        return text


@dataclass(frozen=True)
class ToolComparison:
    """Responses by forces at the tool in one configuration, over those that the motors' responses alone predict.

    motors: held, free or controlled while they were measured.
    """

    configuration: str
    motors: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rms_log_db: float = labelled("measured over predicted magnitude, rms", "dB")


@dataclass(frozen=True)
class ToolAgreement:
    """Responses at the tool over those by the motors' responses alone, and whether both can be of one robot.

    ratio, ratio_std: of the magnitudes.  chi_square: with the errors of both, of `dof` real numbers that count; 1 per
    number where they agree.  cause: the likeliest one in words where they disagree by more than chance, else empty.
    is_misread: it is another reading of force and motion (sign, axis, quantity, motors), which pulls no spring.
    """

    responses: tuple[ToolComparison, ...] = labelled(rows=True)
    ratio: float = math.nan
    ratio_std: float = math.nan
    chi_square: float = 0.0
    dof: int = 0
    cause: str = ""
    is_misread: bool = False

    @property
    def disagrees(self) -> bool:
        """True if tool and motors show different robots by more than chance."""
        return bool(self.cause)

    @property
    def words(self) -> str:
        """The comparison in a sentence."""
        if not self.dof:
            return "no line of the responses at the tool counts: none is more than noise"
        rms = math.sqrt(self.chi_square / self.dof)
        many = len(self.responses) > 1
        count = f"{len(self.responses)} responses at the tool are" if many else "1 response at the tool is"
        return (
            f"{count} {rms:.3g} times {'their' if many else 'its'} std from what those of the motors allow, rms, "
            f"{self.ratio:.4g} +- {self.ratio_std:.2g} times as large"
        )
