"""Responses of structures with known modes."""

import numpy as np
from plants.two_mass import circular

from elastid.record import MOTION_ORDER, Configuration, Motion
from elastid.response import Covariance, Response

BENCH = Configuration("bench", np.zeros(0))
FREQ_HZ = np.arange(32, 800) / 8
NATURAL, ZETA = np.array([12.0, 25.0, 41.0, 66.0, 90.0]), np.array([0.01, 0.015, 0.008, 0.012, 0.01])


def modal_response(
    freq_hz: np.ndarray,
    natural_hz: np.ndarray,
    zeta: np.ndarray,
    shapes: np.ndarray,
    n_u: int = 1,
    noise: float = 0.0,
    seed: int = 0,
    quantity: Motion = "acceleration",
) -> Response:
    """Motion per force of shapes (n_y, n), driven at the first n_u outputs; noise: over the rms of G."""
    omega, natural = 2 * np.pi * freq_hz[:, None], 2 * np.pi * natural_hz
    modal = (1j * omega) ** MOTION_ORDER[quantity] / (natural**2 - omega**2 + 2j * zeta * natural * omega)
    G = np.einsum("ir,fr,jr->fij", shapes, modal, shapes[:n_u])
    rng, std = np.random.default_rng(seed), noise * float(np.sqrt(np.mean(np.abs(G) ** 2)))
    G = G + std * circular(rng, G.shape)
    covariance = Covariance(np.full(G.shape, std**2), np.inf) if noise else None
    names = tuple(f"u{j}" for j in range(n_u)), tuple(f"y{i}" for i in range(len(shapes)))
    return Response(freq_hz, G, *names, quantity, BENCH, noise=covariance)
