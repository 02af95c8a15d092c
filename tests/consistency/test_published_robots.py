"""The published robots in configs/robots, and points that are measured on them, in linear models, rigs and logs."""

from pathlib import Path
from textwrap import indent

import numpy as np
import pytest

from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.channels import ChannelSpec
from elastid.frf.estimate import estimate
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot, Spring
from elastid.study import load, load_robot
from elastid.study.robots import yaml_text

ROBOTS = Path(__file__).parents[2] / "configs" / "robots"


@pytest.fixture(scope="module")
def manutec() -> Robot:
    return load_robot(ROBOTS / "manutec_r3.yml")


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


def two_axes() -> Robot:
    """Two elastic gears and a bearing that tilts, the tool off all axes and turned."""
    upper = (Joint("1", "z", Spring(2e5, 120), Motor(5e-3, 100, 2e-3)), Joint("1x", "x", Spring(4e5, 200)))
    fore = (Joint("2", "y", Spring(6e4, 50), Motor(3e-3, 80, 2e-3)),)
    return Robot(
        "two axes",
        (
            Body("upper", joints=upper, mass=60, center_of_mass=(0.1, 0, 0.2), inertia=(3, 3, 4)),
            Body("fore", "upper", Placement((0.3, 0, 0.5)), fore, 25, (0.4, 0.02, 0.05), (0.4, 2, 2)),
        ),
        frames=(Frame("tool", "fore", Placement((0.8, 0.1, 0.05), (0.3, -0.2, 0.4))),),
    )


ROBOT = "robot:\n" + indent(yaml_text(two_axes()), "  ")
STUDY = (
    """
name: points
seed: 3
excitation: {rate_hz: 1000, period: 2, band_hz: [1, 60], torque_rms: 30}
estimator: {band_hz: [1, 60]}
experiment:
  configurations: {a: [0.2, -0.5], b: [0.4, 0.6]}
  realisations: 2
  simulated:
    truth: {k_1: 1.6e5, k_1x: 3.3e5, k_2: 7e4}
    outputs: [motor 1, motor 2, accelerometer tool z, frame tool y, frame tool rx]
    noise: {angle_std: 1e-7, acceleration_std: 0.01, torque_std: 0.05}
fit:
  parameters: {k_1: {}, k_2: {}, k_1x: {}, d_1: {}, d_2: {}, d_1x: {}, fm_1: {}, fm_2: {}}
"""
    + ROBOT
)


def test_the_rig_measures_what_the_linear_model_says_at_every_place(tmp_path: Path):
    """Motors in rad, a point in m/s^2 with and without gravity, an angle of the tool: all within 0.3 %."""
    path = tmp_path / "study.yml"
    noise = "noise: {angle_std: 1e-7, acceleration_std: 0.01, torque_std: 0.05}"
    quiet = STUDY.replace(noise, "noise: {}").replace("torque_rms: 30", "torque_rms: 3")
    path.write_text(quiet.replace("realisations: 2", "realisations: 1"))
    study = load(path).study
    plan = make_plan(study.excitation, study.experiment, study.robot, study.seed)
    rig = SimulatedRig(study.robot, study.experiment, plan, 1)
    records = [rig.measure(e) for e in rig.experiments if e.configuration.name == "a"]
    assert records[0].quantities == ("position", "position", "acceleration", "acceleration", "position")
    measured = estimate(records, study.estimator)
    model = serial(study.robot.with_parameters({"k_1": 1.6e5, "k_1x": 3.3e5, "k_2": 7e4}))
    linear = linearise(model, measured.configuration, model.theta, measured.outputs, "acceleration")
    G = frequency_response(linear, linear.theta_ref, measured.freq_hz)
    for row in range(len(measured.outputs)):
        assert np.abs(measured.G[:, row] - G[:, row]).max() < 3e-3 * np.abs(G[:, row]).max(), measured.outputs[row]
    # At the lowest lines gravity is what the accelerometer sees most of.
    without = frequency_response(
        linearise(model, measured.configuration, model.theta, ("frame tool z",), "acceleration"),
        linear.theta_ref,
        measured.freq_hz[:1],
    )
    assert np.abs(without[0, 0] - G[0, 2]).max() > 0.05 * np.abs(G[0, 2]).max()


@pytest.mark.parametrize(
    ("channel", "says"),
    [
        ({"at": "accelerometer tool z", "quantity": "velocity"}, "an accelerometer measures acceleration"),
        ({"at": "accelerometer tool z", "quantity": "acceleration", "unit": "g"}, "'g' is the gram.*scale: 9.80665"),
        ({"at": "frame tool z", "quantity": "position", "unit": "rad"}, "measures rad, not m"),
        ({"at": "frame tool rz", "quantity": "position", "unit": "mm"}, "measures m, not rad"),
    ],
)
def test_channels_of_points_have_units_of_length(channel, says):
    """And g is never guessed."""
    with pytest.raises(ValueError, match=says):
        ChannelSpec("y", channel="c", **channel).unit_factor(two_axes().slides(channel["at"]))
    assert ChannelSpec("y", "frame tool z", "c", quantity="velocity", unit="mm/s").unit_factor(True) == 1e-3
