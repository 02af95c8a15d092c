"""Movements under a multisine: sines, square waves and constant velocities with their ramps."""

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.limited_arm import CARRIERS, EXCITATION, arm, experiment
from plants.refusals import refused
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, freqs

from elastid.base.arrays import FloatArray
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.plan.reference_trajectory import (
    Movement,
    check_movement,
    derivatives,
    max_excursion,
    movement,
    reference,
)
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.record import Configuration


@given(
    kind=st.sampled_from(["sine", "square", "offset"]),
    ramp=st.sampled_from([0.0, 0.25, 0.6]),
    hold=st.sampled_from([0.0, 0.1]),
    cycles=st.integers(1, 2),
)
@settings(deadline=None, max_examples=24)
def test_movement_is_integral_of_velocity_and_periodic(kind: Any, ramp: float, hold: float, cycles: int) -> None:
    """Position, velocity, acceleration agree; ends at rest; every period's velocity is the last one's."""
    size = {"amplitude": 0.02} if kind == "sine" else {"velocity": (0.05, -0.1)}
    excitation = replace(EXCITATION, torque_rms=1.0, period=2.0, band_hz=(5.0, 60.0))
    plan = make_plan(excitation, experiment(ramp=ramp, hold=hold), arm(), 0)
    carrier = CarrierSpec(cycles=cycles, kind=kind, **size)
    path = movement(carrier, plan)
    share = np.abs(path.position).max(axis=0) / max_excursion(carrier, 2, 2.0, 2.0 + 2 * 2.0 / 2 + ramp / 2)
    assert np.all(share < 1.001)
    assert np.all(share > (0.2 if kind == "square" else 0.98))
    first = 0 if ramp else plan.first_sample + 1
    moving = slice(first, plan.run_samples - first)
    for x, dx in ((path.position, path.velocity), (path.velocity, path.acceleration)):
        integral = cumulative_trapezoid(dx[moving], dx=1 / plan.rate_hz, axis=0, initial=0)
        np.testing.assert_allclose(x[moving] - x[first], integral, atol=1e-3 * np.abs(x).max())
    N = plan.period_samples
    periods = path.velocity[plan.first_sample :][: 3 * N].reshape(3, N, 2)
    np.testing.assert_allclose(periods - periods[0], 0, atol=1e-12)
    if hold and ramp:
        np.testing.assert_array_equal(path.velocity[: plan.hold_samples], 0)
        np.testing.assert_array_equal(path.velocity[-plan.hold_samples + 1 :], 0)
    assert np.all(path.scale[plan.first_sample :][: 3 * N] == 1)


def test_derivatives_of_a_sampled_motion_are_of_sixth_order() -> None:
    """Within the run; x'' + omega^2 x = 0 of a sine of ten samples a radian to 1e-7 of its size."""
    omega, rate_hz = 2 * np.pi * 8, 500.0
    phase = omega * np.arange(400) / rate_hz
    x = np.stack([np.sin(phase), np.cos(phase)], axis=1)
    first, second = derivatives(x, rate_hz)
    np.testing.assert_allclose((second / omega**2 + x)[3:-3], 0, atol=1e-7)
    np.testing.assert_allclose((first / omega - x[:, ::-1] * (1, -1))[3:-3], 0, atol=1e-6)


@pytest.mark.parametrize(
    "carrier",
    [
        None,
        CarrierSpec(cycles=3, kind="sine", amplitude=0.02),
        CarrierSpec(cycles=2, kind="square", velocity=(0.05, -0.1)),
        CarrierSpec(kind="offset", velocity=(0.05, -0.1)),
    ],
    ids=lambda carrier: "rest" if carrier is None else carrier.kind,
)
def test_feedforward_torque_equals_movement_at_every_sample(carrier: CarrierSpec | None) -> None:
    """Though it is worked out once for all samples at rest, and for one cycle of a carrier."""
    plan = make_plan(replace(EXCITATION, torque_rms=1.0, band_hz=(5.0, 60.0)), experiment(ramp=0.25), arm(), 0)

    def torque(_: Configuration, path: Movement) -> FloatArray:
        return 3 * path.position + 0.2 * path.velocity**2 + 0.01 * path.acceleration

    expected = torque(plan.configurations[0], movement(carrier, plan))
    found = reference(plan, carrier, torque, plan.configurations[0]).feed_forward
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_filtered_square_wave_leaves_analysed_lines_free() -> None:
    """The ideal wave behind a Butterworth filter of second order without its phase, as scipy has it."""
    excitation = replace(EXCITATION, torque_rms=1.0, period=10.0, band_hz=(0.9, 60.0), grid="odd-random")
    plan = make_plan(excitation, experiment(), arm(), 0)
    velocity = movement(CarrierSpec(kind="square", velocity=0.1, cycles=2), plan).velocity[plan.first_sample :]
    analysed = np.concatenate([plan.lines, plan.detection])
    assert len(plan.detection) > 50
    n = plan.period_samples
    phase = np.arange(n) % (n // 2)
    spectrum = np.fft.rfft(np.sign(n // 4 - phase) * (phase > 0))
    b, a = butter(2, 2 * np.pi, analog=True)
    spectrum *= np.abs(freqs(b, a, 2 * np.pi * np.arange(len(spectrum)) / 10.0)[1])
    spectrum[analysed] = 0.0
    np.testing.assert_allclose(velocity[:n, 0], 0.1 * np.fft.irfft(spectrum, n), atol=2e-4)
    assert np.abs(np.fft.rfft(velocity[:n, 0]))[analysed].max() < 1e-12 * n


@pytest.mark.parametrize("carrier", CARRIERS[1:], ids=lambda carrier: carrier.kind)
def test_a_carrier_that_leaves_a_joints_limits_is_refused(carrier: CarrierSpec) -> None:
    """To either side, in the ramps of a constant velocity too."""
    plan = make_plan(replace(EXCITATION, torque_rms=1.0), experiment(), arm(), 0)
    path = movement(carrier, plan).position[:, 0]
    for limit, end in ((-1.5, path.min()), (1.5, path.max())):
        for inside, verdict in ((1e-6, nullcontext()), (-1e-6, refused("experiment/simulated", place="carrier"))):
            posture = Configuration("a", np.array([limit * (1 - inside) - end, 0.0]))
            with verdict:
                check_movement(carrier, replace(plan, configurations=(posture,)), arm())


def test_carrier_on_other_motors_or_excited_lines_is_refused() -> None:
    plan = make_plan(replace(EXCITATION, torque_rms=1.0), experiment(), arm(), 0)
    check_movement(CarrierSpec(0.01, cycles=int(plan.lines[0]) - 1), plan, arm())
    for wrong in (CarrierSpec(0.01, cycles=int(plan.lines[0])), CarrierSpec((0.1, 0.1, 0.1))):
        with refused("experiment/simulated", place="experiment.simulated.carrier"):
            check_movement(wrong, plan, arm())
