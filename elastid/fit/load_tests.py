"""The `loads` section of a study: static load tests, deflections of frames under stated loads with the motors locked.

StaticAgreement, ToolAgreement: load tests and responses at the tool compared with the fit of the motors' responses.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, labelled
from elastid.base.section import Key, section
from elastid.base.units import Force, JointPosition, Length, Mass, Torque
from elastid.robot import TOOL
from elastid.robot.placement import Axis, unit_axis

Deflection: TypeAlias = Length | tuple[Length, Length, Length]


@section
class LoadTest:
    """A load on a frame and the deflection of a frame from the unloaded robot to the loaded one, motors locked."""

    # fmt: off
    configuration: Annotated[str, Key("Name of the configuration of the load test (default: none; then angles).",
        "if responses were measured in the same configuration.")] = ""
    angles: Annotated[tuple[JointPosition, ...] | None, Key("Angles of the driven joints, m for sliding joints "
        "(default: none; then configuration).", "choose configurations in which the load deflects the springs that "
        "responses barely identify.")] = None
    frame: Annotated[str, Key("Frame at whose origin the load acts.", "frame of the hook or flange, not of the dial "
        "gauge.")] = TOOL
    force: Annotated[tuple[Force, Force, Force], Key("Force on the frame, in the axes of the base.", "as large as the "
        "robot's payload allows, since the error of the gauge is constant.")] = (0.0, 0.0, 0.0)
    torque: Annotated[tuple[Torque, Torque, Torque], Key("Torque on the frame, in the axes of the base.",
        "for two equal forces on a lever at the flange.")] = (0.0, 0.0, 0.0)
    mass: Annotated[Mass, Key("Mass hung on the frame; its weight adds to the force.", "for load tests with weights, "
        "instead of a force.", least=0)] = 0.0
    measured_at: Annotated[str, Key("Frame whose deflection is measured (default: frame of the load).", "if the gauge "
        "is at another location, or to separate springs before and behind it.")] = ""
    along: Annotated[Axis | None, Key("Direction of a dial gauge in the axes of the base: x, y, z or three numbers "
        "(default: none, a tracker measures x, y and z).", "direction of motion for a positive measurement.")] = None
    deflection: Annotated[Deflection | None, Key("Measured deflection: one number for a dial gauge, three for a "
        "tracker (default: measured by the simulated rig).", "loaded minus unloaded; average loading and unloading to "
        "remove most of the hysteresis.")] = None
    std: Annotated[Deflection | None, Key("Standard deviation of the deflection, one or three numbers (default: none; "
        "needed for a measured deflection).", "from repeated loading, which includes hysteresis and friction; the "
        "resolution of the gauge is too small.")] = None
    # fmt: on

    def __post_init__(self) -> None:
        if bool(self.configuration) == (self.angles is not None):
            raise ValueError("give the posture of a load test by its configuration or by its angles, one of them")
        if not (np.any(self.force) or np.any(self.torque) or self.mass):
            raise ValueError("a load test without a load; give force, torque or mass")
        if self.along is not None:
            unit_axis(self.along)
        n = self.n_readings
        if isinstance(self.deflection, tuple) != (n == 3) and self.deflection is not None:
            raise ValueError(
                "deflection: a dial gauge has one number and its direction `along`, a tracker three without `along`"
            )
        if self.std is None or not np.all(np.asarray(self.std) > 0):
            raise ValueError("give the std of the deflection, a positive number; 1 to 10 um are usual")
        if isinstance(self.std, tuple) and n == 1:
            raise ValueError("std: a dial gauge has one number")

    @property
    def n_readings(self) -> int:
        """Number of readings: 1 for a dial gauge, 3 for a tracker."""
        return 3 if self.along is None else 1

    @property
    def read_at(self) -> str:
        """The frame whose deflection is measured."""
        return self.measured_at or self.frame

    @property
    def directions(self) -> FloatArray:
        """Rows (n, 3): directions of the readings in the axes of the base."""
        return np.eye(3) if self.along is None else unit_axis(self.along)[None]

    @property
    def measured(self) -> FloatArray:
        """The readings (n,) in m; ValueError without a measurement."""
        if self.deflection is None:
            raise ValueError("a load test without a deflection: only a simulated rig can measure it")
        return np.atleast_1d(np.asarray(self.deflection, dtype=float))

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations (n,) of the readings in m."""
        return np.broadcast_to(np.asarray(self.std, dtype=float), self.n_readings)


