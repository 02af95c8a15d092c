"""The `design` section of a study: candidates, criterion and robot time of the selection of configurations."""

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.names import FileName, Name, match_names
from elastid.base.section import Key, section
from elastid.base.units import JointPosition, Length, Time
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.robot import Vector3


@section
class BoxSpec:
    """Box that the robot must not enter, with edges along the axes of the base frame."""

    # fmt: off
    name: Annotated[Name, Key("Name of the box in messages.", "the name used in the cell.")]
    lower: Annotated[Vector3, Key("Corner with the smallest coordinates.", "measure it in the base frame, and round "
        "outwards.")]
    upper: Annotated[Vector3, Key("Opposite corner, with the largest coordinates.", "each coordinate must exceed "
        "lower; a fence is a thin box.")]
    # fmt: on

    def __post_init__(self) -> None:
        if any(not low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"box {self.name}: each coordinate of lower must be below upper")


@section
class CandidateSpec:
    """Candidate configurations: random (200 by default), on a grid, or listed with names."""

    # fmt: off
    random: Annotated[int | None, Key("Number of random candidates, uniform within the joint limits (default: 200 "
        "without grid and given).", "1000 for six axes; the gain beyond is small.", least=1)] = None
    grid: Annotated[int | tuple[int, ...] | None, Key("Grid points per driven joint between its limits, one number or "
        "one per joint (default: no grid).", "3 to 5 for two or three axes; for six axes random candidates cover the "
        "workspace better.", least=1)] = None
    given: Annotated[dict[FileName, tuple[JointPosition, ...]], Key("Candidates by name, name to angles (joints "
        "without limits within +-180 deg; sliding joints need limits).", "for configurations known to be free and "
        "reachable, such as taught points.")] = field(default_factory=dict)
    margin: Annotated[JointPosition, Key("Distance of random and grid candidates from the joint limits; in m for "
        "sliding joints.", "amplitude of multisine and superimposed slow motion at the lowest line; 0.05 rad is 3 "
        "deg.", least=0)] = 0.05
    floor: Annotated[Length | None, Key("Height of the floor in the base frame, along gravity (default: no floor).",
        "height of the table minus the dimensions of the links below the joints.")] = None
    boxes: Annotated[tuple[BoxSpec, ...], Key("Boxes that the robot must not enter.", "tables, fences and neighbouring "
        "robots; motion between configurations is not checked.")] = ()
    clearance: Annotated[Length, Key("Distance of joints, centres of mass, frames and their connecting lines from "
        "floor and boxes.", "half the width of the arm plus the amplitude of the excitation; add a frame for a "
        "protruding corner.", least=0)] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        if (self.random is not None) + (self.grid is not None) + bool(self.given) > 1:
            raise ValueError("give only one of random, grid and given")
        if self.grid == ():
            raise ValueError("grid: each joint needs at least 1 point")


@section
class DesignSpec:
    """Choice of configurations, in addition to experiment.configurations, for the smallest parameter intervals."""

    # fmt: off
    count: Annotated[int | None, Key("Number of chosen configurations, each measured experiment.realisations times "
        "(default: none; then robot_time).", "more if the predicted intervals are too wide; standard deviations "
        "decrease with the square root of the number.", least=1)] = None
    robot_time: Annotated[Time | None, Key("Robot time for the chosen configurations (default: none; then count).",
        "if robot time is limited; motion between configurations is not counted.")] = None
    candidates: Annotated[CandidateSpec, Key("Candidate configurations.", "give limits and boxes of the cell; the "
        "design can only be as good as its candidates.")] = CandidateSpec()
    parameters: Annotated[tuple[str, ...], Key("Names or patterns such as k_* of the parameters of interest, whose "
        "confidence ellipsoid is minimised (default: all parameters of the fit).", "`k_*` if damping and friction do "
        "not matter; the others remain nuisance parameters.")] = ()
    distortion: Annotated[float, Key("Expected nonlinear distortion in addition to noise: standard deviation of G "
        "relative to |G| in one realisation.", "0.03 to 0.1, from the report of an earlier measurement; it decides "
        "between realisations and periods.", least=0)] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        if (self.count is None) == (self.robot_time is None):
            raise ValueError("give either count (of configurations) or robot_time (s)")


def interest(names: Sequence[str], patterns: Sequence[str]) -> FloatArray:
    """Return the columns (n, s) of the identity that select parameters by patterns, all without patterns.

    StudyError for a pattern that no name matches.
    """
    selection = {name for pattern in patterns for name in identified_names(pattern, names)}
    return np.eye(len(names))[:, [not patterns or name in selection for name in names]]


def identified_names(pattern: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of parameters that match a pattern; StudyError if no name does."""
    if not (matches := match_names(pattern, names)):
        raise StudyError("design/goal", f"the fit does not identify '{pattern}'; {did_you_mean(pattern, list(names))}")
    return matches


def unit_time_s(excitation: MultisineSpec, experiment: ExperimentSpec, n_u: int, periods: int) -> float:
    """Return the robot time, s, of one configuration with n_u motors, at every amplitude, with ramps and transients."""
    runs = len(excitation.amplitudes) * experiment.realisations * experiment.runs(n_u)
    at_ends = 2 * (experiment.ramp + experiment.hold)
    return runs * ((periods + experiment.transient_periods) * excitation.period + at_ends)
