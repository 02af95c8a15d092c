"""Tolerances: prior standard deviations of the values of a robot model, from CAD, data sheets and drawings."""

import math
from typing import Annotated, Literal, TypeAlias

from elastid.base.names import PartName
from elastid.base.section import Key, section
from elastid.base.units import Angle, Length, Ratio
from elastid.robot.placement import Path

Exact: TypeAlias = Literal["exact"]
EXACT: Exact = "exact"
RATIO = 0.003  # relative std of a gear ratio over less than one motor revolution
TORQUE_CONSTANT_STD = 0.05  # relative, by scatter between motors of one type and by temperature


@section
class BodyTolerances:
    """Tolerances of one body, rod of a loop, or payload, instead of the default ones."""

    # fmt: off
    name: Annotated[PartName, Key("Name of the body, of a rod's loop, or `payload`.", "for a weighed body, a body with "
        "a pendulum test, or a body with cables that CAD lacks.")]
    mass: Annotated[Ratio | Exact | None, Key("Relative standard deviation of the mass (default: as for all bodies).",
        "0.5 % for a weighed body; `exact` for a calibrated weight.", above=0, most=1)] = None
    inertia: Annotated[Ratio | Exact | None, Key("Relative standard deviation of the inertia, one factor for all "
        "entries (default: as for all bodies).", "2 % after a pendulum test; 20 % without cables and covers.",
        above=0, most=1)] = None
    motor_inertia: Annotated[Ratio | Exact | None, Key("Relative standard deviation of the inertia of its motors "
        "(default: as for all bodies).", "2 % if brake and pinion are included.", above=0, most=1)] = None
    center_of_mass: Annotated[Length | Exact | None, Key("Standard deviation of each coordinate of the centre of mass "
        "(default: as for all bodies).", "2 mm for a body that was balanced on an edge.", above=0, most=1)] = None
    length: Annotated[Length | Exact | None, Key("Standard deviation of the lengths of joints and placement (default: "
        "as for all bodies).", "`exact` for a link measured on a coordinate measuring machine.", above=0,
        most=1)] = None
    angle: Annotated[Angle | Exact | None, Key("Standard deviation of the zeros of its joints (default: as for all "
        "bodies).", "0.02 deg if the zeros were set with a dial gauge.", above=0, most=1)] = None
    # fmt: on


@section
class Tolerances:
    """Prior standard deviations of the values of a robot model that a fit does not identify.

    All entries of an inertia have one common factor, as with a wrong density in a CAD model.
    """

    # fmt: off
    mass: Annotated[Ratio | Exact, Key("Standard deviation of the mass of each body, relative.", "1 % for a recent CAD "
        "model with cables and oil, 10 % for a guess from a picture, `exact` for calibrated masses.", above=0,
        most=1)] = 0.03
    inertia: Annotated[Ratio | Exact, Key("Standard deviation of the inertia of each body about its centre of mass, "
        "relative, one factor a body.", "5 % for a recent CAD model, 30 % where only boxes were drawn.", above=0,
        most=1)] = 0.1
    motor_inertia: Annotated[Ratio | Exact, Key("Standard deviation of the inertia of each motor, relative.", "10 % if "
        "brake, pinion or input stage of the gear may be missing.", above=0, most=1)] = 0.05
    center_of_mass: Annotated[Length | Exact, Key("Standard deviation of each coordinate of the centres of mass.",
        "3 mm for small robots; in proportion to the length of the links.", above=0, most=1)] = 0.01
    length: Annotated[Length | Exact, Key("Standard deviation of all non-zero lengths and joint locations.",
        "0.1 mm for a calibrated robot, 5 mm for lengths measured with a ruler.", above=0, most=1)] = 1e-3
    angle: Annotated[Angle | Exact, Key("Standard deviation of the zero offsets of rotary driven joints.",
        "0.02 deg after a calibration, 1 deg for marks aligned by eye.", above=0, most=1)] = math.radians(0.2)
    ratio: Annotated[Ratio | Exact, Key("Relative standard deviation of each gear ratio over less than one motor "
        "revolution, caused by transmission error; over n revolutions a fraction 1/n.", "amplitude of the transmission "
        "error in rad times the ratio: 20 arcsec at ratio 100 are 1 %.", above=0, most=1)] = RATIO
    torque_constant: Annotated[Ratio | Exact | None, Key("Relative standard deviation of each torque constant "
        "(default: 5 % if the logs contain current, exact if they contain torque).", "1 % for a calibrated motor; 5 % "
        "for a data sheet, which then limits the accuracy of masses and stiffnesses.", above=0, most=1)] = None
    bodies: Annotated[tuple[BodyTolerances, ...], Key("Bodies with tolerances of their own.", "for measured bodies; "
        "the end of a run states which measurement would narrow which interval.")] = ()
    # fmt: on

    @property
    def ratio_std(self) -> float:
        """Relative std of the gear ratios; 0 if exact."""
        return 0.0 if self.ratio == EXACT else float(self.ratio)

    def std(self, path: Path, body: str) -> float:
        """Return the std of the number at a path of a robot, relative or in m; 0 if exact.

        body: name of its body, loop or payload.
        """
        kind = kind_of(path)
        number = next((getattr(entry, kind, None) for entry in self.bodies if entry.name == body), None)
        value = getattr(self, kind, EXACT) if number is None else number
        return 0.0 if value == EXACT else float(value)


FileTolerances: TypeAlias = Tolerances | Exact | None


def kind_of(path: Path) -> str:
    """Return the key of the tolerance for the number at a path; empty without a tolerance."""
    keys = [key for key in path if isinstance(key, str)]
    last = keys[-1]
    if last == "inertia":
        return "motor_inertia" if "motor" in keys else "inertia"
    if last == "zero":
        return "angle"
    if last in ("mass", "center_of_mass"):
        return last
    is_length = last in ("xyz", "length") or (last == "point" and "compensators" not in keys)
    return "length" if is_length and "compensators" not in keys else ""
