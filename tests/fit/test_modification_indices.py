"""Numbers that a fit held and that are wrong: one step with each of them freed names it and its size."""

from __future__ import annotations

import math

import numpy as np
import pytest
from plants.faults import FAULTS, SPEC, drawn, true_case

from elastid.fit.identify import identify
from elastid.fit.modification_index import ModificationIndex


def indices(fault: str, seed: int = 0) -> tuple[ModificationIndex, ...]:
    case = FAULTS[fault](true_case())
    return identify(drawn(case, np.random.default_rng(seed)), case.robot, SPEC).indices


@pytest.mark.parametrize(
    ("fault", "name", "step"),
    [
        ("delay left out", "delay", 0.3e-3),
        ("link mass +5 %", "m_fore", -math.log(1.05)),
        ("link length", "p_fore_z", -0.03),
        ("inertia +20 %", "I_fore_*", -math.log(1.2)),
        ("gear ratio 1 % wrong", "ratio_*", -0.01),
        ("one sample late", "delay_y_motor_2", 1e-3),
    ],
)
def test_a_wrong_number_is_the_first_that_is_named(fault: str, name: str, step: float) -> None:
    """It explains more than 95 % of the excess, and its step is the true one to 5 %."""
    first = indices(fault)[0]
    assert (first.name, first.place) == (name, 1)
    assert first.share > 0.95
    assert first.steps[0] == pytest.approx(step, rel=0.05)


def test_a_fit_within_its_noise_has_no_indices() -> None:
    """Twenty data sets of the true robot: none, since V does not exceed what the noise explains."""
    case = true_case()
    found = [identify(drawn(case, np.random.default_rng(seed)), case.robot, SPEC).indices for seed in range(20)]
    assert not any(found)
