"""Cross-validation leaves every configuration out once and says whether the parameters depend on single ones."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants.two_mass import FREQ_HZ, response, two_mass

from elastid.validation.agreement import Fold, agreement
from elastid.validation.comparison import (
    ComparedModel,
    Refit,
    describe_folds,
    describe_search,
    divide,
    final_model,
    gather_folds,
    generalises,
    search,
)

FINE = Fold("c1", 1.0, 0.5, 2.0)


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
    scores = {name: Fold(name, 1.0 + i, 0.5 + i, 2.0 + i) for i, name in enumerate(("c1", "c3"))}
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


NAMES = ("a", "b", "c", "d", "e")
ADDED = np.array([0.8, 1.0, 1.1, 1.3])


def world(error):
    """The rows of all models so far where the misfit of a model is error(elastic)."""
    known = {}

    def fitted(models):
        for model in models:
            misfit = np.asarray(error(model), float)
            cost = 1000 * float(misfit.mean())
            known[model] = ComparedModel(
                " ".join(model), len(model), cost, 1000, cost + 2 * len(model), misfit, 0.0, 0.0
            )
        return known

    return fitted


def test_a_spring_that_another_stood_in_for_becomes_rigid_again() -> None:
    """Alone a is the best, beside b and c it is good for nothing."""
    errors = {"a": 3, "b": 4, "c": 4, "ab": 2.5, "ac": 2.5, "bc": 1, "abc": 1.001}
    fitted = world(lambda model: errors.get("".join(model), 6) * ADDED)
    trials = list(search(("a", "b", "c"), fitted))
    assert final_model(trials) == ("b", "c")
    assert ("rigid", ("a",)) in [(trial.becomes, trial.coordinates) for trial in trials if trial.taken]


@given(
    useful=st.sets(st.sampled_from(NAMES)),
    start=st.sets(st.sampled_from(NAMES)),
    gains=st.lists(st.floats(0.1, 100), min_size=5, max_size=5),
)
def test_wherever_a_search_starts_it_finds_what_helps(useful: set[str], start: set[str], gains: list[float]) -> None:
    """Of springs whose parts of the error add up: what helps is freed, the largest first and none tried twice.

    What is elastic to begin with becomes rigid where it helps nothing, and only after all that helps was freed.
    """
    gain = {name: g if name in useful else -1e-3 for name, g in zip(NAMES, gains, strict=True)}
    rest = 1 + sum(max(g, 0) for g in gain.values()) * ADDED
    first = tuple(name for name in NAMES if name in start)
    trials = list(search(NAMES, world(lambda model: rest - sum(gain[name] for name in model) * ADDED), first))
    assert set(final_model(trials, first)) == useful
    taken = [trial for trial in trials if trial.taken]
    assert [trial.becomes for trial in taken] == ["free"] * len(useful - start) + ["rigid"] * len(start - useful)
    freed = [gain[trial.coordinates[0]] for trial in taken[: len(useful - start)]]
    assert freed == pytest.approx(sorted((gain[name] for name in useful - start), reverse=True))
    assert len({(trial.step, trial.elastic) for trial in trials}) == len(trials)
    assert all(name in describe_search(NAMES, trials, first) for name in NAMES)
    assert ("can be rigid" in describe_search(NAMES, trials, first)) == (useful != set(NAMES))
