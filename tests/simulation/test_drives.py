"""Encoders count."""

from __future__ import annotations

import numpy as np
from plants.two_links import (
    arm,
    loop,
    quiet,
)

from elastid.model.serial import serial
from elastid.simulation.closed_loop import simulate
from elastid.simulation.controller import tune


def test_encoders_count() -> None:
    """Readings are whole counts, at most half a count from the angle."""
    model, count, q0 = serial(arm(damping=20.0)), 3e-5, np.zeros(4)
    torque = 80 * np.sin(np.arange(400) / 10)[:, None] * [1, -1]
    run = simulate(loop(model, count=count), tune(model, q0, 3.0, 0.8), quiet(model, q0, 400, torque), q0)
    counts = run.reading / count
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(run.reading - run.q[:, 2:]).max() <= count / 2 * (1 + 1e-9)
    assert len(np.unique(np.round(counts))) > 10
