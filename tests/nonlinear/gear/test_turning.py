"""A sign that turns along a velocity, against the law on many points and against a solved equation of motion."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from elastid.base.arrays import FloatArray
from elastid.nonlinear.gear.turning import turning

PHASE = 2 * np.pi * np.arange(800) / 800


@pytest.mark.parametrize("scale", [0.0, 1e-3])
def test_reversals_between_points_turn_where_the_motion_is_bent(scale: float) -> None:
    """A velocity of 0.4 of its slope on one side of 0, against the law on 200 times as many points."""

    def bent(phase: FloatArray) -> FloatArray:
        return 0.1 * np.where(np.sin(phase) > 0, 1.0, 0.4) * np.sin(phase)

    dense = (np.arange(160_000) + 0.5) * np.pi / 80_000
    exact = np.mean((np.tanh(bent(dense) / scale) if scale else np.sign(bent(dense))) * np.exp(-1j * dense))
    for shift in np.linspace(0.0, 2 * np.pi / 800, 7):
        phi, slope = turning(bent(PHASE - shift), scale)
        assert np.mean(phi * np.exp(-1j * (PHASE - shift))) == pytest.approx(exact, abs=3e-5)
        assert np.all(slope >= 0)


@pytest.mark.parametrize(("turn", "error"), [(0.3, 1e-5), (0.05, 1e-4), (0.002, 3e-4)])
def test_friction_that_bends_its_own_velocity_is_that_of_the_equation(turn: float, error: float) -> None:
    """v' = a(t) - b tanh(v / s) - v, solved from one period on; the sign itself is up to 1e-2 off at these points."""

    def slope(phase: FloatArray, v: FloatArray) -> FloatArray:
        return np.asarray(3 * np.cos(phase) + np.cos(5 * phase + 1) - np.tanh(v / turn) - v)

    points = np.linspace(0, 10 * np.pi, 5 * 400 * 64 + 1)
    solved = solve_ivp(slope, (0, points[-1]), [0.0], "DOP853", points, rtol=1e-9, atol=1e-11, max_step=0.02)
    v = solved.y[0, -400 * 64 - 1 : -1]
    lines = np.fft.rfft(np.tanh(v / turn))[1:20] / len(v)
    found = np.fft.rfft(turning(v[::64], turn)[0])[1:20] / 400
    assert np.linalg.norm(found - lines) < error * np.linalg.norm(lines)


def test_a_motion_that_stands_still_has_numbers() -> None:
    """Nothing moves, or it turns and then stands: no division by a step that is none."""
    still = np.zeros(100)
    stands = np.concatenate([np.full(30, -1.0), [-0.5, 0.5], np.zeros(68)])
    for v in (still, stands):
        phi, slope = turning(v, 0.1)
        assert np.all(np.isfinite(phi))
        assert np.all(np.isfinite(slope))
    assert np.all(turning(still, 0.1)[0] == 0)
