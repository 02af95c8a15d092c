"""A record of one input and one output in steady state, whose motion follows its torque exactly."""

import numpy as np

from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra, RecordSpectra, period_spectra
from elastid.record import MOTION_ORDER, Motion, Record
from plants import random_plants

RATE, N = 200.0, 400
LINES = np.arange(5, 80)
AUTO = EstimatorSpec()


def steady_record(
    periods: int = 4, quantity: Motion = "acceleration", noise: float = 0.0, seed: int = 0, lines: np.ndarray = LINES
) -> Record:
    """u with unit amplitudes, acceleration y = u, given as the quantity asked for; noise on y, relative to y."""
    U = np.exp(2j * np.pi * np.random.default_rng(seed).random((len(lines), 1)))
    j_omega = 2j * np.pi * lines[:, None] * RATE / N
    u, y = random_plants.periods_of(lines, N, periods, U, U / j_omega ** (2 - MOTION_ORDER[quantity]))
    y = y + noise * y.std() * np.random.default_rng(seed + 1).normal(size=y.shape)
    return random_plants.record_of(u, y, n=N, rate_hz=RATE, quantity=quantity)


def periods_of(record: Record, lines: np.ndarray, quantity: Motion) -> PeriodSpectra:
    return period_spectra(RecordSpectra(record), lines, quantity)
