"""Bias of a mean response by Coulomb friction: against the mean of many simulated records of a mass that rubs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from plants.marks import slow
from scipy.special import ive

from elastid.excitation.multisine import synthesise
from elastid.fit.problem.least_squares import as_real
from elastid.frf.distortion import (
    FIRST_ORDER_FRACTION,
    QUADRATURE_FRACTION,
    DetectionLines,
    fast_total_error,
    unit_impedance,
)
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Record

RATE, N, PERIODS = 1000.0, 1000, 3
LINES = np.arange(3, 61, 2)
J, VISCOUS, STIFFNESS = 2.0, 10.0, 300.0


@cache
def rubbing(coulomb: float, n: int, noise: float = 0.0) -> list[Record]:
    """n records of a mass on a spring, J v' + d v + k q + F tanh(v / v_s) = u, u a held multisine of RMS 10."""
    rng = np.random.default_rng(0)
    R = np.sqrt(2 / len(LINES)) * 10 * np.exp(2j * np.pi * rng.random((len(LINES), n)))
    u = synthesise(LINES, R, N)
    q, v, h = np.zeros(n), np.zeros(n), 1 / RATE
    positions = np.empty((PERIODS * N, n))

    def rate(q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
        return (torque - VISCOUS * v - STIFFNESS * q - coulomb * np.tanh(v / 1e-3)) / J

    for k in range(PERIODS * N):
        positions[k], torque = q, u[k % N]
        a_1 = rate(q, v, torque)
        a_2 = rate(q + h / 2 * v, v + h / 2 * a_1, torque)
        a_3 = rate(q + h / 2 * (v + h / 2 * a_1), v + h / 2 * a_2, torque)
        a_4 = rate(q + h * (v + h / 2 * a_2), v + h * a_3, torque)
        q, v = q + h * v + h**2 / 6 * (a_1 + a_2 + a_3), v + h / 6 * (a_1 + 2 * a_2 + 2 * a_3 + a_4)
    y = positions[N:] + noise * rng.standard_normal((2 * N, n))
    place, logged = ("motor 1",), np.tile(u, (2, 1))
    return [
        Record(f"r{m}", Configuration("c", [0.0]), m, 0, RATE, N, place, place, ("position",), logged[:, [m]],
               y[:, [m]], hold="zero-order")
        for m in range(n)
    ]  # fmt: skip


def impedance(G: np.ndarray) -> np.ndarray:
    """Torque per velocity (F,) of acceleration per torque (F,)."""
    return 2j * np.pi * LINES * RATE / N / G


@pytest.mark.parametrize("coulomb", [1.6, slow(3.0)])
def test_second_order_of_coulomb_friction_is_predicted(coulomb: float) -> None:
    """Friction of 0.16 and 0.3 rms torques adds, beside viscous friction, a reactance that grows with frequency.

    The mean of 600 records shows it, turned by 0.2 to 0.4 rad; six alone predict it, without knowing the friction, to a
    third, and leave at most 8 % of what friction adds; viscous friction alone leaves twice as much or more.
    """
    many = rubbing(coulomb, 600)
    mean = estimate(many, EstimatorSpec(), LINES).G[:, 0, 0]
    omega = 2 * np.pi * LINES * RATE / N
    added = impedance(mean) - (VISCOUS + 1j * (J * omega - STIFFNESS / omega))
    response = estimate(many[:6], EstimatorSpec(), LINES)
    predicted = impedance(response.G[:, 0, 0] + response.bias[0, 0, :, 0, 0]) - impedance(response.G[:, 0, 0])
    upper = LINES > 30
    assert added.imag[upper].mean() > 0.05 * added.real.mean()
    assert predicted.imag[upper].mean() == pytest.approx(added.imag[upper].mean(), rel=0.34)
    assert predicted.imag[upper].mean() > 2 * predicted.imag[LINES < 15].mean()
    viscous = impedance(response.G[:, 0, 0] + response.bias[-1, 0, :, 0, 0]) - impedance(response.G[:, 0, 0])
    low = LINES < 10
    assert viscous.real[low].mean() / FIRST_ORDER_FRACTION == pytest.approx(added.real[low].mean(), rel=0.15)
    # Beside viscous friction, of the second order and of it turned by a quarter, as factors of N(0, 1) leave free.
    second, turned = (-1j * omega * each[0, :, 0, 0] / response.G[:, 0, 0] ** 2 for each in response.bias[:2])
    rows = as_real(np.array([np.ones(len(LINES), complex), second, turned])).T
    wanted = as_real(added[None])[0]
    (viscous, size, turn), *_ = np.linalg.lstsq(rows, wanted)
    assert size == pytest.approx(1.0, abs=0.35)
    assert 0.5 < turn < 1.5
    assert 0.2 < turn * QUADRATURE_FRACTION / size < 0.4
    left = np.linalg.norm(wanted - rows @ [viscous, size, turn])
    alone = np.linalg.norm(wanted - rows[:, 0] * (rows[:, 0] @ wanted) / (rows[:, 0] @ rows[:, 0]))
    assert left < 0.08 * np.linalg.norm(wanted)
    assert left < 0.5 * alone


@pytest.mark.parametrize(("coulomb", "noise"), [(0.0, 1e-5), (0.02, 1e-4)])
def test_noise_alone_and_friction_far_below_it_have_no_bias(coulomb: float, noise: float) -> None:
    """The second order would be smaller still."""
    assert estimate(rubbing(coulomb, 6, noise=noise), EstimatorSpec(), LINES).bias is None


def test_friction_hidden_in_noise_has_bias_bound() -> None:
    """Distortion below the noise of each line stands out over all of them, and with it the size of the second order."""
    records, rng = rubbing(1.6, 12), np.random.default_rng(1)
    disturbed = [replace(one, u=one.u + 6 * rng.standard_normal(one.u.shape)) for one in records]
    clean, noisy = (estimate(each, EstimatorSpec(), LINES) for each in (records, disturbed))
    assert np.median(noisy.total.variance) < 2 * np.median(noisy.noise.variance)
    ratio = np.linalg.norm(noisy.bias[0]) / np.linalg.norm(clean.bias[0])
    assert ratio == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize("carrier", [0.0, 0.5, 3.0])
def test_density_at_zero_velocity_equals_sine_in_noise(carrier: float) -> None:
    """e^-x I_0(x) / sqrt(2 pi sigma^2), x = c^2 / 4 sigma^2, of a velocity of deviation sigma about a carrier c."""
    (record, *_), rng = rubbing(1.6, 6), np.random.default_rng(5)
    V = np.zeros((400, N // 2 + 1), complex)
    V[:, LINES] = N / 2 * np.sqrt(2 / len(LINES)) * np.exp(2j * np.pi * rng.random((400, len(LINES))))
    V[:, 2] = N / 2 * carrier
    density, _ = unit_impedance(V, np.ones(len(LINES), complex), LINES, record)
    assert density == pytest.approx(ive(0, carrier**2 / 4) / np.sqrt(2 * np.pi), rel=1e-3)


def test_distortion_at_line_is_that_of_neighbouring_detection_lines() -> None:
    """An excess in proportion to the frequency is found at each line to the distance of two detection lines."""
    lines, odd = np.arange(1, 201, 2), np.arange(7, 200, 8)
    detected = DetectionLines(None, None, odd, odd[:, None, None].astype(complex), 1)
    error = fast_total_error(detected, lines, np.zeros((len(lines), 1, 1), complex), 9)
    assert np.abs(error[0][10:90, 0, 0].real - lines[10:90]).max() <= 8
