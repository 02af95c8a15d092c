"""Presliding friction of motors in responses of a known plant: found with its numbers, and only where it is."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from plants.data_sheet_arm import POSTURES, SPEC, arm, measure
from plants.dry_friction import CONFIGURATIONS, robot, simulated

from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.frf_problem import Assembly
from elastid.fit.identify import fit_parameters, identify
from elastid.fit.parameter_selection import choose
from elastid.fit.presliding import _between_reversals, presliding_note, rate_band, with_presliding
from elastid.fit.problem.frf_residuals import linear_model
from elastid.fit.result import Result
from elastid.fit.result_rows import Presliding
from elastid.fit.spec import FitSpec
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.presliding import RelaxingSpring
from elastid.linear.response.transfer import frequency_response
from elastid.nonlinear.identify_friction import identify_motor_friction
from elastid.nonlinear.net_response import estimate_net_response
from elastid.response import MotorMotion, Response
from elastid.robot import Tolerances
from elastid.targets.numbers import header_lines

TRUE = {"k_1": 3e4, "k_2": 2e4, "d_1": 60.0, "d_2": 40.0}
SPRINGS = {RelaxingSpring("1", -1): (2e4, 80.0), RelaxingSpring("2"): (6e3, 30.0)}


def with_springs(responses: list[Response]) -> list[Response]:
    """The responses, their noise included, of a robot whose motors have SPRINGS."""
    plain = Linearisation.of_robot(arm())
    changed = replace(plain, presliding=tuple(SPRINGS))
    theta = np.append(plain.model.theta, 0.0)
    both = np.insert(theta, len(theta) - 1, [number for s, a in SPRINGS.values() for number in (s, s / a)])
    return [
        replace(
            G,
            G=G.G
            + frequency_response(linear_model(changed, G, both), both, G.freq_hz)
            - frequency_response(linear_model(plain, G, theta), theta, G.freq_hz),
        )
        for G in responses
    ]


@lru_cache(maxsize=2)
def fitted(is_exact: bool) -> tuple[Result, list[Response]]:
    responses = with_springs(measure(arm(), np.random.default_rng(4), 0.003))
    return fit_parameters(responses, arm(None if is_exact else Tolerances()), SPEC), responses


def test_time_between_reversals_is_half_a_period_at_one_frequency() -> None:
    """For two frequencies it is pi sigma_v / sigma_a; a motor without measured motion has none."""
    power = np.zeros((2, 2, 2), complex)
    power[:, 1, 1] = 1.0, 0.0
    motion = MotorMotion(("motor 1", "motor 2"), np.array([4.0, 20.0]), power, np.zeros(2))
    (response,) = measure(arm(), np.random.default_rng(4), 0.003)[:1]
    assert list(_between_reversals(replace(response, motion=motion), "motor 2")) == pytest.approx([0.125])
    power[1, 1, 1] = 0.5
    both = replace(response, motion=replace(motion, power=power))
    v, a = 4**2 + 20**2 / 2, 4**4 + 20**4 / 2
    assert list(_between_reversals(both, "motor 2")) == pytest.approx([np.sqrt(v / a) / 2])
    assert not list(_between_reversals(both, "motor 3"))


def test_a_rate_at_its_bound_is_a_start() -> None:
    """Its time 1 / a is beyond the bound by rounding."""
    responses = measure(arm(), np.random.default_rng(4), 0.003)
    assembly = Assembly.of(responses, arm(), SPEC, choose(SPEC, arm()))
    _, high = rate_band(responses)
    for k in range(9):
        a = 2.4 * high * (1 + k * 2.0**-52)
        parameters = with_presliding(assembly, {RelaxingSpring("2"): (6e3, a)}).parameters
        assert parameters["relaxation_2"].value == pytest.approx(1 / (2.4 * high))


@pytest.mark.parametrize(
    ("stiffness", "exceeds_noise", "has_effect", "severity"),
    [
        (1e4, False, True, "warning"),
        (-1e4, False, True, "information"),
        (-1e4, True, False, "warning"),
        (1e4, False, False, "information"),
    ],
)
def test_a_negative_spring_within_the_noise_is_no_warning(
    stiffness: float, exceeds_noise: bool, has_effect: bool, severity: str
) -> None:
    spring = Presliding("motor 1", "N*m/rad", stiffness, 3e3, 300.0, 70.0)
    assert presliding_note(spring, exceeds_noise, has_effect).severity == severity
    assert spring.spring.sign == np.sign(stiffness)


@pytest.mark.slow
@pytest.mark.parametrize("is_exact", [True, False])
def test_springs_of_motors_are_found_with_their_numbers(is_exact: bool) -> None:
    """Either sign, with an exact file and with tolerances: V is the noise's, and intervals hold k and d."""
    result, _ = fitted(is_exact)
    assert result.status == "converged"
    assert not result.exceeds_noise
    for spring, (s, a) in SPRINGS.items():
        found = next(each for each in result.presliding if each.spring == spring)
        assert abs(found.stiffness - spring.sign * s) < 3 * found.stiffness_std
        assert abs(found.rate - a) < 3 * found.rate_std
    for name, value in TRUE.items():
        assert abs(result.values[name] - value) < 3 * result.std[name]
    assert all(name.split("_")[0] not in ("presliding", "sliding", "relaxation") for name in result.values)
    assert "fit/presliding" in {note.code for note in result.notes}
    comments = [line for line in header_lines(result, "c0") if "presliding" in line]
    assert ["motor 2" in line for line in comments] == [True]  # a negative one is of the compensation


