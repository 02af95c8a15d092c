"""Errors of held numbers that the free parameters take up: no residual shows them, and a sentence says how large."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.data_sheet_arm import SPEC as SPEC_OF_BASE
from plants.data_sheet_arm import arm, measure
from plants.faults import SPEC, Case, drawn, true_case

from elastid.base.arrays import ComplexArray
from elastid.base.errors import Note
from elastid.fit.diagnosis import judge
from elastid.fit.diagnosis.sensitivities import _with_torsions
from elastid.fit.diagnosis.undetectable_errors import UndetectableError, undetectable_errors
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring


def fitted(case: Case, noise: float = 0.005, seed: int = 0) -> Result:
    return identify(drawn(case, np.random.default_rng(seed), noise), case.robot, SPEC)


def exactness(result: Result) -> list[Note]:
    return [note for note in result.notes if note.code == "fit/held-as-exact"]


def test_a_held_number_moves_a_parameter_as_predicted_and_nothing_warns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of its errors per deviation move the parameter by three, and the fit is as fine as the true one."""
    found: list[UndetectableError] = []

    def kept(result, scores):
        found.extend(undetectable_errors(result, scores))
        return ()

    case = true_case()
    with monkeypatch.context() as patched:
        patched.setattr(judge, "find_undetectable_errors", kept)
        right = fitted(case)
    by_name = {one.name: one for one in found}
    for name in ("Jm_1", "m_fore"):
        one = by_name[name]
        assert one.error > 3 * one.per_std
        wrong_number = case.robot.parameters()[name][0] * np.exp(3 * one.per_std)
        wrong = fitted(replace(case, robot=case.robot.with_parameters({name: wrong_number})))
        assert wrong.status == "converged"
        assert not [note for note in wrong.notes if note.severity == "warning"]
        shift = (wrong.x - right.x)[one.parameter] / np.sqrt(right.covariance[one.parameter, one.parameter])
        assert abs(shift) == pytest.approx(3, rel=0.02)


def test_a_precise_fit_says_in_one_sentence_what_it_takes_as_exact() -> None:
    """With the parameter's std, the error that moves it so far, and the error that nothing finds."""
    (note,) = exactness(fitted(true_case()))
    assert note.severity == "information"
    assert note.text.startswith("the intervals take as exact what the fit held: ")
    assert 1 <= note.text.count(" of ") <= 4


def test_a_fit_that_is_wrong_or_knows_no_noise_says_nothing_of_it() -> None:
    """Its intervals are not believed anyway, or nothing says which errors would show."""
    case = true_case()
    heavier = {"m_fore": 1.05 * case.robot.parameters()["m_fore"][0]}
    wrong = fitted(replace(case, robot=case.robot.with_parameters(heavier)))
    assert wrong.status == "misfit"
    assert exactness(wrong) == []
    bare = [replace(response, total=None) for response in drawn(case, np.random.default_rng(0))]
    unknown = identify(bare, case.robot, replace(SPEC, weights=WeightSpec()))
    assert unknown.status == "noise_unknown"
    assert exactness(unknown) == []


def on_a_pedestal(stiffness: float) -> Robot:
    """The arm on a pedestal of that stiffness about the axis of its shoulder."""
    spring = Spring(stiffness, 1e-4 * stiffness)
    upper, fore = arm().bodies
    post = Body("post", joints=(Joint("post", "y", spring),), mass=200.0, inertia=20.0)
    return Robot("arm on a post", (post, replace(upper, parent="post"), fore))


def fitted_on_base(robot: Robot) -> Result:
    """A robot identified as if it were the arm on the ground."""
    return identify(measure(robot, np.random.default_rng(4), 2e-3), arm(), SPEC_OF_BASE)


def test_a_pedestal_that_no_response_shows_is_within_the_total_with_a_base() -> None:
    """120 times as stiff as the gear: k_1 is off by several of its own std, and by less than two with a usual base."""
    result, k = fitted_on_base(on_a_pedestal(120 * 3e4)), 3e4
    assert result.status == "converged"
    off = result.values["k_1"] - k
    assert abs(off) > 5 * result.std["k_1"]
    assert abs(off) < 2 * result.std_with_base["k_1"]
    assert result.std_with_base["k_2"] == pytest.approx(result.std["k_2"], rel=1e-6)
    (base,) = result.rigid_parts
    names = [parameter.name for parameter in result.parameters.asked]
    for name, true, rel in (("k_1", 3e4, 0.1), ("d_1", 60.0, 0.6)):  # the post's inertia damps, too
        stated = float(base.changes[names.index(name)]) * base.stiffness / (120 * 3e4)
        assert math.log(result.values[name] / true) == pytest.approx(stated, rel=rel)


def test_the_stiffness_from_which_on_a_base_is_hidden_is_where_it_moves_by_an_interval() -> None:
    """There the gear is off by 1.96 std; the sentence has both numbers and the advice."""
    result = fitted_on_base(arm())
    (base,) = result.rigid_parts
    softened = base.stiffness * 1e-2 / base.hidden_from
    assert softened == pytest.approx(1.96 * result.std["k_1"] / result.values["k_1"], rel=0.01)
    (note,) = [note for note in result.notes if note.code == "fit/undetectable"]
    assert "takes 1.00 % from k_1" in note.text
    assert f"{base.hidden_from:.2g} N*m/rad on" in note.text


def test_a_base_that_is_in_the_model_is_not_stated_as_rigid() -> None:
    """The robot's file has its spring."""
    robot = on_a_pedestal(20 * 3e4)
    spec = replace(
        SPEC_OF_BASE, parameters=SPEC_OF_BASE.parameters | {"d_post": ParameterSpec(start=100.0, fixed=True)}
    )
    result = identify(measure(robot, np.random.default_rng(4)), robot, spec)
    assert not result.rigid_parts
    assert result.std_with_base == pytest.approx(result.std)


def test_a_base_is_in_series_before_the_first_axis_and_does_not_turn_with_it() -> None:
    """Motor 2, whose axis the first one turns, feels a soft base about y at 0 deg and none at 90 deg."""
    turret = Body("turret", joints=(Joint("1", "z", Spring(3e5, 50), Motor(2e-3, 100)),), mass=100.0, inertia=9.0)
    upper = Body("upper", "turret", Placement(xyz=(0, 0, 0.5)),
                 (Joint("2", "y", Spring(2e5, 40), Motor(2e-3, 100)),), 40.0, (0, 0, 0.4), 3.0)  # fmt: skip
    robot, names = _with_torsions(Robot("two axes", (turret, upper)))
    assert [name for name in names if "upper" not in name] == ["k_base_x", "k_base_y"]

    def response(k: float, degrees: float) -> ComplexArray:
        sprung = robot.with_parameters({name: k if name == "k_base_y" else 1e10 for name in names})
        model, posture = formulate(sprung), Configuration("c", (math.radians(degrees), 0.2))
        linear = Linearisation.of(model).at(posture, model.theta, ("motor 1", "motor 2"), "acceleration")
        return to_response(linear, np.append(model.theta, 0.0), np.linspace(5, 30, 6)).G[:, 1, 1]

    np.testing.assert_allclose(response(5e5, 90), response(1e10, 90), rtol=1e-3)
    assert np.all(np.abs(response(5e5, 0) / response(1e10, 0) - 1) > 0.01)
