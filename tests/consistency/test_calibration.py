"""Intervals of 95 % hold the truth as often as they say, and clean logs raise no alarm."""

from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

import numpy as np
import pytest
from plants.paths import ROOT

SCRIPTS = ROOT / "scripts" / "studies"


@pytest.fixture(scope="module")
def study() -> Iterator[ModuleType]:
    """scripts/studies/calibration.py, whose plants and data sets these tests share."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SCRIPTS))
        yield import_module("calibration")


@pytest.mark.slow
def test_intervals_cover_truth_in_93_to_97_percent(study: ModuleType) -> None:
    """Of the three-mass axis, all parameters alike; the estimates scatter by the Cramer-Rao bound."""
    found = study.calibrate(study.DataSets(study.three_mass(), 2), 1000, 1)
    assert (found["sets"], found["failed"]) == (1000, 0)
    assert 0.93 < found["coverage"] < 0.97
    np.testing.assert_allclose(found["coverage_by_parameter"], 0.95, atol=0.03)
    np.testing.assert_allclose(found["scatter_over_bound"], 1, atol=0.1)
    np.testing.assert_allclose(found["stated_over_bound"], 1, atol=0.1)


@pytest.mark.slow
def test_clean_logs_of_both_generators_raise_no_alarm(study: ModuleType) -> None:
    """Read, estimated, and the first of them fitted."""
    for number in (0, 1):
        assert import_module("false_alarms").judge(number, 0)[1] == {}


def test_no_alarm_in_300_has_upper_bound_1_2_percent(study: ModuleType) -> None:
    """1 - 0.025^(1/300)."""
    low, high = import_module("false_alarms").interval(0, 300)
    assert (low, round(high, 4)) == (0.0, 0.0122)
