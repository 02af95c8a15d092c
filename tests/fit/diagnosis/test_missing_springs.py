"""A spring that the robot's file lacks is found by its resonance, however little V shows of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.elastic_arm import CONFIGURATIONS, FREQ, arm
from plants.faults import SPEC, Case, drawn, faulty, true_case

from elastid.fit.diagnosis.missing_springs import released
from elastid.fit.identify import fit_parameters
from elastid.fit.result import Result
from elastid.fit.spec import WeightSpec
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration


def fitted(case: Case, noise: float, floor: float = 0.0) -> Result:
    return fit_parameters(
        drawn(case, np.random.default_rng(0), noise), case.robot, replace(SPEC, weights=WeightSpec(floor=floor))
    )


@pytest.mark.parametrize(("noise", "floor"), [(0.02, 0.045), (0.05, 0.0), (0.05, 0.045)])
def test_a_missing_torsion_is_named_where_v_does_not_show_it(noise: float, floor: float) -> None:
    """V is 1.13 to 1.36 of its expectation, a stiffness ten of its deviations off; the spring is right to 5 %."""
    case = faulty("missing torsion")
    result = fitted(case, noise, floor)
    true, std = case.stiffness, result.std
    assert (
        max(abs(np.log(result.values[name] / k)) / (std[name] / result.values[name]) for name, k in true.items()) > 10
    )
    assert result.status == "misfit"
    assert "an elastic rotation of body fore about its z axis" in result.message
    first = result.indices[0]
    assert first.name == "torsion_fore_z"
    assert 1 / first.steps[0] == pytest.approx(case.truth.parameters()["k_2z"][0], rel=0.05)


def test_its_effects_on_stiffnesses_are_what_the_fit_with_the_spring_finds() -> None:
    """To a deviation, of ten that one is off, although the spring has the damping of the others, 1.4 times its own."""
    case = faulty("missing torsion")
    without, rightly = fitted(case, 0.005), fitted(true_case(), 0.005)
    found = without.x + without.indices[0].effects
    std = np.sqrt(np.diag(rightly.covariance))
    i, j = ([one.parameters.free_names.index(name) for name in case.stiffness] for one in (without, rightly))
    assert np.all(np.abs(found[i] - rightly.x[j]) < std[j])
    assert np.any(np.abs(without.x[i] - rightly.x[j]) > 10 * std[j])


def test_a_softer_spring_needs_no_further_solution() -> None:
    """A spring of the arm from 1e10 N m/rad to three other values: G and dG / d ln k equal those of a new solution."""
    robot = arm().with_parameters({"k_2z": 1e10, "d_2z": 0.0})
    model, configuration, loss = serial(robot), Configuration("c", CONFIGURATIONS[1]), 1e-3
    linear = linearise(model, configuration, model.theta, robot.motor_locations, "acceleration")

    def solved(k: float) -> np.ndarray:
        theta = linear.theta_ref.copy()
        theta[linear.parameters.index("k_2z")], theta[linear.parameters.index("d_2z")] = k, loss * k
        return to_response(linear, theta, FREQ).G

    stiff = to_response(linear, linear.theta_ref, FREQ).G
    stiffnesses = np.array([2e4, 1e5, 1e6])
    for k, (change, slope) in zip(stiffnesses, released(linear, FREQ, "k_2z", stiffnesses, loss), strict=True):
        np.testing.assert_allclose(stiff + change, solved(k), rtol=1e-6)
        central = (solved(k * np.exp(1e-4)) - solved(k * np.exp(-1e-4))) / 2e-4
        np.testing.assert_allclose(slope, central, atol=1e-5 * np.abs(central).max())
