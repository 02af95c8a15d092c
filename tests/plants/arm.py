"""An arm of two elastic joints in a vertical plane, as if a fit had ended there, and its closed form."""

from functools import cache

import numpy as np

from elastid.fit.parameter_selection import choose
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.linear.linearise import linearise
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.robot import Body, Frame, Joint, Limits, Motor, Placement, Robot, Spring, Tolerances
from plants.outside_arm import Outside

STIFFNESS, DAMPING, MASS, OFFSET, INERTIA = (4e4, 2e4), (80.0, 40.0), (30.0, 20.0), (0.4, 0.35), (1.5, 1.0)
LENGTH, TOOL, GRAVITY, RATIO = 0.8, 0.6, 9.81, 80.0
STD = 0.02  # relative, of each stiffness and damping


def resting(model: ElasticModel, *angles: float) -> OperatingPoint:
    """A robot at rest at angles of its driven joints."""
    return equilibrium(model, model.theta, Configuration("c", np.array(angles)))


def robot(
    damping: tuple[float, float] | None = DAMPING,
    gravity: float = GRAVITY,
    viscous: float = 0.0,
    coulomb: tuple[float, float] = (0.0, 0.0),
    limits: tuple[Limits, Limits] = (Limits(), Limits()),
    tolerances: Tolerances | None = None,
) -> Robot:
    """Two links in a vertical plane with a tool at the end of the second: modes at about 5 and 17 Hz.

    damping: None of rigid gears.  viscous, coulomb: friction of the motors, motor side.
    """
    springs = [None, None] if damping is None else [Spring(k, d) for k, d in zip(STIFFNESS, damping, strict=True)]
    first, second = (
        Joint(str(i + 1), "y", springs[i], Motor(2e-3, RATIO, viscous, coulomb[i]), limits=limits[i]) for i in range(2)
    )
    upper = Body("upper", joints=(first,), mass=MASS[0], center_of_mass=(OFFSET[0], 0, 0), inertia=INERTIA[0])
    fore = Body("fore", "upper", Placement((LENGTH, 0, 0)), (second,), MASS[1], (OFFSET[1], 0, 0), INERTIA[1])
    frames = (Frame("tool", "fore", Placement((TOOL, 0, 0))),)
    return Robot("arm", (upper, fore), (0.0, 0.0, -gravity), frames=frames, tolerances=tolerances)


_OUTSIDE = Outside(robot())


@cache
def result(std: float = STD) -> Result:
    """Stiffnesses and dampings of the robot with independent errors."""
    chosen = choose(FitSpec(parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec()}), robot())
    n = len(chosen.free)
    home = linearise(
        formulate(robot()), Configuration("home", np.array([0.3, 0.5])), formulate(robot()).theta, ("motor 1",),
        "acceleration",
    )  # fmt: skip
    return Result(
        chosen, chosen.x, std**2 * np.eye(n), 1.0, 1, 1.0, "converged", "done", (), 1, np.zeros(n, bool), np.ones(n),
        "complex", linear=(home,), robot=robot(),
    )  # fmt: skip


def rest(
    angles: np.ndarray | tuple[float, ...], force: np.ndarray | tuple[float, float] = (0.0, 0.0),
    stiffness: tuple[float, ...] = STIFFNESS,
) -> np.ndarray:  # fmt: skip
    """Joints (2,) at rest: k (q - angle) = torque of gravity, which turns a positive angle down, and of a force.

    force: x and z at the tool.
    """
    q = np.array(angles, float)
    for _ in range(12):
        q = np.asarray(angles) + (jacobian(q).T @ force - _OUTSIDE.gradient(q)) / stiffness
    return q


def tool(q: np.ndarray) -> np.ndarray:
    """x and z of the tool; a positive turn about y leads z to x."""
    a, b = q[0], q[0] + q[1]
    return np.array([LENGTH * np.cos(a) + TOOL * np.cos(b), -LENGTH * np.sin(a) - TOOL * np.sin(b)])


def jacobian(q: np.ndarray) -> np.ndarray:
    """d tool / d q (2, 2)."""
    return _OUTSIDE.jacobian(q, 1, np.array([TOOL, 0.0, 0.0]))[0][[0, 2]]


def closed_form(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """M, D, K (2, 2) and J (2, 2) of the tool's x and z in the axes of the base, motors held."""
    M, D, K, q = _OUTSIDE.matrices(np.asarray(angles))
    return M[:2, :2], D[:2, :2], K[:2, :2], jacobian(q)
