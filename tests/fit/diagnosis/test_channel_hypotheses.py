"""Delays, holds and misread channels: named with their size; with the right `hold` a fit is exact."""

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from plants.elastic_arm import CONFIGURATIONS, FREQ, arm, started_elsewhere
from plants.marks import slow
from plants.measured_robots import deviation, responses_of

from elastid.fit.diagnosis.channel_hypotheses import quantity_errors
from elastid.fit.diagnosis.delay_hypotheses import as_delay
from elastid.fit.diagnosis.hypothesis import SCALE
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration, ZohTorque
from elastid.response import Covariance, Response
from elastid.robot import Body, Joint, Motor, Robot, Spring

RATE_HZ, N = 1000.0, 1000
LINES = np.arange(4, 121, 2)


def plant(stiffness: float = 100.0) -> Robot:
    """Resonance at 62 Hz, antiresonance at 36 Hz."""
    joint = Joint("1", "z", Spring(stiffness, 0.02), Motor(1e-3, viscous=2e-3))
    return Robot("plant", (Body("load", joints=(joint,), inertia=2e-3),), gravity=(0.0, 0.0, 0.0))


FREE = {name: ParameterSpec() for name in ("k_1", "d_1", "fm_1")}
SPEC = FitSpec(parameters=FREE, starts=2, start_factor=1.3, seed=1, weights=WeightSpec(model_error=0.0), profile=())


HELD = ZohTorque((RATE_HZ,), (True,))


def driven(freq_hz: np.ndarray, hold: ZohTorque | None, late: float = 0.0) -> Response:
    """The motor's exact response with the images of a torque that is held, with noise of 0.1 % in its covariance."""
    model = serial(plant())
    linear = Linearisation.of(model).at(Configuration("c1", [0.0]), model.theta, ("motor 1",), "acceleration")
    exact = to_response(replace(linear, hold=hold), np.append(model.theta, late), freq_hz)
    return replace(exact, noise=Covariance((1e-3 * np.abs(exact.G)) ** 2, np.inf))


@pytest.mark.parametrize("late", [0.0, 7e-4])
def test_large_images_equal_images_of_estimate(late: float) -> None:
    """Exact lines up to 0.45 of the rate at which the torque is held: the stiffness to 1e-5."""
    held = driven(np.arange(4.0, 450.0, 4.0), HELD, late)
    result = identify([held], plant(80.0), replace(SPEC, parameters=FREE | {"delay": ParameterSpec()}))
    assert result.values["k_1"] == pytest.approx(100.0, rel=1e-5)
    assert result.values["delay"] == pytest.approx(late, abs=1e-7)
    assert not result.indices


@pytest.mark.parametrize(("taken", "acts"), [(None, HELD), (HELD, None)])
def test_fit_with_wrong_hold_names_the_correct_hold(taken: ZohTorque | None, acts: ZohTorque | None) -> None:
    """By half a sample at 1 kHz, late or early."""
    freq_hz = LINES * RATE_HZ / N
    H = (np.sinc(freq_hz / RATE_HZ) * np.exp(-1j * np.pi * freq_hz / RATE_HZ))[:, None, None]
    late = float(acts is not None) - float(taken is not None)
    exact = driven(freq_hz, acts)
    result = identify([replace(exact, G=exact.G * H**late, hold=taken)], plant(80.0), SPEC)
    assert (result.indices[0].group, result.notes[0].code) == ("time", "fit/likely-cause")
    assert result.indices[0].steps[0] == pytest.approx(0.5e-3 * late, rel=0.1)


def test_quantities_and_delay_forms_equal_first_order() -> None:
    """Differentiated once more and once less is as before, twice is once again; a low pass is a delay."""
    at = SimpleNamespace(frf=SimpleNamespace(kernel=SimpleNamespace(freq_hz=LINES / 1.0)))
    once, twice, less, least = (partial(change.apply, at) for change in quantity_errors((), np.zeros(0)))
    values = np.ones((len(LINES), 1, 1), complex)
    np.testing.assert_allclose(less(once(values)), values)
    np.testing.assert_allclose(least(once(once(values))), least(twice(values)))
    assert [as_delay(name) for name in ("delay_1", "low_pass_1", "k_1")] == ["delay_1", "delay_1", "k_1"]


def test_channel_unit_is_named_by_factor_far_from_start() -> None:
    """Degrees for radians, from half the stiffness: 2 ln(1 + (ln 2 / 0.5)^2) of the odds, Cauchy's prior of ln k."""
    (response,) = responses_of(plant(), {"c1": (0.0,)}, np.random.default_rng(1), LINES[::2] * RATE_HZ / N)
    spec = FitSpec(parameters={"k_1": ParameterSpec(), "d_1": ParameterSpec()}, starts=1)
    result = identify([replace(response, G=response.G * 180 / math.pi)], plant(50.0), spec)
    first = result.indices[0]
    assert (result.status, first.group, first.place) == ("model_error", SCALE, 1)
    assert float(first.name.split()[-1]) == pytest.approx(math.pi / 180, rel=0.01)
    assert (result.x + first.effects)[0] == pytest.approx(math.log(100.0), abs=0.01)
    assert first.occam == pytest.approx(2 * math.log(1 + (math.log(2) / 0.5) ** 2), rel=0.02)


def test_noise_without_a_robot_in_it_has_no_cause() -> None:
    """A model that is far off such data is worse than none: what is merely less bad explains nothing."""
    robot, rng, shape = plant(80.0), np.random.default_rng(0), (150, 1, 1)
    G = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    noise = Covariance((0.02 * np.abs(G)) ** 2, math.inf)
    at = ("motor 1",)
    read = Response(np.linspace(1, 60, 150), G, at, at, "acceleration", Configuration("c", np.zeros(1)), noise=noise)
    free = {name: ParameterSpec() for name in robot.parameters() if name[:2] in ("k_", "d_", "fm", "Jm", "I_")}
    result = identify([read], robot, FitSpec(parameters=free, starts=8, seed=1, profile=()))
    assert result.status == "model_error"
    assert all(index.explained_fraction < 0.5 for index in result.indices)


@pytest.mark.parametrize("late", [slow(-4e-3), 12e-3])
def test_delay_of_several_periods_is_named_and_identified_from_zero(late: float) -> None:
    """The signed delay to 0.1 ms, from stiffnesses that are 25 % off; freed as advised, k to 1 % and 3 std."""
    true, rng = arm(), np.random.default_rng(3)
    robot = started_elsewhere(true, 1.25)
    measured = responses_of(true, CONFIGURATIONS, rng, FREQ, 0.01, delay=late)
    free = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
    named = identify(measured, robot, FitSpec(parameters=free, starts=1, seed=1, profile=()))
    first = named.indices[0]
    assert named.exceeds_noise
    assert (first.name, first.place) == ("delay", 1)
    assert first.steps[0] == pytest.approx(late, abs=1e-4)
    assert first.explained_fraction > 0.9
    freed = identify(measured, robot, FitSpec(parameters=free | {"delay": ParameterSpec()}, starts=1, profile=()))
    assert freed.status == "converged"
    assert freed.values["delay"] == pytest.approx(late, abs=2e-5)
    for name, value in true.parameters().items():
        if name.startswith("k_"):
            assert freed.values[name] == pytest.approx(value[0], rel=0.01)
            assert deviation(freed, name, value[0]) < 3
