"""A record of one input and one output in steady state, whose motion follows its torque exactly."""

import numpy as np

from elastid.excitation.multisine import synthesise
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra, RecordSpectra, period_spectra
from elastid.record import MOTION_ORDER, Configuration, Motion, Record

RATE, N = 200.0, 400
LINES = np.arange(5, 80)
AUTO = EstimatorSpec()


def unit_phases(n: int, seed: int = 0) -> np.ndarray:
    return np.exp(2j * np.pi * np.random.default_rng(seed).random((n, 1)))


def steady_record(
    periods: int = 4, quantity: Motion = "acceleration", noise: float = 0.0, seed: int = 0, lines: np.ndarray = LINES
) -> Record:
    """u with unit amplitudes, acceleration y = u, given as the quantity asked for; noise on y, relative to y."""
    U = unit_phases(len(lines), seed)
    j_omega = 2j * np.pi * lines[:, None] * RATE / N
    Y = U / j_omega ** (2 - MOTION_ORDER[quantity])
    u, y = (np.tile(synthesise(lines, X, N), (periods, 1)) for X in (U, Y))
    y = y + noise * y.std() * np.random.default_rng(seed + 1).normal(size=y.shape)
    configuration = Configuration("c", np.zeros(1))
    return Record("c-r0-e0", configuration, 0, 0, RATE, N, ("motor 1",), ("joint 1",), (quantity,), u, y)


def periods_of(record: Record, lines: np.ndarray, quantity: Motion) -> PeriodSpectra:
    return period_spectra(RecordSpectra(record), lines, quantity)
