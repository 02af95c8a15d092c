"""Odds of causes: a drop of V, less what freedom and an unusual size take, and what is plausible beforehand."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from plants.faults import FAULTS, SPEC, Case, drawn, exact, true_case

from elastid.fit.diagnosis.judge import RANKING, single_occam
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.robot import Tolerances


@cache
def fitted(fault: str) -> Result:
    case = FAULTS[fault](true_case())
    return identify(drawn(case, np.random.default_rng(0)), case.robot, SPEC)


def rubbing_by_posture(case: Case) -> Case:
    """Motor 2 has three times the viscous friction in the second posture."""
    numbers = case.truth.parameters()
    other = exact(case.truth.with_parameters({"fm_2": 3 * numbers["fm_2"][0]}))
    return replace(case, responses=(case.responses[0], other[1], case.responses[2]))


def test_an_unusual_size_and_more_freedom_lower_the_odds() -> None:
    """Ten usual sizes cost 2 ln 101; a variance a hundred times less costs as much as ln 100 more."""
    usual, variance = 0.01, 1e-8
    assert single_occam(usual, variance, 0.1, 1.0) - single_occam(usual, variance, 0.0, 1.0) == pytest.approx(
        2 * np.log(101)
    )
    assert single_occam(usual, 1e-10, 0.0, 1.0) - single_occam(usual, 1e-8, 0.0, 1.0) == pytest.approx(
        np.log(100), rel=0.01
    )


def test_causes_are_listed_by_their_odds_against_the_first() -> None:
    """The first has none against itself; those that are nearly as likely are named with it."""
    result = fitted("rate 2 % wrong")
    first, *others = [index for index in result.indices if index.place == 0]
    assert first.odds == 0.0
    assert all(a.odds >= b.odds for a, b in pairwise(others))
    near = {index.name for index in others if index.odds > -RANKING.equal_odds}
    assert near <= set(result.indices[0].alike)


def test_friction_that_depends_on_the_posture_is_no_second_robot() -> None:
    """Named as friction of motor 2, with the posture; no note on two groups besides."""
    case = rubbing_by_posture(true_case())
    result = identify(drawn(case, np.random.default_rng(0)), case.robot, SPEC)
    assert result.indices[0].name.startswith("friction_2")
    assert {note.code for note in result.notes} & {"fit/unlike-responses"} == set()
    sentence = next(note.text for note in result.notes if note.code == "fit/likely-cause")
    assert sentence.startswith("friction of motor 2 that depends on the posture (")
    assert "in c2" in sentence


def test_a_mass_beyond_its_tolerance_is_named_though_the_fit_converged() -> None:
    """The fore arm is 30 % lighter than its file: data move it there, and the sentence says so."""
    case = true_case()
    heavy = case.robot.with_parameters({"m_fore": 1.4 * case.robot.parameters()["m_fore"][0]})
    robot = replace(heavy, tolerances=Tolerances())
    result = identify(drawn(case, np.random.default_rng(0)), robot, SPEC)
    first = result.indices[0]
    assert first.name in ("m_fore", "payload_fore")
    sentence = next(note.text for note in result.notes if note.code == "fit/likely-cause")
    assert "beyond" in sentence
