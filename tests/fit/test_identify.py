"""From frequency responses of a robot in several configurations to its elastic parameters."""

from dataclasses import replace

import numpy as np
import pytest
from plants.elastic_arm import arm, measure, pendulum, started_elsewhere
from plants.measured_robots import deviations
from plants.paths import ROBOTS
from plants.refusals import refused

from elastid.base.errors import Note
from elastid.fit.covariance import compensation_error
from elastid.fit.frf_problem import Assembly
from elastid.fit.identify import fit_parameters, identify
from elastid.fit.parameter_selection import choose
from elastid.fit.result import Result
from elastid.fit.solve.solvers import solve
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.fit.status_terms import DISTORTED
from elastid.parameters import Tie
from elastid.response import SYSTEMATIC_ERRORS, UNEXPLAINED, Covariance, Response
from elastid.robot import Body, Joint, Motor, Robot
from elastid.study import load_robot


@pytest.fixture(scope="module")
def noisy() -> list[Response]:
    return measure(arm(), rng=np.random.default_rng(2))


@pytest.fixture(scope="module")
def identified(noisy) -> Result:
    return identify(noisy, started_elsewhere(arm(), 2.0), FitSpec(starts=6, seed=1))


def test_elastic_parameters_are_recovered_from_a_factor_two_off(identified):
    """Four springs with their dampers and two motor frictions, three configurations under gravity, 2 % noise."""
    truth = arm().parameters()
    assert identified.status == "converged"
    assert identified.parameters.free_names == (
        *("k_1", "d_1", "fm_1", "k_1x", "d_1x"),
        *("k_2", "d_2", "fm_2", "k_2z", "d_2z"),
    )
    assert deviations(identified, arm()).max() < 3.5
    for name in ("k_1", "k_2", "k_1x", "k_2z"):
        assert identified.values[name] == pytest.approx(truth[name][0], rel=0.03)
    assert identified["k_1"].value == identified["k_?"]["k_1"].value == identified.values["k_1"]
    assert identified.n_converged_starts >= 2
    assert identified.inflation_factor < 1.05


def test_damping_beside_distortion_that_no_motor_explains_is_not_believed(noisy):
    """A gear's hysteresis takes energy as damping does: the responses say that there is distortion, the fit what of."""
    distorted = [replace(G, notes=(*G.notes, Note(UNEXPLAINED, "distortion is left"))) for G in noisy]
    result = identify(distorted, arm(), FitSpec(starts=1))
    verdicts = dict(zip(result.parameters.free_names, result.verdicts, strict=True))
    assert {name for name, verdict in verdicts.items() if verdict == DISTORTED} == {"d_1", "d_1x", "d_2", "d_2z"}


def test_model_error_without_study_value_follows_residuals(identified):
    """None for noise alone, 0.4 % for errors of that size, and at most 1 %."""
    assert identified.model_error == 0
    rng, exact = np.random.default_rng(3), measure(arm())
    spec = FitSpec(starts=1, profile=(), parameters={"k_1": ParameterSpec(), "k_2": ParameterSpec()})

    def floor_of_error(error: float) -> float:
        wrong = (1 + error * rng.standard_normal(each.G.shape) for each in exact)
        known = [Covariance((1e-3 * np.abs(each.G)) ** 2 + 1e-30, np.inf) for each in exact]
        data = [replace(G, G=G.G * w, noise=C) for G, w, C in zip(exact, wrong, known, strict=True)]
        return fit_parameters(data, arm(), spec).model_error

    assert 0.003 < floor_of_error(0.004) < 0.005
    assert floor_of_error(0.05) == 0.01


def test_the_operating_point_follows_the_stiffness():
    """A soft arm sags: linearised at a start 30 % off the stiffness comes out wrong, settled it is exact."""
    soft = arm(1e4, 4e3)
    start = soft.with_parameters({"k_1": 1e4 * 1.3, "k_2": 4e3 * 0.77})
    spec = FitSpec(parameters={"k_1": ParameterSpec(), "k_2": ParameterSpec()}, starts=1)
    responses = measure(soft)
    parameters = choose(spec, start)
    frozen = solve(Assembly.of(responses, start, spec, parameters).at(parameters.x, "complex").problem, parameters.x)
    assert np.abs(np.exp(frozen.x) / [1e4, 4e3] - 1).max() > 1e-3
    settled = identify(responses, start, spec)
    np.testing.assert_allclose([settled.values["k_1"], settled.values["k_2"]], [1e4, 4e3], rtol=1e-5)
    assert settled.status == "converged"


def test_inertia_friction_and_delay_of_a_bench_are_recovered():
    """Two inertias, a shaft, the friction of both and the delay, from motor and load motion; a tie keeps its ratio."""
    robot = pendulum()
    (response,) = measure(robot, [(0.0,)], np.random.default_rng(5), 2e-4, ("motor 1", "joint 1"))
    free = {name: ParameterSpec() for name in ("Jm_1", "I_load", "k_1", "d_1", "fm_1", "delay")}
    spec = FitSpec(parameters=free | {"f_1": ParameterSpec(tie=Tie("fm_1"))}, starts=8)
    result = identify([response], started_elsewhere(robot, 2.0), replace(spec, seed=3))
    low, high = result.interval("delay")
    assert low < 2e-4 < high
    assert high - low < 1e-4
    assert result.values["f_1"] == result.values["fm_1"]
    names = ("Jm_1", "I_load", "k_1")
    np.testing.assert_allclose([result.values[n] for n in names], [1e-3, 2e-3, 100], rtol=0.02)


