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
PERIOD = 1024


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

    def measured(
        self, r: FloatArray, snr_db: float, rng: np.random.Generator, gain: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """u, y from rest under velocity feedback, with a disturbing torque where there is any; noise on y."""
        d = 0.3 * rng.normal(size=len(r)) * (gain > 0)
        u, y, x = np.zeros(len(r)), np.zeros(len(r)), np.zeros(6)
        for k in range(len(r)):
            y[k] = self.C @ x
            u[k] = r[k] - gain * y[k]
            x = self.A @ x + self.B * (u[k] + d[k])
        return u, y + rng.normal(size=len(y)) * y.std() * 10 ** (-snr_db / 20)


AXIS = ElasticAxis()


def record(u: FloatArray, y: FloatArray, r: FloatArray | None = None, period: int = 0, m: int = 0) -> Record:
    """A record of the axis, without a period where it is 0."""
    names, known = ("motor 1",), None if r is None else r[:, None]
    configuration, N = Configuration("c", np.zeros(1)), period or len(u)
    signals = (u[:, None], y[:, None], known)
    return Record(
        f"c-r{m}-e0", configuration, m, 0, RATE_HZ, N, names, names, ("velocity",), *signals, is_periodic=period > 0
    )


def multisine(rng: np.random.Generator) -> FloatArray:
    """One period of random phases, 0.5 to 40 Hz, RMS 1."""
    lines = np.arange(6, int(40 * PERIOD / RATE_HZ))
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    return np.asarray(np.fft.irfft(spectrum) * PERIOD / np.sqrt(2 * len(lines)))


def swept(seconds: float, method: str = "linear") -> FloatArray:
    """A sine of 0.5 to 40 Hz."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return np.asarray(chirp(t, 0.5, seconds, 40.0, method=method, phi=-90))


def periodic(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """Two realisations of six periods in steady state."""
    runs = [AXIS.measured(np.tile(multisine(rng), 8), snr_db, rng) for _ in range(2)]
    return [record(u[2 * PERIOD :], y[2 * PERIOD :], None, PERIOD, m) for m, (u, y) in enumerate(runs)]


def with_transient(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """Three periods from rest."""
    return [record(*AXIS.measured(np.tile(multisine(rng), 3), snr_db, rng), None, PERIOD)]


def three_repeats(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """The same sweep of 30 s from rest three times."""
    return [record(*AXIS.measured(swept(30.0, "logarithmic"), snr_db, rng), m=m) for m in range(3)]


def linear_chirp(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """A chirp of 15 s, and 5 s in which it rings down."""
    return [record(*AXIS.measured(np.concatenate([swept(15.0), np.zeros(500)]), snr_db, rng))]


def sweep_from_rest(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """A logarithmic sweep of 60 s up to the end of the log."""
    return [record(*AXIS.measured(swept(60.0, "logarithmic"), snr_db, rng))]


def random_noise(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """120 s of white noise, logged while it runs."""
    u, y = AXIS.measured(rng.normal(size=14_000), snr_db, rng)
    return [record(u[2000:], y[2000:])]


def hammer(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """Five blows in 50 s."""
    r = np.zeros(5000)
    for blow in range(5):
        first = 100 + 1000 * blow + int(rng.integers(50))
        r[first : first + 3] = 50.0, 100.0, 50.0
    return [record(*AXIS.measured(r, snr_db, rng))]


def stepped_sine(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """1 to 39 Hz, 3 s of each."""
    t = np.arange(300) / RATE_HZ
    return [record(*AXIS.measured(np.concatenate([np.sin(2 * np.pi * f * t) for f in range(1, 40)]), snr_db, rng))]


def binary(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """80 s of a pseudo-random binary torque that is held for two samples."""
    return [record(*AXIS.measured(np.repeat(rng.choice([-1.0, 1.0], 4000), 2), snr_db, rng))]


def closed_loop(snr_db: float, rng: np.random.Generator) -> list[Record]:
    """100 s of operation under velocity feedback, with noise as injected torque and 0.3 of it as disturbance."""
    r = rng.normal(size=11_000)
    u, y = AXIS.measured(r, snr_db, rng, gain=0.3)
    return [record(u[1000:], y[1000:], r[1000:])]


KINDS: dict[str, Callable[[float, np.random.Generator], list[Record]]] = {
    "multisine periodic": periodic,
    "multisine with transient": with_transient,
    "three repeats": three_repeats,
    "chirp": linear_chirp,
    "sweep from rest": sweep_from_rest,
    "random noise": random_noise,
    "hammer": hammer,
    "stepped sine": stepped_sine,
    "pseudo-random binary": binary,
    "operating closed loop": closed_loop,
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
