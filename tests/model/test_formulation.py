"""Coordinates, sides, places and readings of an ElasticModel, and of one joint; the `model` section."""

from dataclasses import replace

import numpy as np
import pytest
from plants.dry_friction import robot as two_axes
from plants.linkages import LEVER, LOWER, linkage
from plants.refusals import refused
from plants.template_arm import arm as template_arm

from elastid.friction_study.presliding import OF_FILE, _Model
from elastid.linear.equilibrium import equilibrium, rigid_posture
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate, inert_parameters, locked_joint, serial
from elastid.model.spec import ModelSpec, Variant
from elastid.record import Configuration
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot, Rod, Spring

MOTOR = Motor(1e-3, -80, viscous=2e-3)


def test_singular_posture_is_refused_and_named():
    """Wrist axes 4 and 6 in line, no mass between them: their turns cannot be distinguished. Bent, the robot stands."""
    elastic = [Joint(name, axis, Spring(1e4), MOTOR) for name, axis in (("4", "z"), ("5", "y"), ("6", "z"))]
    wrist = Robot(
        "wrist",
        (
            Body("b4", joints=(elastic[0],)),
            Body("b5", "b4", joints=(elastic[1],)),
            Body("hand", "b5", joints=(elastic[2],), mass=5, inertia=(0.1, 0.1, 0.05)),
        ),
    )
    model = serial(wrist)
    with refused("robot/no-equilibrium", place="configuration straight"):
        equilibrium(model, model.theta, Configuration("straight", [0.3, 0.0, 0.2]))
    bent = equilibrium(model, model.theta, Configuration("bent", [0.3, 0.8, 0.2]))
    np.testing.assert_allclose(bent.q[:3], [0.3, 0.8, 0.2], atol=1e-9)


@pytest.mark.parametrize(
    ("variant", "rows", "springs"),
    [
        ("exact", 0, {"k_2", "k_3", "k_b2", "k_rod"}),
        ("bending_outside", 0, {"k_2", "k_3", "k_b2", "k_rod"}),
        ("lumped_rod", 0, {"k_2", "k_3", "k_b2", "k_rod"}),
        ("rigid_loop", 2, {"k_2", "k_3", "k_b2"}),
        ("series_stiffness", 2, {"k_2", "k_3", "k_b2", "k_rod"}),
        ("constant_stiffness", 2, {"k_2", "k_3", "k_b2", "k_rod"}),
    ],
)
def test_elastic_rod_is_cut_or_closes_loop(variant: Variant, rows: int, springs: set[str]) -> None:
    """A loop and an elastic joint in it: two rows where nothing gives in the loop, none where its rod is cut."""
    model = formulate(linkage(bends=True), ModelSpec("minimal", variant))
    assert (model.n_c, set(model.springs)) == (rows, springs)


def test_default_formulation_is_serial_or_constrained() -> None:
    """An elastic rod has a coordinate of its own in the constrained one; a rigid one is a row in both."""
    assert (formulate(template_arm()).n_c, formulate(template_arm()).independent) == (0, None)
    elastic, rigid = linkage(), linkage(Rod(LOWER, 6.2))
    assert (formulate(elastic).n_c, formulate(elastic).coordinates[-1]) == (1, "rod rod")
    assert "rod rod" not in formulate(rigid).coordinates
    for spec, independent in ((ModelSpec("constrained"), None), (ModelSpec("minimal"), ())):
        model = formulate(rigid, spec)
        assert (model.n_c, model.independent) == (1, independent)
    with refused("model/variant", place="model.formulation"):
        formulate(rigid, ModelSpec("serial"))
    with refused("model/variant", place="model.independent"):
        formulate(rigid, ModelSpec("minimal", independent=("joint 2", "joint nope")))


POSTURES = [(0.0, 0.0), (0.2, -0.4), (-0.3, 0.5)]


def of_variant(variant: Variant, robot: Robot | None = None) -> ElasticModel:
    return formulate(linkage() if robot is None else robot, ModelSpec("minimal", variant))


