"""Records of spectra, of static nonlinearities, and a response of two modes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Motion, Record
from plants.two_mass import circular

RATE, N = 1000.0, 1024
ALL_PERIODS = EstimatorSpec(transient_periods=0, outlier_sigma=1e9)


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


def experiments_of(
    G: np.ndarray,
    lines: np.ndarray,
    M: int,
    rng: np.random.Generator,
    n: int = N,
    P: int = 2,
    noise: Sequence[np.ndarray | float] = (),
    scale: Sequence[float] = (),
    distortion: float = 0.0,
    rate_hz: float = RATE,
) -> list[Record]:
    """M realisations of n_u orthogonal experiments of a plant G (F, n_y, n_u), with the references of their inputs.

    noise: matrices, or factors, that mix white noise on u and on y.  scale: of each realisation.  distortion: a random
    error of Y that repeats from period to period.
    """
    F, n_y, n_u = G.shape
    records = []
    for m in range(M):
        for e, U in enumerate(orthogonal_set(np.full((F, n_u), scale[m] if scale else 1.0), rng)):
            Y = np.einsum("fyu,fu->fy", G, U)
            if distortion:
                Y = Y + distortion * circular(rng, (F, n_y))
            r, y = periods_of(lines, n, P, U, Y)
            mixed = [rng.normal(size=x.shape) @ np.transpose(mix * np.eye(x.shape[1]) if np.isscalar(mix) else mix)
                     for x, mix in zip((r, y), noise, strict=False)] or [0.0, 0.0]  # fmt: skip
            records.append(record_of(r + mixed[0], y + mixed[1], m, e, r, n, rate_hz))
    return records


def two_modes(freq_hz: np.ndarray, Phi: np.ndarray, zeta: float = 0.02) -> np.ndarray:
    """G (F, n, n) of two modes of shapes Phi (2, n): torque to velocity."""
    n = Phi.shape[1]
    s, G = 2j * np.pi * freq_hz[:, None, None], np.zeros((len(freq_hz), n, n), dtype=np.complex128)
    for f, phi in zip((45.0, 80.0), Phi, strict=True):
        omega = 2 * np.pi * f
        G += omega * s / (s**2 + 2 * zeta * omega * s + omega**2) * np.outer(phi, phi)
    return G
