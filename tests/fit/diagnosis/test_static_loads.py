"""Static load tests against responses: faults of the tests are found and named, true ones are not."""

from dataclasses import replace

import numpy as np
import pytest
from plants.data_sheet_arm import arm, measure
from plants.loaded_arm import NAMED, load_tests
from plants.two_mass_gear import LINES, POSTURE, Gear, records, robot

from elastid.fit.identify import identify
from elastid.fit.load_tests import LoadTest
from elastid.fit.problem.static_loads import placed_tests
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec

SPEC = FitSpec(parameters={"k_*": ParameterSpec()}, starts=1)


def fitted(changed=lambda y, force: y, loaded=None):
    tests = load_tests(loaded or arm(), np.random.default_rng(5), changed=changed)
    return identify(measure(arm(), np.random.default_rng(6)), arm(), SPEC, loads=placed_tests(tests, NAMED))


def softer(factor):
    return arm().with_parameters({"k_2": factor * arm().parameters()["k_2"][0]})


CASES = {
    "factor": (lambda y, force: 1.2 * y, None, "all springs are softer at rest"),
    "friction": (lambda y, force: 0.8 * y, None, "all springs are stiffer at rest"),
    "stand": (lambda y, force: y - force / 1e6, None, "no single cause"),
    "spring": (lambda y, force: y, 0.7, "no single cause"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_fault_is_a_misfit(case):
    """Deflections of another stiffness, of all springs or of one, and of a gauge that stands on the base."""
    changed, factor, words = CASES[case]
    result = fitted(changed, None if factor is None else softer(factor))
    assert result.status == "misfit"
    assert words in result.static.cause
    assert [note for note in result.notes if note.code == "fit/loads"]


@pytest.mark.slow
def test_readings_that_no_robot_can_have_are_told_from_the_responses():
    """mm for m pull the springs so soft that the robot tips over; their factor is found beside the responses alone."""
    result = fitted(lambda y, force: 1e3 * y)
    assert result.status == "misfit"
    assert result.static.ratio == pytest.approx(1e3, rel=0.01)
    assert "the gauge are in another scale" in result.message


@pytest.mark.slow
def test_a_reading_in_a_wrong_unit_does_not_take_the_responses_with_it():
    """mm for m pulls both into a valley in which the responses alone would stay: they are searched from their start."""
    gear = Gear()
    link = replace(robot(gear).bodies[0], center_of_mass=(1.0, 0.0, 0.0), mass=1e-9)
    axis, spec = replace(robot(gear), bodies=(link,)), EstimatorSpec(friction="none", transient_periods=0)
    responses = [estimate(records(gear, seed=1, experiments=4), spec, LINES)]
    fit = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}, starts=3)
    test = LoadTest(configuration="rest", force=(0.0, 200.0, 0.0), along="y", deflection=1e3 * 200 / gear.k, std=5e-6)
    result = identify(responses, axis, fit, loads=placed_tests([test], {"rest": POSTURE}))
    assert result.status == "misfit", result.message
    assert "static load tests contradict the responses" in result.message
    assert result.values["k_1"] == pytest.approx(gear.k, rel=1e-3)


def test_the_ratio_and_wider_intervals():
    """A factor 1.2 is found as such; intervals that contain the pull of both hold the truth."""
    result = fitted(lambda y, force: 1.2 * y)
    assert abs(result.static.ratio - 1.2) < 4 * result.static.ratio_std + 1e-3
    assert result.static.ratio_std < 0.05
    for name in ("k_1", "k_2"):
        low, high = result.interval(name)
        assert low < arm().parameters()[name][0] < high


def test_true_tests_agree():
    """Ratio 1 within its error, no note."""
    result = fitted()
    assert result.status == "converged"
    assert abs(result.static.ratio - 1) < 3.5 * result.static.ratio_std
    assert not [note for note in result.notes if note.code == "fit/loads"]
