"""Motion between samples and spectra of shapes are those of the motor's motion; coefficients and curves of a result."""

from dataclasses import replace

import numpy as np
import pytest

from elastid.nonlinear.compensated_friction import CompensatedFriction, friction_rows
from elastid.nonlinear.friction_basis import BasisFunction, Kind, amplitudes, sliding_means, spectrum
from elastid.nonlinear.motion import CELLS, motion_of
from elastid.record import Configuration, Motion, Record

RATE, N = 200.0, 400
SIGN = BasisFunction("motor 1", "sign")


def swinging(line: int, amplitude: float, quantity: Motion = "position") -> Record:
    """A motor that swings as a cosine, given as the quantity asked for."""
    omega = 2 * np.pi * line * RATE / N
    order = {"position": 0, "velocity": 1, "acceleration": 2}[quantity]
    phase = omega * np.arange(2 * N) / RATE + order * np.pi / 2
    return record_of(amplitude * omega**order * np.cos(phase), quantity)


def record_of(y: np.ndarray, quantity: Motion = "position") -> Record:
    place, columns = ("motor 1",), y[:, None]
    configuration = Configuration("c", np.zeros(1))
    return Record("c", configuration, 0, 0, RATE, N, place, place, (quantity,), 0 * columns, columns)


def amplitudes_of(record: Record, shape: BasisFunction, lines: list[int]) -> np.ndarray:
    every = np.arange(record.n_samples // record.repeat_samples)
    return amplitudes(record, motion_of(record, "motor 1"), [shape], every, np.array(lines))[0]


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("line", [1, 7, 33])
def test_the_sign_of_a_sinusoid_has_its_fourier_series(quantity: Motion, line: int) -> None:
    """4 / (pi k) at its odd harmonics, against a sine, as exact at 33 lines of 200 as at one."""
    harmonics = [k for k in (1, 3, 5) if k * line < N / 2]
    found = amplitudes_of(swinging(line, 0.1, quantity), SIGN, [k * line for k in harmonics])
    np.testing.assert_allclose(found, [4j / (np.pi * k) for k in harmonics], atol=1e-3)


def test_the_spectrum_of_jumps_is_that_of_jumps() -> None:
    """Of 2 and -2 in turn at cells' edges, below half the rate to 1e-2 of the largest line."""
    samples, cells = 40, CELLS
    times, t = np.array([3.25, 11.5, 17.75, 30.25]), (np.arange(samples * cells) + 0.5) / cells
    means = np.where(np.searchsorted(times, t) % 2 == 0, -1.0, 1.0).reshape(samples, cells)
    s = 2j * np.pi * np.arange(1, samples // 2 + 1) / samples
    expected = np.exp(-np.outer(s, times)) @ (2.0 * (-1.0) ** np.arange(len(times))) / s
    np.testing.assert_allclose(
        spectrum(np.fft.rfft(means.ravel()), len(means))[1:], expected, atol=1e-2 * np.abs(expected).max()
    )


def test_a_stribeck_shape_has_its_first_harmonic_whatever_the_sampling() -> None:
    """By quadrature over one turn: a fall over a twentieth of the peak speed, which few samples see."""
    peak = 0.2 * 2 * np.pi * 33 * RATE / N
    angle = 2 * np.pi * (np.arange(200_000) + 0.5) / 200_000
    velocity = -peak * np.sin(angle)
    expected = 2 * np.mean(np.sign(velocity) * np.exp(-((20 * velocity / peak) ** 2)) * np.exp(-1j * angle))
    (found,) = amplitudes_of(swinging(33, 0.2), BasisFunction("motor 1", "stribeck", peak / 20), [33])
    np.testing.assert_allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize(("kind", "presliding"), [("stop", 1.0), ("bristle", np.tanh(2.0))])
def test_elements_together_dissipate_their_loops_and_damp_by_their_rates(kind: Kind, presliding: float) -> None:
    """A loop over a swing S has the area 2 (S - 2 D) of a stop, 2 (S - 2 D tanh(S / 2 D)) of Dahl's bristle."""
    record, D = swinging(3, 0.1), 0.05
    kinds = ["stop", "bristle", "stop damping", "bristle damping"]
    shapes = [BasisFunction("motor 1", each, D) for each in kinds]
    found = amplitudes(record, motion_of(record, "motor 1"), shapes, np.arange(2), np.array([3]))[:, 0]
    element = found[kinds.index(kind)]
    assert element.imag == pytest.approx(2 * (0.2 - 2 * D * presliding) / (np.pi * 0.1), rel=1e-3)
    np.testing.assert_allclose(found[kinds.index(kind) + 2], 2j * np.pi * 3 / N * element, rtol=1e-3)


def test_a_stribeck_shape_is_no_part_of_fast_sliding() -> None:
    """All of it near standstill, nothing at six times its velocity, and none of F_c."""
    shape = BasisFunction("motor 1", "stribeck", 0.01)
    np.testing.assert_allclose(shape.sliding(np.array([1e-6, -1e-6, 0.06])), [1, -1, 0], atol=1e-7)
    assert shape.when_fast == 0
    np.testing.assert_array_equal(sliding_means(np.zeros((1, 4)), [(shape, 1.0)]), 0)


def test_half_periods_are_repetitions_with_the_other_sign() -> None:
    """A half-wave record has the amplitudes of the same record in whole periods."""
    record = swinging(3, 0.2)
    for shape in (SIGN, BasisFunction("motor 1", "stop", 0.05)):
        np.testing.assert_allclose(
            amplitudes_of(replace(record, half_wave=True), shape, [3, 9]), amplitudes_of(record, shape, [3, 9])
        )


@pytest.mark.parametrize(("kind", "threshold"), [("sign", 1e-3), ("sign", 0.5), ("stribeck", 0.2)])
def test_cell_mean_equals_straight_velocity(kind: str, threshold: float) -> None:
    """It turns within a cell, is one-sided or constant, against ten thousand points of each cell."""
    shape = BasisFunction("motor 1", kind, threshold)
    x = np.linspace(0, 1, 17)
    between = (np.arange(160_000) + 0.5) / 160_000

    def velocity(x: np.ndarray) -> np.ndarray:
        return np.array([0.3 - x, 0.2 * x, 0.4 + 0.0 * x])

    expected = shape.sliding(velocity(between)).reshape(3, 16, -1).mean(axis=2)
    found = sliding_means(velocity(x), [(shape, 1.0)])
    np.testing.assert_allclose(found, expected, atol=1e-4)


FRICTION = CompensatedFriction(
    places=("motor 1", "motor 2"),
    place_units=("N*m", "N*m"),
    shapes=(
        BasisFunction("motor 1", "sign"),
        BasisFunction("motor 1", "stop", 0.1),
        BasisFunction("motor 1", "stribeck", 0.1),
    ),
    coulomb_torque=np.array([2.0, 3.0, 7.0]),
    covariance=np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.0], [0.0, 0.0, 1.0]]),
    configurations=("a",),
    before=np.ones((1, 2)),
    after=np.ones((1, 2)),
    residual_power_ratio=np.ones(2),
    accelerance=np.zeros(2),
)