@section
class LoadsSpec:
    """Static load tests, listed or in a file, whose deflections are fitted together with the responses."""

    # fmt: off
    file: Annotated[str | None, Key("CSV file with a row per test, relative to the study (default: no file). Columns: "
        "configuration or joint names, frame, measured_at, fx fy fz, tx ty tz, mass. Deflection: along_x along_y "
        "along_z, deflection, std; or x y z and std, or std_x std_y std_z. Units in brackets: `deflection [mm]`.",
        "for tests in a spreadsheet; omit columns that are not needed.")] = None
    tests: Annotated[tuple[LoadTest, ...], Key("Load tests in addition to the file.", "20 tests in several directions "
        "and configurations halve the intervals of springs that the motors barely "
        "excite.")] = field(default_factory=tuple)
    # fmt: on


@dataclass(frozen=True)
class LoadReading:
    """Reading of a load test, and its prediction by the fit of the responses alone.

    direction (3,): in the axes of the base.  std: of the reading.  by_responses, by_responses_std: prediction, its std.
    """

    configuration: str
    frame: str
    direction: tuple[float, float, float]
    measured: float = labelled("measured deflection", "m")
    std: float = labelled("its standard deviation", "m")
    by_responses: float = labelled("deflection that the responses alone predict", "m")
    by_responses_std: float = labelled("its standard deviation", "m")


@dataclass(frozen=True)
class ToolComparison:
    """Responses to forces at the tool in one configuration, relative to the prediction by the motors' responses.

    motors: locked, free or controlled during the measurement.
    """

    configuration: str
    motors: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rms_log_db: float = labelled("measured over predicted magnitude, rms", "dB")


@dataclass(frozen=True)
class Agreement:
    """Consistency test between an independent data set (load tests or tool FRFs) and the fit of the motor FRFs.

    ratio, ratio_std: measured over predicted deflection or magnitude; NaN without a prediction.  chi_square: weighted
    by the errors of both, with `dof` degrees of freedom.  cause: the likeliest cause of a significant difference.
    """

    ratio: float = math.nan
    ratio_std: float = math.nan
    chi_square: float = 0.0
    dof: int = 0
    cause: str = ""

    @property
    def disagrees(self) -> bool:
        """True if the difference between data set and prediction is significant."""
        return bool(self.cause)

    def _compared(self, count: int, noun: str) -> str:
        if not self.dof:
            return f"not comparable: the {noun} do not exceed the noise"
        text = f"{count} {noun}: rms deviation from the prediction {math.sqrt(self.chi_square / self.dof):.3g} std"
        return f"{text}; mean ratio {self.ratio:.4g} +- {self.ratio_std:.2g}" if math.isfinite(self.ratio) else text


@dataclass(frozen=True)
class StaticAgreement(Agreement):
    """Deflections of load tests compared with the fit of the responses alone."""

    readings: tuple[LoadReading, ...] = labelled(rows=True, default=())

    @property
    def sentence(self) -> str:
        """The comparison in a sentence."""
        return self._compared(len(self.readings), "readings of load tests")


@dataclass(frozen=True)
class ToolAgreement(Agreement):
    """Responses at the tool compared with the fit of the motors' responses alone.

    is_misread: the cause is a wrong interpretation of force and motion (sign, quantity, motors), not a stiffness.
    """

    responses: tuple[ToolComparison, ...] = labelled(rows=True, default=())
    is_misread: bool = False

    @property
    def sentence(self) -> str:
        """The comparison in a sentence."""
        return self._compared(len(self.responses), "responses at the tool")
