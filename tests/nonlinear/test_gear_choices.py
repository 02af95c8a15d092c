"""Choices among gear effects by costs and magnitudes, with estimates that are given instead of fitted."""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from nonlinear.test_gear_characteristics import PARAMETERS

from elastid.base.statistics import QUANTILE_95
from elastid.nonlinear import gear_model_selection as selection
from elastid.nonlinear.basis_functions import GearEffect, Kind
from elastid.nonlinear.basis_selection import SIGN_ERROR, SLIGHT
from elastid.nonlinear.gear_estimation import GearEstimate

K = 2e5
FRICTION, BEHIND, CUBIC = GearEffect("friction", "1", 1e-3), GearEffect("behind", "2"), GearEffect("cubic", "1")
SINE, COSINE = GearEffect("error sine", "1", 2.0), GearEffect("error cosine", "1", 2.0)


def estimate_of(magnitudes: Mapping[GearEffect, float], cost: float = 0.0) -> GearEstimate:
    """Magnitudes of a std of 1, k and d as they start; each effect's basis function has power 1."""
    n = len(magnitudes)
    covariance, motion = np.diag([1e-6, 1e-6, *np.ones(n)]), SimpleNamespace(Phi=np.ones((1, 1, 1, n)))
    drive = SimpleNamespace(joints=("1", "2"), k=np.array([K, 2 * K]))
    f, zeros = np.array([*magnitudes.values()]), np.zeros(n)
    return GearEstimate(PARAMETERS, tuple(magnitudes), PARAMETERS.x, f, covariance, cost, (motion,), (drive,), zeros)


@pytest.mark.parametrize(
    ("magnitudes", "expected"),
    [
        ({FRICTION: 3.1, CUBIC: -3.1, BEHIND: 2.9}, {FRICTION, CUBIC}),
        ({FRICTION: -30.0, CUBIC: -30.0}, {CUBIC}),
        ({SINE: 5.0, COSINE: 0.1}, {SINE, COSINE}),
        ({CUBIC: 300.0, FRICTION: 5.9, BEHIND: 5.9}, {CUBIC, BEHIND}),
        ({CUBIC: 300.0, FRICTION: 6.1}, {CUBIC, FRICTION}),
    ],
)
def test_small_or_active_effects_are_discarded(
    monkeypatch: pytest.MonkeyPatch, magnitudes: dict[GearEffect, float], expected: set[GearEffect]
) -> None:
    """Three std; friction backwards; a sine with its cosine; 2 % of the torque of another effect of the joint."""
    monkeypatch.setattr(
        selection, "estimate_gear_parameters",
        lambda data, before, effects, **_: estimate_of({e: magnitudes[e] for e in effects}),
    )  # fmt: skip
    estimate, data = estimate_of(magnitudes), SimpleNamespace()
    pruned = selection._prune(data, estimate)
    assert {*pruned.effects} == expected
    assert (pruned is estimate) == (expected == {*magnitudes})


@pytest.mark.parametrize(
    ("kind", "magnitude", "expected", "stiffness"),
    [
        ("range", 4 * K, "gap", 5 * K),
        ("range", 1.2 * K, "range", K),
        ("gap", 0.5 * K, "range", 0.5 * K),
        ("gap", 0.6 * K, "gap", K),
        ("gap", 1.1 * K, "gap", K),
    ],
)
def test_a_range_far_stiffer_beyond_its_end_is_a_gap(
    monkeypatch: pytest.MonkeyPatch, kind: Kind, magnitude: float, expected: Kind, stiffness: float
) -> None:
    """By 2.25 times; k is then that of the flanks. A gap without a stiffness within stays one."""
    monkeypatch.setattr(selection, "estimate_gear_parameters", lambda data, before, effects, **_: before)
    spring = GearEffect(kind, "1", 0.0 if kind == "cubic" else 1e-4)
    data = SimpleNamespace()
    found = selection._as_gap_or_range(data, estimate_of({FRICTION: 9.0, spring: magnitude}), "1")
    assert [effect.kind for effect in found.effects] == ["friction", expected]
    assert found.parameters.as_dict(found.x)["k_1"] == pytest.approx(stiffness)
    two = estimate_of({spring: magnitude, replace(spring, scale=3e-4): magnitude})
    assert selection._as_gap_or_range(data, two, "1") is two


