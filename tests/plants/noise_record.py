"""Resonances from rest whose responses are known exactly, as digital filters, and records of white noise and sweeps."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import chirp, lfilter

from elastid.base.arrays import ComplexArray, FloatArray
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
    resonance = 1 / (A[0] + A[1] * z + A[2] * z**2)
    G = resonance[:, None, None] * MIX + DIRECT
    return G[:, :n, :n]


def noise_record(n_samples: int, seed: int, n: int = 2, noise: float = 0.0, realisation: int = 0) -> Record:
    """White noise on n inputs, the first of n outputs of the plant from rest, white noise on the outputs."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(n_samples, n))
    y = lfilter([1.0], A, u, axis=0) @ MIX[:n, :n].T + u @ DIRECT[:n, :n].T + noise * rng.normal(size=(n_samples, n))
    record = record_of(u, y, realisation, 0, None, n_samples, RATE, "velocity")
    return replace(record, outputs=record.inputs, is_periodic=False)


@dataclass(frozen=True)
class Resonances:
    """Sum of f / (1 - 2 Re(p) z^-1 + |p|^2 z^-2), p = e^(2 pi f (j - zeta) / rate), over frequencies f in Hz."""

    freq_hz: tuple[float, ...]
    zeta: float = 0.01
    rate_hz: float = RATE

    @property
    def denominators(self) -> list[tuple[float, list[float]]]:
        """Each frequency with the polynomial in z^-1."""
        poles = {f: np.exp(2 * np.pi * f / self.rate_hz * (1j - self.zeta)) for f in self.freq_hz}
        return [(f, [1.0, -2 * p.real, abs(p) ** 2]) for f, p in poles.items()]

    def driven(self, u: FloatArray) -> FloatArray:
        """The output (n, 1) under an input (n, 1), from rest."""
        return sum(f * lfilter([1.0], a, u, axis=0) for f, a in self.denominators)

    def G(self, freq_hz: FloatArray) -> ComplexArray:
        z = np.exp(-2j * np.pi * freq_hz / self.rate_hz)
        return sum(f / (a[0] + a[1] * z + a[2] * z**2) for f, a in self.denominators)


AXIS, SWEPT_HZ = Resonances((6.0, 15.0), 0.03), (2.0, 35.0)


def sweeps(repeats: int, snr_db: float, rng: np.random.Generator) -> list[Record]:
    """Records of the same sine sweep of AXIS, 20 s from rest to its end, output noise so far below the output."""
    t = np.arange(4000) / RATE
    u = chirp(t, 1.0, t[-1], 40.0, phi=-90)[:, None]
    y = AXIS.driven(u)
    noise = y.std() * 10 ** (-snr_db / 20)
    return [
        record_of(u, y + noise * rng.normal(size=y.shape), m, 0, None, len(t), RATE, "velocity") for m in range(repeats)
    ]
