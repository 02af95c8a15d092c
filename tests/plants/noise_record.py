"""A record of white noise, without a period, of a resonance of two inputs and two outputs whose response is known."""

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from elastid.frf.spec import EstimatorSpec
from elastid.record import Record
from plants.random_plants import record_of

RATE = 200.0
H1 = EstimatorSpec(method="h1", quantity="velocity", segment=1.28)
# Two inputs to two outputs: an AR(2) resonance at 30 Hz seen through different gains, and a direct part.
POLES = 0.9 * np.exp(2j * np.pi * 30 / RATE)
A = np.array([1.0, -2 * POLES.real, abs(POLES) ** 2])
MIX, DIRECT = np.array([[1.0, 0.5], [-0.3, 2.0]]), np.array([[0.2, 0.0], [0.1, 0.4]])


def truth(freq_hz: np.ndarray, n: int = 2) -> np.ndarray:
    z = np.exp(-2j * np.pi * freq_hz / RATE)
    resonance: np.ndarray = 1 / (A[0] + A[1] * z + A[2] * z**2)
    G: np.ndarray = resonance[:, None, None] * MIX + DIRECT
    return G[:, :n, :n]


def noise_record(n_samples: int, seed: int, n: int = 2, noise: float = 0.0, realisation: int = 0) -> Record:
    """White noise on n inputs, the first of n outputs of the plant from rest, white noise on the outputs."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(n_samples, n))
    y = lfilter([1.0], A, u, axis=0) @ MIX[:n, :n].T + u @ DIRECT[:n, :n].T + noise * rng.normal(size=(n_samples, n))
    record = record_of(u, y, realisation, 0, None, n_samples, RATE, "velocity")
    return replace(record, outputs=record.inputs, is_periodic=False)
