"""Cross-validation leaves every configuration out once and says whether the parameters depend on single ones."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants.two_mass import FREQ_HZ, response, two_mass

from elastid.validation.agreement import agreement
from elastid.validation.comparison import LeftOut, Refit
from elastid.validation.cross_validation import describe_folds, divide, gather_folds, generalises
from elastid.validation.results import Fold

FINE = Fold("c1", 1.0, 0.5, 2.0)
FAILED = Fold("c2", math.nan, math.nan, math.nan, "every start failed")


@given(n=st.integers(2, 12), parts=st.integers(0, 12).filter(lambda k: k != 1))
def test_parts_leave_every_configuration_out_once(n: int, parts: int) -> None:
    """And never all of them."""
    names = [f"c{i}" for i in range(n)]
    found = divide(names, parts)
    assert sorted(name for part in found for name in part) == sorted(names)
    assert all(0 < len(part) < n for part in found)
    assert len(found) == (min(parts, n) if parts else n)


def test_a_single_configuration_is_never_left_out():
    """It would leave nothing to fit."""
    assert divide(["c1"], 0) == ()


def test_every_configuration_has_the_fold_of_the_fit_without_it():
    """Its errors, or the reason why there are none."""
    scores = {name: LeftOut(1.0 + i, 0.5 + i, 2.0 + i) for i, name in enumerate(("c1", "c3"))}
    refits = [Refit("converged", "", 2, 1.0, 10, scores), Refit("failed", "every start failed", 0, math.inf, 0, {})]
    good, other, failed = gather_folds([("c1", "c3"), ("c2",)], refits)
    assert (good, other) == (FINE, Fold("c3", 2.0, 1.5, 3.0))
    assert (failed.configuration, failed.message) == ("c2", "every start failed")
    assert math.isnan(failed.misfit)
    assert gather_folds((), ()) == ()


def fitted(error_db):
    """An agreement of c1 and of c2 with this error."""
    G = two_mass(FREQ_HZ)[0]
    return [agreement(response(G, name=name), response(G * 10 ** (error_db / 20), name=name)) for name in ("c1", "c2")]


@pytest.mark.parametrize(("left_out_db", "depends"), [(0.84, False), (0.86, True)])
def test_parameters_depend_on_a_configuration_that_is_predicted_worse_than_it_is_fitted(left_out_db, depends):
    """By a factor of 1.5 and a tenth of a decibel."""
    said = describe_folds([replace(FINE, rms_log_db=left_out_db)], fitted(0.5))
    assert ("depend on single configurations; measure more configurations like c1" in said) == depends
    assert ("do not depend on single configurations" in said) != depends
    assert generalises(left_out_db, 0.5) != depends


def test_errors_of_folds_are_pooled_and_the_worst_is_named():
    """Root mean square of 0.3 and 0.4 dB."""
    said = describe_folds([replace(FINE, rms_log_db=0.3), Fold("c2", 1.0, 0.4, 1.0)], fitted(0.2))
    assert f"with {np.hypot(0.3, 0.4) / math.sqrt(2):.2g} dB rms" in said
    assert "all has 0.2 dB; worst is c2 with 0.4 dB" in said


def test_failed_folds_are_named():
    """With the reason; where every fit failed, that is the message."""
    assert describe_folds([FINE, FAILED], fitted(0.5)).endswith("The fit without c2 failed: every start failed")
    assert describe_folds([FAILED], fitted(0.5)).endswith("failed; the first with: every start failed")
