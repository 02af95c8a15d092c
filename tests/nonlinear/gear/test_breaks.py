"""Springs and loops that break between points, against their laws on many points."""

import numpy as np
import pytest

from elastid.base.arrays import FloatArray
from elastid.nonlinear.gear.effects import GearEffect, Kind, along_period, implicit_law

N, MORE, LINES = 800, 256, slice(1, 80)


def deflection(n: int) -> FloatArray:
    """A motion of many reversals, some of them small."""
    phase = 2 * np.pi * np.arange(n) / n
    return np.asarray(1e-3 * (np.sin(phase + 0.3) + 0.4 * np.sin(5 * phase + 1) + 0.1 * np.sin(17 * phase + 2)))


@pytest.mark.parametrize("kind", ["range", "gap", "stop", "bristle"])
@pytest.mark.parametrize("scale", [5e-5, 1e-4, 5e-4])
def test_what_breaks_between_points_does_so_there(kind: Kind, scale: float) -> None:
    """From point to point x moves by up to 0.7 of the smallest scale; at points alone ten times as far off."""
    effect, x = GearEffect(kind, "1", scale), deflection(N)
    true = np.fft.rfft(implicit_law(effect, deflection(N * MORE))[0])[LINES] / (N * MORE)
    found, at_points = (np.fft.rfft(law(effect, x)[0])[LINES] / N for law in (along_period, implicit_law))
    off, without = (np.linalg.norm(each - true) / np.linalg.norm(true) for each in (found, at_points))
    assert off < 1e-4
    assert off < without / 10


@pytest.mark.parametrize("kind", ["range", "gap"])
def test_slopes_are_those_of_the_points(kind: Kind) -> None:
    """The force of a motion that is everywhere a little further, from lines that the points can tell."""
    effect, x, h = GearEffect(kind, "1", 1e-4), deflection(N), 1e-9
    slope = along_period(effect, x)[1]
    further = h * np.cos(2 * np.pi * 3 * np.arange(N) / N)
    change = along_period(effect, x + further)[0] - along_period(effect, x - further)[0]
    lines = [np.fft.rfft(each)[LINES] for each in (change, 2 * slope * further)]
    assert np.linalg.norm(lines[0] - lines[1]) < 0.03 * np.linalg.norm(lines[0])


def test_a_deflection_that_stands_still_has_numbers() -> None:
    for kind in ("range", "gap", "stop", "bristle"):
        for x in (np.zeros(100), np.concatenate([np.full(50, -3e-4), np.full(50, 3e-4)])):
            for each in along_period(GearEffect(kind, "1", 1e-4), x):
                assert np.all(np.isfinite(each))
