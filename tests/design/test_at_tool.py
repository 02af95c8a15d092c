"""The forecast of load tests and taps against fits of a robot with equations of its own that has them."""

import re
from dataclasses import replace

import numpy as np
import pytest
from plants import tapped_arm, weighed_arm

from elastid.design.at_tool import study_tests, tool_notes
from elastid.design.prospect import ExpectedResponse, expected_fit
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.parameter_choice import choose
from elastid.fit.problem.elastic import linear_model
from elastid.fit.problem.static_loads import PlacedTest, placed_tests
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FitSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import EXACT
from elastid.robot import Frame


def forecasts(seed: int, tests: tuple[PlacedTest, ...]) -> tuple[dict[str, str], list]:
    """Text of each note by what it offers, taps or loads, and the fits that the study makes of its responses."""
    study = weighed_arm if tests else tapped_arm
    with_both, alone, _ = study.one_fit(seed) if tests else study.one_fit(seed, also_alone=True)
    robot = weighed_arm.nominal()
    true = weighed_arm.outside(robot.with_parameters({n: alone.values[n] for n in alone.parameters.free_names}))
    measured = weighed_arm.responses(true, np.random.default_rng(3))
    fitted, spec = FittedRobot.of(alone, robot, measured), FitSpec(weights=WeightSpec(floor=0.0))
    parameters = alone.parameters.with_means(alone.x)
    expected = [
        ExpectedResponse(replace(G, G=model.G), linear, weigh(G, spec), parameters, spec)
        for G, model, linear in zip(measured, fitted.responses, fitted.linear, strict=True)
    ]
    A = expected_fit(expected).evaluate(alone.x).hessian / 2
    std = np.array([alone.std[name] / alone.values[name] for name in alone.parameters.free_names])
    notes = tool_notes(expected, A, std, alone.robot, EXACT, study_tests(tests))
    assert {note.code for note in notes} <= {"design/forecast"}
    return {"taps" if "taps" in note.text else "loads": note.text for note in notes}, [with_both, alone]


def percent(text: str, name: str) -> tuple[float, float]:
    """Both ends of `k_6 from 16 % to 1.3 %`."""
    found = re.search(rf"{name} from ([\d.e+-]+) % to ([\d.e+-]+) %", text)
    assert found is not None, text
    return float(found[1]), float(found[2])


@pytest.mark.slow
def test_the_load_tests_of_a_study_bring_what_is_forecast() -> None:
    """Standard deviations of the wrist within 30 % of those of the fit that has the tests."""
    # The draws of the study's first fit.
    robot, rng = weighed_arm.nominal(), np.random.default_rng([0, 0])
    springs = {n: v * np.exp(0.1 * rng.standard_normal()) for n, (v, _) in robot.parameters().items() if n[0] in "kd"}
    true = weighed_arm.outside(robot.with_parameters(springs))
    where = {G.configuration.name: G.configuration for G in weighed_arm.responses(true, rng)}
    tests = placed_tests(weighed_arm.load_tests(true, rng), where)
    notes, (both, alone) = forecasts(0, tests)
    for name in ("k_4", "k_5", "k_6"):
        before, after = percent(notes["loads"], name)
        assert before == pytest.approx(100 * alone.std[name] / alone.values[name], rel=0.1)
        assert after == pytest.approx(100 * both.std[name] / both.values[name], rel=0.3), name


@pytest.mark.slow
def test_typical_taps_and_load_tests_are_offered_for_a_wrist() -> None:
    """Both are, with the frame and the postures; taps at the error of the study bring what its fit has, within 2."""
    notes, (both, alone) = forecasts(0, ())
    assert "taps with a hammer on hook in p0, p1, p2" in notes["taps"]
    assert "section `loads`" in notes["loads"]
    before, after = percent(notes["taps"], "k_6")
    assert before == pytest.approx(100 * alone.std["k_6"] / alone.values["k_6"], rel=0.1)
    # 2 % in three postures on other lines, where the study has 1 % in two.
    assert 0.5 < after / (100 * both.std["k_6"] / both.values["k_6"]) < 5


def test_a_frame_that_does_not_move_brings_nothing() -> None:
    """On the base: no note, and no error."""
    robot = replace(weighed_arm.nominal(), frames=(Frame("tool", "base"),))
    true = weighed_arm.outside(weighed_arm.nominal())
    measured = weighed_arm.responses(true, np.random.default_rng(0))[:1]
    parameters, spec = choose(FitSpec(), robot), FitSpec()
    linear = linear_model(Linearisation.of_robot(robot), measured[0], parameters.expand(parameters.x))
    expected = [ExpectedResponse(measured[0], linear, weigh(measured[0], spec), parameters, spec)]
    A = expected_fit(expected).evaluate(parameters.x).hessian / 2
    assert tool_notes(expected, A, np.ones(len(A)), robot, EXACT, ()) == ()