def of_lever(model: ElasticModel, angles: tuple[float, float]) -> tuple[float, float]:
    """Stiffness and damping that hold the motor of the lever, which nothing else holds but its own friction."""
    q, i = rigid_posture(model, Configuration("c", angles)), model.index("motor 3")
    K = model.stiffness(q, np.zeros(model.constraint.size1_out(0)), model.theta)
    return float(K[i, i]), float(model.damping(q, model.theta)[i, i])


@pytest.mark.parametrize("angles", POSTURES)
def test_gear_and_rod_are_springs_in_series(angles: tuple[float, float]) -> None:
    """In a parallelogram y = l cos(q_3 - q_2); a constant one has that of the start; a rigid loop the gear alone."""
    k, d, k_r, d_r = 5e5, 250.0, 1e7, 4000.0
    stiff, own_damping = of_lever(of_variant("rigid_loop"), angles)
    assert stiff == pytest.approx(k)
    for variant, angle in (("series_stiffness", angles[1] - angles[0]), ("constant_stiffness", 0.0)):
        y = LEVER * np.cos(angle)
        K, D = of_lever(of_variant(variant), angles)
        k_eff = 1 / (1 / k + 1 / (k_r * y**2))
        assert pytest.approx(k_eff, rel=1e-9) == K
        d_eff = k_eff**2 * (d / k**2 + d_r * y**2 / (k_r * y**2) ** 2)
        assert pytest.approx(d_eff, rel=1e-6) == D - own_damping + d


def test_end_masses_equal_lumped_rod() -> None:
    """I = a (1 - a) m L^2; any other inertia is moved to the ends."""
    m, a = 6.2, 0.52
    at_ends, evenly = (Rod(LOWER, m, a, inertia) for inertia in (a * (1 - a) * m * LOWER**2, 0.3))
    q = rigid_posture(of_variant("exact", linkage(at_ends)), Configuration("c", (0.2, -0.4)))
    M, M_lumped, M_even, M_moved = (
        model.mass(q, model.theta).full()
        for rod in (at_ends, evenly)
        for model in (of_variant("exact", linkage(rod)), of_variant("lumped_rod", linkage(rod)))
    )
    np.testing.assert_allclose(M_lumped, M, atol=1e-12 * M.max())
    np.testing.assert_allclose(M_moved, M, atol=1e-12 * M.max())
    assert np.abs(M_even - M).max() > 1e-3


def test_omitted_terms_leave_parameters_without_effect() -> None:
    """Rods and elastic joints in stiff loops; of a stiffness that is the gear's the rod's; inertia of lumped rods."""
    robot = linkage(bends=True)
    assert inert_parameters(robot, "exact") == inert_parameters(robot, "bending_outside") == ()
    assert inert_parameters(robot, "lumped_rod") == ("I_rod",)
    bending = ("k_b2", "d_b2", "f_b2")
    assert inert_parameters(robot, "series_stiffness") == bending
    assert (
        inert_parameters(robot, "constant_stiffness")
        == inert_parameters(robot, "rigid_loop")
        == (*bending, "k_rod", "d_rod")
    )
    assert inert_parameters(linkage(Rod(LOWER, 6.2, 0.52, 0.64), bends=True), "constant_stiffness") == bending


def test_a_rod_that_no_elastic_gear_drives_cannot_be_condensed() -> None:
    """The lever's gear is rigid: the message names the rod, and the way out."""
    robot = linkage()
    rigid = Joint("3", "y", motor=Motor(2e-3, 100))
    bodies = tuple(replace(body, joints=(rigid,)) if body.name == "crank" else body for body in robot.bodies)
    with refused("model/variant", place="model.variant"):
        of_variant("series_stiffness", replace(robot, bodies=bodies))


MOTOR_ELASTIC = Motor(1e-3, 80)


