"""The stage design proposes what a study takes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from plants.report_values import plan

from elastid.app.stages.design import _second_amplitude
from elastid.excitation.spec import MultisineSpec


def test_a_second_amplitude_is_proposed_as_a_study_takes_it() -> None:
    """At half the torque of the plan, of which each motor has its own."""
    planned = plan(2)
    words = _second_amplitude(replace(planned, R=planned.R * np.array([1.0, 0.5])))
    levels = words.partition("torque_rms: ")[2].partition(", with")[0]
    ((one, two), (half, quarter)) = MultisineSpec(500.0, 2.0, (1.0, 60.0), json.loads(levels)).levels
    assert one == pytest.approx(30 * np.sqrt(73 / 2), rel=5e-3)
    assert (half / one, two / one, quarter / one) == pytest.approx((0.5, 0.5, 0.25), rel=1e-2)
