"""Geometry identified: where an arm bends and where springs and rods end, together with their stiffness."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from plants.linkages import linkage
from plants.marks import SEEDS
from plants.measured_robots import deviations, responses_of
from plants.refusals import refused

from elastid.base.errors import StudyError
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.frf_problem import Assembly
from elastid.fit.identify import identify
from elastid.fit.parameter_selection import choose
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.model.spec import ModelSpec
from elastid.response import Response
from elastid.robot import Anchor, Body, CoilSpring, Compensator, Frame, Joint, Motor, Placement, Robot, Rod, Spring

FREQ = np.linspace(1, 50, 50)
MOTOR = Motor(2e-3, 60, 1e-3)


def bending_arm() -> Robot:
    """A coil that carries much of the weight, an upper arm of 0.8 m that bends at 0.35 m, an elbow."""
    ends = Anchor("base", (-0.15, 0, -0.5)), Anchor("root", (-0.1, 0, 0.25))
    bend = Joint("1b", "y", Spring(6e4, 30), point=(0.0, 0.0, 0.35))
    shoulder, elbow = Joint("1", "y", Spring(3e4, 60), MOTOR), Joint("2", "y", Spring(2e4, 40), MOTOR)
    return Robot(
        "bending arm",
        (
            Body("root", joints=(shoulder,), mass=15, center_of_mass=(0, 0, 0.2), inertia=1.0),
            Body("tip", "root", joints=(bend,), mass=20, center_of_mass=(0, 0, 0.6), inertia=1.0),
            Body("fore", "tip", Placement((0, 0, 0.8)), (elbow,), 25, (0.3, 0, 0), 1.0),
        ),
        frames=(Frame("tool", "fore", Placement((0.6, 0, 0.1))),),
        compensators=(Compensator("coil", ends, coil=CoilSpring(5e4, 0.4)),),
    )


LINKAGE = linkage(Rod(0.86, 6.2, 0.4, 0.5, 2e7, 3000), crank=0.33, bends=True)
POSTURES = ((0.4, -0.3), (-0.5, 0.8), (0.9, 1.0), (0.0, 0.1))
APART = ((0.0, 0.0), (0.5, -0.1), (-0.4, 0.4), (0.2, 0.9), (0.6, -0.2))
GYROSCOPES = ("body end y", "body upper y")


def measure(
    robot: Robot,
    postures: tuple[tuple[float, float], ...],
    seed: int,
    further: tuple[str, ...] = (),
    spec: ModelSpec = ModelSpec(),  # noqa: B008
) -> list[Response]:
    """Exact responses in each posture with 2 % noise of known variance."""
    return responses_of(robot, postures, np.random.default_rng(seed), FREQ, further=further, spec=spec)


OF_ARM = {
    "k_*": ParameterSpec(),
    "d_*": ParameterSpec(),
    "pj_1b_z": ParameterSpec(start=0.25, bounds=(0.05, 0.75)),
    "pc1_coil_x": ParameterSpec(start=-0.2, bounds=(-0.4, -0.05)),
}


@pytest.mark.parametrize("seed", SEEDS)
def test_where_an_arm_bends_and_where_its_spring_is_fixed(seed: int) -> None:
    """Both to a few millimetres, with all stiffnesses, from starts 50 to 100 mm away, within the claimed intervals."""
    truth = bending_arm()
    start = truth.with_parameters({"k_1": 2e4, "k_1b": 9e4, "k_2": 3e4})
    result = identify(measure(truth, POSTURES, seed), start, FitSpec(starts=2, parameters=OF_ARM, seed=seed))
    assert result.status == "converged"
    assert deviations(result, truth).max() < 3.5
    assert result.inflation_factor < 1.1
    for name in ("pj_1b_z", "pc1_coil_x"):
        low, high = result.interval(name)
        assert high - low < 0.025
        assert result.parameters[name].unit == "m"
    (again, *_) = FittedRobot.of(result, start, measure(truth, POSTURES, seed)).responses
    (exact, *_) = measure(truth, POSTURES, seed)
    assert np.abs(again.G / exact.G - 1).max() < 0.2


def test_the_gradient_is_that_of_differences_and_travels_to_processes() -> None:
    """What the search solves, with points of an arm that the geometry moves, survives pickling and knows its slope."""
    robot, places = bending_arm(), ("accelerometer tool z", "frame tool x")
    spec = FitSpec(parameters=OF_ARM | {"p_fore_z": ParameterSpec(start=0.82)})
    parameters = choose(spec, robot)
    assembly = Assembly.of(measure(robot, POSTURES[:2], 0, places), robot, spec, parameters)
    assert assembly.linearisation.follows
    problem = assembly.search_problem(assembly.at(parameters.x, "complex"))
    sent = pickle.loads(pickle.dumps(problem))
    here, there = problem.evaluate(parameters.x), sent.evaluate(parameters.x)
    assert here.cost == there.cost
    np.testing.assert_array_equal(here.gradient, there.gradient)
    for i, unit in enumerate(1e-5 * np.eye(len(parameters.x))):
        slope = (problem.evaluate(parameters.x + unit).cost - problem.evaluate(parameters.x - unit).cost) / 2e-5
        assert here.gradient[i] == pytest.approx(slope, rel=1e-5, abs=1e-6 * here.cost)
    affine = assembly.at(parameters.x, "complex").problem.evaluate(parameters.x)
    assert affine.cost == pytest.approx(here.cost, rel=1e-12)
    np.testing.assert_allclose(affine.gradient, here.gradient, rtol=1e-9)


def fit_of_two(robot: Robot, wanted: dict[str, ParameterSpec], spec: ModelSpec = ModelSpec()) -> None:  # noqa: B008
    identify(measure(robot, POSTURES[:2], 0), robot, FitSpec(starts=1, parameters=wanted), model=spec)


def test_what_nothing_depends_on_is_named() -> None:
    """Along the axis of a joint, and across the plane in which all that moves lies."""
    robot = replace(bending_arm(), compensators=())
    with refused("fit/not-identifiable", holds="p_root_x, pj_1b_y: "):
        fit_of_two(robot, {"k_1": ParameterSpec(), "pj_1b_y": ParameterSpec(), "p_root_x": ParameterSpec()})
    with refused("fit/not-identifiable", holds="p2_rod_y: "):
        fit_of_two(LINKAGE, {"p2_rod_y": ParameterSpec()})


@pytest.mark.parametrize(
    ("name", "asked", "code", "place"),
    [
        ("l_rod", ParameterSpec(start=0.4), "robot/no-equilibrium", "configuration"),
        ("l_rod", ParameterSpec(start=-1.0), "fit/parameters", "fit.parameters"),
        ("p1_rod_x", ParameterSpec(start=-2.0, bounds=(-3.0, 0.0)), "robot/no-equilibrium", "configuration"),
    ],
)
def test_a_robot_that_cannot_stand_at_its_start_is_named(name, asked, code, place):
    """Loops that do not close, a rod without length."""
    with refused(code, place=place):
        fit_of_two(LINKAGE, {name: asked})


def test_equations_without_geometry_refuse_it() -> None:
    """They name the coordinate, and the variants that have it."""
    with pytest.raises(StudyError, match="p1_rod_x"):
        fit_of_two(LINKAGE, {"p1_rod_x": ParameterSpec()}, ModelSpec("minimal", "constant_stiffness"))


@pytest.mark.parametrize(("formulation", "seed"), [("constrained", 0), ("minimal", 1)])
@pytest.mark.slow
def test_the_ends_of_a_rod_and_its_stiffness(formulation: str, seed: int) -> None:
    """The crank's length to a tenth of a millimetre, with the stiffness of rod, gears and bending, from 30 mm off."""
    truth, spec = LINKAGE, ModelSpec(formulation)
    wanted = {name: ParameterSpec() for name in ("k_*", "d_*")}
    wanted["p1_rod_x"] = ParameterSpec(start=-0.30, bounds=(-0.4, -0.2))
    responses = measure(truth, APART, seed, GYROSCOPES, spec)
    result = identify(responses, truth, FitSpec(starts=1, parameters=wanted, seed=seed), model=spec)
    assert result.status == "converged"
    assert deviations(result, truth).max() < 3.5
    low, high = result.interval("p1_rod_x")
    assert high - low < 1e-4
