"""What a fit held or read wrongly is named with its size, by its own list of causes and by those of a user."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plants.faults import FAULTS, FURTHER, SPEC, Case, drawn, faulty, true_case
from plants.marks import slow

from elastid.base.arrays import ComplexArray
from elastid.fit.diagnosis.hypotheses import HYPOTHESES
from elastid.fit.diagnosis.hypothesis import Hypothesis, Size
from elastid.fit.diagnosis.judge import single_occam
from elastid.fit.diagnosis.score_test import Candidate, HeldNumber, Load, ScoreTest, find_load
from elastid.fit.diagnosis.sensitivities import HeldResponse
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.robot import Tolerances


@cache
def fitted(fault: str) -> Result:
    case = faulty(fault)
    return identify(drawn(case, np.random.default_rng(0)), case.robot, SPEC)


@pytest.mark.parametrize(
    "fault",
    [slow(name) if name in FURTHER else name for name in FAULTS if name not in ("rate 2 % wrong", "missing torsion")],
)
def test_a_fault_is_named_first_with_its_size(fault: str) -> None:
    """It explains most of the excess, its steps are the true ones, and a warning is about it."""
    result, named = fitted(fault), FAULTS[fault]
    first = result.indices[0]
    # Within tolerances of the file a reading may be as likely as another.
    assert named.cause in (first.name, *(first.alike if named.has_tolerances else ()))
    assert first.place == 1
    assert first.share > named.share
    if named.steps:
        np.testing.assert_allclose(first.steps, np.broadcast_to(named.steps, len(first.steps)), atol=named.within)
    assert "fit/likely-cause" in {note.code for note in result.notes}
    assert "fit/unlike-responses" not in {note.code for note in result.notes}


def test_the_drop_is_that_of_least_squares_with_the_number_free() -> None:
    """A linear problem of four columns, two of them held: drop, step and effects as of the solution of all."""
    rng = np.random.default_rng(3)
    J, r = rng.standard_normal((50, 4)), rng.standard_normal(50)
    numbers = [HeldNumber(name, "", 0.0, "1", False, -math.inf, math.inf, 1.0) for name in "ab"]
    r = r - J[:, :2] @ np.linalg.lstsq(J[:, :2], r, rcond=None)[0]
    test = ScoreTest.of(numbers, J.T @ J, J.T @ r, np.ones(2, dtype=bool))
    alone = Candidate("b", "", np.array([1]), np.eye(1))
    steps, drop = test.step(alone)
    every = np.linalg.lstsq(J[:, [0, 1, 3]], -r, rcond=None)[0]
    left = r + J[:, [0, 1, 3]] @ every
    assert drop == pytest.approx(r @ r - left @ left, rel=1e-9)
    np.testing.assert_allclose([*test.effects(alone, steps), *steps], every, rtol=1e-9)
    _, further = test.freed(alone).step(Candidate("a", "", np.array([0]), np.eye(1)))
    whole = r + J @ np.linalg.lstsq(J, -r, rcond=None)[0]
    assert further == pytest.approx(left @ left - whole @ whole, rel=1e-9)


MASS, CENTRE, INERTIA = 40.0, (0.3, 0.0, 0.1), (0.8, 4.0, 4.1)
LOAD, PLACE = 3.0, np.array([0.7, 0.1, 0.05])


def numbers() -> list[HeldNumber]:
    centre = [HeldNumber(f"c_arm_{a}", "", c, "m", False, -1, 1, 0.01) for a, c in zip("xyz", CENTRE, strict=True)]
    inertia = [
        HeldNumber(f"I_arm_{a}{a}", "", i, "kg*m^2", True, -9, 9, 0.1) for a, i in zip("xyz", INERTIA, strict=True)
    ]
    return [HeldNumber("m_arm", "", MASS, "kg", True, -9, 9, 0.05), *centre, *inertia]


def searched(mass: float) -> tuple[Load | None, float]:
    """The load that is found of one of a mass at PLACE, by exact sums of a linear problem, and its drop of V."""
    members, rho = numbers(), PLACE - CENTRE
    change = np.array([mass / MASS, *(mass / MASS * rho), *(mass * (rho @ rho - rho**2) / INERTIA)])
    J = np.random.default_rng(0).standard_normal((100, len(members)))
    S = 1e6 * J.T @ J
    test = ScoreTest(tuple(members), S, -S @ change, np.zeros((0, len(members))), np.ones(len(members), dtype=bool))
    return find_load(test, Candidate("payload_arm", "payload", np.arange(7), np.eye(7)), 1.0, 0.0), change @ S @ change


def test_a_point_mass_is_found_with_its_place_and_changes_mass_and_centre_as_statics_says() -> None:
    """The new centre is that of both masses."""
    load, drop = searched(LOAD)
    assert load.mass == pytest.approx(LOAD, rel=1e-3)
    np.testing.assert_allclose(load.place, PLACE - CENTRE, atol=1e-3)
    assert load.drop == pytest.approx(drop, rel=1e-4)
    mass, x = MASS * np.exp(load.steps[0]), CENTRE[0] + load.steps[1]
    assert mass == pytest.approx(MASS + LOAD, rel=1e-3)
    assert x == pytest.approx((MASS * CENTRE[0] + LOAD * PLACE[0]) / (MASS + LOAD), rel=1e-3)


def test_an_unusual_size_and_more_freedom_lower_the_odds() -> None:
    """Ten usual sizes cost 2 ln 101; a variance a hundred times less costs as much as ln 100 more."""
    usual, variance = 0.01, 1e-8
    assert single_occam(usual, variance, 0.1, 1.0) - single_occam(usual, variance, 0.0, 1.0) == pytest.approx(
        2 * np.log(101)
    )
    assert single_occam(usual, 1e-10, 0.0, 1.0) - single_occam(usual, 1e-8, 0.0, 1.0) == pytest.approx(
        np.log(100), rel=0.01
    )


@pytest.mark.slow
def test_a_mass_beyond_its_tolerance_is_named_though_the_fit_converged() -> None:
    """The fore arm is 30 % lighter than its file: data move it there, and the sentence says so."""
    case = true_case()
    heavy = case.robot.with_parameters({"m_fore": 1.4 * case.robot.parameters()["m_fore"][0]})
    robot = replace(heavy, tolerances=Tolerances())
    result = identify(drawn(case, np.random.default_rng(0)), robot, SPEC)
    first = result.indices[0]
    assert first.name in ("m_fore", "payload_fore")
    assert "fit/likely-cause" in {note.code for note in result.notes}


SHARE = 0.04
FIRST_ON_SECOND = np.array([[0.0, 0.0], [1.0, 0.0]])


def crosstalk(response: HeldResponse) -> dict[str, ComplexArray]:
    """The torque that is logged at motor 2 has a share of motor 1's: G E^-1 with E = 1 + share e_2 e_1^T."""
    return {"crosstalk_2": -response.G @ FIRST_ON_SECOND}


