"""The published robots in configs/robots: numbers as published, behaviour as their authors describe it."""

from pathlib import Path

import numpy as np
import pytest
from plants.zeros import antiresonances

from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.study import load_robot

ROBOTS = Path(__file__).parents[2] / "configs" / "robots"


@pytest.fixture(scope="module")
def manutec() -> Robot:
    return load_robot(ROBOTS / "manutec_r3.yml")


def test_manutec_holds_its_weight_with_the_moment_of_its_masses(manutec):
    """Upper arm level: axis 2 holds m g x summed over arm, forearm, wrist and load by their published positions."""
    model = serial(manutec)
    rigid = {name: 1e10 for name in manutec.parameters() if name.startswith("k_")}
    theta = [rigid.get(name, value) for name, value in zip(model.parameters, model.theta, strict=True)]
    point = equilibrium(model, theta, Configuration("level", (0, np.pi / 2, 0, 0, 0, 0)))
    heights = {56.5: 0.205, 26.4: 0.65 - 0.034, 28.7: 1.064, 5.2: 1.25, 0.5: 1.425, 15.0: 1.625}
    expected = 9.81 * sum(mass * height for mass, height in heights.items())
    assert abs(point.u[1]) == pytest.approx(expected, rel=1e-5)
    assert point.u[0] == pytest.approx(0, abs=1e-6)


def test_manutec_turns_on_axis_1_with_the_inertia_of_its_bodies(manutec):
    """Upright, M_11 is the sum over the bodies by the parallel axis theorem; its lowest mode is an axis on its gear."""
    model = serial(manutec)
    axis = model.index("joint 1")
    # The arm stands 0.3 m in front of axis 1 (in z), its wrist 0.145 m.
    J = 1.16 + 0.64 + 56.5 * (0.172**2 + 0.3**2) + 0.245 + 26.4 * (0.064**2 + 0.3**2)
    J += 0.081 + 0.81 + (28.7 + 5.2) * 0.145**2 + 0.5 * (0.05**2 + 0.195**2) + 15 * (0.1**2 + 0.245**2)
    assert model.mass(np.zeros(model.n_q), model.theta)[axis, axis] == pytest.approx(J, rel=1e-12)

    linear = linearise(model, Configuration("upright", np.zeros(6)), model.theta, model.inputs, "acceleration")
    assert linear.K[axis, axis] == pytest.approx(43 * 105**2, rel=1e-12)
    assert 5 < modes(linear, linear.theta_ref).freq_hz[0] < 40


def linear(robot: Robot, angles: tuple[float, ...] = (0.0,)) -> LinearModel:
    """Motor torques to motor accelerations."""
    model = serial(robot)
    return linearise(model, Configuration("c", angles), model.theta, model.inputs, "acceleration")


@pytest.mark.parametrize(
    ("k_1", "poles", "zeros"),
    [
        (100.0, [12.402, 19.120, 54.671], [5.255, 15.378, 52.321]),
        (16.7, [8.763, 14.472, 41.773], [2.911, 14.250, 41.654]),
    ],
)
def test_the_four_masses_have_their_published_resonances(k_1, poles, zeros):
    """Undamped, to the digits printed; 1 / (sum of J) at low and 1 / J_m at high frequencies."""
    robot = load_robot(ROBOTS / "four_mass_benchmark.yml")
    undamped = {name: 0.0 for name in robot.parameters() if name.startswith(("d_", "f_", "fm_"))}
    model = linear(robot.with_parameters(undamped | {"k_1": k_1}))
    np.testing.assert_allclose(modes(model, model.theta_ref).freq_hz, poles, atol=6e-4)
    found, _ = antiresonances(model, "motor 1", "motor 1")
    np.testing.assert_allclose(found, zeros, atol=6e-4)
    low, high = frequency_response(model, model.theta_ref, np.array([1e-3, 1e4]))[:, 0, 0].real
    assert low == pytest.approx(21.277, abs=5e-4)
    assert high == pytest.approx(200, rel=1e-4)


def test_the_kuka_arm_has_the_reach_and_weight_of_its_table():
    """Eighteen coordinates; the tool where its links lie stretched out, gravity on axis 2 by hand."""
    robot = load_robot(ROBOTS / "kr300_twelve_springs.yml")
    model = serial(robot)
    assert model.n_q == 18
    assert sum(joint.spring is not None for joint in robot.joints) == 12
    tool = frame_poses(robot, np.zeros((1, 12)), "tool").position[0]
    np.testing.assert_allclose(tool, [0.35 + 1.15 + 1.0 + 0.24, 0, 0.675 - 0.041], atol=1e-12)
    # Centres of mass from axis 2, along x, by the table: link 2 from its far end, forearm and hand behind axis 3.
    arms = {339.12: 1.15 - 0.709, 105.21: 1.15 + 0.076, 35.80: 1.15 + 1.0 - 0.236, 31.46: 1.15 + 1.0 + 0.009}
    arms |= {17.78: 1.15 + 1.24 - 0.05, 200.0: 1.15 + 1.24 + 0.1}
    q = np.zeros(18)
    torque = model.potential_gradient(q, model.theta).full()[model.index("joint 2"), 0]
    assert abs(torque) == pytest.approx(9.81 * sum(m * x for m, x in arms.items()), rel=2e-3)
