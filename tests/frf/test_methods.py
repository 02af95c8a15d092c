"""Estimators of a response against theory and Monte Carlo; fewer experiments than motors."""

from dataclasses import replace

import numpy as np
import pytest
from plants import random_plants
from plants.random_plants import ALL_PERIODS, experiments_of
from plants.refusals import refused
from plants.two_axes import study as study
from plants.two_mass import circular
from scipy.signal import csd

from elastid.excitation.multisine import orthogonal_set
from elastid.frf.estimate import estimate
from elastid.frf.estimators import METHODS, arithmetic, errors_in_variables, h1, joint, noise_covariance
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.record import Record

RATE, N = 500.0, 256


def spectra_from(
    U: np.ndarray, Y: np.ndarray, R: np.ndarray | None = None, P: int = 2, C_Z: np.ndarray | None = None
) -> MeanSpectra:
    """From U (M, F, n_u, E), Y (M, F, n_y, E) and R like U."""
    noise = np.zeros(U.shape[1:3])
    blocks = [
        Block(U[m], Y[m], None if R is None else R[m], np.full(U.shape[3], float(P)), noise, 1) for m in range(len(U))
    ]
    n = U.shape[2] + Y.shape[2]
    return MeanSpectra(tuple(blocks), np.zeros((U.shape[1], n, n)) if C_Z is None else C_Z, 1)


def record_of(U: np.ndarray, Y: np.ndarray, lines: np.ndarray, m: int, e: int, R: np.ndarray | None = None) -> Record:
    u, y, r = random_plants.periods_of(lines, N, 2, U, Y, R)
    return random_plants.record_of(u, y, m, e, r, N, RATE)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("n_y", "n_u"), [(1, 1), (3, 3), (3, 2), (2, 3)])
def test_every_method_is_exact_without_noise(method: str, n_y: int, n_u: int) -> None:
    rng, lines = np.random.default_rng(0), np.arange(4, 40)
    F = len(lines)
    G = circular(rng, (F, n_y, n_u)) + 2
    records = []
    for m in range(3):
        for e, R in enumerate(orthogonal_set(np.ones((F, n_u)), rng)):
            U = R + 0.2 * circular(rng, (F, n_u))
            records.append(record_of(U, np.einsum("fyu,fu->fy", G, U), lines, m, e, R))
    spec = replace(ALL_PERIODS, method=method)
    response = estimate(records, spec, lines)
    np.testing.assert_allclose(response.G, G, atol=1e-9)
    assert response.noise is not None
    assert np.all(response.total.variance < 1e-15)


@pytest.mark.parametrize("injection", ["reference", "torque"])
def test_h1_is_biased_in_closed_loop_unlike_joint_method(injection: str) -> None:
    """Output noise fed back into the inputs: what many blocks leave of the error is the bias of H1."""
    rng, M, F, n = np.random.default_rng(1), 400, 30, 2
    G, C = circular(rng, (F, n, n)) + 2 * np.eye(n), circular(rng, (F, n, n)) + 2 * np.eye(n)
    R = np.array([np.moveaxis(orthogonal_set(np.ones((F, n)), rng), 0, 2) for _ in range(M)])
    V, eye = 0.15 * circular(rng, (M, F, n, n)), np.eye(n)
    U = np.linalg.solve(eye + C @ G, C @ (R - V) if injection == "reference" else R - C @ V)
    data = spectra_from(U, G @ U + V, R)
    error = {m.__name__: np.sqrt(np.mean(np.abs(m(data).G - G) ** 2)) for m in (h1, joint, arithmetic)}
    assert error["h1"] > 2 * error["arithmetic"]
    assert error["h1"] > 2 * error["joint"]


def test_errors_in_variables_has_noise_of_both_sides() -> None:
    """Correlated noise on inputs and outputs, known from the periods: its error, scatter alone, is far below its."""
    rng, M, F, n = np.random.default_rng(1), 1500, 12, 2
    G = circular(rng, (F, n, n)) + 2 * np.eye(n)
    mix = 0.25 * (np.eye(2 * n) + 0.5 * np.tri(2 * n))
    U = np.array([np.moveaxis(orthogonal_set(np.ones((F, n)), rng), 0, 2) for _ in range(M)])
    Z = np.concatenate([G @ U, U], axis=2) + mix @ circular(rng, (M, F, 2 * n, n))
    C_Z = np.broadcast_to(mix @ mix.T, (F, 2 * n, 2 * n)).astype(complex)
    data = spectra_from(Z[:, :, n:], Z[:, :, :n], P=1, C_Z=C_Z)
    error = {m.__name__: np.abs(m(data).G - G).mean() for m in (h1, errors_in_variables)}
    assert error["errors_in_variables"] < 0.3 * error["h1"]


