"""The published robots in configs/robots, and points that are measured on them, in linear models, rigs and logs."""

from dataclasses import replace

import numpy as np
import pytest
from plants.dry_friction import robot as two_axes
from plants.paths import ROBOTS

from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration
from elastid.robot import Frame, Placement
from elastid.study import load_robot


def test_manutec_turns_on_axis_1_with_body_inertia():
    """Upright, M_11 is the sum over the bodies by the parallel axis theorem; its lowest mode is an axis on its gear."""
    model = serial(load_robot(ROBOTS / "manutec_r3.yml"))
    axis = model.index("joint 1")
    # The arm stands 0.3 m in front of axis 1 (in z), its wrist 0.145 m.
    J = 1.16 + 0.64 + 56.5 * (0.172**2 + 0.3**2) + 0.245 + 26.4 * (0.064**2 + 0.3**2)
    J += 0.081 + 0.81 + (28.7 + 5.2) * 0.145**2 + 0.5 * (0.05**2 + 0.195**2) + 15 * (0.1**2 + 0.245**2)
    assert model.mass(np.zeros(model.n_q), model.theta)[axis, axis] == pytest.approx(J, rel=1e-12)

    linear = linearise(model, Configuration("upright", np.zeros(6)), model.theta, model.inputs, "acceleration")
    assert linear.K[axis, axis] == pytest.approx(43 * 105**2, rel=1e-12)
    assert 5 < modes(linear, linear.theta_ref).freq_hz[0] < 40


def test_kuka_arm_has_reach_and_weight_of_table():
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


# Two axes on springs, the tool off all axes and turned.
AXES = replace(two_axes((0.0, 0.0)), frames=(Frame("tool", "fore", Placement((0.8, 0.1, 0.05), (0.3, -0.2, 0.4))),))
OUTPUTS = ("motor 1", "motor 2", "accelerometer tool z", "frame tool y", "frame tool rx")


def test_rig_measures_linear_model_at_every_location():
    """Motors in rad, a point in m/s^2 with and without gravity, an angle of the tool: all within 0.3 %."""
    experiment = ExperimentSpec({"a": (0.2, -0.5)}, 1, simulated=SimulatedSpec(outputs=OUTPUTS))
    plan = make_plan(MultisineSpec(1000.0, 2.0, (1.0, 60.0), 3.0), experiment, AXES, 3)
    rig = SimulatedRig(AXES, experiment, plan, 1)
    records = [rig.measure(each) for each in rig.experiments]
    assert records[0].quantities == ("position", "position", "acceleration", "acceleration", "position")
    measured = estimate(records, EstimatorSpec(band_hz=(1.0, 60.0)))
    model = serial(AXES)
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
        ChannelSpec("y", channel="c", **channel).unit_factor(AXES.slides(channel["at"]))
    assert ChannelSpec("y", "frame tool z", "c", quantity="velocity", unit="mm/s").unit_factor(True) == 1e-3
