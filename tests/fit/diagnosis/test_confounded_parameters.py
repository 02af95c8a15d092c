"""Errors of held numbers that the free parameters take up: no residual shows them, and a sentence says how large."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.data_sheet_arm import SPEC as SPEC_OF_BASE
from plants.data_sheet_arm import arm, measure
from plants.faults import SPEC, Case, drawn, true_case

from elastid.fit.diagnosis import rank_hypotheses
from elastid.fit.diagnosis.confounded_parameters import STIFFEST_BASE, undetectable_errors
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.robot import Body, Joint, Robot, Spring


def fitted(case: Case) -> Result:
    return identify(drawn(case, np.random.default_rng(0), 0.005), case.robot, SPEC)


def test_fixed_number_moves_parameter_as_predicted_without_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three of its errors per deviation move the parameter by three, and the fit is as fine as the true one."""
    found, tests = [], []

    def kept(result, scores):
        found.extend(undetectable_errors(result, scores))
        tests.append(scores.test)
        return ()

    case = true_case()
    with monkeypatch.context() as patched:
        patched.setattr(rank_hypotheses, "find_undetectable_errors", kept)
        right = fitted(case)
    by_name = {one.name: one for one in found}
    further = [number.usual for number in tests[0].numbers if number.family == "compliance"]
    np.testing.assert_allclose(further, 1 / np.median([*case.stiffness.values()]))  # as the springs of the file
    for name in ("Jm_1", "m_fore"):
        one = by_name[name]
        assert one.error > 3 * one.per_std
        wrong_number = case.robot.parameters()[name][0] * np.exp(3 * one.per_std)
        wrong = fitted(replace(case, robot=case.robot.with_parameters({name: wrong_number})))
        assert wrong.status == "converged"
        assert not [note for note in wrong.notes if note.severity == "warning"]
        shift = (wrong.x - right.x)[one.parameter] / np.sqrt(right.covariance[one.parameter, one.parameter])
        assert abs(shift) == pytest.approx(3, rel=0.02)


@pytest.mark.slow
def test_unseen_pedestal_is_within_total_with_base() -> None:
    """120 times as stiff as the gear: k_1 is off by several of its own std, and by less than two with a usual base."""
    k, (upper, fore) = 3e4, arm().bodies
    pedestal = Joint("post", "y", Spring(120 * k, 1e-4 * 120 * k))
    post = Body("post", joints=(pedestal,), mass=200.0, inertia=20.0)
    robot = Robot("arm on a post", (post, replace(upper, parent="post"), fore))
    result = identify(measure(robot, np.random.default_rng(4), 2e-3), arm(), SPEC_OF_BASE)
    assert result.status == "converged"
    off = result.values["k_1"] - k
    assert abs(off) > 5 * result.std["k_1"]
    assert abs(off) < 2 * result.std_with_base["k_1"]
    assert result.std_with_base["k_2"] == pytest.approx(result.std["k_2"], rel=1e-6)
    (base,) = result.assumed_rigid
    names = [parameter.name for parameter in result.parameters.of_interest]
    for name, true, rel in (("k_1", 3e4, 0.1), ("d_1", 60.0, 0.6)):  # the post's inertia damps, too
        stated = float(base.changes[names.index(name)]) * base.stiffness / (120 * 3e4)
        assert math.log(result.values[name] / true) == pytest.approx(stated, rel=rel)


def test_hidden_base_stiffness_shifts_by_one_interval() -> None:
    """There the gear is off by 1.96 std; of gears ten times as stiff, on a base as stiff as one of steel on a floor."""
    file = arm()
    heavy = file.with_parameters({n: 10 * v for n, (v, _) in file.parameters().items() if n[0] in "mIkdJf"})
    result = identify(measure(heavy, np.random.default_rng(4), 2e-3), heavy, SPEC_OF_BASE)
    (base,) = result.assumed_rigid
    assert base.stiffness == STIFFEST_BASE
    k = result.values["k_1"]
    assert k / base.detection_limit == pytest.approx(1.96 * result.std["k_1"] / k, rel=0.01)
    assert "fit/assumed-rigid" in {note.code for note in result.notes}
