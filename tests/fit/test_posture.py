"""A fitted robot in postures that were not measured."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import LENGTH, MASS, STD, STIFFNESS, TOOL, closed_form, result
from plants.fitted_models import fitted_model
from plants.outside_arm import natural_frequencies
from plants.refusals import refused

from elastid.base.errors import UnknownNameError
from elastid.fit.result_rows import ModificationIndex
from elastid.model.spec import ModelSpec
from elastid.record import JointLoop
from elastid.robot import Frame, Payload, Placement
from elastid.simulation.spec import ControllerSpec

ANGLES = np.array([0.2, 0.9])
LINES = np.linspace(1.0, 60.0, 40)
LINKAGES = ("linkage_arm constrained", "linkage_arm minimal")


def test_tool_responses_compliance_and_modes_equal_closed_form() -> None:
    """About the equilibrium under gravity, in the axes of the base, with the motors held."""
    M, D, K, J = closed_form(ANGLES)
    inputs, outputs = ["force tool x", "force tool z"], ["frame tool x", "frame tool z"]
    model = result().at(ANGLES, inputs, outputs, axes="world")
    s = 2j * np.pi * LINES[:, None, None]
    expected = J @ np.linalg.solve(s**2 * M + s * D + K, np.broadcast_to(J.T.astype(complex), (len(LINES), 2, 2)))
    np.testing.assert_allclose(model.response(LINES).G, expected, rtol=1e-9)
    stiff = model.stiffness()
    np.testing.assert_allclose(stiff.compliance[np.ix_([0, 2], [0, 2])], J @ np.linalg.solve(K, J.T), rtol=1e-9)
    np.testing.assert_allclose(model.modes().freq_hz, natural_frequencies(M, D, K), rtol=1e-9)
    assert np.isnan(stiff.matrix).all()  # two springs leave four directions rigid


def test_standard_deviations_are_those_of_the_parameters() -> None:
    """Of the compliance of a robot without gravity: sum of (J_i^2 / k_i std)^2 along a direction."""
    own = result()
    still = replace(own, robot=replace(own.robot, gravity=(0.0, 0.0, 0.0)))
    stiff = still.at(ANGLES, axes="world").stiffness()
    a, b = ANGLES[0], ANGLES.sum()
    J = np.array([-LENGTH * np.sin(a) - TOOL * np.sin(b), -TOOL * np.sin(b)])
    expected = STD * np.sqrt(np.sum((J**2 / STIFFNESS) ** 2))
    assert stiff.compliance_std[0, 0] == pytest.approx(expected, rel=2e-3)
    assert stiff.by == "linearisation"


@pytest.mark.parametrize("motors", ["locked", "free", "controlled"])
@pytest.mark.parametrize("name", ["scara", *(pytest.param(name, marks=pytest.mark.slow) for name in LINKAGES)])
def test_a_response_is_that_of_its_state_space_to_rounding(name: str, motors: str) -> None:
    """Serial and with loops, a sliding joint, an integral in the controller."""
    fitted = fitted_model(name)
    spec = ModelSpec("minimal") if "minimal" in name else ModelSpec()
    own = replace(fitted.result, robot=fitted.model.robot, linear=fitted.linear, equations=spec)
    controller = ControllerSpec(4.0, kind="cascade") if motors == "controlled" else None
    model = own.at("one", motors=motors, controller=controller)
    G = model.response(LINES).G
    np.testing.assert_allclose(model.state_space().response(LINES), G, atol=1e-9 * np.abs(G).max())


def test_what_samples_between_response_and_state_space_is_an_argument() -> None:
    """A torque that is held and an angle that is sampled contain images; a fast rate has none of them."""
    model = result().at(ANGLES, ["motor 1"], ["motor 1"], motors="free", quantity="acceleration")
    plain = model.response(LINES).G
    assert 1e-3 < np.abs(model.response(LINES, sampled_hz=400.0).G / plain - 1).max() < 0.3
    assert np.abs(model.response(LINES, sampled_hz=1e6).G / plain - 1).max() < 1e-6


def test_stiff_controller_locks_motors_and_soft_one_frees_them() -> None:
    """Servo stiffness adds to compliance as a spring in series, a thousandth of the gears' at most."""
    held = result().at(ANGLES).stiffness().compliance
    loop = JointLoop(np.full(2, 1e8), np.full(2, 1e4), np.zeros(2))
    servo = result().at(ANGLES, motors="controlled", controller=loop).stiffness().compliance
    np.testing.assert_allclose(servo, held, atol=2e-3 * np.abs(held).max())
    soft = JointLoop(np.array(STIFFNESS), np.full(2, 1e4), np.zeros(2))
    double = result().at(ANGLES, motors="controlled", controller=soft).stiffness().compliance
    assert double[2, 2] > 1.5 * held[2, 2]