def test_what_only_a_sum_determines_is_ill_conditioned():
    """Friction of a motor and of the joint that it drives rigidly have infinite intervals, the inertia its own."""
    joint = Joint("1", motor=Motor(1e-3, viscous=1e-3), viscous=2e-3)
    rigid = Robot("rigid", (Body("load", joints=(joint,), inertia=2e-3),), gravity=(0.0, 0.0, 0.0))
    free = {name: ParameterSpec() for name in ("fm_1", "f_1", "I_load")}
    result = identify(measure(rigid, [(0.0,)]), rigid, FitSpec(parameters=free, starts=2))
    assert result.status == "ill_conditioned"
    assert np.isinf([result.std["f_1"], result.std["fm_1"]]).all()
    assert result.std["I_load"] < 1e-4
    assert result.singular_values[-1] < 1e-8 * result.singular_values[0]


def test_masks_that_leave_nothing_or_name_nothing_are_refused():
    """No line in the band; one line for three parameters."""
    (response,) = measure(pendulum(), [(0.0,)])
    with refused("fit/not-identifiable"):
        identify([response], pendulum(), FitSpec(band_hz=(2.5, 3.5)))
    with refused("fit/not-identifiable", place="nothing is left to fit"):
        identify([response], pendulum(), FitSpec(band_hz=(200.0, 300.0)))


def test_without_a_measured_variance_the_residuals_set_the_intervals():
    """0.14 % of noise that was not measured: intervals near those of the known noise, far below the floor of 1 %."""
    (response,) = measure(pendulum(), [(0.0,)])
    rng = np.random.default_rng(4)
    unit = rng.standard_normal(response.G.shape) + 1j * rng.standard_normal(response.G.shape)
    bare = replace(response, G=response.G + 1e-3 * np.abs(response.G) * unit, noise=None)
    spec = FitSpec(parameters={"k_1": ParameterSpec(), "d_1": ParameterSpec()}, starts=2)
    result = identify([bare], pendulum(), spec)
    known = replace(bare, noise=Covariance(2e-6 * np.abs(response.G) ** 2, np.inf))
    reference = identify([known], pendulum(), replace(spec, weights=WeightSpec(model_error=0.0)))
    assert 0.8 < result.std["k_1"] / reference.std["k_1"] < 3
    assert deviations(result, pendulum()).max() < 3
    assert (result.notes[0].code, result.notes[0].place) == ("fit/weights", "configuration c1")


def test_remaining_friction_after_compensation_is_in_intervals():
    """Responses whose systematic errors hold those of its levels, too: their variance besides, and the same numbers."""
    (response,) = measure(pendulum(), [(0.0,)], np.random.default_rng(1))
    none = np.zeros((SYSTEMATIC_ERRORS + 1, 1, *response.G.shape), complex)
    taken, left = (identify([replace(response, bias=b)], pendulum(), FitSpec(starts=1)) for b in (none, none[1:]))
    np.testing.assert_array_equal(taken.x, left.x)
    besides = taken.covariance - left.covariance
    np.testing.assert_allclose(besides, np.diag(compensation_error(taken.parameters) ** 2), atol=1e-15)


@pytest.mark.parametrize("factor", [2 * np.pi, 1 / (2 * np.pi)])
def test_frequencies_in_the_wrong_unit_are_suspected_from_the_stiffnesses(factor: float) -> None:
    """No residual shows it: the springs alone come out (2 pi)^2 too stiff, or too soft."""
    (response,) = measure(pendulum(), [(0.0,)], np.random.default_rng(7), outputs=("motor 1", "joint 1"))
    response = replace(response, freq_hz=factor * response.freq_hz)
    result = identify([response], started_elsewhere(pendulum(), 1.5), FitSpec(starts=10, start_factor=60.0, seed=1))
    assert result.inflation_factor < 2
    assert (result.notes[0].code, result.notes[0].place) == ("fit/frequency-unit", "k_1")


@pytest.mark.slow
def test_six_axes_are_found_from_every_start_in_few_evaluations() -> None:
    """Twelve springs with their dampers and six frictions, starts a factor of 3 off, dampings and frictions of 9.

    Beside its iterations a start costs the evaluations with which its three solves begin.
    """
    robot = load_robot(ROBOTS / "kr300_twelve_springs.yml")
    rng = np.random.default_rng(0)
    responses = measure(robot, rng.uniform(-1.2, 1.2, (5, 6)).tolist(), rng)
    result = identify(responses, robot, FitSpec(starts=6, seed=1, profile=(), weights=WeightSpec(model_error=0.0)))
    assert len(result.x) == 30
    assert result.n_converged_starts == 6
    assert max(end.iterations + 3 for end in result.starts) <= 25
