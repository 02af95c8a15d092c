"""The next experiment informs what the goal still lacks, keeps all limits, and says where none leads to the goal."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plants.limited_arm import LIMITS, arm, experiment
from plants.units import factor, in_other_units

from elastid.base.execution import Execution
from elastid.design.design import design, with_friction_damping
from elastid.design.next_experiment import Goal, NextExperiment, PriorEstimate, next_experiment
from elastid.design.problem import DesignProblem, with_typical_spectrum
from elastid.design.spec import BoxSpec, CandidateSpec, DesignSpec
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.reference_trajectory import movement
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.robot import Frame, Placement, Robot, Tolerances
from elastid.robot.simplified import without_dry_friction

EXCITATION = MultisineSpec(rate_hz=250.0, period=1.0, band_hz=(2.0, 60.0), torque_rms=(60.0, 50.0))
# Upright, the beam loads the spring of axis 1 with its smallest inertia; level, with its largest.
GIVEN = {"upright": (0.0, 0.0), "level": (0.0, 1.4)}


def problem(robot: Robot | None = None, excitation: MultisineSpec = EXCITATION, **candidates: object) -> DesignProblem:
    spec = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*")})
    chosen = DesignSpec(count=1, candidates=CandidateSpec(given=GIVEN, **candidates))
    own = experiment(CarrierSpec(amplitude=0.01), configurations={}, ramp=0.25)
    return DesignProblem(robot or arm(), excitation, own, spec, "acceleration", 1, chosen)


def proposed(
    asked: DesignProblem, goal: Goal, known: PriorEstimate | None = None, robots: tuple[Robot, ...] = ()
) -> NextExperiment:
    assert asked.design is not None
    how = asked.candidates(asked.design), known or PriorEstimate.of(asked), goal, robots
    return next_experiment(asked, *how, "x1", 7, Execution())


def deviations(asked: DesignProblem, name: str) -> dict[str, float]:
    """Of the stiffnesses, as the design of one posture by itself expects them."""
    own = replace(asked, design=None, experiment=replace(asked.experiment, configurations={name: GIVEN[name]}))
    forecast = design(own).forecast
    return dict(zip(forecast.parameters, np.sqrt(np.diag(forecast.covariance)).tolist(), strict=True))


def test_the_posture_is_that_which_informs_the_goal() -> None:
    """Each spring by itself, against the forecast of both postures as plans of their own; friction scatters by seed."""
    asked = problem(without_dry_friction(arm()))
    expected = {name: deviations(asked, name) for name in GIVEN}
    for spring in ("k_1", "k_2"):
        best = min(GIVEN, key=lambda name: expected[name][spring])
        np.testing.assert_allclose(proposed(asked, Goal({spring: 1e-9})).plan.configurations[0].angles, GIVEN[best])


def test_the_shortest_experiment_that_reaches_the_goal_is_taken() -> None:
    """For a fine goal long ones pay where noise limits, short ones where friction does, the same in all periods."""
    smooth = without_dry_friction(arm())
    coarse, fine = Goal({"k_1": 0.05, "k_2": 0.05}), Goal({"k_1": 1e-6, "k_2": 1e-6})
    for robot, best in ((smooth, 8), (arm(), 2)):
        asked = problem(robot)
        asked = replace(asked, experiment=replace(asked.experiment, periods=4))
        found = proposed(asked, coarse)
        assert found.plan.periods == 2
        assert found.option.reaches
        found = proposed(asked, fine)
        assert found.plan.periods == best
        assert found.option.more_s > found.plan.robot_time_s


def test_a_parameter_that_is_known_no_longer_counts() -> None:
    """Where the fit knows one spring a hundred times better than asked, the posture is that of the other."""
    asked = problem()
    before = PriorEstimate.of(asked)
    i = before.parameters.free_names.index("k_1")
    covariance = before.covariance.copy()
    covariance[i, i] = 1e-12
    goal = Goal({"k_1": 1e-4, "k_2": 1e-9})
    found = proposed(asked, goal, replace(before, covariance=covariance))
    alone = proposed(asked, Goal({"k_2": 1e-9}))
    np.testing.assert_array_equal(found.plan.configurations[0].angles, alone.plan.configurations[0].angles)


def test_limits_are_kept_on_every_robot_that_the_fit_allows() -> None:
    """Lighter rotors are faster: amplitudes fall until these, too, keep the margin."""
    asked = problem(excitation=replace(EXCITATION, torque_rms="limits"))
    light = arm().with_parameters({"Jm_1": 1e-3, "Jm_2": 1e-3})
    goal = Goal({"k_1": 1e-3, "k_2": 1e-3})
    alone, both = proposed(asked, goal), proposed(asked, goal, robots=(light,))
    assert alone.limit_use.used.max() > 0.8
    assert np.abs(both.plan.R).max() < 0.9 * np.abs(alone.plan.R).max()
    limits = np.array([LIMITS.torque, 1.5 - 1.4, LIMITS.velocity, LIMITS.acceleration])
    for run in both.plan.experiments:
        peaks = np.abs(replace(asked, robot=light).rig(both.plan).rehearse(run).signals).max(axis=(1, 2))
        assert np.all(peaks <= limits * (1 - EXCITATION.margin) * 1.001)


def test_excitation_peaks_exclude_postures() -> None:
    """A box a millimetre off the beam when it is level: free as a posture, and touched by its swing."""
    robot = replace(arm(), frames=(Frame("tip", arm().bodies[-1].name, Placement((0.0, 0.0, 0.5))),))
    x, z = 0.1 + 0.5 * np.sin(1.4), 0.4 + 0.5 * np.cos(1.4)
    box = BoxSpec("table", (x - 0.3, -0.5, z - 0.4), (x + 0.2, 0.5, z - 0.12))
    free = problem(robot)
    goal = Goal({"k_1": 1e-9})
    assert proposed(free, goal).plan.configurations[0].angles[1] in (0.0, 1.4)
    near = problem(robot, boxes=(replace(box, upper=(x + 0.2, 0.5, z - 0.001)),))
    assert near.design is not None
    assert len(near.candidates(near.design).configurations) <= 2
    assert proposed(near, goal).plan.configurations[0].angles[1] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("flat", ["torque", "information"])
def test_a_design_is_the_same_in_other_units(flat: str) -> None:
    """Torques, standard deviations, and the next experiment; numbers of the file within their tolerances."""
    robot = replace(without_dry_friction(arm()), tolerances=Tolerances())
    asked = problem(robot, replace(EXCITATION, torque_rms="limits", flat=flat), floor=0.1)
    other, goal = in_other_units(asked), Goal({"k_1": 1e-3, "d_2": 0.02})
    here, there = design(asked), design(other)
    np.testing.assert_allclose(there.plan.R, here.plan.R * factor("N*m"), rtol=1e-6)
    sizes = np.array([factor(unit) for unit in here.forecast.units])
    np.testing.assert_allclose(there.forecast.std, here.forecast.std * sizes, rtol=1e-6)
    one, same = proposed(asked, goal), proposed(other, goal)
    np.testing.assert_allclose(same.plan.R, one.plan.R * factor("N*m"), rtol=1e-6)
    assert same.option.more_s == pytest.approx(one.option.more_s * factor("s"))


def test_a_configuration_without_a_spectrum_has_the_typical_one() -> None:
    asked = problem(excitation=replace(EXCITATION, flat="information"))
    asked = with_typical_spectrum(asked, EXCITATION.torque_rms)
    amplitudes = np.abs(asked.plan(experiment()).R[0])
    np.testing.assert_allclose(amplitudes, np.broadcast_to(asked.typical_spectrum, amplitudes.shape))


def test_goal_is_reached_at_requested_interval() -> None:
    """Half widths of 95 % over those of the goal, by a covariance and by intervals; unknown numbers never are."""
    asked, goal = problem().parameters, Goal({"k_1": 0.02, "k_2": 0.1})
    std = np.array([0.02 if name == "k_1" else 0.05 for name in asked.free_names]) / 1.96
    np.testing.assert_allclose(goal.used(asked, asked.x, np.diag(std**2)), [1.0, 0.5], rtol=1e-4)
    intervals = {"k_1": (98.0, 102.0), "k_2": (0.0, np.inf)}
    result = SimpleNamespace(values={"k_1": 100.0, "k_2": 1.0}, interval=intervals.get)
    assert goal.reached(result) == {"k_1": pytest.approx(1.0), "k_2": np.inf}


def test_friction_damps_remaining_motion_and_carrier_uses_limits() -> None:
    """The damping of a design is that of the motion with it; candidates are off the limits by swing and margin."""
    asked = problem()
    settled = with_friction_damping(asked)
    probe = settled.probe(settled.experiment)
    ratios = np.array([joint.motor.ratio for joint in asked.robot.driven if joint.motor])
    values = [[robot.parameters()[f"fm_{i}"][0] for i in "12"] for robot in (settled.robot, asked.robot)]
    damping = settled.at_equilibria(
        probe, lambda q, c: settled.prospect(probe, q).equivalent_damping(c, asked.parameters.x)
    )
    np.testing.assert_allclose(np.mean(damping, axis=0), np.subtract(*values) * ratios**2, rtol=0.02)
    for carrier in (CarrierSpec(amplitude=0.5), CarrierSpec(kind="offset", velocity=0.2)):
        wide = replace(asked, experiment=experiment(carrier))
        drawn = wide.candidates(DesignSpec(count=1, candidates=CandidateSpec(random=500)))
        largest = np.abs([c.angles for c in drawn.configurations]).max()
        swing = np.abs(movement(carrier, wide.plan(wide.experiment)).position).max()
        assert largest == pytest.approx(1.45 - swing / (1 - EXCITATION.margin), abs=0.01)
