"""Fixtures of this room."""

import numpy as np
import pytest
from plants.lab_logs import N, P, Signals, multisines


@pytest.fixture(scope="module")
def log() -> Signals:
    """Four periods of what a controller would have written, the angle with a ramp of drift."""
    signals = multisines(np.arange(3, 60, 2), N, P * N)
    return signals | {"phi": signals["phi"] + np.linspace(0, 300, P * N)}
