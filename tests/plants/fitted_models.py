"""Fitted models of serial robots and of robots with loops, as if a fit had ended a tenth above their stiffnesses."""

from functools import cache

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.fitted_robot import FittedRobot, models_by_group
from elastid.fit.parameter_selection import choose
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response, to_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from elastid.study import load_robot
from plants.paths import ROOT

ROBOTS = {
    "manutec": ROOT / "configs" / "robots" / "manutec_r3.yml",
    "arm": ROOT / "elastid" / "app" / "templates" / "serial" / "robot.yml",
    "bench": ROOT / "configs" / "robots" / "two_inertia_bench.yml",
    "table": ROOT / "configs" / "robots" / "kr300_twelve_springs.yml",
}
SERIAL = [*ROBOTS, "scara"]
LOOPED = [f"{robot} {of}" for robot in ("linkage_arm", "irb4400_linkage") for of in ("constrained", "minimal")]
DELAY = 4e-4


@cache
def fitted_model(name: str) -> FittedRobot:
    """One of SERIAL, with a delay, or of LOOPED, with its formulation."""
    return _looped(*name.split()) if name in LOOPED else _serial(name)


def responses_of(model: FittedRobot, configuration: int = 0) -> ComplexArray:
    """Those of the linear model on the measured lines."""
    return frequency_response(model.linear[configuration], model.theta, model.measured[configuration].freq_hz)


def close(G: ComplexArray, expected: ComplexArray, part: float) -> bool:
    """Relative to the largest element on each line: some elements are zero by symmetry."""
    return bool(np.all(np.abs(G - expected) <= part * np.abs(expected).max(axis=(1, 2), keepdims=True)))


def scara() -> Robot:
    """Two turning axes, an elastic tilt of the first, and a screw that slides; products of inertia."""
    axes = (
        Joint("1", "z", Spring(2e5, 150.0), Motor(1.2e-3, 100, 1e-3)),
        Joint("1x", "x", Spring(4e5, 100.0), viscous=40.0),
        Joint("2", "z", Spring(8e4, 60.0), Motor(8e-4, 80, 8e-4), point=(0.03, 0.02, 0.0)),
        Joint("3", "z", Spring(3e6, 900.0), Motor(2e-4, 600.0, 1e-4), motion="translation"),
    )
    inertia = (0.2, 0.6, 0.7, 0.02, 0.01, 0.0)
    first = Body("a", "base", Placement((0, 0, 0.5)), axes[:2], 20, (0.2, 0.01, 0.03), inertia)
    second = Body("b", "a", Placement((0.4, 0, 0.05)), axes[2:3], 12, (0.15, 0, 0.06), (0.1, 0.25, 0.3))
    quill = Body("quill", "b", Placement((0.35, 0, 0)), axes[3:], 4, (0.02, 0, -0.1), (0.03, 0.03, 0.005))
    return Robot("scara", (first, second, quill), gravity=(0.0, 0.0, -9.81))


def _serial(name: str) -> FittedRobot:
    robot = load_robot(ROBOTS[name]) if name in ROBOTS else scara()
    n_u, lines = len(robot.driven), np.geomspace(0.5, 100, 40)
    springs = {"k_*": ParameterSpec(), "delay": ParameterSpec(bounds=(0.0, 0.01))}
    return _fitted(robot, ModelSpec(), springs, (np.linspace(0.3, -0.4, n_u), np.linspace(-0.5, 0.6, n_u)), lines)


def _looped(name: str, formulation: str) -> FittedRobot:
    robot = load_robot(ROOT / "configs" / "robots" / f"{name}.yml")
    configurations = tuple(np.array(angles)[-len(robot.driven) :] for angles in ((0.1, 0.3, -0.1), (0.4, -0.4, 0.2)))
    spec = ModelSpec("constrained" if formulation == "constrained" else "minimal")
    return _fitted(robot, spec, {"k_*": ParameterSpec()}, configurations, np.geomspace(0.5, 120, 40))


def _fitted(
    robot: Robot,
    spec: ModelSpec,
    parameters: dict[str, ParameterSpec],
    configurations: tuple[FloatArray, ...],
    freq_hz: FloatArray,
) -> FittedRobot:
    chosen = choose(FitSpec(parameters=parameters), robot)
    x = np.array([p.to_x(DELAY if p.name == "delay" else 1.1 * p.value) for p in chosen.free])
    n = len(x)
    result = Result(
        chosen, x, 1e-4 * np.eye(n), 1.0, 1, 1.0, "converged", "", (), 0, np.zeros(n, bool), np.ones(n), "log",
        robot=robot, equations=spec,
    )  # fmt: skip
    model, responses = formulate(robot, spec), []
    for name, angles in zip(("one", "two"), configurations, strict=True):
        linear = linearise(model, Configuration(name, angles), model.theta, model.inputs, "acceleration")
        responses.append(to_response(linear, linear.theta_ref, freq_hz))
    return models_by_group(result, robot, responses, spec, "study")[""]


def rest_of(model: FittedRobot, posture: int = 0) -> OperatingPoint:
    """A fitted robot at rest in one of its postures."""
    return equilibrium(model.model, model.theta[:-1], model.linear[posture].configuration)