def test_payload_lowers_frequencies_at_any_frame() -> None:
    """A mass of 20 kg at the tool; none again where it is left out; a frame that the file lacks."""
    empty = result().at(ANGLES).modes().freq_hz[0]
    assert result().at(ANGLES, payload=Payload(20.0)).modes().freq_hz[0] < 0.9 * empty
    elbow = result().at(ANGLES, frame=Frame("elbow", "upper", Placement((LENGTH, 0, 0))), axes="world").stiffness()
    assert elbow.frame == "elbow"
    assert elbow.compliance[2, 2] < result().at(ANGLES, axes="world").stiffness().compliance[2, 2]
    assert result().at(ANGLES, frame="fore").stiffness().frame == "fore"


def test_postures_are_numbers_names_or_configurations() -> None:
    """All the same robot; what is no posture is refused with what is missing."""
    own = result()
    by_name, by_angle = own.at("home").modes().freq_hz, own.at([0.3, 0.5]).modes().freq_hz
    np.testing.assert_array_equal(by_name, by_angle)
    np.testing.assert_array_equal(own.at({"2": 0.5, "1": 0.3}).modes().freq_hz, by_angle)
    for posture in ([0.1], {"1": 0.1}, {"1": 0.1, "3": 0}):
        with refused("fit/posture", place="posture"):
            own.at(posture)
    with pytest.raises(UnknownNameError):
        own.at("nowhere")


def test_what_cannot_be_asked_is_refused_with_the_reason() -> None:
    own = result()
    for keys, code in (
        ({"inputs": ["motor 1"]}, "fit/posture"),
        ({"inputs": ["force nose x"]}, "robot/unknown-name"),
        ({"inputs": ["push tool x"]}, "fit/posture"),
        ({"outputs": ["accelerometer tool x"], "quantity": "position"}, "fit/posture"),
    ):
        with refused(code):
            own.at(ANGLES, **keys)
    with refused("fit/posture"):
        own.at(ANGLES, motors="free").stiffness()
    with refused("fit/no-robot"):
        replace(own, robot=None).at(ANGLES)


def test_misfit_widens_predictions_by_causing_numbers() -> None:
    """A mass that the fit held, 10 % off by its index, moves frequencies by about 5 % of their part of it."""
    own = result()
    index = ModificationIndex(
        "m_fore", "mass", ("m_fore",), np.array([MASS[1]]), ("kg",), (True,), np.array([0.1]), 0.01, 100.0, 0.9,
        np.zeros(len(own.x)), place=1,
    )  # fmt: skip
    wrong = replace(own, cost=4000.0, cost_expected=1000.0, cost_dof=1000.0, indices=(index,), status="misfit")
    before, after = own.at(ANGLES).modes(), wrong.at(ANGLES).modes()
    assert after.freq_std[0] > 2 * before.freq_std[0]  # residuals of twice the noise, and the mass
    assert after.freq_std[0] / after.freq_hz[0] > 0.02


def test_an_accelerometer_sees_gravity_turn() -> None:
    """Its reading by a slow force is the tilt times gravity, which a frame's acceleration lacks."""
    model = result().at([0.0, 0.0], ["force tool z"], ["accelerometer tool x", "frame tool x"])
    slow = model.response([0.01]).G[0, :, 0]
    assert model.linear.quantity == "acceleration"
    assert abs(slow[0]) > 1e3 * abs(slow[1])
