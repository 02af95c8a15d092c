"""Loops, their elements, and bristles at rest."""

from __future__ import annotations

import numpy as np
import pytest
from plants import friction_study as study
from plants.report_values import bars_of, lines_of

from elastid.report.figures.friction_presliding import friction_at_rest, friction_loops


def test_loops_are_replayed_and_the_spectrum_is_in_torque() -> None:
    """k D of each element; the log's first half loop is not drawn."""
    log, found = study.loops()
    loop, spectrum, errors = friction_loops(log, found).axes
    measured, replayed = lines_of(loop)["measured"], lines_of(loop)["replayed"]
    assert len(measured.get_xdata()) == len(log.position) - log.settled
    np.testing.assert_allclose(replayed.get_ydata(), measured.get_ydata(), atol=1e-12)
    np.testing.assert_allclose(lines_of(spectrum)["2 elements"].get_data(), ((1.0, 3.0), (0.3, 1.5)))
    assert lines_of(errors)["error of unseen parts"].get_ydata()[0] == pytest.approx(100 * 0.2 / 1.8)


def test_bristles_at_rest_end_at_amplitude_zero() -> None:
    spring, damper = friction_at_rest("joint elbow", study.at_rest()).axes
    assert bars_of(spring)["extrapolated"] == (np.zeros(1), np.array([1e4]))
    assert bars_of(damper)["extrapolated"] == (np.zeros(1), np.array([10.0]))
    np.testing.assert_array_equal(bars_of(spring)["measured"], ((0.5, 1.0), (9.9e3, 9.8e3)))
