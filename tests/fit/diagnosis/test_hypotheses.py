"""A hypothesis of a user's own: one function and an entry in the list, and it is judged with all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.faults import SPEC, Case, drawn, true_case

from elastid.base.arrays import ComplexArray
from elastid.fit.diagnosis.hypotheses import HYPOTHESES
from elastid.fit.diagnosis.hypothesis import Hypothesis, Size, hypothesis_of
from elastid.fit.diagnosis.sensitivities import HeldResponse
from elastid.fit.identify import identify
from elastid.fit.result import Result

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


def fitted(case: Case, hypotheses: tuple[Hypothesis, ...] = (CROSSTALK, *HYPOTHESES)) -> Result:
    return identify(drawn(case, np.random.default_rng(0)), case.robot, SPEC, hypotheses=hypotheses)


def with_crosstalk(case: Case) -> Case:
    mixed = np.linalg.inv(np.eye(2) + SHARE * FIRST_ON_SECOND)
    return replace(case, responses=tuple(replace(response, G=response.G @ mixed) for response in case.responses))


def test_an_invented_hypothesis_is_found_first_where_it_is_true() -> None:
    """With its size to 5 %, nearly all of the excess, and its own words."""
    result = fitted(with_crosstalk(true_case()))
    first = result.indices[0]
    assert (first.name, first.group, first.place) == ("crosstalk_2", "crosstalk", 1)
    assert first.share > 0.95
    assert first.steps[0] == pytest.approx(SHARE, rel=0.05)
    sentence = next(note.text for note in result.notes if note.code == "fit/likely-cause")
    assert sentence.startswith("4.0 % of motor 1's torque logged at motor 2 would explain 9")
    assert sentence.endswith("check the wiring of 2")


def test_an_implausible_family_does_not_come_first() -> None:
    """The same data with crosstalk held for as good as impossible: another cause leads, though it explains less."""
    doubted = replace(CROSSTALK, plausibility=1e-200)
    result = fitted(with_crosstalk(true_case()), (doubted, *HYPOTHESES))
    assert result.indices[0].group != "crosstalk"
    assert any(index.group == "crosstalk" for index in result.indices)


def test_every_number_has_one_hypothesis() -> None:
    """By the longest beginning of its name; those that no entry knows are numbers of their own."""
    families = {name: hypothesis_of(name, HYPOTHESES).family for name in ("gain_u_motor_1", "m_fore", "xyz_1")}
    assert families == {"gain_u_motor_1": "gain", "m_fore": "mass", "xyz_1": "number"}
    beginnings = [number for hypothesis in HYPOTHESES for number in hypothesis.numbers]
    assert len(beginnings) == len(set(beginnings))
