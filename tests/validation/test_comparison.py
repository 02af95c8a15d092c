"""Models are ranked by predictions of left-out configurations, each left out once; the search for elastic joints."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants.dry_friction import robot as two_axes
from plants.measured_robots import responses_of
from plants.refusals import refused

from elastid.fit.parameter_selection import choose
from elastid.fit.spec import FactorSpec, FitSpec, ParameterSpec, WeightSpec
from elastid.model.formulation import EXACT
from elastid.response import Response
from elastid.robot import Robot
from elastid.robot.simplified import with_stiff_joints
from elastid.validation.comparison import (
    ComparedModel,
    ComparedVariant,
    Comparison,
    Refit,
    fix,
    rank,
    refit,
    restrict,
    split_folds,
)
from elastid.validation.elastic_search import describe_search, final_model, search
from elastid.validation.frf_error import Fold


@given(n=st.integers(1, 12), parts=st.integers(0, 12).filter(lambda k: k != 1))
def test_parts_leave_every_configuration_out_once(n: int, parts: int) -> None:
    """And never all of them: a single one never."""
    names = [f"c{i}" for i in range(n)]
    found = split_folds(names, parts)
    assert sorted(name for part in found for name in part) == (sorted(names) if n > 1 else [])
    assert all(0 < len(part) < n for part in found)
    assert len(found) == (min(parts or n, n) if n > 1 else 0)


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


CONFIGURATIONS = ("a", "b", "c", "d")


@pytest.fixture(scope="module")
def robot() -> Robot:
    """Two axes with the further elastic joints 1x and 2x."""
    return two_axes((0.0, 0.0))


def compared(robot: Robot, **models: tuple[int, float, tuple[float, ...]]) -> Comparison:
    """The ranking of models by name: parameters, V of the fit to all and its misfit in each configuration."""
    refits = [
        [
            Refit("converged", "", n, cost, 1000 - n, {}),
            *(
                Refit("converged", "", n, cost, 700, {c: Fold(c, m, m, m)})
                for c, m in zip("abcd", misfit, strict=False)
            ),
        ]
        for n, cost, misfit in models.values()
    ]
    return rank(CONFIGURATIONS, [ComparedVariant(name, robot, FitSpec(), EXACT) for name in models], refits)


def test_smallest_misfit_ranks_first_with_scaled_qaic(robot: Robot) -> None:
    """c = V / dof of the best fit, here 2: a cost 100 higher with one parameter less is 50 - 2."""
    found = compared(robot, lean=(4, 2092.0, (3, 3.2, 2.9, 3)), own=(5, 1990.0, (2, 2.1, 1.9, 2)))
    assert [row.name for row in found.rows] == ["own", "lean"]
    assert found.rows[0].criterion == 0
    assert found.rows[1].criterion == pytest.approx(102 / 2 - 2)
    difference = np.array([1, 1.1, 1.0, 1])
    assert found.rows[1].behind(found.rows[0]) == pytest.approx((difference.mean(), difference.std(ddof=1) / 2))
    assert found.rows[1].rms_log_db == pytest.approx(math.sqrt(np.mean(np.array([3, 3.2, 2.9, 3]) ** 2)))
    worse = math.sqrt(3.025 / 2)
    assert f"worse by more than the standard error, the next by a factor {worse:.3g}" in found.verdict
    assert "own predicts left-out configurations best (1.41 sigma rms)" in found.verdict


def test_simplest_model_within_standard_error_is_named(robot: Robot) -> None:
    """Better in two configurations, worse in two; or worse by less than a thousandth in all."""
    for misfit in ((2.2, 1.8, 2.1, 1.95), (2.001,) * 4):
        verdict = compared(robot, lean=(4, 2000.0, misfit), own=(5, 1990.0, (2.0, 2.0, 2.0, 2.0))).verdict
        assert "own predicts" in verdict
        assert "lean cannot be distinguished from it with these data" in verdict
        assert "The simplest of these models is lean, with 4 parameters" in verdict
    assert "distinguished" not in compared(robot, lean=(4, 2e3, (2.003,) * 4), own=(5, 2e3, (2.0,) * 4)).verdict


def test_failed_fits_are_last_and_their_reason_is_noted(robot: Robot) -> None:
    """One that failed on all, one that failed without a configuration, one that did not converge."""
    failed = Refit("failed", "every start failed", 0, math.inf, 0, {})
    fine = [Refit("converged", "", 3, 100.0, 100, {c: Fold(c, 1.0, 1.0, 1.0)}) for c in ("", *CONFIGURATIONS)]
    slow = [replace(each, status="not_converged") for each in fine]
    variants = [ComparedVariant(name, robot, FitSpec(), EXACT) for name in ("none", "some", "slow", "fine")]
    found = rank(CONFIGURATIONS, variants, [[failed] * 5, [*fine[:-1], failed], slow, fine])
    notes = {row.name: row.note for row in found.rows}
    assert [row.name for row in found.rows] == ["slow", "fine", "some", "none"]
    assert notes["none"] == "fit to all: every start failed; 4 of 4 fits failed: every start failed"
    assert notes["some"] == "1 of 4 fits failed: every start failed"
    assert (notes["slow"], notes["fine"]) == ("not converged", "")
    assert rank(CONFIGURATIONS, variants[:1], [[failed] * 5]).verdict.startswith("No model could be fitted")


def test_parameters_that_a_model_lacks_are_fixed_at_their_starts(robot: Robot) -> None:
    """The others stay free, also without a list of parameters in the study."""
    for spec in (FitSpec(parameters={"k_*": ParameterSpec()}), FitSpec()):
        before, after = choose(spec, robot).free_names, choose(fix(spec, robot, ["k_2x", "k_9"]), robot).free_names
        assert set(before) - set(after) == {"k_2x"}
    assert fix(FitSpec(), robot, ["k_9"]).parameters.keys() == {p.name for p in choose(FitSpec(), robot).free}


def test_variant_fit_has_its_own_parameters(robot):
    """None is left: refused, as an empty list would mean every stiffness."""
    lean = with_stiff_joints(robot, ["2x"])
    both = FitSpec(parameters={"k_2x": ParameterSpec(), "k_1": ParameterSpec()})
    assert restrict(both, lean, robot).parameters.keys() == {"k_1"}
    with refused("compare/variants"):
        restrict(SPEC, lean, robot)


@pytest.fixture(scope="module")
def responses(robot) -> list[Response]:
    """Of the robot in three configurations, with 2 % noise."""
    postures = {"a": (0.0, 0.2), "b": (0.5, 0.9), "c": (-0.4, -0.7)}
    return responses_of(robot, postures, np.random.default_rng(0), np.linspace(2, 50, 30), added=1e-3)


SPEC = FitSpec(starts=1, parameters={"k_2x": ParameterSpec()}, weights=WeightSpec(model_error=0.0))


def test_refit_predicts_left_out_configurations(robot: Robot, responses: list[Response]) -> None:
    """|E|^2 / sigma^2 is 1 for the true model, 1 + 1 / 0.02^2 / 100 or more for responses a tenth larger."""
    scaled = [*responses[:2], replace(responses[2], G=1.1 * responses[2].G)]
    task = (ComparedVariant("own", robot, SPEC, EXACT), ("c",))
    true, off = refit(responses, task), refit(scaled, task)
    assert (true.status, true.n_free, list(true.folds)) == ("converged", 1, ["c"])
    assert true.cost == off.cost
    assert true.folds["c"].misfit == pytest.approx(1, abs=0.2)
    assert off.folds["c"].misfit > 5
    assert off.folds["c"].rms_log_db == pytest.approx(20 * math.log10(1.1), abs=0.2)


def test_masks_apply_to_the_configurations_that_they_name(robot: Robot, responses: list[Response]) -> None:
    """Of those fitted and of those left out; where nothing is left to fit, the refit fails with the reason."""
    low = replace(SPEC, weights=WeightSpec(model_error=0.0, factors=(FactorSpec(0.0, ("c",), band_hz=(0.0, 30.0)),)))
    low_lines = (responses[2].freq_hz < 30)[:, None, None]
    spoilt = [*responses[:2], replace(responses[2], G=responses[2].G + 9 * low_lines)]
    found = refit(spoilt, (ComparedVariant("own", robot, low, EXACT), ("c",)))
    assert found.folds["c"].misfit == pytest.approx(1, abs=0.3)
    nothing = replace(SPEC, weights=WeightSpec(model_error=0.0, factors=(FactorSpec(0.0, ("a", "b")),)))
    failed = refit(responses, (ComparedVariant("own", robot, nothing, EXACT), ("c",)))
    assert (failed.status, failed.n_free, failed.folds) == ("failed", 0, {})
    assert failed.message
