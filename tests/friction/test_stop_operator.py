"""Bristles follow their laws, and the mean of a sign counts a reversal where it is."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.extra.numpy import arrays

from elastid.base.kernels import is_compiled
from elastid.friction import stop_operator
from elastid.friction.stop_operator import Path, bristle, stop


@settings(max_examples=50, suppress_health_check=[HealthCheck.too_slow])  # a machine may be busy
@given(arrays(np.float64, 40, elements=st.floats(-3, 3)), st.floats(0.1, 4))
def test_a_stop_operator_follows_its_recursion(q: np.ndarray, D: float) -> None:
    """s(k) = clip(s(k - 1) + q(k) - q(k - 1), -D, D), also where q stands still."""
    q = np.round(q, 1)
    expected = [0.0]
    for step in np.diff(q):
        expected.append(min(max(expected[-1] + step, -D), D))
    np.testing.assert_allclose(stop(Path.of(q), D), expected, atol=1e-12)


def test_a_bristle_follows_its_differential_equation() -> None:
    """ds = dq - |dq| s / D in ten thousand small steps."""
    t = np.linspace(0, 1, 10_001)
    q = np.sin(7 * t) + 0.4 * np.sin(31 * t)
    s = [0.0]
    for step in np.diff(q):
        s.append(s[-1] + step - abs(step) * s[-1] / 0.2)
    np.testing.assert_allclose(bristle(Path.of(q), 0.2), s, atol=1e-3)


def test_states_in_c_are_those_of_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of a path whose first points are left out, and of one that stands still; to rounding."""
    if not is_compiled():
        pytest.skip("the kernels in C are not built")
    q = np.cumsum(np.random.default_rng(0).normal(size=200))
    paths = [Path.of(q), Path.of(q).without(50), Path.of(np.zeros(4))]
    in_c = [of(path, 0.7) for path in paths for of in (stop, bristle)]
    monkeypatch.setattr(stop_operator, "is_compiled", lambda: False)
    expected = [of(path, 0.7) for path in paths for of in (stop, bristle)]
    for found, states in zip(in_c, expected, strict=True):
        np.testing.assert_allclose(found, states, atol=1e-14)
