"""Steps of references in a log that is faster than their cycle."""

import numpy as np
import pytest

from elastid.base.arrays import FloatArray
from elastid.frf.lines import reference_steps
from elastid.record import Configuration, Record

K = np.arange(4000)


def wave(k: FloatArray) -> FloatArray:
    """Reference of lines from 1 to 40 Hz at 1 kHz beside a slow motion, at rest for the last third, rounded."""
    phases = np.random.default_rng(2).uniform(0, 2 * np.pi, 40)
    k = np.minimum(k, 2700)
    x = 1e-3 * np.cos(2 * np.pi * np.outer(k / 1000, np.arange(1, 41)) + phases).sum(axis=1) + np.sin(k / 637)
    return np.asarray(x.round(7))


def record(reference: FloatArray) -> Record:
    """Log of a joint that follows a reference, beside a joint at rest."""
    u = np.column_stack([reference, 0 * reference])
    names = ("reference 1", "reference 2"), ("motor 1", "motor 2"), ("position", "position")
    return Record("a", Configuration("c", [0.0, 0.0]), 0, 0, 1000.0, len(K), *names, u, u)


@pytest.mark.parametrize("n", [2, 4, 5, 12])
def test_steps_of_references_have_their_cycle(n: int) -> None:
    """References that are held for n samples from any sample on, or joined by lines: their cycle and interpolation."""
    held = wave((K + 1) // n * n)
    assert reference_steps(record(held)) == (n, "hold")
    part = (K + 1) % n / n
    assert reference_steps(record(((1 - part) * wave((K + 1) // n * n - n) + part * held).round(9))) == (n, "linear")


def test_smooth_or_coarse_references_have_no_steps() -> None:
    """References at the rate of the log, rounded to a tenth of their steps or not: a cycle of one sample."""
    assert reference_steps(record(wave(K))) == (1, "hold")
    assert reference_steps(record(wave(K).round(4)))[0] == 1
