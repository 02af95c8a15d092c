"""Commands that a drive holds from sample to sample: with the key `hold` the fit is exact, without it it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants.held_torque import measured, plant

from elastid.fit.identify import identify
from elastid.fit.result import FitResult
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.record import Hold

FREE = {name: ParameterSpec() for name in ("k_1", "d_1", "fm_1")}
SPEC = FitSpec(parameters=FREE, starts=2, start_factor=1.3, seed=1, weights=WeightSpec(floor=0.0), profile=())


def fitted(folder: Path, seed: int, hold: Hold, acts: Hold = "zero-order") -> FitResult:
    return identify([measured(folder, seed, hold, acts)], plant(80.0), SPEC)


def deviation(result: FitResult) -> float:
    """ln k over its truth, in claimed standard deviations."""
    place = result.parameters.free_names.index("k_1")
    return float((result.x[place] - np.log(100.0)) / np.sqrt(result.covariance[place, place]))


@pytest.mark.parametrize("acts", ["zero-order", "band-limited"])
def test_a_fit_is_exact_where_the_study_says_how_the_torque_acts(tmp_path: Path, acts: Hold) -> None:
    """Eight logs: residuals 1.0 to 1.15 times the noise of twelve periods, the stiffness within its interval."""
    results = [fitted(tmp_path, seed, acts, acts) for seed in range(8)]
    assert all(0.9 < result.model_error < 1.15 for result in results)
    assert np.sum(np.abs([deviation(result) for result in results]) > 2) <= 1
    assert max(abs(result.values["k_1"] / 100 - 1) for result in results) < 0.003


def test_a_held_torque_that_is_taken_as_measured_bends_the_stiffness(tmp_path: Path) -> None:
    """The same logs without the key: residuals 1.7 to 2.1 times the noise, the stiffness five of its deviations off."""
    results = [fitted(tmp_path, seed, "band-limited") for seed in range(4)]
    assert all(1.7 < result.model_error < 2.1 for result in results)
    assert all(abs(deviation(result)) > 4 for result in results)
    assert all(result.values["k_1"] < 99 for result in results)
