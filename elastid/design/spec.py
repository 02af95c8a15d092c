"""The `design` section of a study: candidates, the criterion of the choice, and the robot time that it may take."""

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.names import FileName, Name, matching
from elastid.base.section import Key, section
from elastid.base.units import JointPosition, Length, Time
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.robot import Vector3


@section
class BoxSpec:
    """A box that the robot must stay out of, its edges along the axes of the base frame."""

    # fmt: off
    name: Annotated[Name, Key("Name of the box, for messages.", "as people in the cell call it, since messages say "
        "what a posture would hit.")]
    lower: Annotated[Vector3, Key("Corner of smallest coordinates.", "measure it in the robot's base frame, and round "
        "outwards.")]
    upper: Annotated[Vector3, Key("Opposite corner, of largest coordinates.", "each of the three must exceed that of "
        "lower; a fence is a thin box.")]
    # fmt: on

    def __post_init__(self) -> None:
        if any(not low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"box {self.name}: each number of lower must be below that of upper")


@section
class CandidateSpec:
    """Configurations to choose from: drawn at random (200 by default), a grid, or those given by name."""

    # fmt: off
    random: Annotated[int | None, Key("Number of candidates that are drawn, uniformly within the joints' limits.",
        "1000 for six axes, at the cost of time in proportion; beyond that the criterion gains little.",
        least=1)] = None
    grid: Annotated[int | tuple[int, ...] | None, Key("Grid points per driven joint, one number for all or one for "
        "each, from limit to limit.", "3 to 5 for two or three axes; six axes need 3^6 = 729 postures, and drawn ones "
        "cover them better.", least=1)] = None
    given: Annotated[dict[FileName, tuple[JointPosition, ...]], Key("Candidates by name, name to angles. A joint that "
        "turns without limits does so within +-180 deg, one that slides must have them; a simulated carrier keeps its "
        "swing within the limits.", "postures that are known to be free and reachable, as taught points; nothing else "
        "is then chosen from.")] = field(default_factory=dict)
    margin: Annotated[JointPosition, Key("Further distance that drawn and grid candidates keep from the limits, room "
        "for the multisine; in m where a joint slides.", "the amplitude of multisine and carrier at the lowest line "
        "and some more; 0.05 rad is 3 deg.", least=0)] = 0.05
    floor: Annotated[Length | None, Key("Height of the floor in the base frame, along gravity, that nothing may reach.",
        "the height of the table, minus the reach of parts below the joints; without it nothing stops an elbow below "
        "the floor.")] = None
    boxes: Annotated[tuple[BoxSpec, ...], Key("Boxes that the robot must stay out of.", "tables, fences and the "
        "neighbouring robot; paths between postures are not checked.")] = ()
    clearance: Annotated[Length, Key("Distance that joints, centres of mass, frames and the lines between them "
        "keep from floor and boxes.", "half the width of the arm, and the swing of the excitation; a frame of the "
        "robot stands for a corner that sticks out.", least=0)] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        if (self.random is not None) + (self.grid is not None) + bool(self.given) > 1:
            raise ValueError("give only one of random, grid and given")
        if self.grid == ():
            raise ValueError("grid: each joint needs at least 1 point")


@section
class DesignSpec:
    """Choice of configurations in addition to those of experiment.configurations, for the smallest intervals of the
    parameters.
    """

    # fmt: off
    count: Annotated[int | None, Key("Number of configurations to choose, each measured experiment.realisations times; "
        "a configuration chosen twice gets twice the realisations.", "more where the stage design predicts intervals "
        "that are too wide; standard deviations fall with the root of the number.", least=1)] = None
    robot_time: Annotated[Time | None, Key("Robot time for the chosen configurations, as many as fit in; in place of "
        "count.", "where time is what is limited: an hour on the line; moving between postures is not counted.")] = None
    candidates: Annotated[CandidateSpec, Key("Configurations to choose from.", "more, or given ones, where the robot "
        "stands in a cell; the choice is only as good as what it may choose from.")] = CandidateSpec()
    parameters: Annotated[tuple[str, ...], Key("Names or patterns such as k_* of the parameters that count (default: "
        "all that the fit identifies); the volume of their confidence ellipsoid is to be the smallest.", "`k_*` where "
        "dampings and friction do not matter; the others are still unknowns, and cost what they cost.")] = ()
    distortion: Annotated[float, Key("Nonlinear distortion (friction above all) that is expected on top of the "
        "rig's noise, as the standard deviation of G relative to |G| in one realisation.", "0.03 to 0.1 from the "
        "report of an earlier measurement; without it many realisations seem as good as many periods, and predicted "
        "intervals are those of the simulated rig.", least=0)] = 0.0
    # fmt: on

    def __post_init__(self) -> None:
        if (self.count is None) == (self.robot_time is None):
            raise ValueError("give either count (of configurations) or robot_time (s)")


def interest(names: Sequence[str], patterns: Sequence[str]) -> FloatArray:
    """Columns (n, s) of the identity that select the parameters of names or patterns, all where there are none.

    StudyError for a pattern that matches none of the names.
    """
    chosen = {pattern: matching(pattern, names) for pattern in patterns}
    for pattern, matches in chosen.items():
        if not matches:
            raise StudyError(
                "design/goal", f"the fit does not identify '{pattern}'; {did_you_mean(pattern, list(names))}"
            )
    counts = [not patterns or any(name in matches for matches in chosen.values()) for name in names]
    return np.eye(len(names))[:, counts]


def unit_time_s(excitation: MultisineSpec, experiment: ExperimentSpec, n_u: int, periods: int) -> float:
    """Robot time of one configuration on a robot of n_u motors, at every amplitude, with its ramps and transients."""
    runs = len(excitation.amplitudes) * experiment.realisations * experiment.runs(n_u)
    at_ends = 2 * (experiment.ramp + experiment.hold)
    return runs * ((periods + experiment.transient_periods) * excitation.period + at_ends)


def room(spec: DesignSpec, excitation: MultisineSpec, experiment: ExperimentSpec, n_u: int) -> int:
    """The number of configurations that can be chosen in addition to those given."""
    if spec.robot_time is None:
        return spec.count or 0
    unit = unit_time_s(excitation, experiment, n_u, experiment.periods)
    return int(spec.robot_time / unit + 1e-9) - len(experiment.configurations)
