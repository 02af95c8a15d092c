"""Variance of gear ratios that differ between angles, from residuals that are linear in their errors."""

from dataclasses import replace

import numpy as np
import pytest
from fit.test_covariance import evidence_of
from plants.data_sheet_arm import SPEC, arm, measure

from elastid.base.arrays import FloatArray
from elastid.fit.frf_problem import Assembly
from elastid.fit.gear_ratios import RatioScatter, ratio_std, scatter_of_ratios
from elastid.fit.parameter_selection import choose
from elastid.fit.problem.systematic_errors import ratio_errors
from elastid.fit.robust_covariance import LineSums, RatioSums

Q, N, HALF = 40, 30, np.diag([2.0, 0.1])


def scatter(
    std: float, is_excess: bool = True, noise: float = 1.0, min_std: float = 0.0
) -> tuple[RatioScatter, FloatArray]:
    """Scatter of a gear at Q angles whose ratios have so many tolerances, and dx (Q, 2) by one tolerance at each."""
    rng = np.random.default_rng(3)
    J = np.linalg.qr(rng.standard_normal((Q * N, 2)))[0]
    V = 3 * rng.standard_normal((Q, N)) + np.reshape(J @ [20.0, 40.0], (Q, N))
    r = (V * std * rng.standard_normal((Q, 1))).ravel() + noise * rng.standard_normal(Q * N)
    r = r - J @ (J.T @ r)
    rows, residuals, parts = np.reshape(J, (Q, N, 2)), np.reshape(r, (Q, N)), []
    for q in range(Q):
        ratios = RatioSums((("motor 1", 0.1 * q),), V[[q]] @ rows[q], V[[q]] @ V[[q]].T, V[[q]] @ residuals[q])
        parts.append(LineSums(**vars(evidence_of(rows[q], residuals[q])) | {"ratios": ratios}))
    pull = np.array([part.ratios.pull[0] for part in parts])
    return scatter_of_ratios(parts, HALF, float(r @ r), N * Q - 2.0, 1.0, is_excess, min_std), pull @ HALF


@pytest.mark.parametrize("std", [0.5, 3.0])
def test_ratio_std_is_recovered_and_propagated(std: float) -> None:
    """The std over 40 angles to 20 %, and the covariance of x by it: sum of s^2 dx dx^T."""
    found, dx = scatter(std)
    assert found.std["motor 1"] == pytest.approx(std, rel=0.2)
    assert found.explains
    np.testing.assert_allclose(found.covariance, found.std["motor 1"] ** 2 * dx.T @ dx)


def test_ratios_without_excess_explain_nothing() -> None:
    """Residuals of noise alone: the std is small, and no excess is explained."""
    found, _ = scatter(0.0, is_excess=False)
    assert found.std["motor 1"] < 0.2
    assert not found.explains


def test_ratios_beside_model_error_have_at_least_tolerance() -> None:
    """Residuals of noise alone after a model error was added to it: ratios that agree prove nothing."""
    agreeing, dx = scatter(0.0, is_excess=False, min_std=1.0)
    np.testing.assert_allclose(agreeing.covariance, dx.T @ dx)
    different, _ = scatter(3.0, is_excess=False, min_std=1.0)
    assert different.std["motor 1"] == pytest.approx(3.0, rel=0.2)


@pytest.mark.parametrize(("std", "noise"), [(0.0, 2.0), (20.0, 1.0)])
def test_another_error_is_not_explained_by_ratios(std: float, noise: float) -> None:
    """White residuals of twice the noise, or ratios 20 tolerances off: they count with one tolerance."""
    found, dx = scatter(std, noise=noise)
    assert not found.explains
    np.testing.assert_allclose(found.covariance, dx.T @ dx)


def test_ratio_errors_use_modelled_response_without_noise() -> None:
    """Noise in them would be correlated with residuals, and look like a scatter of the ratios."""
    responses = measure(arm(), np.random.default_rng(1), 0.05)
    assembly, errors = Assembly.of(responses, arm(), SPEC, parameters := choose(SPEC, arm())), []
    (part, *_), G = assembly.at(parameters.x, SPEC.criterion).frfs, responses[0]
    for data in (G.G, 1.1 * G.G):
        given = replace(G, G=data, ratio_std=np.full(2, 0.003))
        errors.append(np.array([*ratio_errors(part, given, part.theta(parameters, parameters.x), None).values()]))
    assert np.abs(errors[0]).max() > 0
    np.testing.assert_array_equal(*errors)


def test_gear_with_equal_ratios_shares_scatter_of_others() -> None:
    """Two angles say little of a scatter; those of the second gear are so many tolerances off, or agree, too."""
    N, names, first = 1e4 * np.eye(4), ["1", "1", "2", "2"], [0.0, 0.05]
    alone = ratio_std(N[:2, :2], 1e4 * np.array(first), names[:2], 1.0)[0]
    wide, narrow = (ratio_std(N, 1e4 * np.array([*first, by, -by]), names, 1.0)[0] for by in (4.0, 0.05))
    assert wide > 3 * alone
    assert narrow < alone / 2
