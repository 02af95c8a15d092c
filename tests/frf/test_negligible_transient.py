"""A transient is left out only where it matters against the total standard deviation of the response."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plants.notes import said

from elastid.excitation.multisine import synthesise
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Record
from elastid.response import Response

N, P, M, RATE = 256, 5, 6, 256.0
LINES = np.arange(5, 100)
SPEC = EstimatorSpec()


def _records(scatter: float, transient: float, count: int = M) -> list[Record]:
    """Realisations of one input: y = u, a relative scatter of their own, and a transient in the first two periods."""
    records = []
    for m in range(count):
        rng = np.random.default_rng(m)
        U = np.exp(2j * np.pi * rng.random((len(LINES), 1)))
        error = scatter * (rng.normal(size=U.shape) + 1j * rng.normal(size=U.shape)) / np.sqrt(2)
        u, y = (np.tile(synthesise(LINES, X, N), (P, 1)) for X in (U, U * (1 + error)))
        t = np.arange(P * N) / RATE
        y = y + 1e-6 * y.std() * rng.normal(size=y.shape)
        y[:, 0] += 3 * transient * y.std() * np.exp(-8 * t) * np.sin(2 * np.pi * 20 * t)
        y[N : 2 * N] *= 1 + transient
        names, configuration = ("motor 1",), Configuration("c", np.zeros(1))
        quantities = ("acceleration",)
        records.append(Record(f"c-r{m}-e0", configuration, m, 0, RATE, N, names, names, quantities, u, y))
    return records


def _words(response: Response) -> str:
    return " ".join(said(response.notes))


def _total(response: Response) -> np.ndarray:
    assert response.total is not None
    return response.total.variance


def test_a_transient_of_a_hundredth_of_a_percent_stays_where_friction_scatters_the_response_by_a_third_of_one() -> None:
    """0.3 % of scatter: all five periods are used, and the note says why; G moves by less than its std / 10."""
    records = _records(3e-3, 3e-4)
    response = estimate(records, SPEC)
    assert "left out" not in _words(response)
    assert "2 of 5 periods hold a transient, which is kept" in _words(response)
    settled = estimate(records, replace(SPEC, transient_periods=2))
    moved = np.abs(response.G - settled.G)
    assert np.sqrt(np.mean(moved**2)) < 0.1 * np.sqrt(np.mean(_total(settled)))
