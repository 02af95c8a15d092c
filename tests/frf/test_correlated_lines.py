"""Errors of G at neighbouring lines: over how many they are correlated, as a response says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from elastid.base.arrays import ComplexArray
from elastid.frf.estimate import estimate
from elastid.frf.segments import Segments
from elastid.frf.spec import EstimatorSpec, Method
from elastid.record import Configuration, Record


def noise_record(seed: int) -> Record:
    """White torque through a first-order low pass, output noise of a tenth; no period."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((4096, 1))
    y = lfilter([0.5], [1, -0.5], u, axis=0) + 0.1 * rng.standard_normal((4096, 1))
    return Record(
        "noise", Configuration("c", [0.0]), 0, 0, 100.0, 4096, ("motor 1",), ("motor 1",), ("position",), u, y,
        is_periodic=False,
    )  # fmt: skip


@pytest.mark.parametrize("method", ["h1", "local_polynomial"])
@pytest.mark.slow
def test_the_stated_lines_are_the_sum_of_the_autocorrelation_of_the_errors(method: Method) -> None:
    """12 records; errors relative to their scatter, lags up to a hundred lines."""
    spec = EstimatorSpec(method=method, quantity="position", lines="full", band_hz=(2.0, 45.0))
    found = [estimate([noise_record(seed)], spec) for seed in range(12)]
    G = np.stack([response.G[:, 0, 0] for response in found])
    errors: ComplexArray = (G - G.mean(axis=0)) / G.std(axis=0)
    rho = [float(np.mean((errors[:, : -lag or None].conj() * errors[:, lag:]).real)) for lag in range(60)]
    assert found[0].correlated_lines == pytest.approx(1 + 2 * sum(rho[1:]) / rho[0], rel=0.35)


def test_windows_of_welch_have_their_closed_form() -> None:
    """1 for a boxcar; 35/18 for Hann's."""
    n = np.arange(512)
    assert Segments(np.ones(512), 256).correlated_lines == pytest.approx(1.0)
    assert Segments(0.5 - 0.5 * np.cos(2 * np.pi * n / 512), 256).correlated_lines == pytest.approx(35 / 18)