def arm() -> Robot:
    """An elastically geared joint, a rigidly geared one and a free one about y; a frame 0.5 m up the last body."""
    bodies = (
        Body(
            "a",
            joints=(Joint("1", "y", Spring(5e4, 40), MOTOR_ELASTIC),),
            mass=20,
            center_of_mass=(0, 0, 0.3),
            inertia=1.0,
        ),
        Body("b", "a", Placement((0, 0, 0.6)), (Joint("2", "y", motor=MOTOR_ELASTIC),), 9, (0, 0, 0.2), 0.3),
        Body("c", "b", Placement((0, 0, 0.4)), (Joint("3", "y"),), 3, (0, 0, 0.2), 0.1),
    )
    return Robot("arm", bodies, (0.0, 0.0, -9.81), frames=(Frame("tip", "c", Placement((0, 0, 0.5))),))


def test_locations_read_rates_and_accelerometers_read_gravity() -> None:
    """Upright: the tip moves by 1.5, 0.9 and 0.5 m along x per rad; tilted it sees g of gravity along -x per rad."""
    model = serial(arm())
    q, places = np.zeros(4), ("motor 1", "joint 3", "body c y", "frame tip x", "frame tip ry", "accelerometer tip x")
    C, T = (part.full() for part in model.readout(q, model.theta, places))
    expected = [[0, 0, 0, 1], [0, 0, 1, 0], [1, 1, 1, 0], [1.5, 0.9, 0.5, 0], [1, 1, 1, 0], [1.5, 0.9, 0.5, 0]]
    np.testing.assert_allclose(C, expected, atol=1e-12)
    np.testing.assert_allclose(T[:5], 0)
    np.testing.assert_allclose(T[5], [-9.81, -9.81, -9.81, 0])
    np.testing.assert_allclose(model.output_jacobian(q, places), C)


def test_locked_motors_leave_two_mass_model() -> None:
    """At two postures; the whole model with every coordinate struck out but those of motor 1 and joint 1."""
    robot = two_axes((0.0, 0.0))
    model = formulate(robot)
    omega = 2 * np.pi * np.geomspace(1, 50, 7)
    for angles in (np.array([0.0, 0.2]), np.array([0.4, -0.9])):
        joint = locked_joint(robot, "1", angles)
        assert joint is not None
        q = np.zeros(model.n_q)
        q[[model.index("joint 1"), model.index("joint 2")]] = angles
        kept = [model.index("motor 1"), model.index("joint 1")]
        M = np.asarray(model.mass(q, model.theta))[np.ix_(kept, kept)]
        K = np.array([[1.0, -1.0], [-1.0, 1.0]]) * 30e3
        D = np.array([[1.0, -1.0], [-1.0, 1.0]]) * 30.0
        Z = -(omega[:, None, None] ** 2) * M + K + 1j * omega[:, None, None] * D
        reaction = _Model((), joint, 0.0).reaction(np.zeros(len(OF_FILE)), omega)
        np.testing.assert_allclose(reaction, 1 / np.linalg.inv(Z)[:, 0, 0], rtol=1e-9)


@pytest.mark.parametrize("formulation", [None, "serial", "constrained"])
def test_variants_and_independent_coordinates_are_choices_of_the_minimal_formulation(formulation: str | None) -> None:
    for choice in ({"variant": "rigid_loop"}, {"independent": ("joint 2",)}):
        with pytest.raises(ValueError, match=f"{next(iter(choice))} is a choice of the minimal formulation"):
            ModelSpec(formulation, **choice)
        ModelSpec("minimal", **choice)


def test_unsuitable_keys_are_named_with_place() -> None:
    """Loops that a serial formulation leaves open; names that are no coordinates; others have their places."""
    robot = linkage()
    assert list(ModelSpec().refusals(robot)) == []
    ((key, words),) = ModelSpec("serial").refusals(robot)
    assert key == ("formulation",)
    assert "has loops (rod)" in words
    spec = ModelSpec("minimal", independent=("joint 2", "motor elbow", "motor 3", "rod rod"))
    assert [key for key, _ in spec.refusals(robot)] == [("independent", 1), ("independent", 3)]
