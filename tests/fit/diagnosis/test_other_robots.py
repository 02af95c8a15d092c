"""Robots mounted otherwise, or read otherwise, than their files have them: found by a fit, not by a held number."""

from __future__ import annotations

from collections.abc import Callable, Iterable
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "name"),
    [
        (np.degrees, "angles of all configurations in degrees, read as radians"),
        (lambda q: q * (1, -1), "angle of axis 2 counted in the other direction in all configurations"),
        (lambda q: q[::-1], "angles of axes 1 and 2 exchanged in all configurations"),
    ],
)
def test_angles_in_another_unit_direction_or_order_are_named(
    stated: Callable[[np.ndarray], Iterable[float]], name: str
) -> None:
    """Of all configurations; the first cause explains 99 % of the excess."""
    case = true_case()
    data = [
        replace(G, configuration=replace(G.configuration, angles=tuple(stated(np.array(G.configuration.angles)))))
        for G in drawn(case, np.random.default_rng(0))
    ]
    first = identify(data, case.robot, SPEC).indices[0]
    assert first.name == name
    assert first.share > 0.99


@pytest.mark.slow
def test_inertias_of_motors_on_the_link_side_are_named() -> None:
    """The file has n^2 times the inertias of the motors, as referred through their gears."""
    case = true_case()
    numbers = case.robot.parameters()
    given = {f"Jm_{j.name}": numbers[f"Jm_{j.name}"][0] * case.robot.ratio(j.name) ** 2 for j in case.robot.driven}
    first = identify(drawn(case, np.random.default_rng(0)), case.robot.with_parameters(given), SPEC).indices[0]
    assert first.name == "inertias of all motors given on the link side, or in kg cm^2"
    assert first.share > 0.99
