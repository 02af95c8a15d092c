"""Coefficients of friction by regression; signs turn over the speed that friction has, not over one of those tried."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from plants.two_mass import circular

from elastid.nonlinear.basis_selection import (
    SHAPE_ERROR,
    SIGN_ERROR,
    Basis,
    basis_error_covariance,
    greedy,
    identifiable_basis,
    refine_basis,
    select_motor_basis,
)
from elastid.nonlinear.friction_basis import BasisFunction, Kind
from elastid.nonlinear.spectra import ConfigurationSpectra
from elastid.nonlinear.variable_projection import NormalEquations, solve

EVERY = np.arange(3)
F_C = 9.0


def sums(X: np.ndarray, e: np.ndarray) -> NormalEquations:
    """The sums of a regression of e (n,) on shapes X (3, n), complex, of variance 1, as one fold."""
    A, b = (X.conj() @ X.T).real, (X.conj() @ e).real
    return NormalEquations(A[None], b[None], np.array([[np.sum(np.abs(e) ** 2)]]), np.zeros((1, 1)), 1.0)


def shapes(alike: float, rng: np.random.Generator) -> np.ndarray:
    """Three shapes (3, 400): the second as the first but for a part, the third like neither."""
    X = circular(rng, (3, 400)) / 10
    X[1] = X[0] + alike * X[1]
    return X


def regression(alike: float, seed: int, truth: tuple[float, float, float] = (F_C, 0.0, 0.0)) -> NormalEquations:
    rng = np.random.default_rng(seed)
    X = shapes(alike, rng)
    noise = circular(rng, 400)
    return sums(X, np.array(truth) @ X + noise)


def folded(equations: NormalEquations) -> NormalEquations:
    """The same in each of two folds."""
    return replace(equations, **{name: np.repeat(getattr(equations, name), 2, axis=0) for name in "Abc"})


def kinds(*names: Kind) -> list[BasisFunction]:
    return [BasisFunction("motor 1", kind, 1.0) for kind in names]


def test_of_rivals_one_is_chosen() -> None:
    """Friction of a shape and of two rivals: the rival that explains more, also where another came first."""
    folds = folded(regression(1.0, 0, (F_C, 2.0, 3.0)))
    free, _ = select_motor_basis(folds, 0, EVERY, kinds("sign", "sign", "sign"))
    np.testing.assert_array_equal(free, EVERY)
    chosen, _ = select_motor_basis(folds, 0, EVERY, kinds("sign", "stribeck", "stribeck"))
    np.testing.assert_array_equal(chosen, [0, 2])


def test_a_stribeck_curve_is_not_chosen_alone() -> None:
    """A nearly flat Stribeck curve fits the friction alone but has no F_c: Coulomb friction is chosen with it."""
    folds, shapes = folded(regression(0.25, 0, (0.0, F_C, 0.0))), kinds("sign", "stribeck", "sign")
    chosen, _ = select_motor_basis(folds, 0, EVERY, shapes)
    assert {0, 1} <= {*chosen.tolist()}
    alone, _ = select_motor_basis(folds, 0, np.array([1]), shapes)
    assert alone.tolist() == []


@pytest.mark.parametrize(("element", "is_chosen"), [("stop", True), ("bristle", True), ("sign", False)])
def test_damping_is_chosen_beside_the_element_that_it_damps(element: Kind, is_chosen: bool) -> None:
    """The rate at which a sign turns is no damping of an element: a sign jumps."""
    folds = folded(regression(1.0, 0, (F_C, 3.0, 0.0)))
    chosen, _ = select_motor_basis(folds, 0, np.arange(2), kinds(element, "bristle damping", "sign"))
    assert (1 in chosen) is is_chosen


def on_a_carrier(power: float) -> ConfigurationSpectra:
    """Three experiments of one motor whose slowest line, alike in all, has `power` times that of the others.

    Two shapes: a sign, of which no response explains half at the other lines, and a spring, which one explains.
    """
    rng = np.random.default_rng(0)
    U, others = circular(rng, (2, 20, 1, 3))
    U[0] = others[0] = 1
    size = np.where(np.arange(20) == 0, np.sqrt(power), 1.0)[:, None, None]
    Phi = size * np.concatenate([U + others, U], axis=1)
    lines = np.arange(2, 22)
    return ConfigurationSpectra(
        lines, lines / 2.0, np.ones(20, bool), size * U, size * U, Phi, np.arange(3),
        np.zeros(1),
    )  # fmt: skip


@pytest.mark.parametrize("power", [1.0, 1e3])
def test_friction_is_told_from_a_spring_beside_a_carrier(power: float) -> None:
    """Most of a sign's power is then at the carrier's line, where it is in proportion to the torque."""
    (own,) = identifiable_basis([on_a_carrier(power)], np.zeros(2, np.int64))
    assert own.tolist() == [0]


PLACES = ("motor 1", "motor 2")
QUIET = np.zeros(2)


def choice_of(shapes: Sequence[BasisFunction]) -> Basis:
    return Basis(tuple(shapes), np.array([PLACES.index(shape.place) for shape in shapes]), np.ones(2))


def fitted(shapes: Sequence[BasisFunction], v: np.ndarray, truth: np.ndarray) -> np.ndarray:
    X = np.stack([shape.sliding(v) for shape in shapes], axis=1)
    return solve(X.T @ X, X.T @ truth)


def test_grid_signs_refine_to_two_about_mean() -> None:
    """tanh(v / 1e-3), tried at 0.93e-3 and 1.87e-3: in sliding, these two fitted are off, the close ones by less
    than a quarter of that."""
    v = np.random.default_rng(1).normal(0, 0.05, 20000)
    truth = 90 * np.tanh(v / 1e-3)
    tried = [BasisFunction("motor 1", "sign", 0.93e-3), BasisFunction("motor 1", "sign", 1.87e-3)]
    coefficients = fitted(tried, v, truth)
    near = refine_basis(choice_of(tried), coefficients, PLACES, QUIET).shapes
    assert near[0].threshold < 1e-3 < near[1].threshold < 1.3 * near[0].threshold
    assert abs(coefficients.sum() - 90) > 4 * abs(fitted(near, v, truth).sum() - 90)


@pytest.mark.parametrize("speed", [0.0, 2e-3])
def test_jump_friction_ignores_velocity_noise(speed: float) -> None:
    """Of 5e-4 rad/s, over which it seems to turn; one that turns over 2e-3 rad/s keeps that within a tenth."""
    rng = np.random.default_rng(1)
    v = rng.normal(0, 0.05, 200000)
    seen, truth = v + rng.normal(0, 5e-4, v.shape), BasisFunction("motor 1", "sign", speed).sliding(v)
    tried = [BasisFunction("motor 1", "sign", 5e-4 * 2**i) for i in range(4)]
    coefficients = fitted(tried, seen, truth)
    as_seen, corrected = (
        refine_basis(choice_of(tried), coefficients, PLACES, noise).shapes for noise in (QUIET, QUIET + 5e-4)
    )
    assert 0.9 * corrected[0].threshold <= speed <= 1.1 * corrected[-1].threshold
    assert as_seen[0].threshold > 5e-4


def test_bristles_and_other_motors_stay_as_they_are() -> None:
    """Beside signs that are refined; a sign without a coefficient goes with those that have one."""
    shapes = [
        BasisFunction("motor 1", "sign", 1e-3),
        BasisFunction("motor 1", "sign", 2e-3),
        BasisFunction("motor 1", "bristle", 3e-4),
        BasisFunction("motor 2", "sign", 0.0),
    ]
    bristle, *signs, ideal = refine_basis(choice_of(shapes), np.array([5.0, 0.0, 1.0, 2.0]), PLACES, QUIET).shapes
    assert (bristle, ideal) == tuple(shapes[2:])
    np.testing.assert_allclose([shape.threshold for shape in signs], 1e-3, rtol=0.11)


def test_a_stribeck_velocity_between_those_that_were_tried_is_found() -> None:
    """F_c is 1 % off with the neighbour's velocity, by less than a tenth of that with two about its own."""
    v = np.random.default_rng(1).normal(0, 0.05, 20000)
    truth = 90 * np.sign(v) + 30 * np.sign(v) * np.exp(-((v / 0.01) ** 2))
    tried = [BasisFunction("motor 1", "sign"), BasisFunction("motor 1", "stribeck", 0.0135)]
    coefficients = fitted(tried, v, truth)
    near = refine_basis(choice_of(tried), coefficients, PLACES, QUIET).shapes
    F_c = sum(
        coefficient for shape, coefficient in zip(near, fitted(near, v, truth), strict=True) if shape.kind == "sign"
    )
    assert abs(coefficients[0] - 90) > 0.5
    assert abs(F_c - 90) < 0.1 * abs(coefficients[0] - 90)