def test_sliding_torque_sums_signs_and_bristles() -> None:
    """With the correlation of the coefficients; 0 of a motor that nothing was taken out of."""
    assert FRICTION.coulomb_friction("motor 1") == pytest.approx((5.0, np.sqrt(0.15)))
    assert FRICTION.coulomb_friction("motor 2") == (0.0, 0.0)
    assert FRICTION.compensated_motors() == ("motor 1",)


def test_sliding_torque_uncertainty_counts_sticking_elements() -> None:
    """A stop of 3 Nm is half-way to sliding after a motion of its threshold; a spring of 10 Nm/rad has no bound."""
    short = replace(FRICTION, swings=(0.1, 0.1))
    assert short.coulomb_friction("motor 1") == pytest.approx((5.0, np.hypot(np.sqrt(0.15), 1.5)))
    assert short.swing_ratio("motor 1") == pytest.approx(1.0)
    (plain, _), (with_spring, _) = friction_rows(short), friction_rows(short, {"motor 1": 10.0})
    assert with_spring.std == pytest.approx(np.hypot(plain.std or 0.0, 6.0))


def test_reversal_runs_from_minus_to_plus_coulomb_torque() -> None:
    """A sign jumps; the stop operator bends over twice its threshold; Dahl's bristle ends there, too."""
    torque, std = FRICTION.reversal("motor 1", np.array([0.0, 1e-9, 0.1, 0.2, 0.5]))
    np.testing.assert_allclose(torque, [-5.0, -1.0, 2.0, 5.0, 5.0])
    np.testing.assert_allclose(std, np.sqrt([0.15, 0.11, 0.04, 0.15, 0.15]))
    np.testing.assert_allclose(BasisFunction("motor 1", "bristle", 0.1).reversal(np.array([0.0, 5.0])), [-1, 1])


PERIODS = 3
TIME = np.arange(PERIODS * N) / RATE
FINE = np.arange(PERIODS * N * CELLS + 1) / (RATE * CELLS)


def test_a_periodic_motion_is_exact_between_its_samples() -> None:
    """Angle about a mean far from zero, and velocity, which if logged keeps its value at the start."""
    omega = 2 * np.pi * 37 * RATE / N
    motion = motion_of(record_of(1.2 + 0.1 * np.sin(omega * TIME)), "motor 1")
    np.testing.assert_allclose(motion.angle, 1.2 + 0.1 * np.sin(omega * FINE), atol=1e-4)
    np.testing.assert_allclose(motion.swings, 0.2, rtol=0.01)
    logged = motion_of(record_of(0.1 * omega * np.cos(omega * TIME), "velocity"), "motor 1")
    for each in (motion, logged):
        np.testing.assert_allclose(each.velocity, 0.1 * omega * np.cos(omega * FINE), atol=0.01)


def test_a_transient_and_a_drift_keep_their_velocity() -> None:
    """To 2 % of its largest, away from the ends, where a record that does not repeat is cut; of one period a ramp."""
    ramp = replace(record_of(0.02 * TIME), period_samples=len(TIME))
    np.testing.assert_allclose(motion_of(ramp, "motor 1").velocity, 0.02, rtol=1e-6)
    motion = motion_of(record_of(0.3 * np.exp(-2 * TIME) + 0.02 * TIME), "motor 1")
    error = motion.velocity - (0.02 - 0.6 * np.exp(-2 * FINE))
    assert np.sqrt(np.mean(error[40 * CELLS : -40 * CELLS] ** 2)) < 0.02 * 0.6


def test_the_noise_of_the_velocity_is_known() -> None:
    """To a tenth, where it is small: only lines between those of the period are left out."""
    omega, noise = 2 * np.pi * 9 * RATE / N, 1e-5 * np.random.default_rng(0).standard_normal(len(TIME))
    motion = motion_of(record_of(0.1 * np.sin(omega * TIME) + noise), "motor 1")
    error = np.std(motion.velocity - 0.1 * omega * np.cos(omega * FINE))
    assert abs(motion.velocity_noise - error) < 0.1 * error
