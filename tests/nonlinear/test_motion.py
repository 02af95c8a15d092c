"""The motion of a motor is known between its samples, in steady state or not."""

from dataclasses import replace

import numpy as np

from elastid.nonlinear.motion import CELLS, Motion, motion_of
from elastid.record import Configuration, Record

RATE, N, PERIODS = 200.0, 400, 3
TIME = np.arange(PERIODS * N) / RATE
FINE = np.arange(PERIODS * N * CELLS + 1) / (RATE * CELLS)


def record_of(y: np.ndarray) -> Record:
    configuration = Configuration("c", np.zeros(1))
    return Record(
        "c", configuration, 0, 0, RATE, N, ("motor 1",), ("motor 1",), ("position",), 0 * y[:, None], y[:, None]
    )


def test_a_periodic_motion_is_exact_between_its_samples() -> None:
    """Angle about a mean far from zero, and velocity."""
    omega = 2 * np.pi * 37 * RATE / N
    motion = motion_of(record_of(1.2 + 0.1 * np.sin(omega * TIME)), "motor 1")
    np.testing.assert_allclose(motion.angle, 1.2 + 0.1 * np.sin(omega * FINE), atol=1e-4)
    np.testing.assert_allclose(motion.velocity, 0.1 * omega * np.cos(omega * FINE), atol=0.01)
    np.testing.assert_allclose(motion.swings, 0.2, rtol=0.01)


def test_a_logged_velocity_keeps_its_value_at_the_start() -> None:
    """A swing that is fastest there."""
    omega = 2 * np.pi * 37 * RATE / N
    logged = replace(record_of(0.1 * omega * np.cos(omega * TIME)), quantities=("velocity",))
    motion = motion_of(logged, "motor 1")
    np.testing.assert_allclose(motion.velocity, 0.1 * omega * np.cos(omega * FINE), atol=0.01)


def test_a_transient_and_a_drift_keep_their_velocity() -> None:
    """To 2 % of its largest, away from the ends, where a record that does not repeat is cut."""
    motion = motion_of(record_of(0.3 * np.exp(-2 * TIME) + 0.02 * TIME), "motor 1")
    error = motion.velocity - (0.02 - 0.6 * np.exp(-2 * FINE))
    assert np.sqrt(np.mean(error[40 * CELLS : -40 * CELLS] ** 2)) < 0.02 * 0.6


def noisy(std: float) -> tuple[Motion, float]:
    """A swing with noise on the angle, and the RMS error of its velocity."""
    noise = std * np.random.default_rng(0).standard_normal(len(TIME))
    omega = 2 * np.pi * 9 * RATE / N
    motion = motion_of(record_of(0.1 * np.sin(omega * TIME) + noise), "motor 1")
    return motion, float(np.std(motion.velocity - 0.1 * omega * np.cos(omega * FINE)))


def test_the_noise_of_the_velocity_is_known() -> None:
    """To a tenth, where it is small: only lines between those of the period are left out."""
    motion, error = noisy(1e-5)
    assert abs(motion.velocity_noise - error) < 0.1 * error
