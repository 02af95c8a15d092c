"""Records of random matrices with noise, of static nonlinearities and of plants whose responses are known exactly."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm
from scipy.signal import chirp

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Motion, Record

RATE, N = 1000.0, 1024
ALL_PERIODS = EstimatorSpec(transient_periods=0, outlier_sigma=1e9)
ODD = np.arange(21, 301, 2)


def record_of(
    u: np.ndarray,
    y: np.ndarray,
    m: int = 0,
    e: int = 0,
    r: np.ndarray | None = None,
    n: int = N,
    rate_hz: float = RATE,
    quantity: Motion = "acceleration",
) -> Record:
    """Signals (P n, c) with periods of n samples, motors in and joints out."""
    inputs = tuple(f"motor {i + 1}" for i in range(u.shape[1]))
    outputs = tuple(f"joint {i + 1}" for i in range(y.shape[1]))
    quantities = (quantity,) * len(outputs)
    return Record(f"c-r{m}-e{e}", Configuration("c", [0.0]), m, e, rate_hz, n, inputs, outputs, quantities, u, y, r)


def periods_of(lines: np.ndarray, n: int, P: int, *spectra: np.ndarray | None) -> list[Any]:
    """P periods (P n, c) of each of the spectra (F, c) at the lines; None where there is none."""
    return [None if X is None else np.tile(synthesise(lines, X, n), (P, 1)) for X in spectra]


def nonlinear(
    function: Callable[[np.ndarray], np.ndarray], lines: np.ndarray, M: int, noise: float = 0.0, seed: int = 0
) -> list[Record]:
    """One input of RMS 1 through a static function, M realisations of two periods."""
    rng = np.random.default_rng(seed)
    records = []
    for m in range(M):
        R = orthogonal_set(np.full((len(lines), 1), np.sqrt(2 / len(lines))), rng)[0]
        u = np.tile(synthesise(lines, R, N), (2, 1))
        records.append(record_of(u, function(u) + noise * rng.normal(size=u.shape), m))
    return records


def two_modes(freq_hz: np.ndarray, Phi: np.ndarray, zeta: float = 0.02) -> np.ndarray:
    """G (F, n, n) of two modes of shapes Phi (2, n): torque to velocity."""
    n = Phi.shape[1]
    s, G = 2j * np.pi * freq_hz[:, None, None], np.zeros((len(freq_hz), n, n), dtype=np.complex128)
    for f, phi in zip((45.0, 80.0), Phi, strict=True):
        omega = 2 * np.pi * f
        G += omega * s / (s**2 + 2 * zeta * omega * s + omega**2) * np.outer(phi, phi)
    return G


@dataclass(frozen=True)
class TwoModes:
    """SISO, band-limited torque; the exact response from rest is steady state less its initial state's free motion."""

    N: int = 4096
    rate_hz: float = 1000.0
    zeta: float = 0.01
    at_lines: tuple[float, ...] = (82.0, 250.0)
    lines: tuple[int, int] = (6, 600)

    @property
    def excited(self) -> IntArray:
        """Lines, 595 of them."""
        return np.arange(self.lines[0], self.lines[1] + 1)

    def _mode(self, omega_0: float, omega: FloatArray) -> ComplexArray:
        response: ComplexArray = omega_0**2 / (omega_0**2 - omega**2 + 2j * self.zeta * omega_0 * omega)
        return response

    def G(self) -> ComplexArray:
        """The truth at the excited lines."""
        omega = 2 * np.pi * self.excited * self.rate_hz / self.N
        modes = [self._mode(2 * np.pi * k * self.rate_hz / self.N, omega) for k in self.at_lines]
        return np.sum(modes, axis=0)

    def from_rest(self, P: int, snr_db: float, rng: np.random.Generator) -> Record:
        """P periods from rest, output noise snr_db below the output."""
        unit = self.rate_hz / self.N
        omega, t = 2 * np.pi * self.excited * unit, np.arange(P * self.N) / self.rate_hz
        U = np.exp(2j * np.pi * rng.random(len(omega)))
        u, y = (np.tile(synthesise(self.excited, X[:, None], self.N), (P, 1)) for X in (U, self.G() * U))
        for k in self.at_lines:
            omega_0 = 2 * np.pi * k * unit
            decay, omega_d = self.zeta * omega_0, omega_0 * np.sqrt(1 - self.zeta**2)
            X = self._mode(omega_0, omega) * U
            x, v = np.sum(X).real, np.sum(1j * omega * X).real
            free = x * np.cos(omega_d * t) + (v + decay * x) / omega_d * np.sin(omega_d * t)
            y[:, 0] -= np.exp(-decay * t) * free
        y += rng.normal(size=y.shape) * np.std(y[-self.N :]) * 10 ** (-snr_db / 20)
        return record_of(u, y, n=self.N, rate_hz=self.rate_hz, quantity="velocity")


class SweptAxis:
    """One motor, a rigid body and two modes of 3 %, torque to velocity; a sine sweep of 20 s from rest to its end."""

    rate_hz = 200.0
    n_samples = 4000
    band_hz = (2.0, 35.0)

    def __init__(self) -> None:
        A, B, self.C = np.zeros((6, 6)), np.zeros(6), np.zeros(5)
        A[0, 0], B[0], self.C[0] = -0.5, 1.0, 1.0
        for i, f in ((1, 6.0), (3, 15.0)):
            omega = 2 * np.pi * f
            A[i, i + 1], A[i + 1, i : i + 2] = 1.0, (-(omega**2), -0.06 * omega)
            B[i + 1] = self.C[i + 1] = 1.0
        A[:, 5] = B
        step = expm(A / self.rate_hz)
        self.A, self.B = step[:5, :5], step[:5, 5]

    def G(self, freq_hz: FloatArray) -> ComplexArray:
        """The truth (F,): of the samples of y to those of u."""
        z = np.exp(2j * np.pi * freq_hz / self.rate_hz)[:, None, None]
        states = np.linalg.solve(z * np.eye(5) - self.A, self.B[:, None].astype(np.complex128))
        return np.asarray(states[:, :, 0] @ self.C)

    def measured(self, repeats: int, snr_db: float, rng: np.random.Generator) -> list[Record]:
        """Records of the same sweep."""
        t = np.arange(self.n_samples) / self.rate_hz
        u = chirp(t, 1.0, t[-1], 40.0, phi=-90)
        y, x = np.zeros(len(t)), np.zeros(5)
        for k in range(len(t)):
            y[k] = self.C @ x
            x = self.A @ x + self.B * u[k]
        found = []
        for m in range(repeats):
            noise = rng.normal(size=len(t)) * y.std() * 10 ** (-snr_db / 20)
            found.append(record_of(u[:, None], (y + noise)[:, None], m, 0, None, len(t), self.rate_hz, "velocity"))
        return found


def decibels(estimate: ComplexArray, truth: ComplexArray) -> float:
    """Relative error of all lines."""
    return float(20 * np.log10(np.linalg.norm(estimate - truth) / np.linalg.norm(truth)))