def test_experiment_of_several_periods_counts_each_period() -> None:
    """The maximum likelihood estimate of both, and the variance of h1 of one input by the noise of each experiment."""
    rng, F, P = np.random.default_rng(4), 8, np.array([3, 4, 3, 4, 4])
    U, Y, Z = (circular(rng, (F, n, k)) for n, k in ((2, 5), (2, 5), (4, 9)))
    data = spectra_from(U[None], Y[None], C_Z=Z @ Z.mT.conj())
    once = replace(data, blocks=tuple(replace(block, periods=P.astype(float)) for block in data.blocks))
    U_all, Y_all = (np.repeat(X, P, axis=2)[None] for X in (U, Y))
    apart = spectra_from(U_all, Y_all, P=1, C_Z=data.S_Z)
    np.testing.assert_allclose(errors_in_variables(once).G, errors_in_variables(apart).G, rtol=1e-9)
    one = spectra_from(U[None, :, :1], Y[None, :, :1])
    one = replace(one, blocks=tuple(replace(block, periods=P.astype(float)) for block in one.blocks))
    power = np.abs(U[:, 0]) ** 2
    variance = noise_covariance(one, h1(one), np.ones((F, 1, 1), complex)).variance[:, 0, 0]
    np.testing.assert_allclose(variance, np.sum(power / P, axis=1) / np.sum(power, axis=1) ** 2, rtol=1e-12)


def test_methods_that_pool_get_by_with_fewer_experiments_than_inputs() -> None:
    """Two realisations of one experiment each move two inputs in two ways: H1 has an answer, a mean has none."""
    rng, lines = np.random.default_rng(0), np.arange(4, 40)
    G = circular(rng, (36, 2, 2))
    records = []
    for m in range(2):
        U = circular(rng, (36, 2))
        records.append(record_of(U, np.einsum("fyu,fu->fy", G, U), lines, m, 0))
    np.testing.assert_allclose(estimate(records, replace(ALL_PERIODS, method="h1"), lines).G, G, atol=1e-8)
    auto = estimate(records, replace(ALL_PERIODS, method="auto"), lines)
    assert "errors_in_variables" in auto.notes[0].text
    injected = [replace(record, r=record.u) for record in records]
    assert "joint" in estimate(injected, replace(ALL_PERIODS, method="auto"), lines).notes[0].text
    with refused("frf/inputs-not-separable", place="configuration c, realisation 0"):
        estimate(records, replace(ALL_PERIODS, method="arithmetic"), lines)
    with refused("frf/method"):
        estimate(records, replace(ALL_PERIODS, method="joint"), lines)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_h1_agrees_with_welch_spectra_line_by_line(n: int) -> None:
    """The definition written out over SciPy's cross spectra, to 1e-10; 0.3 of noise on every input and output."""
    rng = np.random.default_rng(3)
    G = circular(rng, (96, n, n))
    records = experiments_of(G, np.arange(4, 100), 4, rng, N, noise=(0.3, 0.3), rate_hz=RATE)
    z = np.array([np.hstack([r.y, r.u]).reshape(-1, N, 2 * n).mean(axis=0).T for r in records])
    found = estimate(records, replace(ALL_PERIODS, method="h1"), np.arange(4, 100))
    # csd conjugates its first argument: S[a, b] is the mean of A conj B.
    channels = np.moveaxis(z, 1, 0)
    S = np.array([[csd(b, a, window="boxcar", nperseg=N)[1].mean(axis=0) for b in channels] for a in channels])
    for k, G in zip(np.round(found.freq_hz * N / RATE).astype(int), found.G, strict=True):
        np.testing.assert_allclose(G, S[:n, n:, k] @ np.linalg.inv(S[n:, n:, k]), rtol=1e-10, atol=1e-10)


@pytest.mark.oracle("best_linear_approximation")
def test_means_and_covariances_agree_with_best_linear_approximation() -> None:
    """G and its total covariance by the robust method, noisy inputs; its package needs Python 3.12."""
    from best_linear_approximation import robust

    rng, lines, n, M = np.random.default_rng(4), np.arange(4, 40), 2, 12
    G = circular(rng, (36, n, n)) + 2
    records = experiments_of(G, lines, M, rng, N, noise=(0.05, 0.05), rate_hz=RATE)
    records = [replace(record, r=None) for record in records]
    u, y = (
        np.array([getattr(r, name).reshape(2, N, n) for r in records])
        .reshape(M, n, 2, N, n)
        .transpose(3, 4, 1, 0, 2)
        for name in ("u", "y")
    )  # fmt: skip
    peer = robust.noisy_input(u, y, RATE, lines, show_warnings=False).G
    found = estimate(records, ALL_PERIODS, lines)
    np.testing.assert_allclose(found.G, peer.value, rtol=1e-10)
    assert found.total.form == "full"
    np.testing.assert_allclose(found.total.full(), peer.total.cov, rtol=1e-8, atol=1e-14)