CROSSTALK = Hypothesis(
    "crosstalk",
    ("crosstalk",),
    Size(0.05, 0.5, unit="1"),
    phrase=lambda index: f"{100 * index.steps[0]:.1f} % of motor 1's torque logged at motor {index.name[-1]}",
    advice="check the wiring of {where}",
    columns=crosstalk,
)


def with_crosstalk(case: Case) -> Case:
    mixed = np.linalg.inv(np.eye(2) + SHARE * FIRST_ON_SECOND)
    return replace(case, responses=tuple(replace(response, G=response.G @ mixed) for response in case.responses))


def test_an_invented_hypothesis_is_found_first_where_it_is_true() -> None:
    """With its size to 5 %, nearly all of the excess, and its own words."""
    case, hypotheses = with_crosstalk(true_case()), (CROSSTALK, *HYPOTHESES)
    result = identify(drawn(case, np.random.default_rng(0)), case.robot, SPEC, hypotheses=hypotheses)
    first = result.indices[0]
    assert (first.name, first.group, first.place) == ("crosstalk_2", "crosstalk", 1)
    assert first.share > 0.95
    assert first.steps[0] == pytest.approx(SHARE, rel=0.05)
    sentence = next(note.text for note in result.notes if note.code == "fit/likely-cause")
    assert sentence.startswith("4.0 % of motor 1's torque logged at motor 2 would explain 9")
    assert sentence.endswith("check the wiring of 2")
