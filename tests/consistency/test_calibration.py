"""Intervals of 95 % hold the truth 95 times in a hundred, and no estimator could do with much narrower ones."""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts" / "studies"


@pytest.fixture(scope="module")
def study() -> Iterator[ModuleType]:
    """scripts/studies/calibration.py, whose plants and data sets these tests share."""
    with pytest.MonkeyPatch.context() as patch:
        for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            patch.setenv(variable, "1")
        patch.syspath_prepend(str(SCRIPTS))
        yield import_module("calibration")


def test_a_few_dozen_intervals_hold_the_truth_as_often_as_chance_allows(study: ModuleType) -> None:
    """The three-mass axis: shares and scatters within three and a half standard deviations of what chance does."""
    n = 60
    plant = study.three_mass()
    found = study.calibrated(study.DataSets(plant, 0), n, 1, plant.parameters.free_names)
    assert (found["sets"], found["failed"]) == (n, 0)
    # Estimates of one data set are correlated: its four intervals count as one.
    assert found["coverage"] > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / n)
    assert np.abs(np.array(found["scatter_over_bound"]) - 1).max() < 3.5 / np.sqrt(2 * n)
    assert 0.99 < min(found["stated_over_bound"]) <= max(found["stated_over_bound"]) < 1.15
