"""Gear boxes: the springs that couplings join, the deflections that they allow, and the ratios of all motors."""

from dataclasses import replace
from itertools import starmap

import numpy as np
import pytest

from elastid.robot import Body, GearCoupling, Joint, Motor, Robot, Spring


def wrist(coupling: GearCoupling | None, rigid: str = "", shaft: str = "") -> Robot:
    """Three joints in a row, the last two coupled; without the springs of `rigid`, with a shaft spring at `shaft`."""
    joints = [
        Joint(
            name,
            "z",
            None if name in rigid else Spring(1e4),
            Motor(1e-3, ratio, spring=Spring(2.0) if name in shaft else None),
        )
        for name, ratio in zip("456", (100.0, -80.0, 50.0), strict=True)
    ]
    bodies = tuple(
        Body(f"b{joint.name}", f"b{before.name}" if before else "base", joints=(joint,), inertia=1.0)
        for before, joint in zip((None, *joints), joints, strict=False)
    )
    return Robot("wrist", bodies, gears=() if coupling is None else (coupling,))


def test_a_coupling_behind_the_springs_joins_two_of_them() -> None:
    """Before the coupling E: the joints turn by E^-1 where a spring deflects by 1; eta_ij = the ratio given."""
    robot = wrist(GearCoupling("5", "6", 40.0, "before"))
    first, second = robot.gearboxes
    assert (first.gears, second.gears, second.springs) == ((0,), (1, 2), ("k_5", "k_6"))
    E = np.array([[1.0, 40.0 / -80.0], [0.0, 1.0]])
    np.testing.assert_allclose(robot.mixing[1:, 1:], E)
    np.testing.assert_allclose(robot.eta[1, 2], 40.0)
    np.testing.assert_allclose(second.X, np.linalg.inv(E))
    np.testing.assert_allclose(second.deflections, E)
    assert second.range.tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert second.rigid.shape == (0, 2)
    assert not second.is_in_series


def test_rigid_gear_is_moved_by_coupling() -> None:
    """X has one column: the range is its direction, and the row of `rigid` is across it."""
    robot = wrist(GearCoupling("6", "5", 40.0, "before"), rigid="6", shaft="")
    box = robot.gearboxes[1]
    assert (box.gears, box.springs) == ((1, 2), ("k_5",))
    np.testing.assert_allclose(box.X.ravel(), [1.0, -40.0 / 50.0])
    np.testing.assert_allclose(box.rigid @ box.X, 0, atol=1e-15)
    np.testing.assert_allclose(np.abs(box.range.T @ box.X), np.linalg.norm(box.X))
    np.testing.assert_allclose(box.deflections @ box.X, 1.0)
    assert [joint.name for joint in robot.flexible] == ["4", "5", "6"]


@pytest.mark.parametrize(
    ("couplings", "says"),
    [
        ([("5", "5", 40.0)], "couplings only"),
        ([("5", "6", 0.0)], "couples nothing"),
        ([("5", "7", 40.0)], "joint 7 has a motor.*4, 5, 6"),
        ([("6", "5", 1.0), ("6", "5", 2.0)], "motor 6 with joint 5 is given twice"),
        ([("5", "4", 80.0), ("4", "5", -100.0)], "matrix of gear ratios is singular"),
    ],
)
def test_gears_that_cannot_be_are_refused(couplings, says):
    """Unknown joints, couplings given twice, motors that no longer distinguish the joints."""
    with pytest.raises(ValueError, match=says):
        replace(wrist(None), gears=tuple(starmap(GearCoupling, couplings)))
