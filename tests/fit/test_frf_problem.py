"""Several robots of one type in one fit, and nonlinear springs from one posture to another."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants import data_sheet_arm
from plants.elastic_arm import started_elsewhere
from plants.marks import SEEDS
from plants.measured_robots import deviation, deviations, responses_of
from plants.refusals import refused

from elastid.fit.fitted_robot import FittedRobot, models_by_group
from elastid.fit.frf_problem import Assembly, is_distorted_by_friction, relinearise
from elastid.fit.identify import identify
from elastid.fit.parameter_selection import choose
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.spec import FitSpec, ParameterSpec, RatioSpec, WeightSpec
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import EXACT
from elastid.parameters import Tie
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from elastid.validation.comparison import ComparedVariant, refit

FREQ = np.linspace(2, 60, 60)
# Joint 1 carries 850, 760, 290, 40, 990 Nm: from nearly its stiffness without load to five times as much.
POSTURES = ((1.2, 0.3), (0.6, -0.7), (0.1, 1.0), (-0.3, -0.3), (1.5, -1.0))
WANTED = FitSpec(starts=6, parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*", "k3_*")})


def arm(first: Spring, second: Spring) -> Robot:
    """Two driven links in a vertical plane."""
    upper = Body("upper", "base", Placement(), (Joint("1", "y", first, Motor(2.5e-3, 120, 1.5e-3)),), 60, (0, 0, 0.4))
    fore = (Joint("2", "y", second, Motor(1.6e-3, 110, 1.2e-3)),)
    return Robot(
        "arm",
        (
            replace(upper, inertia=(6.0, 6.2, 0.8)),
            Body("fore", "upper", Placement((0, 0, 0.85)), fore, 75, (0.45, 0, 0.1), (1.5, 11, 11.0)),
        ),
    )


CUBIC = arm(Spring(3e5, 500, cubic=2e11), Spring(1.8e5, 250, cubic=8e10))


def measure(robot: Robot, postures: tuple[tuple[float, float], ...], seed: int) -> list[Response]:
    """Exact responses of the tangent in each posture with 2 % noise of known variance."""
    return responses_of(robot, postures, np.random.default_rng(seed), FREQ)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.slow
def test_cubic_stiffness_is_found_from_postures_with_different_preload(seed: int) -> None:
    """k and k3 of both gears from starts off by up to a factor of 2, within the claimed intervals."""
    result = identify(measure(CUBIC, POSTURES, seed), started_elsewhere(CUBIC, 2.0, seed), replace(WANTED, seed=seed))
    assert result.status == "converged"
    assert deviations(result, CUBIC).max() < 3.5
    for name in ("k_1", "k3_1", "k_2", "k3_2"):
        low, high = result.interval(name)
        assert high / low < 1.05
    assert result.inflation_factor < 1.1


def test_a_fit_names_the_joint_that_rests_inside_its_gap() -> None:
    """Stiffness beyond the gap is found from loaded postures; the posture in between is spoken of."""
    truth = arm(Spring(9e5, 500, backlash=1e-4, inner_stiffness=1e5), Spring(4e5, 250, backlash=5e-5))
    wanted = replace(WANTED, starts=2, parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec()})
    result = identify(measure(truth, POSTURES, 1), started_elsewhere(truth, 1.3, 1), wanted)
    assert result.status == "converged"
    assert deviations(result, truth).max() < 3.5
    assert "robot/operating-point" in {note.code for note in result.notes}


def test_search_returns_from_collapse_to_equilibrium() -> None:
    """Springs a thousand times softer than those of the file carry neither link; the end says so, and is none."""
    robot, spec = (
        arm(Spring(3e5, 500), Spring(1.8e5, 250)),
        FitSpec(parameters={"k_*": ParameterSpec()}, weights=WeightSpec(model_error=0.0)),
    )
    data = measure(robot, POSTURES[:2], seed=0)
    assembly = Assembly.of(data, robot, spec, choose(spec, robot, [G.configuration.name for G in data]))
    start = assembly.parameters.x
    soft = start + math.log(1e-3)
    end = relinearise(assembly, LocalOptimum(soft, soft, 0.0, 0, True, "soft"), "complex").end
    assert not end.converged
    assembly.at(end.x, "complex")  # StudyError where the robot does not stand
    np.testing.assert_allclose(end.x, (soft + start) / 2)


A = data_sheet_arm.arm()
B = data_sheet_arm.arm().with_parameters({"k_1": 3.6e4, "fm_1": 3e-2, "fm_2": 5e-3})
ROBOTS = {"A": ("a1", "a2", "a3"), "B": ("b1", "b2", "b3")}


def measure_one(robot: Robot, name: str, seed: int) -> list[Response]:
    """Responses in each posture with 2 % noise of known variance."""
    named = {f"{name}{i + 1}": angles for i, angles in enumerate(data_sheet_arm.POSTURES)}
    return responses_of(robot, named, np.random.default_rng(seed), data_sheet_arm.FREQ)


def both(seed: int) -> list[Response]:
    """Two robots, measured in the same postures."""
    return [*measure_one(A, "a", 2 * seed), *measure_one(B, "b", 2 * seed + 1)]


SPEC = FitSpec(
    starts=2,
    robots=ROBOTS,
    parameters={
        "k_1": ParameterSpec(per="robot"),
        "k_2": ParameterSpec(),
        "d_*": ParameterSpec(),
        "fm_*": ParameterSpec(per=ROBOTS),
    },
)
TRUTH = {"k_1@A": 3e4, "k_1@B": 3.6e4, "k_2": 2e4, "fm_1@A": 1e-2, "fm_1@B": 3e-2, "fm_2@A": 1e-2, "fm_2@B": 5e-3}


@pytest.mark.parametrize("seed", SEEDS)
def test_shared_and_own_values_of_two_robots_are_found(seed: int) -> None:
    """Each robot's stiffness and friction by its name, what they share once, all within the claimed intervals."""
    result = identify(
        both(seed), data_sheet_arm.arm().with_parameters({"k_1": 2.5e4, "k_2": 2.5e4}), replace(SPEC, seed=seed)
    )
    assert result.status == "converged"
    assert set(result.parameters.free_names) == {*TRUTH, "d_1", "d_2"}
    assert max(deviation(result, name, truth) for name, truth in TRUTH.items()) < 3.5
    assert not {"fit/responses", "fit/inconsistent-responses"} & {note.code for note in result.notes}
    place = result.parameters.index("k_1")
    assert result.parameters.expand(result.x, "b3")[place] == result.values["k_1@B"]
    # Most information on a number of robot B is from the configurations of B.
    assert result.information_fraction[3:, result.parameters.free_names.index("fm_1@B")].sum() > 0.6
    np.testing.assert_allclose(result.information_fraction.sum(axis=0), 1.0)
    # A third robot of the type, of which nothing was fitted: the mean of those that were.
    assert result.parameters.expand(result.x, "c1")[place] == pytest.approx(
        math.sqrt(result.values["k_1@A"] * result.values["k_1@B"])
    )


