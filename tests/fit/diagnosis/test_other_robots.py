"""A robot that is mounted otherwise than its file says is found by its fit, not by a number of the file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.faults import SPEC, drawn, exact, true_case

from elastid.fit.identify import identify


@pytest.mark.slow
def test_a_robot_on_the_ceiling_is_named() -> None:
    """Gravity along +z in the truth; the first cause and the first sentence agree."""
    case = true_case()
    hanging = replace(case.truth, gravity=(0.0, 0.0, 9.81))
    result = identify(drawn(replace(case, responses=exact(hanging)), np.random.default_rng(0)), case.robot, SPEC)
    first = result.indices[0]
    assert first.name == "gravity along +z of the base"
    assert first.share > 0.9
    sentence = next(note.text for note in result.notes if note.code == "modification-index")
    assert sentence.startswith("gravity along +z of the base instead of the file's")