@pytest.mark.parametrize(
    ("start", "costs", "expected"),
    [
        ("cubic", {"cubic": 100.0, "progressive": 98.0}, ["progressive"]),
        ("cubic", {"cubic": 100.0, "progressive": 101.0, "range": 89.0}, ["cubic"]),
        ("cubic", {"cubic": 100.0, "range": 87.0}, ["range"]),
        ("range", {"range": 100.0, "gap": 0.0}, ["range"]),
        ("cubic", {"cubic": 100.0, "range": 109.0, "range range": 50.0}, ["range", "range"]),
        ("cubic", {"cubic": 100.0, "range": 111.0, "range range": 50.0}, ["cubic"]),
        ("cubic", {"cubic": 100.0, "range": 109.0, "range range": 65.0}, ["cubic"]),
    ],
)
def test_spring_characteristic_explains_more_or_needs_fewer_numbers(
    monkeypatch: pytest.MonkeyPatch, start: Kind, costs: dict[str, float], expected: list[str]
) -> None:
    """12 for a number; two ranges, 1.5 times as far, where one explains nearly as much; no gap beside a range."""

    def of(effects: tuple[GearEffect, ...]) -> GearEstimate:
        names = " ".join(effect.kind for effect in effects if effect.kind != "friction")
        return estimate_of(dict.fromkeys(effects, 1.0), cost=costs.get(names, 1e3))

    monkeypatch.setattr(selection, "estimate_gear_parameters", lambda data, before, effects, *_, **__: of(effects))
    monkeypatch.setattr(selection, "_prune", lambda data, estimate: estimate)
    monkeypatch.setattr(selection, "_sizes", lambda data, estimate, j: (1.0, 1e-3))
    data = SimpleNamespace(joints=("1",), lines=[SimpleNamespace(Y=np.zeros(10))])
    first = GearEffect(start, "1", 1e-3 if start == "range" else 0.0)
    found = selection._best_law(data, of((FRICTION, first)), "1", selection.SPRINGS)
    springs = [effect for effect in found.effects if effect.kind != "friction"]
    assert [effect.kind for effect in springs] == expected
    assert [effect.scale for effect in springs[1:]] == pytest.approx([1.5e-3] * (len(springs) - 1))


@pytest.mark.parametrize(
    ("gains", "expected"),
    [
        ({CUBIC: 59.0}, []),
        ({SINE: 23.0}, []),
        ({FRICTION: 13.0, CUBIC: 61.0, SINE: 25.0}, [CUBIC, SINE, COSINE, FRICTION]),
        ({FRICTION: 11.0}, []),
        ({FRICTION: 13.0}, [FRICTION]),
        ({FRICTION: 13.0, GearEffect("load", "1", 1e-3): 40.0}, [GearEffect("load", "1", 1e-3), FRICTION]),
    ],
)
def test_group_that_lowers_cross_validated_cost_is_added(
    gains: dict[GearEffect, float], expected: list[GearEffect]
) -> None:
    """12 for each effect of a group, 60 for the law of a spring; the best one first."""
    groups = [(effect, COSINE) if effect == SINE else (effect,) for effect in gains]
    every = [0.0, 0.0, *(x for group in groups for x in (gains[group[0]], 0.0)[: len(group)])]
    n = len(every)
    apart = np.tile(np.eye(n), (2, 1, 1)), np.tile(np.sqrt(np.array(every) / 2), (2, 1)), np.full(2, 100.0)
    equations = apart, (np.zeros((n, n)), np.zeros(n))  # of two realisations, both together and apart
    data = SimpleNamespace(joint_normal_equations=lambda estimate, further: equations)
    assert selection._select_effects(data, estimate_of({}), groups) == expected


def test_joint_friction_is_systematic_error_of_transmission() -> None:
    """A part of each magnitude; of an error the deflection by 2 % of the friction on either side of its gear."""
    std = selection._systematic_std(estimate_of({FRICTION: 32.0, SINE: 2e-5, BEHIND: 10.0, COSINE: 0.0, CUBIC: 1e9}))
    bends = SLIGHT / QUANTILE_95 * 32.0 / K
    expected = [32 * SIGN_ERROR, np.hypot(2e-5 * SIGN_ERROR, bends), 10 * SIGN_ERROR, bends, 1e9 * SIGN_ERROR]
    assert std == pytest.approx(expected)
