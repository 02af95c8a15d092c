"""Errors of held numbers that the free parameters take up: no residual shows them, and a sentence says how large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.faults import SPEC, Case, drawn, true_case

from elastid.base.errors import Note
from elastid.fit.diagnosis import judge
from elastid.fit.diagnosis.undetectable_errors import UndetectableError, undetectable_errors
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import WeightSpec


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
        assert one.moved > 3
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
    assert note.text.startswith("the intervals take as exact what the fit held: k_")
    assert note.text.count("moves by one standard deviation with") <= 3


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
