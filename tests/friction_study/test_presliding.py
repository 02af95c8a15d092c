"""Presliding friction by Maxwell slip elements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused

from elastid.base.arrays import FloatArray
from elastid.friction_study.presliding import Elements, fit_presliding
from elastid.record import FrictionRecord

RATE, COUNT = 200.0, 2 * np.pi / 2**16
# Ten elements, 790 Nm/rad, break-away 1.6 Nm.
THRESHOLDS = np.geomspace(6e-4, 8e-3, 10)
STIFFNESS = 1.6 / 10 / THRESHOLDS * 790 / np.sum(1.6 / 10 / THRESHOLDS)
TRUTH = Elements(STIFFNESS, THRESHOLDS * 1.6 / float(STIFFNESS @ THRESHOLDS), 0.0)
REACH = 0.012


def growing(seconds: float = 40.0) -> FloatArray:
    """Loops of 0.5 Hz that grow from 2 to 100 % of the reach."""
    t = np.arange(round(seconds * RATE)) / RATE
    return np.asarray(REACH * np.clip(0.02 + 0.98 * t / seconds, 0, 1) * np.sin(2 * np.pi * 0.5 * t))


def minor_loops() -> FloatArray:
    """Loops in loops, not seen by the fit."""
    t = np.arange(round(20 * RATE)) / RATE
    return np.asarray(REACH * (0.55 * np.sin(2 * np.pi * 0.3 * t) + 0.25 * np.sin(2 * np.pi * 1.1 * t + 1)))


def loops(q: FloatArray, torque: FloatArray, counts: float = 0.0) -> FrictionRecord:
    return FrictionRecord("loops", "1", "loops", RATE, q, torque, resolution=counts)


def log(seed: int, noise: float = 0.02, counts: float = COUNT) -> FrictionRecord:
    """Measured with torque noise and an encoder."""
    q = growing()
    torque = TRUTH.torque(q) + 0.1 + noise * np.random.default_rng(seed).standard_normal(len(q))
    return loops(np.round(q / counts) * counts, torque, counts)


def error(found: Elements) -> float:
    """Rms on the unseen loops, in parts of break-away, after the first half loop."""
    q = minor_loops()
    missed = found.torque(q) - found.offset - TRUTH.torque(q)
    return float(np.sqrt(np.mean(missed[400:] ** 2))) / 1.6


@pytest.mark.slow
def test_few_elements_are_chosen_and_nearly_as_good() -> None:
    found = fit_presliding(log(1), 0.5)
    assert 3 <= np.sum(found.stiffness > 0) <= 8
    assert error(found) < 0.025
    assert error(fit_presliding(log(1), 0.5, elements=1)) > 3 * error(found)
    assert found.offset == pytest.approx(0.1, abs=0.01)


def test_one_bristle_is_one_element() -> None:
    """A single stop operator: thresholds elsewhere get nothing, and one element is enough."""
    one = Elements(np.array([300.0]), np.array([4e-3]), 0.0)
    q = growing()
    torque = one.torque(q) + 0.01 * np.random.default_rng(0).standard_normal(len(q))
    found = fit_presliding(loops(q, torque), 0.5)
    assert len(found.stiffness) == 1
    assert found.stiffness[0] == pytest.approx(300, rel=0.01)
    assert found.threshold[0] == pytest.approx(4e-3, rel=0.01)


def test_the_robot_file_has_the_same_shares_and_stiffness() -> None:
    slip = TRUTH.to_maxwell_slip()
    assert sum(slip.shares) == pytest.approx(1.0)
    assert sum(slip.stiffness) == pytest.approx(float(STIFFNESS.sum()))
    levels = np.array(slip.shares) * 1.6 / np.array(slip.stiffness)
    np.testing.assert_allclose(levels, TRUTH.threshold)


def test_loops_of_a_few_counts_are_refused() -> None:
    with refused("friction/presliding", place="loops of joint 1"):
        fit_presliding(replace(log(0), resolution=5e-3), None)
