"""Fixtures of this room."""

import numpy as np
import pytest
from plants.lab_logs import N, P

from elastid.excitation.multisine import orthogonal_set, synthesise


@pytest.fixture(scope="module")
def log() -> dict[str, np.ndarray]:
    """Four periods of what a controller would have written, the angle with a ramp of drift."""
    lines = np.arange(3, 60, 2)
    U = orthogonal_set(np.ones((len(lines), 4)), np.random.default_rng(0))[0]
    signals = np.tile(synthesise(lines, U, N), (P, 1))
    signals[:, 2] += np.linspace(0, 300, len(signals))
    return dict(zip(("i1", "i2", "phi", "w2"), signals.T, strict=True))
