"""Torque constants that drift while a record runs: inputs that read more for the same motion."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.base.arrays import ComplexArray
from elastid.frf.gain_drift import GainDrift, drift_notes, gain_drift

F, N_U, PERIODS = 60, 2, 4
INPUTS = ("motor 1", "motor 2")


def white(rng: np.random.Generator, *shape: int) -> ComplexArray:
    return np.asarray(rng.standard_normal(shape) + 1j * rng.standard_normal(shape))


def drift_of(rng: np.random.Generator, drift: tuple[float, float], of_plant: float = 0.0) -> GainDrift:
    """Of a record with 0.5 % of noise, whose inputs change by so much from the first period to the last.

    of_plant: a term that turns its phase along frequency, as friction that warms up.
    """
    G, U = white(rng, F, N_U, N_U), white(rng, F, N_U)
    t = np.linspace(0, 1, PERIODS)[:, None, None]
    U_p = U * (1 + t * drift) + 0.005 * white(rng, PERIODS, F, N_U)
    turning = 1 + of_plant * t * np.exp(2j * np.pi * np.linspace(0, 1, F))[:, None]
    Y_p = np.einsum("fyu,pfu->pfy", G, U * turning) + 0.005 * white(rng, PERIODS, F, N_U)
    Z = np.concatenate([Y_p, U_p], axis=2)
    found = gain_drift(Z - Z.mean(axis=0), U_p.mean(axis=0), G)
    assert found is not None
    return found


def test_a_drift_of_one_constant_is_named_with_its_size() -> None:
    """3 % at motor 2 to 10 % of it, in the mean of two records; motor 1 is not named."""
    rng = np.random.default_rng(0)
    (note,) = drift_notes([drift_of(rng, (0.0, 0.03)) for _ in range(2)], INPUTS)
    assert "of u at motor 2" in note.text
    assert "motor 1" not in note.text
    size = float(note.text.partition("each record, ")[2].partition(" %")[0])
    # From the middle of one period to that of the next it is a third of it.
    assert size == pytest.approx(3 * PERIODS / (PERIODS - 1), rel=0.1)


def test_neither_noise_nor_a_plant_that_changes_is_a_drift() -> None:
    """200 records without any; a term of 10 % whose phase turns along frequency."""
    rng = np.random.default_rng(1)
    assert not any(drift_notes([drift_of(rng, (0.0, 0.0))], INPUTS) for _ in range(200))
    assert not any(drift_notes([drift_of(rng, (0.0, 0.0), 0.1)], INPUTS) for _ in range(20))
