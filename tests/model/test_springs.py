"""Nonlinear springs: their laws, what gravity makes of them, and how the linear model follows."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.arm import resting

from elastid.linear.equilibrium import preloads
from elastid.linear.linearise import Linearisation, linearise
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Anchor, Body, Compensator, GasSpring, Joint, Motor, Placement, Robot, Spring

HORIZONTAL = Configuration("horizontal", (0.0,))


def beam(spring: Spring, weight: float) -> Robot:
    """A beam on a geared motor, held level: `weight` Nm about y at angle 0, upright at -pi / 2."""
    joint = Joint("1", "y", spring, Motor(1e-3, 100))
    body = Body("beam", joints=(joint,), mass=weight / 9.81, center_of_mass=(1.0, 0, 0), inertia=1.0)
    return Robot("beam", (body,))


def arm() -> Robot:
    """Every kind of spring in an arm that gravity loads, with a gas spring beside the first joint."""
    springs = (
        Spring(2e5, 60, quadratic=2e6, cubic=2e10),
        Spring(8e4, 30, symmetric_quadratic=3e7, cubic=1e10),
        Spring(5e4, 10, cubic=1e10),
        Spring(3e4, 10, backlash=1e-4, inner_stiffness=5e3),
    )
    upper = Body("a", "base", Placement(), (Joint("1", "y", springs[0], Motor(2e-3, -100, 1e-3)),), 60, (0.4, 0, 0.05))
    fore = (Joint("2", "y", springs[1], Motor(1e-3, 90)), Joint("2x", "x", springs[2]))
    wrist = (Joint("3", "x", springs[3], Motor(2e-4, 60)),)
    gas = GasSpring(force=800, length=0.5, column=0.8, kappa=1.2)
    return Robot(
        "arm",
        (
            replace(upper, inertia=(1.0, 4.0, 4.0)),
            Body("b", "a", Placement((0.8, 0, 0)), fore, 30, (0.35, 0.1, 0.1), (0.5, 2, 2)),
            Body("c", "b", Placement((0.6, 0, 0)), wrist, 8, (0.1, 0.1, 0.05), 0.1),
        ),
        compensators=(Compensator("g", (Anchor("base", (-0.2, 0, 0.3)), Anchor("a", (0.3, 0, 0.1))), gas=gas),),
    )


def torque_of(spring: Spring, x: np.ndarray) -> np.ndarray:
    """The law tau(Delta) as the model has it, read off a weightless beam whose motor is turned by Delta."""
    model = serial(replace(beam(spring, 10.0), gravity=(0.0, 0.0, 0.0)))
    q = np.vstack([np.zeros_like(x), x])
    return model.potential_gradient.map(len(x))(q, model.theta).full()[1]


def at_rest(model: ElasticModel, angle: float) -> tuple[float, float]:
    """Deflection and tangent stiffness of the only spring."""
    point = resting(model, angle)
    _, deflection, tangent = preloads(model, model.theta, [point])
    return float(deflection[0, 0]), float(tangent[0, 0])


X = np.linspace(-3e-3, 3e-3, 61)


def test_backlash_is_the_smooth_dead_zone() -> None:
    """tau = k/2 [2 D + sqrt((D-b)^2 + e^2) - sqrt((D+b)^2 + e^2)]; e -> 0 gives the dead zone, at the rate of e."""
    k, b = 1e6, 1e-3
    dead_zone = k * np.sign(X) * np.maximum(np.abs(X) - b, 0)
    errors = []
    for part in (0.1, 0.05, 0.025):
        e = part * b
        found = torque_of(Spring(k, backlash=b, rounding=part), X)
        expected = k / 2 * (2 * X + np.sqrt((X - b) ** 2 + e**2) - np.sqrt((X + b) ** 2 + e**2))
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
        errors.append(np.abs(found - dead_zone).max())
    assert errors[0] == pytest.approx(k * 1e-4 / 2, rel=0.05)
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 2.0, rtol=0.05)


def test_the_torque_of_a_spring_is_its_polynomial():
    """k D + k2 D^2 + k3 D^3, and k D + k2s |D| D."""
    softer_one_way = torque_of(Spring(2e5, quadratic=2e6, cubic=2e10), X)
    np.testing.assert_allclose(softer_one_way, 2e5 * X + 2e6 * X**2 + 2e10 * X**3, atol=1e-9)
    stiffer_both_ways = torque_of(Spring(8e4, symmetric_quadratic=3e7), X)
    np.testing.assert_allclose(stiffer_both_ways, 8e4 * X + 3e7 * np.abs(X) * X, atol=1e-9)


@pytest.mark.slow
@given(st.lists(st.floats(-2e-3, 2e-3), min_size=7, max_size=7))
@settings(deadline=None, max_examples=25)
def test_torques_and_stiffness_are_derivatives_of_one_potential(numbers: list[float]) -> None:
    """f at rest is dV/dq, K its Jacobian, by central differences about any deflection, in gaps and at their edges."""
    model = serial(arm())
    q = np.array(numbers)
    f = model.force(q, np.zeros(model.n_q), model.theta).full()[:, 0]
    np.testing.assert_allclose(f, model.potential_gradient(q, model.theta).full()[:, 0], rtol=1e-9, atol=1e-7)
    h = 1e-7
    shifted = [
        [model.force(q + side * h * unit, np.zeros(model.n_q), model.theta).full()[:, 0] for side in (1, -1)]
        for unit in np.eye(model.n_q)
    ]
    differences = np.column_stack([(up - down) / (2 * h) for up, down in shifted])
    K = model.stiffness(q, [], model.theta).full()
    np.testing.assert_allclose(K, differences, atol=2e-4 * np.abs(K).max())


@pytest.mark.parametrize(("weight", "factor"), [(1000.0, 1.62), (3000.0, 3.45)])
def test_the_response_sees_the_tangent_at_the_gravity_preload(weight: float, factor: float) -> None:
    """a0 = 1e6, a2 = 3e11: the tangent is 1.62 times a0 under 1 kNm and 3.45 times under 3 kNm."""
    model = serial(beam(Spring(1e6, cubic=3e11), weight))
    deflection, tangent = at_rest(model, 0.0)
    assert tangent / 1e6 == pytest.approx(factor, abs=0.005)
    assert tangent == pytest.approx(1e6 + 9e11 * deflection**2, rel=1e-12)
    linear = linearise(model, HORIZONTAL, model.theta, ("motor 1",), "acceleration")
    assert linear.K[1, 1] == pytest.approx(tangent, rel=1e-12)


def test_gravity_hides_the_backlash() -> None:
    """Under a preload beyond b the tangent is that without gap, but for (e / D)^2; inside the gap nearly nothing."""
    k, b = 1e6, 2e-4
    model = serial(beam(Spring(k, backlash=b, rounding=0.01), 1000.0))
    deflection, tangent = at_rest(model, 0.0)
    assert abs(deflection) == pytest.approx(b + 1e-3, rel=1e-3)
    assert tangent == pytest.approx(k, rel=1e-5)
    hanging, free = at_rest(model, math.pi / 2)
    assert abs(hanging) < 1e-9
    assert free < 1e-4 * k


@given(
    rounding=st.floats(-8, 0).map(lambda power: 10**power),
    b=st.floats(-5, -2).map(lambda power: 10**power),
    angle=st.floats(-3.1, 3.1),
)
@settings(deadline=None, max_examples=40)
def test_statics_converge_across_any_gap(rounding: float, b: float, angle: float) -> None:
    """From the middle of a gap without stiffness to a flank, whatever the width, the edge and the direction."""
    model = serial(beam(Spring(1e6, backlash=b, rounding=rounding), 500.0))
    point = resting(model, angle)
    assert abs(point.q[1] - point.q[0]) < 2.1 * b + 1e-3
    assert abs(model.potential_gradient(point.q, model.theta).full()[:, 0][0]) < 1e-4
    assert point.u[0] == pytest.approx(-500 * math.cos(point.q[0]), abs=1e-3)


def test_slopes_follow_the_operating_point() -> None:
    """dG / dtheta of every parameter equals differences through the whole statics and linearisation, to 1e-6."""
    model = serial(arm())
    linearisation, outputs = Linearisation.of(model), ("motor 1", "motor 2", "joint 2x", "motor 3")
    configuration, freq_hz = Configuration("c", (0.3, -0.7, 0.4)), np.linspace(1, 60, 30)

    def response(theta: np.ndarray) -> np.ndarray:
        linear = linearisation.at(configuration, theta, outputs, "acceleration")
        return frequency_response(linear, linear.theta_ref, freq_hz)

    linear = linearisation.at(configuration, model.theta, outputs, "acceleration")
    G, dG = Columns(Kernel(linear, freq_hz, model.parameters)).evaluate(linear.theta_ref)
    assert linearisation.follows
    for i, name in enumerate(model.parameters):
        if np.abs(dG[i]).max() == 0:
            continue
        h = 1e-3 * (model.theta[i] or 0.01) * np.eye(len(model.theta))[i]
        near, far = (response(model.theta + s * h) - response(model.theta - s * h) for s in (1, 2))
        difference = (8 * near - far) / (12 * h[i])
        rounding = 1e-11 * np.abs(G).max() / abs(h[i])
        assert np.abs(dG[i] - difference).max() < 1e-6 * np.abs(difference).max() + rounding, name


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"cubic": -1.0}, "at a positive deflection of"),
        ({"quadratic": 1e9, "cubic": 1e11}, "at a negative deflection of 0.0005"),
        ({"symmetric_quadratic": -1e9}, "at a positive deflection of 0.0005"),
        ({"backlash": 1e-4, "quadratic": 1e6}, "inside the backlash"),
        ({"backlash": 0.0}, "^backlash: "),
        ({"inner_stiffness": 10.0}, "^inner_stiffness, .* backlash"),
        ({"backlash": 1e-4, "inner_stiffness": -1.0}, "^inner_stiffness: "),
        ({"backlash": 1e-4, "rounding": 0.0}, "^rounding: "),
    ],
)
def test_springs_that_pull_are_refused(fields: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Spring(1e6, **fields)
