"""Plants whose responses are known exactly, measured in one experiment, and the errors of local methods on them."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.signal import chirp

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.multisine import synthesise
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record
from plants.random_plants import record_of

LPM = EstimatorSpec(method="local_polynomial", quantity="velocity")
LRM = EstimatorSpec(method="local_rational", quantity="velocity")


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

    def measured(
        self, repeats: int, gain: float, snr_db: float, rng: np.random.Generator, gains: tuple[float, ...] = ()
    ) -> list[Record]:
        """Records of the same sweep under velocity feedback of this gain; 0 is open loop, without a reference."""
        t = np.arange(self.n_samples) / self.rate_hz
        r = chirp(t, 1.0, t[-1], 40.0, phi=-90)
        u, y, x = np.zeros(len(t)), np.zeros(len(t)), np.zeros(5)
        for k in range(len(t)):
            y[k] = self.C @ x
            u[k] = r[k] - gain * y[k]
            x = self.A @ x + self.B * u[k]
        found = []
        for m, c in enumerate(gains or (1.0,) * repeats):
            noise = rng.normal(size=len(t)) * y.std() * 10 ** (-snr_db / 20)
            torque, speed, sent = c * u[:, None], (c * y + noise)[:, None], c * r[:, None] if gain else None
            found.append(record_of(torque, speed, m, 0, sent, len(t), self.rate_hz, "velocity"))
        return found


def decibels(estimate: ComplexArray, truth: ComplexArray) -> float:
    """Relative error of all lines."""
    return float(20 * np.log10(np.linalg.norm(estimate - truth) / np.linalg.norm(truth)))
