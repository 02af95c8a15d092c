"""Variants of a linkage against closed forms: springs in series, stiff and unseen joints, rods as two masses."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from plants.linkages import LEVER, LOWER, linkage

from elastid.base.errors import StudyError
from elastid.linear.equilibrium import rigid_posture
from elastid.model.approximations import elastic_joints_within, unbent, unseen
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec, Variant
from elastid.record import Configuration
from elastid.robot import Joint, Motor, Robot, Rod

POSTURES = [(0.0, 0.0), (0.2, -0.4), (-0.3, 0.5)]


def of_variant(variant: Variant, robot: Robot | None = None) -> ElasticModel:
    return formulate(linkage() if robot is None else robot, ModelSpec("minimal", variant))


def of_lever(model: ElasticModel, angles: tuple[float, float]) -> tuple[float, float]:
    """Stiffness and damping that hold the motor of the lever, which nothing else holds but its own friction."""
    q, i = rigid_posture(model, Configuration("c", angles)), model.index("motor 3")
    K = model.stiffness(q, np.zeros(model.constraint.size1_out(0)), model.theta)
    return float(K[i, i]), float(model.damping(q, model.theta)[i, i])


@pytest.mark.parametrize("angles", POSTURES)
def test_gear_and_rod_are_springs_in_series_by_the_sine_of_the_angle_between_lever_and_rod(
    angles: tuple[float, float],
) -> None:
    """In a parallelogram y = l cos(q_3 - q_2); a constant one has that of the start; a rigid loop the gear alone."""
    k, d, k_r, d_r = 5e5, 250.0, 1e7, 4000.0
    stiff, own_damping = of_lever(of_variant("rigid_loop"), angles)
    assert stiff == pytest.approx(k)
    for variant, angle in (("series_stiffness", angles[1] - angles[0]), ("constant_stiffness", 0.0)):
        y = LEVER * np.cos(angle)
        K, D = of_lever(of_variant(variant), angles)
        k_eff = 1 / (1 / k + 1 / (k_r * y**2))
        assert pytest.approx(k_eff, rel=1e-9) == K
        d_eff = k_eff**2 * (d / k**2 + d_r * y**2 / (k_r * y**2) ** 2)
        assert pytest.approx(d_eff, rel=1e-6) == D - own_damping + d


def test_a_rod_whose_mass_is_at_its_ends_is_that_of_lumped_rod() -> None:
    """I = a (1 - a) m L^2; any other inertia is moved to the ends."""
    m, a = 6.2, 0.52
    at_ends, evenly = (Rod(LOWER, m, a, inertia) for inertia in (a * (1 - a) * m * LOWER**2, 0.3))
    q = rigid_posture(of_variant("exact", linkage(at_ends)), Configuration("c", (0.2, -0.4)))
    M, M_lumped, M_even, M_moved = (
        model.mass(q, model.theta).full()
        for rod in (at_ends, evenly)
        for model in (of_variant("exact", linkage(rod)), of_variant("lumped_rod", linkage(rod)))
    )
    np.testing.assert_allclose(M_lumped, M, atol=1e-12 * M.max())
    np.testing.assert_allclose(M_moved, M, atol=1e-12 * M.max())
    assert np.abs(M_even - M).max() > 1e-3


def test_a_loop_sees_an_elastic_joint_straight_and_its_passive_joint_turned_back() -> None:
    """The bodies behind the elbow keep their direction, as in a parallelogram; without loops nothing changes."""
    robot = linkage(bends=True)
    names = [joint.name for joint in robot.joints]
    bend, elbow = names.index("b2"), names.index("elbow")
    assert elastic_joints_within(robot) == (bend,)
    q = ca.SX.sym("q", len(names))
    values = np.array([0.3, 0.02, -0.1, 0.4])
    seen = ca.Function("seen", [q], [unbent(robot, q)])(values).full().ravel()
    expected = values.copy()
    expected[bend], expected[elbow] = 0.0, 0.42
    np.testing.assert_allclose(seen, expected)


def test_parameters_without_an_effect_are_those_of_what_a_variant_leaves_out() -> None:
    """Rods and elastic joints in stiff loops; of a stiffness that is the gear's the rod's; inertia of lumped rods."""
    robot = linkage(bends=True)
    assert unseen(robot, "exact") == unseen(robot, "bending_outside") == ()
    assert unseen(robot, "lumped_rod") == ("I_rod",)
    bending = ("k_b2", "d_b2", "f_b2")
    assert unseen(robot, "series_stiffness") == bending
    assert unseen(robot, "constant_stiffness") == unseen(robot, "rigid_loop") == (*bending, "k_rod", "d_rod")
    rigid = linkage(Rod(LOWER, 6.2, 0.52, 0.64), bends=True)
    assert unseen(rigid, "constant_stiffness") == bending


def test_a_rod_that_no_elastic_gear_drives_cannot_be_condensed() -> None:
    """The lever's gear is rigid: the message names the rod, and the way out."""
    robot = linkage()
    rigid = Joint("3", "y", motor=Motor(2e-3, 100))
    bodies = tuple(replace(body, joints=(rigid,)) if body.name == "crank" else body for body in robot.bodies)
    with pytest.raises(StudyError, match=r"no lever with an elastic gear drives the rod rod, .* the variant exact"):
        of_variant("series_stiffness", replace(robot, bodies=bodies))
