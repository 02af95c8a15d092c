"""Robots with loops and what acts on them beside springs; closed postures on the branch of the start."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from plants.linkages import LEVER, LOWER, linkage
from plants.marks import slow
from plants.paths import ROBOTS
from plants.refusals import refused

from elastid.base.errors import StudyError
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import (
    Anchor,
    Body,
    CoilSpring,
    Compensator,
    GearCoupling,
    Joint,
    Loop,
    Motor,
    Pin,
    Placement,
    Robot,
    Rod,
    Spring,
)
from elastid.study import load_robot

LINES = np.geomspace(1, 150, 60)
CONSTRAINED, MINIMAL = ModelSpec("constrained"), ModelSpec("minimal")
RIGID_ROD = Rod(LOWER, 6.2, 0.52, 0.64)
PARALLELOGRAM = linkage(RIGID_ROD)
FOUR_BAR = linkage(Rod(0.86, 6.2, 0.4, 0.5), crank=0.33)
SPATIAL = linkage(Rod(0.86, 6.2, 0.4, 0.5, 2e7, 3000), crank=0.33, bends=True, spatial=True)


def response(robot: Robot, spec: ModelSpec, at: Configuration):
    model = formulate(robot, spec)
    linear = linearise(model, at, model.theta, model.inputs, "acceleration")
    return frequency_response(linear, linear.theta_ref, LINES)


def saddle_point(model: ElasticModel, at: Configuration):
    """G_acc by the scaled KKT matrix at every line, of all coordinates at rest: the oracle."""
    point, theta = equilibrium(model, model.theta, at), model.theta
    assert np.abs(model.constraint(point.q, theta).full()).max(initial=0) < 1e-10
    K, Phi = model.stiffness(point.q, point.lambda_, theta).full(), model.constraint_jacobian(point.q, theta).full()
    M, D = model.mass(point.q, theta).full(), model.damping(point.q, theta).full()
    n, m, scale = len(M), len(Phi), np.abs(K).max()
    G = []
    for omega in 2 * np.pi * LINES:
        H = -(omega**2) * M + 1j * omega * D + K
        A = np.block([[H, scale * Phi.T], [scale * Phi, np.zeros((m, m))]])
        X = np.linalg.solve(A, np.vstack([model.B, np.zeros((m, model.n_u))]).astype(complex))[:n]
        G.append(-(omega**2) * model.B.T @ X)
    return np.array(G)


def far(G, reference):
    """Largest difference, relative to the largest element of the line."""
    return float((np.abs(G - reference).max(axis=(1, 2)) / np.abs(reference).max(axis=(1, 2))).max())


@pytest.mark.slow
@settings(max_examples=16, deadline=None)
@example(crank=LEVER, length=LOWER, mass=6.2, stiffness=None, angles=(0.4, -0.3), bends=True, spatial=True)
@example(crank=LEVER, length=LOWER, mass=0.0, stiffness=7.3, angles=(-0.6, 0.2), bends=True, spatial=True)
# Its last step is 2.6e-9 rad.
@example(crank=0.34375, length=0.875, mass=6.2, stiffness=8.0, angles=(0.75, 0.375), bends=True, spatial=False)
@given(
    crank=st.floats(0.25, 0.35),
    length=st.floats(0.85, 0.95),
    mass=st.sampled_from((0.0, 6.2)),
    stiffness=st.none() | st.floats(6, 8.5),
    angles=st.tuples(st.floats(-0.8, 0.8), st.floats(-0.4, 0.4)),
    bends=st.booleans(),
    spatial=st.booleans(),
)
def test_constrained_equals_minimal_equals_saddle_point(crank, length, mass, stiffness, angles, bends, spatial):
    """To 1e-10 from 1 to 150 Hz on any four-bar, its rod rigid or elastic; the rod of the minimal form is cut."""
    spring = () if stiffness is None else (10**stiffness, 1e3)
    robot = linkage(Rod(length, mass, 0.5 * bool(mass), 0.1 * mass, *spring), crank, bends, spatial)
    at = Configuration("c", ((0.3,) if spatial else ()) + (angles[0], angles[0] + angles[1]))
    G = response(robot, CONSTRAINED, at)
    assert far(response(robot, MINIMAL, at), G) < 1e-10
    assert far(saddle_point(formulate(robot, CONSTRAINED), at), G) < 1e-10
    np.testing.assert_allclose(G, np.swapaxes(G, 1, 2), rtol=0, atol=1e-10 * np.abs(G).max())


def test_stiffness_is_the_derivative_of_the_forces():
    """Hessian of V + lambda^T phi against central differences of dV/dq + Phi^T lambda."""
    model = formulate(SPATIAL, CONSTRAINED)
    random = np.random.default_rng(2)
    q, lambda_ = random.uniform(-0.5, 0.5, model.n_q), random.normal(0, 1e4, model.n_c)
    K, step = model.stiffness(q, lambda_, model.theta).full(), 1e-6

    def force(x):
        phi_q = model.constraint_jacobian(x, model.theta).full()
        return model.potential_gradient(x, model.theta).full()[:, 0] + phi_q.T @ lambda_

    differences = [(force(q + step * e) - force(q - step * e)) / (2 * step) for e in np.eye(model.n_q)]
    np.testing.assert_allclose(K, np.array(differences).T, rtol=0, atol=1e-7 * np.abs(K).max())


@pytest.mark.parametrize("spec", [CONSTRAINED, MINIMAL, ModelSpec("minimal", "series_stiffness")])
def test_derivatives_of_the_response_equal_differences(spec: ModelSpec):
    """To 1e-6 for springs, dampers, rods and motors at a held operating point."""
    model, at = formulate(SPATIAL, spec), Configuration("c", (0.6, 0.6, 0.1))
    wanted = ("k_3", "d_3", "k_rod", "d_rod", "Jm_2", "k_2")
    linear = linearise(model, at, model.theta, model.inputs, "acceleration")
    kernel = Kernel(linear, LINES, wanted)
    _, dG = Columns(kernel).evaluate(linear.theta_ref)
    for i, name in enumerate(wanted):
        place, step = linear.parameters.index(name), 1e-4
        up, down = (np.array(linear.theta_ref) for _ in range(2))
        up[place] *= 1 + step
        down[place] *= 1 - step
        # The model is affine in theta but for springs in series, where it is so to first order only.
        difference = (kernel.response(up) - kernel.response(down)) / (up[place] - down[place])
        assert np.abs(dG[i] - difference).max() < 1e-6 * np.abs(dG[i]).max()


def test_redundant_constraints_change_nothing():
    """A rod that is a body closed by a spatial pin (5 rows, 3 of them redundant), by a planar one, and as a rod."""
    at = Configuration("c", (0.4, 0.1))
    body = Body(
        "bar",
        "crank",
        Placement((-LEVER, -0.069, 0.0)),
        (Joint("bar", "y"),),
        6.2,
        (0.0, 0.0, 0.52 * LOWER),
        (0.64, 0.64, 0.0),
    )
    ends = (Anchor("bar", (0.0, 0.0, LOWER)), Anchor("upper", (-LEVER, 0.0, 0.0)))
    loops = (Loop("top", ends, Pin("y", planar=True)), Loop("top", ends, Pin("y")), Loop("top", ends))
    reference = response(PARALLELOGRAM, CONSTRAINED, at)
    for loop in loops:
        robot = linkage(loop=loop, further=(body,))
        assert formulate(robot).n_c in (2, 3, 5)
        for spec in (CONSTRAINED, MINIMAL):
            assert far(response(robot, spec, at), reference) < 1e-10
    again = replace(PARALLELOGRAM.loops[0], name="again", rod=Rod(LOWER))
    doubled = replace(PARALLELOGRAM, loops=(*PARALLELOGRAM.loops, again))
    for spec in (CONSTRAINED, MINIMAL):
        assert far(response(doubled, spec, at), reference) < 1e-10


def test_any_choice_of_independent_coordinates_gives_the_same_response():
    """And one that is none is refused, with what is wrong."""
    robot, at = FOUR_BAR, Configuration("c", (0.4, 0.1))
    reference = response(robot, CONSTRAINED, at)
    for dropped in ("joint elbow", "joint 2", "joint 3"):
        kept = tuple(name for name in formulate(robot).coordinates if name != dropped)
        assert far(response(robot, ModelSpec("minimal", independent=kept), at), reference) < 1e-9
    short = tuple(name for name in formulate(robot).coordinates if name != "motor 2")
    with refused("robot/loops"):
        response(robot, ModelSpec("minimal", independent=short), at)
    with refused("robot/loops"):
        response(robot, ModelSpec("minimal", independent=("joint 2",)), at)
    with refused("model/variant", place="model.independent"):
        response(robot, ModelSpec("minimal", independent=("joint 9",)), at)


def test_start_posture_decides_loop_branch() -> None:
    """The other branch of a four-bar is another mechanism, followed to the same configuration."""
    robot, at = FOUR_BAR, Configuration("c", (0.5, 0.3))
    *others, upper = robot.bodies
    flipped = replace(robot, bodies=(*others, replace(upper, joints=(Joint("elbow", "y", start=2.6),))))
    elbows = []
    for one in (robot, flipped):
        model = formulate(one)
        point = equilibrium(model, model.theta, at)
        assert np.abs(model.constraint(point.q, model.theta).full()).max() < 1e-10
        elbows.append(point.q[model.index("joint elbow")])
    assert abs(elbows[1] - elbows[0]) > 1.0


def wrong(robot: Robot, angles: tuple[float, ...] = (0.0, 0.0)) -> str:
    model = formulate(robot)
    with pytest.raises(StudyError) as caught:
        equilibrium(model, model.theta, Configuration("pose", angles))
    return str(caught.value)


def test_what_is_wrong_with_a_loop_is_said() -> None:
    """How much stays open and where; what is locked, left free, folded up."""
    said = wrong(linkage(Rod(2.0)))
    assert "pose: loop rod does not close at the start posture" in said
    assert "the rod is 2000 mm" in said
    assert "joint elbow" in wrong(PARALLELOGRAM, (0.0, -1.57))
    geared = Joint("elbow", "y", Spring(1e5), Motor(1e-3, 50))
    robot = PARALLELOGRAM
    locked = replace(robot, bodies=(*robot.bodies[:-1], replace(robot.bodies[-1], joints=(geared,))))
    assert "lock 2, 3, elbow" in wrong(locked, (0.0, 0.0, 0.0))
    loose = (Joint("elbow", "y"), Joint("twist", (-LEVER, 0.0, 0.0)))
    free = replace(robot, bodies=(*robot.bodies[:-1], replace(robot.bodies[-1], joints=loose)))
    assert "joint twist" in wrong(free)
    assert "does not close: its ends are" in wrong(linkage(Rod(0.75), crank=0.45), (0.0, -1.2))


AT = Configuration("c", np.array([0.2, 0.4, 0.1]))


def arm() -> Robot:
    return load_robot(ROBOTS / "irb4400_linkage.yml")


def changed(robot: Robot, name: str, change) -> Robot:
    """The robot with one joint made another."""

    def joints(body):
        return tuple(change(joint) if joint.name == name else joint for joint in body.joints)

    return replace(robot, bodies=tuple(replace(body, joints=joints(body)) for body in robot.bodies))


def riding(robot: Robot) -> Robot:
    """Motors 2 and 3 ride on the turret, with gears so low that it shows."""
    for name, on, axis in (("2", "turret", "y"), ("3", "turret", "y")):

        def onto(joint: Joint, on=on, axis=axis) -> Joint:
            assert joint.motor is not None
            return replace(joint, motor=replace(joint.motor, ratio=15.0, inertia=0.2, on=on, axis=axis))

        robot = changed(robot, name, onto)
    return robot


def hardening(joint: Joint) -> Joint:
    """With a cubic spring that gravity bends visibly."""
    assert joint.spring is not None
    return replace(joint, spring=replace(joint.spring, cubic=1e11))


BALANCE = Compensator(
    "balance", (Anchor("turret", (-0.28, 0.0, 0.78)), Anchor("lower_end", (0.12, 0.0, 0.1))), coil=CoilSpring(2e4, 0.3)
)
# From the crank to the upper arm, both ends moved by the loop.
ACROSS = Compensator(
    "across", (Anchor("crank", (-0.2, 0.0, 0.1)), Anchor("upper", (-0.2, 0.0, 0.1))), CoilSpring(8e4, 0.5)
)
ROBOTS_WITH = {
    "compensator to the lower arm": lambda: replace(arm(), compensators=(BALANCE,)),
    "compensator across the loop": lambda: replace(arm(), compensators=(ACROSS,)),
    "riding motors": lambda: riding(arm()),
    "coupled gears, springs after": lambda: replace(arm(), gears=(GearCoupling("3", "2", 40.0),)),
    "coupled gears, springs before": lambda: replace(arm(), gears=(GearCoupling("3", "2", 40.0, "before"),)),
    "a hardening gear": lambda: changed(arm(), "3", hardening),
}


# The others run with the slow tests.
QUICK = {"compensator across the loop", "coupled gears, springs after", "a hardening gear"}


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in ROBOTS_WITH])
def test_both_formulations_agree_with_all_that_drives_a_robot(name: str) -> None:
    """Responses to 1e-10, and the response is another one than without it."""
    robot = ROBOTS_WITH[name]()
    constrained = response(robot, CONSTRAINED, AT)
    assert far(response(robot, MINIMAL, AT), constrained) < 1e-10
    assert far(response(arm(), CONSTRAINED, AT), constrained) > 1e-3
    np.testing.assert_allclose(
        constrained, np.swapaxes(constrained, 1, 2), rtol=0, atol=1e-9 * np.abs(constrained).max()
    )