def test_a_left_out_configuration_has_the_numbers_of_its_robot() -> None:
    """What is found for robot B from b1 and b2 predicts b3; without any of B's, the mean of the others does."""
    data = both(0)
    own = ComparedVariant("own", data_sheet_arm.arm(), SPEC, EXACT)
    assert refit(data, (own, ("b3",))).folds["b3"].misfit < 1.2
    assert refit(data, (own, ROBOTS["B"])).folds["b1"].misfit > 10


def test_robots_must_be_named_once_and_at_all() -> None:
    with refused("fit/parameters", place="fit.parameters.k_1.per"):
        choose(replace(SPEC, robots={}), data_sheet_arm.arm(), ["a1"])
    with pytest.raises(ValueError, match="robots: configuration a1 is given to A, B"):
        FitSpec(robots={"A": ("a1",), "B": ("a1",)})


def test_an_export_is_of_one_robot_each() -> None:
    """The linear models of robot B have its numbers: their response is that of the fit, and A's are another's."""
    data = both(0)
    ratio = {"beta": RatioSpec(start=2e-3)}
    tied = SPEC.parameters | {"d_*": ParameterSpec(tie=Tie("k_*", by="beta"))}
    result = identify(data, data_sheet_arm.arm(), replace(SPEC, parameters=tied, ratios=ratio, starts=1))
    models = models_by_group(result, data_sheet_arm.arm(), data)
    assert {name: tuple(G.configuration.name for G in of.measured) for name, of in models.items()} == ROBOTS
    for name, model in models.items():
        assert model.robot.parameters()["k_1"][0] == result.values[f"k_1@{name}"]
        names = [p.name for p in model.parameters]
        assert f"fm_1@{name}" in names
        assert not {"k_1", "fm_1", f"fm_1@{'BA'['AB'.index(name)]}"} & set(names)
        for linear, fitted in zip(
            model.linear, FittedRobot.of(result, data_sheet_arm.arm(), model.measured).responses, strict=True
        ):
            np.testing.assert_allclose(
                frequency_response(linear, model.theta, data_sheet_arm.FREQ), fitted.G, rtol=1e-9
            )


@pytest.mark.parametrize(("ratio", "is_distorted"), [(3.9, False), (4.1, True)])
def test_distortion_is_significant_above_four_noise_variances(ratio: float, is_distorted: bool) -> None:
    """In the median over lines with noise; never in a response without noise."""
    noise = np.array([0.0, 1.0, 2.0, 1.0])[:, None, None]
    total = np.array([9.0, ratio, 2 * ratio, 99.0])[:, None, None]
    response = Response(
        np.arange(1.0, 5), np.ones((4, 1, 1), complex), ("motor 1",), ("motor 1",), "acceleration",
        Configuration("c", [0.0]), noise=Covariance(noise, 8.0), total=Covariance(total, 8.0),
    )  # fmt: skip
    assert is_distorted_by_friction(response) == is_distorted
    assert not is_distorted_by_friction(replace(response, noise=Covariance(0 * noise, 8.0)))
    assert not is_distorted_by_friction(replace(response, noise=None))
