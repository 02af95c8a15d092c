"""Records of many kinds of an elastic axis whose response of samples is known in closed form."""

from collections.abc import Callable

import numpy as np
from scipy.linalg import expm
from scipy.signal import chirp

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Record

RATE_HZ = 100.0
BAND_HZ = (0.6, 38.0)


class ElasticAxis:
    """J q'' + D q' + K q = b u of a motor and two inertias; K from the clamped frequencies 2.45 and 14 Hz."""

    def __init__(self) -> None:
        J = np.diag([0.02, 0.02, 0.004])
        k_1, k_2 = (2 * np.pi * 2.45) ** 2 * 0.024, (2 * np.pi * 14.0) ** 2 * 0.004
        K = np.array([[k_1, -k_1, 0], [-k_1, k_1 + k_2, -k_2], [0, -k_2, k_2]])
        D = 4e-4 * K + np.diag([0.03, 0, 0])
        A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(J, K), -np.linalg.solve(J, D)]])
        B = np.concatenate([np.zeros(3), [1 / J[0, 0], 0, 0]])
        step = expm(np.block([[A, B[:, None]], [np.zeros((1, 7))]]) / RATE_HZ)
        self.A, self.B, self.C = step[:6, :6], step[:6, 6], np.eye(6)[3]

    def G(self, freq_hz: FloatArray) -> ComplexArray:
        """The truth (F,): of the samples of y to those of u."""
        z = np.exp(2j * np.pi * freq_hz / RATE_HZ)[:, None, None]
        states = np.linalg.solve(z * np.eye(6) - self.A, self.B[:, None].astype(np.complex128))
        return np.asarray(states[:, :, 0] @ self.C)

    def measured(self, u: FloatArray, snr_db: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """u, y from rest; noise on y."""
        y, x = np.zeros(len(u)), np.zeros(6)
        for k in range(len(u)):
            y[k] = self.C @ x
            x = self.A @ x + self.B * u[k]
        return u, y + rng.normal(size=len(y)) * y.std() * 10 ** (-snr_db / 20)


AXIS = ElasticAxis()


def record(u: FloatArray, y: FloatArray, m: int = 0) -> Record:
    """A record of the axis without a period."""
    names, where = ("motor 1",), Configuration("c", np.zeros(1))
    axes = (names, names, ("velocity",), u[:, None], y[:, None])
    return Record(f"c-r{m}-e0", where, m, 0, RATE_HZ, len(u), *axes, is_periodic=False)


def swept(seconds: float, method: str = "linear") -> FloatArray:
    """A sine of 0.5 to 40 Hz."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return np.asarray(chirp(t, 0.5, seconds, 40.0, method=method, phi=-90))


def three_repeats(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """The same sweep of 30 s from rest three times."""
    return [record(*AXIS.measured(swept(30.0, "logarithmic"), snr_db, rng), m=m) for m in range(3)]


def linear_chirp(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """A chirp of 15 s, and 5 s in which it rings down."""
    return [record(*AXIS.measured(np.concatenate([swept(15.0), np.zeros(500)]), snr_db, rng))]


def sweep_from_rest(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """A logarithmic sweep of 60 s up to the end of the log."""
    return [record(*AXIS.measured(swept(60.0, "logarithmic"), snr_db, rng))]


KINDS: dict[str, Callable[[float, np.random.Generator], list[Record]]] = {
    "three repeats": three_repeats,
    "chirp": linear_chirp,
    "sweep from rest": sweep_from_rest,
}


def h1_coverage(kind: str, draws: int) -> dict[str, float]:
    """Shares of lines whose 95 % regions by `noise` and by `total` hold the truth."""
    holds: dict[str, list[float]] = {"noise": [], "total": []}
    for snr_db in (30.0, 50.0):
        for seed in range(draws):
            records = KINDS[kind](snr_db, np.random.default_rng(seed))
            response = estimate(records, EstimatorSpec(method="h1", quantity="velocity", band_hz=BAND_HZ))
            assert response.quality is not None
            power = response.quality.input_singular_values[:, 0] ** 2
            square = np.abs(response.G[:, 0, 0] - AXIS.G(response.freq_hz)) ** 2
            for name, shares in holds.items():
                inside = square < -np.log(0.05) * getattr(response, name).variance[:, 0, 0]
                shares.append(float(np.mean(inside[power > 1e-3 * power.max()])))
    return {name: round(float(np.mean(shares)), 3) for name, shares in holds.items()}