def test_what_no_shape_has_is_smaller_where_signs_are_all() -> None:
    """Coefficients of one motor are off by one factor, those of different motors by their own."""
    shapes = [
        BasisFunction("motor 1", "sign"),
        BasisFunction("motor 1", "bristle", 1e-4),
        BasisFunction("motor 2", "sign"),
    ]
    C = basis_error_covariance(choice_of(shapes), np.array([3.0, 1.0, 2.0]))
    of_curves, of_signs = np.array([3.0, 1.0]) * SHAPE_ERROR, 2.0 * SIGN_ERROR
    np.testing.assert_allclose(C[:2, :2], np.outer(of_curves, of_curves))
    np.testing.assert_allclose(C[2], [0, 0, of_signs**2])
    assert SHAPE_ERROR > SIGN_ERROR


def test_shapes_that_are_alike_share_a_level() -> None:
    """Any division between them is a least one; without a pull there is none."""
    x, y = np.ones(5), np.arange(5.0)
    X = np.stack([x, x, -x], axis=1)
    np.testing.assert_allclose(solve(X.T @ X, X.T @ y)[:2].sum(), 2.0, rtol=1e-6)
    assert not solve(np.eye(2), np.array([-1.0, -2.0])).any()
    assert not solve(np.eye(2), np.zeros(2)).any()


def test_forward_selection_adds_effect_behind_useless_one() -> None:
    """Gain (needed): member 0 5 (6), member 1 4 (2), member 2 3 (2), but only 1 once member 1 is selected."""
    gains, needs = (5.0, 4.0, 3.0), (6.0, 2.0, 2.0)
    members, cost = greedy(
        lambda chosen: [[*chosen, i] for i in range(3) if i not in chosen],
        lambda chosen: 10 - sum(gains[i] for i in chosen) + 2 * ({1, 2} <= {*chosen}),
        lambda before, after, chosen: before - after > needs[chosen[-1]],
    )
    assert (members, cost) == ([1], 6.0)