@pytest.mark.slow
def test_fitted_model_has_presliding_in_responses_only() -> None:
    """Residuals of the responses are as large as the noise; the linear models have the robot's coordinates alone."""
    result, responses = fitted(True)
    robot = FittedRobot.of(result, arm(), responses)
    plain = identify(measure(arm(), np.random.default_rng(4), 0.003), arm(), SPEC)
    assert [linear.n for linear in result.linear] == [linear.n for linear in plain.linear]
    for G, modelled in zip(responses, robot.responses, strict=True):
        error = np.abs(G.G - modelled.G) ** 2 / G.uncertainty.variance
        assert 0.7 < float(np.mean(error)) < 1.4


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_without_presliding_has_none(seed: int) -> None:
    """Nor is it looked for where V is that of the noise."""
    result = identify(measure(arm(), np.random.default_rng(seed)), arm(Tolerances()), SPEC)
    assert result.presliding == ()
    assert "fit/presliding" not in {note.code for note in result.notes}
    assert len(result.linear) == len(POSTURES)


@pytest.mark.slow
@pytest.mark.parametrize(("law", "bending"), [("lugre", 0.04), ("maxwell slip", 0.02)])
def test_bristles_leave_stiffness_and_damping_right(law: str, bending: float) -> None:
    """Motors that move a fifth of the distance over which their bristles bend, friction of 0.16 of the torque.

    k within 0.3 % and d within 4 %, where a fit without springs has V at 5 to 10 times the noise and k_1 1 % off.
    """
    measured, lines = simulated(robot(law=law, bending=bending), CONFIGURATIONS, 2, 1, 8, carrier=None)
    spec, plain = EstimatorSpec(friction="auto"), replace(robot((0.0, 0.0)), tolerances=Tolerances())
    taken = identify_motor_friction(list(measured), spec, lines)
    responses = [estimate_net_response(group, taken, spec, lines, None, plain) for group in measured]
    result = fit_parameters(responses, plain, FitSpec(starts=2, seed=1))
    assert {found.place for found in result.presliding} == {"motor 1", "motor 2"}
    assert result.status == "converged"
    for name, value in {"k_1": 30e3, "k_2": 15e3, "d_1": 30.0, "d_2": 10.0}.items():
        assert abs(result.values[name] / value - 1) < (0.003 if name[0] == "k" else 0.04)
        assert abs(result.values[name] - value) < 3 * result.std[name]
