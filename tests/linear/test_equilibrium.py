"""Rest under gravity: deflections, holding torques and the stiffness that gravity adds or takes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.arm import resting
from plants.paths import ROOT
from plants.refusals import refused
from plants.template_arm import arm

from elastid.linear.equilibrium import equilibrium, spring_notes
from elastid.model.formulation import formulate, serial
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from elastid.robot.simplified import with_joints
from elastid.study import load_robot

M, L, G = 12.0, 0.7, 9.81


def pendulum(k: float) -> Robot:
    """A rod on a geared motor, upright at angle 0, turning about y."""
    joint = Joint("1", "y", Spring(k, 1.0), Motor(1e-3, 100))
    return Robot("pendulum", (Body("rod", joints=(joint,), mass=M, center_of_mass=(0.0, 0.0, L), inertia=0.5),))


@given(angle=st.floats(-3, 3))
@settings(deadline=None, max_examples=20)
def test_pendulum_on_a_spring_bends_by_its_weight(angle):
    """k (q_a - q_m) = m g l sin(q_a): the deflection solves the scalar equation, the motor holds m g l sin(q_a)."""
    model = serial(pendulum(k=5e3))
    point = resting(model, angle)
    q_a, q_m = point.q
    assert q_m == angle
    assert 5e3 * (q_a - q_m) == pytest.approx(M * G * L * np.sin(q_a), abs=1e-9)
    assert point.u[0] == pytest.approx(-M * G * L * np.sin(q_a), abs=1e-8)


@pytest.mark.slow
@given(angles=st.tuples(*[st.floats(-3, 3)] * 3))
@settings(deadline=None, max_examples=20)
def test_at_rest_nothing_accelerates(angles):
    """f(q0, 0) = B u0: the full nonlinear equations are satisfied with the holding torque."""
    model = serial(arm())
    point = resting(model, *angles)
    f = model.force(point.q, np.zeros(model.n_q), model.theta).full()[:, 0]
    np.testing.assert_allclose(f, model.B @ point.u, atol=1e-6)
    np.testing.assert_array_equal(point.q[[model.index(motor) for motor in ("motor 1", "motor 2", "motor 3")]], angles)


def test_joint_without_spring_hangs_down():
    """A free joint finds the bottom of its pendulum from nearby, and stays put where nothing pulls."""
    hanging = Joint("free", "y")
    upper = Body("arm", joints=(Joint("1", "y", motor=Motor(1e-3)),), mass=5, center_of_mass=(0.2, 0, 0), inertia=0.1)
    bob = Body("bob", "arm", Placement((0.5, 0, 0)), (hanging,), 2, (0, 0, -0.3), 0.01)
    model = serial(Robot("r", (upper, bob)))
    point = resting(model, 0.8)
    assert point.q[model.index("joint free")] == pytest.approx(-0.8, abs=1e-12)
    weightless = serial(Robot("r", (upper, bob), gravity=(0, 0, 0)))
    point = resting(weightless, 0.8)
    np.testing.assert_allclose(point.q, [0.8, 0.0], atol=0)


@pytest.mark.parametrize(("k", "factor"), [(0.5 * M * G * L, 1.0), (5e3, np.nan)])
def test_too_soft_spring_or_undefined_parameter_is_refused(k: float, factor: float) -> None:
    """An upright pendulum with k < m g l tips over; a parameter that is not a number gives no response of NaN."""
    model = serial(pendulum(k))
    with refused("robot/no-equilibrium", place="configuration up"):
        equilibrium(
            model, model.theta * np.where(np.arange(len(model.theta)), 1.0, factor), Configuration("up", (0.0,))
        )


def test_a_joint_without_load_rests_inside_its_gap() -> None:
    loose = with_joints(pendulum(5e3), lambda joint: replace(joint, spring=Spring(5e3, 1.0, backlash=1e-3)))
    model = serial(loose)
    for angle, count in ((np.pi, 1), (1.5, 0)):
        point = resting(model, angle)
        assert [note.code for note in spring_notes(model, model.theta, [point])] == count * ["robot/operating-point"]


def test_a_joint_that_moves_no_inertia_is_named() -> None:
    """A massless hand on a spring: its mass matrix is singular, which no solver below can say."""
    joint = Joint("2", "y", spring=Spring(1e3))
    upper = Body("arm", joints=(Joint("1", "y", Spring(1e3), Motor(1e-3, 50)),), mass=1.0, inertia=0.1)
    robot = Robot("light", (upper, Body("hand", "arm", joints=(joint,))))
    model = serial(robot)
    with refused("robot/no-equilibrium", place="configuration home"):
        equilibrium(model, model.theta, Configuration("home", np.zeros(1)))


@pytest.mark.parametrize("angles", [(1.00387526, -0.62551334), (0.84303525, -0.77842651)])
def test_nearly_folded_linkage_has_minimal_equilibrium(angles):
    """Steps back onto the loops are taken in full, whatever work they do: both ended half open without."""
    robot = load_robot(ROOT / "configs" / "robots" / "linkage_arm.yml")
    posture, count = Configuration("near folding", np.array(angles)), len(robot.joints)
    rests = []
    for equations in ("constrained", "minimal"):
        model = formulate(robot, ModelSpec(equations))
        rests.append(equilibrium(model, model.theta, posture).q[:count])
    np.testing.assert_allclose(rests[0], rests[1], atol=1e-9)
