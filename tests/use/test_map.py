"""Maps of the workspace: quantities in closed form, order, limiting springs, intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.predicted_arm import STD, closed_form, result

from elastid.base.errors import StudyError
from elastid.use.compliance import QUANTITIES, Cut
from elastid.use.map import LINES, map_workspace

ANGLES = np.array([[0.2, 0.4], [-0.7, 1.1], [0.9, -0.5], [0.1, 0.05]])


def test_static_and_modal_quantities_are_those_of_the_closed_form() -> None:
    """Compliance along x, y and z, deflection under a load, softest direction, natural frequencies."""
    load = (30.0, 0.0, -100.0)
    workspace = map_workspace(result(), ANGLES, Cut(load=load))
    for i, angles in enumerate(ANGLES):
        M, D, K, J = closed_form(angles)
        C = J @ np.linalg.solve(K, J.T)
        assert workspace["compliance_x"].value[i] == pytest.approx(C[0, 0], rel=1e-7)
        assert workspace["compliance_y"].value[i] == 0
        assert workspace["compliance_z"].value[i] == pytest.approx(C[1, 1], rel=1e-7)
        assert workspace["softest_compliance"].value[i] == pytest.approx(np.linalg.eigvalsh(C)[-1], rel=1e-7)
        moved = C @ np.array([load[0], load[2]])
        assert workspace["deflection"].value[i] == pytest.approx(np.linalg.norm(moved), rel=1e-7)
        A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
        poles = np.linalg.eigvals(A)
        found = np.sort(np.abs(poles[poles.imag > 0])) / (2 * np.pi)
        assert workspace["frequency_1"].value[i] == pytest.approx(found[0], rel=1e-7)
        assert workspace["frequency_2"].value[i] == pytest.approx(found[1], rel=1e-7)
    assert np.isnan(workspace["frequency_3"].value).all()
    assert {each.name for each in workspace.quantities} == set(QUANTITIES)


def test_the_softest_first_and_the_spring_that_gives_most() -> None:
    """Shares of the springs add up to 1 under no gravity's help; the order is that of the compliance."""
    workspace = map_workspace(result(), ANGLES)
    value = workspace["softest_compliance"].value
    assert np.all(np.diff(value[workspace.softest]) <= 0)
    assert workspace.asked.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(workspace.share.sum(axis=1), 1.0, rtol=0.05)  # the rest is gravity's
    largest = [workspace.springs[i] for i in workspace.share.argmax(axis=1)]
    assert workspace.limiting_springs == tuple(largest)
    assert len(workspace.lines_hz) == LINES


def test_intervals_are_those_of_the_stiffness() -> None:
    """All springs 2 % off independently: the softest compliance between 2 %/sqrt(2) and 2 % off, in logarithm."""
    quantity = map_workspace(result(), ANGLES)["softest_compliance"]
    assert np.all((quantity.relative_std > 0.9 * STD / np.sqrt(2)) & (quantity.relative_std < 1.1 * STD))
    low, high = quantity.interval
    np.testing.assert_allclose(np.log(high / low), 2 * 1.959964 * quantity.relative_std, rtol=1e-9)


def test_where_nothing_rests_the_map_says_why() -> None:
    """A robot of rubber."""
    own = result()
    rubber = replace(own, x=own.x - np.log(4e4))
    with pytest.raises(StudyError, match="finds no rest in any of the 1 postures"):
        map_workspace(rubber, np.array([[-0.2, 0.1]]))
