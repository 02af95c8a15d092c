"""Rotors that ride on bodies: the complete model against an independent implementation, its structure, its energy."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.gears import wrist
from plants.refusals import refused

from elastid.model.formulation import serial
from elastid.robot import BASE, Body, GearCoupling, Joint, Motor, Placement, Robot, Spring, unit_axis
from elastid.targets.mujoco import write_mujoco

seeds = st.integers(0, 2**31)


def random_arm(seed: int, n: int = 4, coupled: bool = True) -> Robot:
    """A chain of n driven axes, elastic and rigid, whose motors ride on any body along it, with a branch beside it."""
    rng = np.random.default_rng(seed)
    names = [f"b{i}" for i in range(n)]
    bodies = []
    for i, name in enumerate(names):
        carrier = rng.choice(["", BASE, *names])
        rides = {"on": carrier, "axis": tuple(rng.normal(size=3))} if carrier else {}
        motor = Motor(10 ** rng.uniform(-3, 0), rng.choice([-1, 1]) * rng.uniform(1, 20), **rides)
        spring = Spring(1e3 * rng.uniform(1, 3)) if rng.random() < 0.7 else None
        joints = (Joint(f"{i}e", "x", Spring(2e3)),) if rng.random() < 0.4 else ()
        points = rng.normal(size=(4, 3)) * 0.2
        I = sum((r @ r) * np.eye(3) - np.outer(r, r) for r in points - points.mean(axis=0))  # noqa: E741
        bodies.append(
            Body(
                name,
                names[i - 1] if i else BASE,
                Placement(tuple(rng.normal(size=3)), tuple(rng.normal(size=3))),
                (Joint(f"{i}", tuple(rng.normal(size=3)), spring, motor), *joints),
                4.0,
                tuple(points.mean(axis=0)),
                (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]),
            )
        )
    bodies.append(Body("branch", "b0", joints=(Joint("s", "y", Spring(1e3)),), mass=1.0, center_of_mass=(0.3, 0, 0)))
    gears = (GearCoupling("3", "1", 4.0), GearCoupling("2", "1", -3.0)) if coupled else ()
    return Robot("arm", tuple(bodies), gears=gears)


@pytest.fixture(scope="module")
def pin():
    return pytest.importorskip("pinocchio", reason="the independent implementation is in the group 'oracles'")


def with_rotor_bodies(pin, robot: Robot):
    """The robot in pinocchio, every riding rotor a body on a joint of its own; and T (n_pin, n_q), q_pin = T q.

    Rotors that do not ride have their inertia as armature of a joint on the base. A rotor's joint turns by (eta q_m)_i.
    """
    model, columns = pin.Model(), {}
    model.gravity.linear = np.array(robot.gravity)

    def add_rotors(carrier: str, parent: int, placement) -> None:
        for joint in robot.driven:
            if joint.motor.on == carrier or (carrier == BASE and not joint.motor.on):
                axis = unit_axis(joint.motor.axis or "z")
                turning = pin.JointModelRevoluteUnaligned(axis)
                rotor = model.addJoint(parent, turning, placement, f"rotor {joint.name}")
                inertia = pin.Inertia(0.0, np.zeros(3), joint.motor.inertia * np.outer(axis, axis))
                model.appendBodyToJoint(rotor, inertia, pin.SE3.Identity())

    def add(name: str, parent: int, placement) -> None:
        add_rotors(name, parent, placement)
        for body in robot.bodies:
            if body.parent != name:
                continue
            seat, at = parent, placement * pin.SE3(body.placement.rotation, np.array(body.placement.xyz))
            for joint in body.joints:
                turning = pin.JointModelRevoluteUnaligned(unit_axis(joint.axis))
                seat, at = model.addJoint(seat, turning, at, joint.name), pin.SE3.Identity()
            inertia = pin.Inertia(body.mass, np.array(body.center_of_mass), body.inertia_matrix)
            model.appendBodyToJoint(seat, inertia, at)
            add(body.name, seat, at)

    add(BASE, 0, pin.SE3.Identity())
    columns = [f"joint {joint.name}" for joint in robot.joints] + [f"motor {joint.name}" for joint in robot.flexible]
    T = np.zeros((model.nv, len(columns)))
    for i, joint in enumerate(robot.joints):
        T[model.joints[model.getJointId(joint.name)].idx_v, i] = 1.0
    for joint, row in zip(robot.driven, robot.eta, strict=True):
        for turned, ratio in zip(robot.driven, row, strict=True):
            of = f"motor {turned.name}" if turned.is_flexible else f"joint {turned.name}"
            T[model.joints[model.getJointId(f"rotor {joint.name}")].idx_v, columns.index(of)] = ratio
    return model, T


@given(seed=seeds)
@settings(deadline=None, max_examples=12)
def test_mass_and_coriolis_equal_pinocchio_with_rotors_as_bodies(pin, seed):
    """M with S in it, C_1 and C_2 of chains with rotors anywhere and coupled gears, to 1e-10."""
    robot = random_arm(seed)
    model = serial(robot)
    reference, T = with_rotor_bodies(pin, robot)
    data = reference.createData()
    q, v = np.random.default_rng(seed).normal(size=(2, model.n_q))
    M = pin.crba(reference, data, T @ q)
    M = T.T @ (np.triu(M) + np.triu(M, 1).T) @ T
    np.testing.assert_allclose(model.mass(q, model.theta).full(), M, rtol=0, atol=1e-10 * np.abs(M).max())
    still = pin.nonLinearEffects(reference, data, T @ q, np.zeros(reference.nv))
    c = T.T @ (pin.nonLinearEffects(reference, data, T @ q, T @ v) - still)
    found = (model.force(q, v, model.theta) - model.force(q, 0 * v, model.theta)).full()[:, 0]
    springs = np.abs(model.force(q, 0 * v, model.theta).full()).max()
    np.testing.assert_allclose(found, c, rtol=0, atol=1e-10 * max(np.abs(c).max(), 1e-3 * springs))


@pytest.mark.parametrize(
    ("on", "axis", "says"),
    [
        ("leg", "z", "joint 1: motor.on: no body is called leg; there are base, arm, other"),
        ("other", "z", "joint 1: its motor is on other, a branch that neither carries the joint nor is moved by it"),
        ("arm", None, "give both `on`, the body, and `axis`"),
        ("", "z", "give both `on`, the body, and `axis`"),
        ("arm", (0.0, 0.0, 0.0), "axis is the zero vector"),
    ],
)
def test_a_rotor_that_no_robot_can_have_is_refused(on, axis, says):
    """With the body, the joint and what could be given instead."""
    with pytest.raises(ValueError, match=says):
        Robot(
            "arm",
            (Body("arm", joints=(Joint("1", motor=Motor(1e-3, 100, on=on, axis=axis)),), inertia=1.0), Body("other")),
        )


def test_what_mujoco_has_no_words_for_is_not_exported(tmp_path: Path) -> None:
    """An armature neither rides on a body nor is coupled: named, with the targets that hold it."""
    for robot in (random_arm(0, coupled=False), wrist()):
        with refused("export/not-representable", place=f"robot {robot.name}"):
            write_mujoco(tmp_path, SimpleNamespace(robot=robot))
