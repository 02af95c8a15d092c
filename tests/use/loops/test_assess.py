"""A controller is judged in every posture: named where it is unstable, its peak traced to a mode."""

from __future__ import annotations

import numpy as np
from plants.predicted_arm import result

from elastid.simulation.controller import Gains
from elastid.use.loops.assess import assess
from elastid.use.loops.design import Scene, design
from elastid.use.loops.plants import PostureFamily


def test_an_unstable_controller_is_named(family: PostureFamily) -> None:
    """With the axis and the frequency, and an infinite peak."""
    modes = tuple(family.modes(q) for q in range(2))
    gains = Gains(np.full(2, 3e5), np.full(2, 2e4), np.zeros(2))
    state = assess("wild", family.estimate(), None, gains, None, family.names, ("1", "2"), modes)
    assert np.isinf(state.peak_db).all()
    assert all(cause.startswith("unstable, at") for cause in state.limited_by)


def test_a_peak_is_traced_to_the_mode_that_makes_it(family: PostureFamily) -> None:
    """Gains near those at which the first mode rings: its frequency, and the spring with most of its energy."""
    modes = tuple(family.modes(q) for q in range(2))
    cascade = next(design(Scene.of(family.estimate()), 9.0, 1))
    state = assess("own", family.estimate(), family.draws(result(), 10, 1), cascade.gains, cascade.filters(250.0),
                   family.names, ("1", "2"), modes)  # fmt: skip
    assert any(f"mode at {mode.freq_hz:.3g} Hz, {mode.spring}" in " ".join(state.limited_by)
               for own in modes for mode in own)  # fmt: skip
    assert np.all(state.peak_low <= state.peak_high)
    assert np.all(state.stable == 1)
