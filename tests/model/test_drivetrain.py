"""Rotors that ride on bodies and gears that couple axes: an independent implementation, energy, either side, a fit."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.gears import COUPLINGS, D_SHAFT, K_SHAFT, LINKS, RATIO, J, wrist
from plants.pinocchio_robot import append, assert_mass, mass_of, pin, pinocchio_model, point_inertia, six
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response, to_response
from elastid.logs.units_and_sides import to_joints
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.response import Covariance
from elastid.robot import BASE, Body, GearCoupling, Joint, Motor, Placement, Robot, Spring, unit_axis
from elastid.targets.mujoco import mjcf

seeds = st.integers(0, 2**31)


def random_arm(seed: int, coupled: bool = True) -> Robot:
    """A chain of n driven axes, elastic and rigid, whose motors ride on any body along it, with a branch beside it."""
    rng = np.random.default_rng(seed)
    names = [f"b{i}" for i in range(4)]
    bodies = []
    for i, name in enumerate(names):
        carrier = rng.choice(["", BASE, *names])
        rides = {"on": carrier, "axis": tuple(rng.normal(size=3))} if carrier else {}
        motor = Motor(10 ** rng.uniform(-3, 0), rng.choice([-1, 1]) * rng.uniform(1, 20), **rides)
        spring = Spring(1e3 * rng.uniform(1, 3)) if rng.random() < 0.7 else None
        joints = (Joint(f"{i}e", "x", Spring(2e3)),) if rng.random() < 0.4 else ()
        points = rng.normal(size=(4, 3)) * 0.2
        bodies.append(
            Body(
                name,
                names[i - 1] if i else BASE,
                Placement(tuple(rng.normal(size=3)), tuple(rng.normal(size=3))),
                (Joint(f"{i}", tuple(rng.normal(size=3)), spring, motor), *joints),
                4.0,
                tuple(points.mean(axis=0)),
                six(point_inertia(points - points.mean(axis=0), np.ones(4))),
            )
        )
    bodies.append(Body("branch", "b0", joints=(Joint("s", "y", Spring(1e3)),), mass=1.0, center_of_mass=(0.3, 0, 0)))
    gears = (GearCoupling("3", "1", 4.0), GearCoupling("2", "1", -3.0)) if coupled else ()
    return Robot("arm", tuple(bodies), gears=gears)


def with_rotor_bodies(robot: Robot):
    """The robot in pinocchio, every riding rotor a body on a joint of its own; and T (n_pin, n_q), q_pin = T q.

    Rotors that do not ride have their inertia as armature of a joint on the base. A rotor's joint turns by (eta q_m)_i.
    """

    def add_rotors(model, carrier: str, at) -> None:
        for joint in robot.driven:
            if joint.motor.on == carrier or (carrier == BASE and not joint.motor.on):
                axis = unit_axis(joint.motor.axis or "z")
                rotor = model.addJoint(at[0], pin.JointModelRevoluteUnaligned(axis), at[1], f"rotor {joint.name}")
                inertia = joint.motor.inertia * np.outer(axis, axis)
                append(model, (rotor, pin.SE3.Identity()), 0.0, np.zeros(3), inertia)

    model, _ = pinocchio_model(robot, add_rotors)
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
@pytest.mark.oracle("pinocchio")
def test_mass_and_coriolis_equal_pinocchio_with_rotors_as_bodies(seed):
    """M with S in it, C_1 and C_2 of chains with rotors anywhere and coupled gears, to 1e-10."""
    robot = random_arm(seed)
    model = serial(robot)
    reference, T = with_rotor_bodies(robot)
    data = reference.createData()
    q, v = np.random.default_rng(seed).normal(size=(2, model.n_q))
    M = T.T @ mass_of(reference, data, T @ q) @ T
    assert_mass(model, q, M)
    still = pin.nonLinearEffects(reference, data, T @ q, np.zeros(reference.nv))
    c = T.T @ (pin.nonLinearEffects(reference, data, T @ q, T @ v) - still)
    found = (model.force(q, v, model.theta) - model.force(q, 0 * v, model.theta)).full()[:, 0]
    springs = np.abs(model.force(q, 0 * v, model.theta).full()).max()
    np.testing.assert_allclose(found, c, rtol=0, atol=1e-10 * max(np.abs(c).max(), 1e-3 * springs))


@pytest.mark.parametrize(
    ("on", "axis", "says"),
    [
        ("leg", "z", "joint 1: motor.on: no body is called leg; there are base, arm, other"),
        ("other", "z", "joint 1: its motor is on other, "),
        ("arm", None, "got arm.*got nothing"),
        ("", "z", "got nothing.*got z"),
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


def test_what_mujoco_has_no_words_for_is_not_exported() -> None:
    """An armature neither rides on a body nor is coupled: named, with the targets that hold it."""
    for robot in (random_arm(0, coupled=False), wrist()):
        with refused("export/not-representable", place=f"robot {robot.name}"):
            mjcf(robot)


def linear(robot: Robot):
    model = serial(robot)
    return linearise(model, Configuration("c", (0.3, 0.5, -0.2)), model.theta, robot.motor_locations, "acceleration")


def test_responses_change_side_by_the_gear_matrix():
    """G^m = eta G^a eta^T, against the response of motor angles to motor torques set up by hand."""
    robot = wrist()
    model, eta = linear(robot), robot.eta
    freq_hz = np.array([3.0, 11.0, 40.0])
    Z = np.hstack([-eta, np.eye(3)])
    M = scipy.linalg.block_diag(linear(robot).M[:3, :3], np.diag(J))
    K = Z.T @ np.diag(K_SHAFT) @ Z
    D = Z.T @ np.diag(D_SHAFT) @ Z + np.diag(np.r_[np.zeros(3), np.full(3, 1e-4)])
    s = 2j * np.pi * freq_hz[:, None, None]
    G_m = (s**2 * np.linalg.inv(s**2 * M + s * D + K))[:, 3:, 3:]
    G_a = frequency_response(model, model.theta_ref, freq_hz)
    np.testing.assert_allclose(eta @ G_a @ eta.T, G_m, rtol=1e-9, atol=1e-9 * np.abs(G_m).max())


@pytest.mark.parametrize(("springs", "before"), [("after", ()), ("before", ()), ("after", ("6",))])
def test_compliances_in_series_add(springs, before):
    """K_a^-1 = K_links^-1 through eta_2 + eta^-1 K_shafts^-1 eta^-T, before, between and after the stages (5.4)."""
    robot = wrist(springs, shafts=True, links=True, before=before)
    model, eta = linear(robot), robot.eta
    eta_2 = np.eye(3)
    for motor, joint, ratio in COUPLINGS:
        if springs == "before" or motor in before:
            eta_2[LINKS.index(motor), LINKS.index(joint)] = ratio / RATIO[LINKS.index(motor)]
    links = np.linalg.inv(eta_2) @ np.diag(1 / np.array([7e3, 14e3, 21e3])) @ np.linalg.inv(eta_2).T
    shafts = np.linalg.inv(eta) @ np.diag(1 / K_SHAFT) @ np.linalg.inv(eta).T
    np.testing.assert_allclose(np.linalg.inv(model.K[3:, 3:]), links + shafts, rtol=1e-9)


def test_damping_in_series_is_right_to_first_order():
    """K + s D against the exact dynamic stiffness of springs with dampers in series: the error falls as s^2."""
    robot = wrist(shafts=True, links=True)
    model, eta = linear(robot), robot.eta
    k, d = np.array([7e3, 14e3, 21e3]), np.full(3, 3.0)
    D = model.D[3:, 3:] - eta.T @ np.diag(np.full(3, 1e-4)) @ eta
    errors = []
    for omega in (1.0, 10.0):
        s = 1j * omega
        shafts = np.linalg.inv(eta) @ np.diag(1 / (K_SHAFT + s * D_SHAFT)) @ np.linalg.inv(eta).T
        exact = np.linalg.inv(np.diag(1 / (k + s * d)) + shafts)
        errors.append(np.abs(exact - model.K[3:, 3:] - s * D).max())
    assert errors[1] / errors[0] == pytest.approx(100, rel=0.05)


def test_logs_of_coupled_motors_come_to_the_link_side_together():
    """tau_a = eta^T tau_m and q_a = eta^-1 q_m of all channels; one that is missing is named."""
    robot = wrist()
    channels = [ChannelSpec("u", f"motor {n}", f"t{n}", side="motor") for n in LINKS]
    channels += [ChannelSpec("y", f"motor {n}", f"q{n}", quantity="position", side="motor") for n in LINKS]
    T = to_joints(channels, robot)
    rng = np.random.default_rng(1)
    torque, angle = rng.normal(size=(2, 3))
    both = T @ np.r_[RATIO * torque, angle / RATIO]
    np.testing.assert_allclose(both[:3], robot.eta.T @ torque)
    np.testing.assert_allclose(both[3:], np.linalg.solve(robot.eta, angle))
    with refused("study/recorded", place="channel t4"):
        to_joints([*channels[:2], *channels[3:]], robot)


def test_springs_on_both_ends_of_coupled_gears_are_told_apart() -> None:
    """Three axes coupled all around: six stiffnesses in series are found from starts a factor 1.5 off."""
    robot = wrist(shafts=True, links=True)
    responses = []
    for i, angles in enumerate(((0.3, 0.5, -0.2), (-0.6, 1.1, 0.4))):
        model = serial(robot)
        at = linearise(model, Configuration(f"c{i}", angles), model.theta, robot.motor_locations, "acceleration")
        exact = to_response(at, at.theta_ref, np.linspace(2, 80, 60))
        responses.append(replace(exact, noise=Covariance((0.01 * np.abs(exact.G)) ** 2, np.inf)))
    truth = {name: value for name, (value, _) in robot.parameters().items() if name[0] == "k"}
    off = dict(zip(truth, (1.5, 1 / 1.5, 1.5, 1.2, 1 / 1.3, 1.4), strict=True))
    start = robot.with_parameters({name: value * off[name] for name, value in truth.items()})
    spec = FitSpec(parameters={"k*": ParameterSpec()}, starts=1)
    result = identify(responses, start, spec)
    found = np.array([result.values[name] for name in truth])
    np.testing.assert_allclose(found, list(truth.values()), rtol=1e-4)
    assert result.status == "converged"
