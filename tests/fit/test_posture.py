"""A fitted robot in postures that were not measured."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from plants import elastic_arm
from plants.arm import LENGTH, MASS, STD, STIFFNESS, TOOL, closed_form, result
from plants.fitted_models import fitted_model
from plants.outside_arm import natural_frequencies
from plants.refusals import refused
from scipy.stats import chi2

from elastid.base.errors import UnknownNameError
from elastid.fit.combinations import combination_notes, loop_note
from elastid.fit.diagnosis.status import decisive_index
from elastid.fit.fitted_robot import remaining_tolerances
from elastid.fit.parameter_selection import choose, with_tolerances
from elastid.fit.result import Result
from elastid.fit.result_rows import ModificationIndex
from elastid.fit.spec import FitSpec
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameter, Parameters
from elastid.record import JointLoop
from elastid.robot import Body, Frame, Joint, Motor, Payload, Placement, Robot, Spring, Tolerances
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


def test_ratios_and_contributions_follow_from_cost_and_covariance() -> None:
    """Contributions add in squares; the whole variance of an unidentifiable parameter is noise."""
    n = len(result().x)
    fractions = {"averaging_fraction": np.full(n, 0.5), "persistent_fraction": np.full(n, 0.2)}
    covariance = np.diag([*np.diag(result().covariance)[:-1], np.inf])
    limit = chi2.isf(1 / 700, 20) / 20
    own = replace(result(), covariance=covariance, cost=80.0, cost_expected=20.0, cost_dof=20.0, dof=45, **fractions)
    assert (own.residual_ratio, own.inflation_factor, own.error_ratio) == pytest.approx((2, 2, 4 / 3))
    assert replace(own, cost=10.0).inflation_factor == 1
    np.testing.assert_allclose(own.covariance_of_prediction, 4 * np.diag(np.diag(covariance)))
    np.testing.assert_array_equal(replace(own, cost=10.0).covariance_of_prediction, covariance)
    assert [replace(own, cost=20 * limit * r).exceeds_noise for r in (0.999, 1.001)] == [False, True]
    assert [replace(own, model_error=e).is_within_declared for e in (0.0, 0.02)] == [False, True]
    assert not replace(own, model_error=0.02, dof=30).is_within_declared
    assert not replace(own, cost_dof=np.nan).exceeds_noise
    for name, std in zip([*own][:-1], np.sqrt(np.diag(covariance)), strict=False):
        parts = [getattr(own, kind)[name] ** 2 for kind in ("std_noise", "std_prior", "std_systematic")]
        np.testing.assert_allclose(parts, (std * own.values[name]) ** 2 * np.array([0.5, 0.2, 0.3]))
        assert own.interval(name) == pytest.approx(own.values[name] * np.exp([-1.959964 * std, 1.959964 * std]))
    last = [*own][-1]
    assert (own.std_noise[last], own.std_prior[last], own.std_systematic[last]) == (np.inf, 0, 0)


def test_modification_index_gives_changed_values_and_most_affected_stiffness() -> None:
    index = ModificationIndex(
        "m", "mass", values=[2.0, 3.0], log=(True, False), steps=[np.log(2), 0.5], effects=[0.1, -0.3, np.nan]
    )
    assert index.changed == pytest.approx((4.0, 3.5))
    assert index.most_moved(("k_1", "k_2", "k_3")) == ("k_2", pytest.approx(np.expm1(-0.3)))
    assert index.most_moved(("k_1", "d_2", "k_3")) == ("k_1", pytest.approx(np.expm1(0.1)))
    assert index.most_moved(("d_1", "d_2", "d_3")) == ("", 0)


def stated(text: object) -> list[float]:
    """Value and half width of each interval in a text."""
    return [float(number) for pair in re.findall(r"([-\d.]+) \+- ([\d.]+)", str(text)) for number in pair]


def test_well_identified_sum_of_weak_parameters_is_stated() -> None:
    """a + b / 2 has std 0.1, a and b have 1 and 2; no note if all are identified well, or not correlated."""
    free = Parameters((Parameter("a", 3.0, "N*m"), Parameter("c", 50.0, "N*m"), Parameter("b", 1.0, "N*m")))
    C = np.array([[1.0, 0.02, -1.99], [0.02, 0.25, 0.0], [-1.99, 0.0, 4.0]])
    own = Result(free, free.x, C, 1.0, 1, 1.0, "converged", "", (), 1, np.zeros(3, bool), np.ones(3), "complex")
    (note,) = combination_notes(own)
    assert stated(note) == [3.5, 0.2]
    assert not list(combination_notes(replace(own, covariance=C / 100)))
    assert not list(combination_notes(replace(own, covariance=np.diag(np.diag(C)))))


@pytest.mark.parametrize(("gain", "std"), [(None, 2.0), (0.5, np.sqrt(4 + 16 + 2 * 0.25 * 2 * 4))])
def test_velocity_gain_and_friction_of_motor_are_identified_as_sum(gain: float | None, std: float) -> None:
    """n^2 f_m + g k_d with the correlation of both, for the motor with free friction."""
    drives = [Joint(name, "y", Spring(1e4, 1.0), Motor(1e-3, 10.0, 0.02)) for name in "12"]
    bodies = (Body("a", joints=(drives[0],), mass=1.0), Body("b", "a", Placement((0.3, 0, 0)), (drives[1],), 1.0))
    friction = Parameter("fm_2", 0.04, "N*m*s")
    numbers = (friction,) if gain is None else (friction, Parameter("gain_kd_motor_2", gain))
    free, C = Parameters(numbers), np.array([[4e-4, 0.25 * 0.02 * 0.1], [0.25 * 0.02 * 0.1, 0.01]])[: len(numbers)]
    own = Result(
        free, free.x, C[:, : len(C)], 1.0, 1, 1.0, "converged", "", (), 1, np.zeros(len(C), bool), np.ones(1), "log"
    )
    loop = JointLoop(np.array([1.0, 1.0]), np.array([70.0, 40.0]), np.zeros(2))
    (note,) = loop_note(own, Robot("r", bodies), loop)
    value, width = stated(note)
    assert value == pytest.approx(4 + 40 * (gain or 1), rel=0.05)
    assert width == pytest.approx(1.96 * std, rel=0.05)
    assert loop_note(result(), Robot("r", bodies), loop) == ()


def test_manually_set_parameter_is_exact_and_others_are_unchanged() -> None:
    own = result()
    index = ModificationIndex("m", "mass", effects=np.ones(len(own.x)))
    changed = replace(own, indices=(index,), profile95=np.ones((len(own.x), 2))).with_parameters(k_1=2e4)
    free = np.array(own.parameters.free_names) != "k_1"
    assert changed.values == own.values | {"k_1": pytest.approx(2e4)}
    np.testing.assert_array_equal(changed.covariance, own.covariance * np.outer(free, free))
    np.testing.assert_array_equal(changed.indices[0].effects, free)
    np.testing.assert_array_equal(np.isnan(changed.profile95).all(axis=1), ~free)
    for wrong in (-1.0, 0.0, np.inf):
        with pytest.raises(ValueError, match="finite positive"):
            own.with_parameters(k_1=wrong)


def test_tolerances_after_fit_are_the_posterior_deviations() -> None:
    """Half of the stated tolerances if the data halve each std; unchanged if the fit includes none."""
    arm = replace(elastic_arm.arm(), tolerances=Tolerances())
    free = with_tolerances(choose(FitSpec(), arm, ["a"]), arm, FitSpec())
    std = np.array([1.0 if p.prior is None else p.prior.std / 2 for p in free.free])
    own = Result(
        free, free.x, np.diag(std**2), 1.0, 1, 1.0, "converged", "", (), 1, np.zeros(len(std), bool), std, "log"
    )
    bodies = remaining_tolerances(own, arm).bodies
    assert {body.name for body in bodies} == {"upper", "fore"}
    for body in bodies:
        for kind in ("mass", "inertia", "center_of_mass"):
            assert getattr(body, kind) == pytest.approx(getattr(arm.tolerances, kind) / 2), kind
    assert remaining_tolerances(result(), arm) == arm.tolerances


def test_decisive_cause_is_the_largest_that_moves_a_parameter() -> None:
    """The likeliest cause is preferred if it moves a parameter; else an equivalent, or none if it explains as much."""
    own, drops = result(), {"a": 40.0, "b": 50.0, "c": 20.0, "still": 90.0, "several": 99.0}
    several = {"steps": np.array([0.1, 0.2])}
    every = {
        name: ModificationIndex(
            name, "", drop=drop, effects=(name != "still") * 3 * np.sqrt(np.diag(own.covariance)),
            **(several if name == "several" else {"steps": np.ones(2)}),
        )
        for name, drop in drops.items()
    }  # fmt: skip
    known = SimpleNamespace(disagreement=1.0)

    def decisive(*likeliest: ModificationIndex) -> str:
        index = decisive_index(own, known, [*(replace(each, place=1) for each in likeliest), *every.values()])
        return "" if index is None else index.name

    assert decisive() == decisive(every["b"]) == "b"
    assert decisive(every["a"]) == "a"
    assert decisive(every["still"]) == ""
    assert decisive(replace(every["still"], drop=30.0)) == "b"
    assert decisive(replace(every["still"], alike=("a", "c"))) == "a"
    assert decisive_index(own, SimpleNamespace(disagreement=np.nan), [every["b"]]) is None
