"""Static load tests against responses: faults of the tests are found and named, true ones are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants import arm as planar
from plants.load_tests import NAMED, load_tests, measure, tapped
from plants.measured_robots import responses_of
from plants.refusals import refused
from plants.two_mass import two_inertias

import elastid as ei
from elastid.fit.identify import check_responses, identify
from elastid.fit.problem.static_loads import placed_tests
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.record import JointLoop
from elastid.response import Covariance
from elastid.study import load_robot

SPEC = FitSpec(parameters={"k_*": ParameterSpec()}, starts=1)


def fitted(changed=lambda y, force: y, stiffness=planar.STIFFNESS):
    tests = load_tests(np.random.default_rng(5), changed=changed, stiffness=stiffness)
    return identify(measure(np.random.default_rng(6)), planar.robot(), SPEC, loads=placed_tests(tests, NAMED))


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "leaning", "stiffer"), [(1.2, 0, 1), (0.8, 0, 1), (1, 1e-5, 1), (1, 0, (1.4, 0.7))])
def test_a_fault_is_a_misfit(factor, leaning, stiffer):
    """Deflections of all springs by one factor and by two, and of a gauge whose stand leans along x."""
    result = fitted(
        lambda y, force: factor * y - (leaning, 0, 0) * force, tuple(np.multiply(stiffer, planar.STIFFNESS))
    )
    assert result.status == "misfit"
    assert [note for note in result.notes if note.code == "fit/loads"]


@pytest.mark.slow
def test_readings_that_no_robot_can_have_are_told_from_the_responses():
    """mm for m pull the springs so soft that the robot tips over; their factor is found beside the responses alone."""
    result = fitted(lambda y, force: 1e3 * y)
    assert result.status == "misfit"
    assert result.static.ratio == pytest.approx(1e3, rel=0.01)


def test_the_ratio_and_wider_intervals():
    """A factor 1.2 is found as such; intervals that contain the pull of both hold the truth."""
    result = fitted(lambda y, force: 1.2 * y)
    assert abs(result.static.ratio - 1.2) < 4 * result.static.ratio_std + 1e-3
    assert result.static.ratio_std < 0.05
    for name, true in zip(("k_1", "k_2"), planar.STIFFNESS, strict=True):
        low, high = result.interval(name)
        assert low < true < high


POSTURES = {"p0": (0.3, 0.5), "p1": (-0.4, 1.0), "p2": (0.8, -0.6)}


def taps(rng: np.random.Generator, **fault: float) -> list[ei.Response]:
    """At the tool in each posture, 1 % of noise."""
    named = [ei.Configuration(f"{name} at the tool", np.array(angles)) for name, angles in POSTURES.items()]
    return [tapped(where, np.linspace(3, 40, 60), 0.01, rng, **fault) for where in named]


def fitted_with_taps(noise: float, **fault: float) -> tuple[ei.Result, ei.Result]:
    """Of the planar arm from a robot 10 % off, with taps and without; noise: of the motors' responses."""
    rng, spec = np.random.default_rng(1), FitSpec(parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec()}, starts=1)
    start = planar.robot().with_parameters({"k_1": 1.1 * planar.STIFFNESS[0], "k_2": 0.9 * planar.STIFFNESS[1]})
    measured = responses_of(planar.robot(), POSTURES, rng, np.linspace(2, 40, 40), noise)
    return identify([*measured, *taps(rng, **fault)], start, spec), identify(measured, start, spec)


def test_taps_tell_what_noisy_motors_barely_do() -> None:
    """Springs ten times narrower, within four standard deviations of the truth, and no contradiction."""
    both, alone = fitted_with_taps(0.3)
    assert not both.tool.disagrees, both.tool.cause
    assert abs(both.tool.ratio - 1) < 4 * both.tool.ratio_std
    assert all(each.rms_log_db < 20 for each in both.tool.responses)
    assert [each.configuration.name for each in both.linear] == [*POSTURES]
    for name, true in zip(("k_1", "k_2"), planar.STIFFNESS, strict=True):
        assert both.std[name] < alone.std[name] / 10, name
        assert abs(both.values[name] - true) < 4 * both.std[name], name


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "cause"), [({"sign": -1.0}, "opposite signs"), ({"softer": 0.1}, "no single cause")])
def test_a_contradiction_is_named_and_does_not_bend_the_numbers(fault: dict[str, float], cause: str) -> None:
    """The cause first, a misfit, a warning; the numbers of the motors alone, with intervals that hold the truth."""
    both, _ = fitted_with_taps(0.02, **fault)
    assert cause in both.tool.cause.partition(" or ")[0]
    assert both.status == "misfit"
    assert "fit/tool" in {note.code for note in both.notes}
    for name, true in zip(("k_1", "k_2"), planar.STIFFNESS, strict=True):
        assert abs(both.values[name] - true) < 4 * both.std[name], name


def test_a_sensor_that_was_not_plugged_in_says_nothing(tiny: Path) -> None:
    """Zeros at the tool: a warning, the motors' numbers as they are, and no disagreement."""
    file, where = tiny.with_name("robot.yml"), ei.Configuration("a", np.zeros(1))
    file.write_text(file.read_text() + "frames: [{name: tool, body: load, placement: {xyz: [0.4, 0, 0]}}]\n")
    robot = load_robot(file)
    f = np.linspace(5, 80, 30)
    G = two_inertias(f, 1e-3, 1e-3, 60.0, 0.01, 1e-3)[:, :1]
    of_motor = ei.Response(
        f, G, ("motor 1",), ("motor 1",), "acceleration", where, noise=Covariance(1e-4 * np.abs(G) ** 2, 1e4)
    )
    tool = ("force tool y",), ("frame tool y",)
    silent = ei.Response(
        f, 0 * G, *tool, "acceleration", ei.Configuration("a at the tool", np.zeros(1)),
        noise=Covariance(0 * np.abs(G), 1e4), motors="held",
    )  # fmt: skip
    result = identify([of_motor, silent], robot, FitSpec(parameters={"k_1": ParameterSpec()}, starts=1))
    assert not result.tool.disagrees
    assert result.tool.ratio_std == np.inf
    assert any("frame tool y" in note.text for note in result.notes)
    assert result.values["k_1"] == pytest.approx(60, rel=1e-6)


def test_what_no_motor_can_do_is_refused() -> None:
    """Motors that are held and move, or are controlled by nothing; torques of motors and forces in one response."""
    tapped, loop = taps(np.random.default_rng(0))[0], JointLoop(np.ones(2), np.ones(2), np.ones(2))
    for wrong in (
        {"outputs": ("motor 1", "frame tool z")},
        {"motors": "controlled"},
        {"motors": "controlled", "loop": loop},
        {"inputs": ("force tool x", "motor 1")},
        {"inputs": ("motor 1", "motor 2")},
        {"inputs": ("force hok x", "force tool z")},
    ):
        with refused("fit/responses", place=f"configuration {tapped.configuration.name}"):
            check_responses([replace(tapped, **wrong)], planar.robot())
