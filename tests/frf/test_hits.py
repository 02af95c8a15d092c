"""Faults of hammer tests are named, and clean ones are not."""

import numpy as np
import pytest

from elastid.frf.checks import hit_notes, pulses
from elastid.record import Configuration, Record

RATE_HZ, WIDTH = 2000.0, 10
STARTS = (400, 4400, 8400)


def record(u: np.ndarray, y: np.ndarray) -> Record:
    names = ("hammer",), ("tip",), ("acceleration",)
    return Record(
        "a", Configuration("bench", np.zeros(0)), 0, 0, RATE_HZ, len(u), *names, u[:, None], y[:, None],
        is_periodic=False,
    )  # fmt: skip


def hits() -> tuple[np.ndarray, np.ndarray]:
    """Three half sines of 100, 80 and 120 N, and a mode of 50 Hz that rings after each."""
    u, y, t = np.zeros(12_000), np.zeros(12_000), np.arange(12_000) / RATE_HZ
    for start, size in zip(STARTS, (100.0, 80.0, 120.0), strict=True):
        u[start : start + WIDTH] = size * np.sin(np.pi * (np.arange(WIDTH) + 0.4) / WIDTH)
        after = np.maximum(t - start / RATE_HZ, 0)
        y += size * np.exp(-3 * after) * np.sin(2 * np.pi * 50.3 * after)
    return u, y


def codes(u: np.ndarray, y: np.ndarray) -> list[str]:
    return [note.code for note in hit_notes([record(u, y)])]


def test_clean_hits_and_other_forces_have_no_note() -> None:
    u, y = hits()
    assert codes(u, y) == []
    assert pulses(np.random.default_rng(0).normal(size=5000)) is None
    assert pulses(np.zeros(100)) is None


def test_a_double_hit_is_named_with_its_dips() -> None:
    """A second blow 25 ms later and half as strong makes dips every 40 Hz."""
    u, y = hits()
    u[4450 : 4450 + WIDTH] = 0.5 * u[4400 : 4400 + WIDTH]
    (note,) = hit_notes([record(u, y)])
    assert note.code == "frf/hits"
    assert "1 of 3 hits of hammer are double" in note.text


@pytest.mark.parametrize(
    ("fault", "code"), [("force", "frf/overload"), ("answer", "frf/overload"), ("begin", "frf/hits"),
                        ("end", "frf/hits")],
)  # fmt: skip
def test_faults_are_named(fault: str, code: str) -> None:
    u, y = hits()
    if fault == "force":
        u = np.minimum(u, 70.0)
    elif fault == "answer":
        y = np.clip(y, -50.0, 50.0)
    elif fault == "begin":
        u, y = u[STARTS[0] + 3 :], y[STARTS[0] + 3 :]
    else:
        u, y = u[: STARTS[2] + 3], y[: STARTS[2] + 3]
    assert codes(u, y) == [code]
