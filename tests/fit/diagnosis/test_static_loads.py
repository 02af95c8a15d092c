"""Static load tests against responses: faults of the tests are found and named, true ones are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.data_sheet_arm import arm, measure
from plants.loaded_arm import NAMED, load_tests
from plants.refusals import refused
from plants.tapped_arm import FAULTS, WRIST, one_fit, taps
from plants.two_mass_gear import LINES, POSTURE, Gear, records, robot
from plants.weighed_arm import nominal, outside

import elastid as ei
from elastid.fit.identify import check_responses, identify
from elastid.fit.load_tests import LoadTest
from elastid.fit.problem.static_loads import placed_tests
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import JointLoop
from elastid.response import Covariance
from elastid.study import load_robot

SPEC = FitSpec(parameters={"k_*": ParameterSpec()}, starts=1)


def fitted(changed=lambda y, force: y, loaded=None):
    tests = load_tests(loaded or arm(), np.random.default_rng(5), changed=changed)
    return identify(measure(arm(), np.random.default_rng(6)), arm(), SPEC, loads=placed_tests(tests, NAMED))


def softer(factor):
    return arm().with_parameters({"k_2": factor * arm().parameters()["k_2"][0]})


CASES = {
    "factor": (lambda y, force: 1.2 * y, None, "all springs are softer at rest"),
    "friction": (lambda y, force: 0.8 * y, None, "all springs are stiffer at rest"),
    "stand": (lambda y, force: y - force / 1e6, None, "no single cause"),
    "spring": (lambda y, force: y, 0.7, "no single cause"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_fault_is_a_misfit(case):
    """Deflections of another stiffness, of all springs or of one, and of a gauge that stands on the base."""
    changed, factor, words = CASES[case]
    result = fitted(changed, None if factor is None else softer(factor))
    assert result.status == "misfit"
    assert words in result.static.cause
    assert [note for note in result.notes if note.code == "fit/loads"]


@pytest.mark.slow
def test_readings_that_no_robot_can_have_are_told_from_the_responses():
    """mm for m pull the springs so soft that the robot tips over; their factor is found beside the responses alone."""
    result = fitted(lambda y, force: 1e3 * y)
    assert result.status == "misfit"
    assert result.static.ratio == pytest.approx(1e3, rel=0.01)
    assert "the gauge are in another scale" in result.message


@pytest.mark.slow
def test_a_reading_in_a_wrong_unit_does_not_take_the_responses_with_it():
    """mm for m pulls both into a valley in which the responses alone would stay: they are searched from their start."""
    gear = Gear()
    link = replace(robot(gear).bodies[0], center_of_mass=(1.0, 0.0, 0.0), mass=1e-9)
    axis, spec = replace(robot(gear), bodies=(link,)), EstimatorSpec(friction="none", transient_periods=0)
    responses = [estimate(records(gear, seed=1, experiments=4), spec, LINES)]
    fit = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}, starts=3)
    test = LoadTest(configuration="rest", force=(0.0, 200.0, 0.0), along="y", deflection=1e3 * 200 / gear.k, std=5e-6)
    result = identify(responses, axis, fit, loads=placed_tests([test], {"rest": POSTURE}))
    assert result.status == "misfit", result.message
    assert "static load tests contradict the responses" in result.message
    assert result.values["k_1"] == pytest.approx(gear.k, rel=1e-3)


def test_the_ratio_and_wider_intervals():
    """A factor 1.2 is found as such; intervals that contain the pull of both hold the truth."""
    result = fitted(lambda y, force: 1.2 * y)
    assert abs(result.static.ratio - 1.2) < 4 * result.static.ratio_std + 1e-3
    assert result.static.ratio_std < 0.05
    for name in ("k_1", "k_2"):
        low, high = result.interval(name)
        assert low < arm().parameters()[name][0] < high


def test_true_tests_agree():
    """Ratio 1 within its error, no note."""
    result = fitted()
    assert result.status == "converged"
    assert abs(result.static.ratio - 1) < 3.5 * result.static.ratio_std
    assert not [note for note in result.notes if note.code == "fit/loads"]


@pytest.mark.slow
def test_taps_make_a_wrist_known_that_motors_barely_move() -> None:
    """Ten times narrower and more, within four standard deviations of the truth, and no contradiction."""
    both, alone, truth = one_fit(0, also_alone=True)
    assert alone is not None
    assert both.tool is not None
    assert not both.tool.disagrees, both.tool.cause
    assert abs(both.tool.ratio - 1) < 4 * both.tool.ratio_std
    assert [each.configuration.name for each in both.linear] == [f"p{i}" for i in range(5)]
    for name in WRIST:
        assert both.std[name] < alone.std[name] / 10, name
        assert abs(both.values[name] - truth[name]) < 4 * both.std[name], name


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "seed"), [("sign", 2), ("gear", 1)])
def test_a_contradiction_is_named_and_does_not_bend_the_numbers(fault: str, seed: int) -> None:
    """The cause first, a misfit, a warning; the numbers of the motors alone, with intervals that hold the truth.

    Of sign 2 a step of a wrong cause goes so far that slopes overflow.
    """
    both, _, truth = one_fit(seed, fault)
    assert both.tool is not None
    assert FAULTS[fault][1] in both.tool.cause.partition(" or ")[0]
    assert both.status == "misfit"
    assert "contradict" in both.message
    for name in ("k_1", "k_2", "k_3"):
        assert abs(both.values[name] - truth[name]) < 4 * both.std[name], name


def test_a_sensor_that_was_not_plugged_in_says_nothing(tiny: Path) -> None:
    """Zeros at the tool: a warning, the motors' numbers as they are, and no disagreement."""
    file, where = tiny.with_name("robot.yml"), ei.Configuration("a", np.zeros(1))
    file.write_text(file.read_text() + "frames: [{name: tool, body: load, placement: {xyz: [0.4, 0, 0]}}]\n")
    robot = load_robot(file)
    f = np.linspace(5, 80, 30)
    s = (2j * np.pi * f)[:, None, None]
    inertia, spring = 1e-3 * s**2, 0.01 * s + 60
    G = s**2 * (inertia + spring) / ((inertia + 1e-3 * s + spring) * (inertia + spring) - spring**2)
    of_motor = ei.Response(
        f, G, ("motor 1",), ("motor 1",), "acceleration", where, noise=Covariance(1e-4 * np.abs(G) ** 2, 1e4)
    )
    tool = ("force tool y",), ("frame tool y",)
    silent = ei.Response(
        f, 0 * G, *tool, "acceleration", ei.Configuration("a at the tool", np.zeros(1)),
        noise=Covariance(0 * np.abs(G), 1e4), motors="held",
    )  # fmt: skip
    result = identify([of_motor, silent], robot, FitSpec(parameters={"k_1": ParameterSpec()}, starts=1))
    assert result.tool is not None
    assert not result.tool.disagrees
    assert "none is more than noise" in result.tool.words
    assert result.tool.ratio_std == np.inf
    assert any("frame tool y" in note.text for note in result.notes)
    assert result.values["k_1"] == pytest.approx(60, rel=1e-6)


def test_what_no_motor_can_do_is_refused() -> None:
    """Motors that are held and move, or are controlled by nothing; torques of motors and forces in one response."""
    robot = nominal()
    tapped = taps(outside(robot), np.random.default_rng(0))[0]
    loop = JointLoop(np.ones(6), np.ones(6), np.ones(6))
    mixed = (*tapped.inputs[:2], "motor 1")
    for wrong in (
        replace(tapped, outputs=("motor 1", *tapped.outputs[1:])),
        replace(tapped, motors="controlled"),
        replace(tapped, motors="controlled", loop=loop),
        replace(tapped, inputs=mixed),
        replace(tapped, inputs=("motor 1", "motor 2", "motor 3")),
        replace(tapped, inputs=("force hok x", *tapped.inputs[1:])),
    ):
        with refused("fit/responses", place=f"configuration {tapped.configuration.name}"):
            check_responses([wrong], robot)
