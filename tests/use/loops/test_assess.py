"""A controller is judged in every posture: named where it is unstable, its peak traced to a mode."""

from __future__ import annotations

import numpy as np
from plants.predicted_arm import result

from elastid.use.loops.design import Scene, design
from elastid.use.loops.plants import PostureFamily
from elastid.use.loops.result import assess


def test_a_peak_is_traced_to_the_mode_that_makes_it(family: PostureFamily) -> None:
    """Gains near those at which the first mode rings: its frequency, and the spring with most of its energy."""
    modes = tuple(family.modes(q) for q in range(2))
    cascade = next(design(Scene.of(family.estimate()), 9.0, 1))
    state = assess("own", family.estimate(), family.draws(result(), 10, 1), cascade.gains, cascade.filters(250.0),
                   family.names, ("1", "2"), modes)  # fmt: skip
    assert any(f"mode at {mode.freq_hz:.3g} Hz, {mode.spring}" in " ".join(state.limited_by)
               for own in modes for mode in own)  # fmt: skip
    assert np.all(state.peak_low <= state.peak_high)
