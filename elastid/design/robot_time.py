"""How many configurations fit into the robot time that a design is given; study and design ask alike."""

from __future__ import annotations

from elastid.design.spec import DesignSpec
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.experiment import ExperimentSpec


def unit_time_s(excitation: MultisineSpec, experiment: ExperimentSpec, n_u: int, periods: int) -> float:
    """Robot time of one configuration on a robot of n_u motors, its ramps and transients included."""
    runs = experiment.realisations * experiment.runs(n_u)
    at_ends = 2 * (experiment.ramp + experiment.hold)
    return runs * ((periods + experiment.transient_periods) * excitation.period + at_ends)


def room(spec: DesignSpec, excitation: MultisineSpec, experiment: ExperimentSpec, n_u: int, periods: int) -> int:
    """How many configurations of so many periods can be chosen beside those given."""
    if spec.robot_time is None:
        return spec.count or 0
    unit = unit_time_s(excitation, experiment, n_u, periods)
    return int(spec.robot_time / unit + 1e-9) - len(experiment.configurations)


def period_options(spec: DesignSpec, experiment: ExperimentSpec) -> tuple[int, ...]:
    """The numbers of periods that a design chooses from."""
    return spec.periods or (experiment.periods,)


def robot_time_refusal(spec: DesignSpec, excitation: MultisineSpec, experiment: ExperimentSpec, n_u: int) -> str:
    """A sentence where the robot time leaves no room for any configuration; an empty text where it does."""
    options = period_options(spec, experiment)
    if any(room(spec, excitation, experiment, n_u, periods) >= 1 for periods in options):
        return ""
    given, shortest = len(experiment.configurations), unit_time_s(excitation, experiment, n_u, min(options))
    return (
        f"{spec.robot_time:g} s leave no room for a configuration beside the {given} given: one takes {shortest:g} s "
        f"of the robot's time; give at least {(given + 1) * shortest:g} s, or fewer realisations or periods"
    )
