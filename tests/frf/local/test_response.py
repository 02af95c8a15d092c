"""Local polynomial and local rational responses against exact data, analytic plants, chi-square and Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.marks import slow
from plants.noise_record import Resonances, noise_record, sweeps
from plants.random_plants import periods_of, record_of, two_modes
from plants.refusals import refused
from plants.two_mass import circular

from elastid.frf.estimate import estimate
from elastid.frf.local.response import local_response, merge_repeats, spectra_at, steady_spectra
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record

RATE, N = 512.0, 512
LPM = EstimatorSpec(method="local_polynomial", quantity="velocity")
LRM = EstimatorSpec(method="local_rational", quantity="velocity")
LINES = np.arange(10, 131)
FREQ = LINES * RATE / N


def _record(
    U: np.ndarray, Y: np.ndarray, R: np.ndarray | None = None, lines: np.ndarray = LINES, P: int = 2, e: int = 0
) -> Record:
    """P periods of the spectra U (F, n_u), Y (F, n_y), R (F, n_u) at the lines."""
    u, y, r = periods_of(lines, N, P, U, Y, R)
    return record_of(u, y, 0, e, r, N, RATE, "velocity")


def _noisy(record: Record, rng: np.random.Generator, std_y: float, std_u: float = 0.0) -> Record:
    u = record.u + std_u * rng.normal(size=record.u.shape)
    return replace(record, u=u, y=record.y + std_y * rng.normal(size=record.y.shape))


def _phases(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return np.exp(2j * np.pi * rng.random(shape))


def _polynomial(n_y: int, n_u: int, rng: np.random.Generator, degree: int = 2) -> np.ndarray:
    """G (F, n_y, n_u), a polynomial in frequency."""
    C = circular(rng, (degree + 1, n_y, n_u))
    x = (FREQ - FREQ.mean()) / np.ptp(FREQ)
    return np.einsum("pyu,fp->fyu", C, x[:, None] ** np.arange(degree + 1))


@given(
    n_y=st.integers(1, 4), n_u=st.integers(1, 4), E=st.integers(1, 3), P=st.integers(1, 3), seed=st.integers(0, 10**6)
)
@settings(deadline=None, max_examples=15)
def test_one_experiment_gives_polynomial_response_for_all_inputs(n_y: int, n_u: int, E: int, P: int, seed: int) -> None:
    """Any n_y, n_u and number of experiments, fewer than inputs too; the transient beside or between the lines."""
    rng = np.random.default_rng(seed)
    G = _polynomial(n_y, n_u, rng)
    U = _phases(rng, E, len(LINES), n_u)
    records = [_record(X, np.einsum("fyu,fu->fy", G, X), P=P, e=e) for e, X in enumerate(U)]
    np.testing.assert_allclose(local_response(records, LPM, LINES).G, G, atol=1e-9 * np.abs(G).max())


@pytest.mark.parametrize("order", [2, 3])
def test_a_rational_response_of_low_order_is_reproduced_to_rounding(order: int) -> None:
    """B(f) / A(f) of the local order, three inputs, two outputs, one experiment."""
    rng = np.random.default_rng(order)
    poles = np.array([40 + 1j, 85 + 2j, 200 + 5j])[:order]
    G = _polynomial(2, 3, rng, order) / np.prod((FREQ[:, None] - poles) / 50, axis=1)[:, None, None]
    U = _phases(rng, len(LINES), 3)
    record = _record(U, np.einsum("fyu,fu->fy", G, U), P=1)
    response = local_response([record], replace(LRM, local_order=order), LINES)
    np.testing.assert_allclose(response.G, G, atol=1e-9 * np.abs(G).max())
    assert np.abs(local_response([record], LPM, LINES).G - G).max() > 1e-2 * np.abs(G).max()


@pytest.mark.parametrize(("spec", "closed"), [slow(LPM, True), (LPM, False), slow(LRM, True), slow(LRM, False)])
def test_variances_are_those_of_monte_carlo(spec: EstimatorSpec, closed: bool) -> None:
    """One experiment of three inputs, of a plant that the local model can follow: the squared error to 5 %.

    In closed loop from R it follows poles only approximately, which is in total: 8 %, and noise is less.
    """
    rng = np.random.default_rng(3)
    G = two_modes(FREQ, rng.normal(size=(2, 3))) if closed and spec is LRM else _polynomial(3, 3, rng)
    if spec is LRM and not closed:
        G /= np.prod((FREQ[:, None] - [40 + 8j, 85 + 10j]) / 30, axis=1)[:, None, None]
    size, std = np.abs(G).max(), 1e-2 if closed else 1e-3
    squares, noise, total = [], [], []
    for _ in range(25):
        R = _phases(rng, len(LINES), 3)
        U = np.linalg.solve(np.eye(3) + 0.3 / size * G, R[..., None])
        clean = _record(U[..., 0], (G @ U)[..., 0], R if closed else None, P=4)
        response = local_response([_noisy(clean, rng, std * size, std / 4 if closed else 0.0)], spec, LINES)
        squares.append(np.abs(response.G - G) ** 2)
        noise.append(response.noise.variance)
        total.append(response.total.variance)
    by_noise, by_total = (np.mean(np.mean(squares, axis=0) / np.mean(each, axis=0)) for each in (noise, total))
    if closed and spec is LRM:
        assert by_total == pytest.approx(1, rel=0.08)
        assert 1 < by_noise < 1.15
    else:
        assert [by_noise, by_total] == pytest.approx([1, 1], rel=0.05)


def test_noise_and_nonlinear_distortion_are_told_apart_from_one_realisation() -> None:
    """What repeats from period to period but is not linear is in total, not in noise."""
    rng = np.random.default_rng(4)
    std, distortion = 0.02, 0.05
    noise, total = [], []
    for _ in range(20):
        U = _phases(rng, len(LINES), 2)
        G = _polynomial(2, 2, np.random.default_rng(0))
        Y_s = distortion * circular(rng, U.shape)
        taken = _noisy(_record(U, np.einsum("fyu,fu->fy", G, U) + Y_s, P=4), rng, std)
        response = local_response([taken], LPM, LINES)
        noise.append(response.noise.variance)
        total.append(response.total.variance)
    # Of an amplitude 2/K sum over K = 4 N samples; the transient's uncertainty adds some.
    from_noise = 4 / (4 * N) * std**2
    ratio = np.mean(total) / np.mean(noise)
    assert ratio == pytest.approx(1 + distortion**2 / (1.1 * from_noise), rel=0.15)


def test_unequal_records_with_drift_give_one_response() -> None:
    """From rest, three and five periods, acceleration from a position that gains from end to end: -70 dB as a rule.

    Single draws scatter from -66 to -94 dB: where the phases leave a line near a resonance with little input.
    """
    plant, errors, lines, n, rate_hz = Resonances((20.0, 61.0), 0.03, 1000.0), [], np.arange(6, 600), 4096, 1000.0
    for seed in range(5):
        rng, records = np.random.default_rng(seed), []
        for P in (3, 5):
            (u,) = periods_of(lines, n, P, _phases(rng, len(lines), 1))
            y = plant.driven(u)
            y += 1e-5 * np.std(y) * rng.normal(size=y.shape)
            taken = record_of(u, y, n=n, rate_hz=rate_hz)
            drift = np.linspace(0, 3 * np.std(taken.y), len(taken.y))[:, None]
            records.append(replace(taken, name=f"{P} periods", y=taken.y + drift, quantities=("position",)))
        response = local_response(records, replace(LRM, quantity="acceleration"), lines)
        omega = 2 * np.pi * response.freq_hz
        G, truth = response.G[:, 0, 0] / -(omega**2), plant.G(response.freq_hz)
        errors.append(20 * np.log10(np.linalg.norm(G - truth) / np.linalg.norm(truth)))
    assert np.median(errors) < -70


def test_the_noise_of_repeats_is_that_of_all_their_periods() -> None:
    """Settled records of two and three periods: the merged one has the mean of five and its noise."""
    lines, spectra = np.arange(40, 700), []
    for P in (2, 3):
        records = sweeps(P, 20.0, np.random.default_rng(P))
        u, y = (np.concatenate([getattr(each, name) for each in records]) for name in ("u", "y"))
        spectra.append(steady_spectra(replace(records[0], u=u, y=y), lines, "velocity"))
    (merged,) = merge_repeats(spectra, closed=False)
    assert merged.n_periods == pytest.approx(5)
    np.testing.assert_allclose(merged.Y, (2 * spectra[0].Y + 3 * spectra[1].Y) / 5)
    np.testing.assert_allclose(merged.noise, (4 * spectra[0].noise + 9 * spectra[1].noise) / 25)


def test_too_few_lines_are_refused() -> None:
    rng = np.random.default_rng(0)
    few = _record(_phases(rng, 12, 3), _phases(rng, 12, 3), lines=LINES[:12])
    with refused("frf/lines", place="configuration c"):
        local_response([few], LPM, LINES[:12])


def test_records_of_unequal_length_are_cut_or_refused() -> None:
    """A note for a little, a refusal whose remedy, h1, works for much."""
    spec = EstimatorSpec(method="local_rational", quantity="velocity", band_hz=(5.0, 80.0))
    a, b, c = (noise_record(n, i, noise=0.1, realisation=i) for i, n in enumerate((2000, 2040, 900)))
    assert [note.code for note in estimate([a, b], spec).notes] == ["frf/window"] * 2
    with refused("frf/records", place="configuration c"):
        estimate([a, b, c], spec)
    assert estimate([a, b, c], replace(spec, method="h1")).n_lines > 10


@pytest.mark.parametrize(("P", "N"), [(200, 100), (331, 64), (7, 300)])
def test_spectra_near_lines_are_those_of_the_whole_record(P: int, N: int) -> None:
    """Also for lengths with a large prime factor, and where all bins are wanted."""
    signals = np.random.default_rng(0).normal(size=(P * N + 37, 2))
    lines, used = np.arange(3, N // 2 - 1, 4), slice(20, 20 + P * N)
    bins = np.unique((lines[:, None] * P + np.arange(-9, 10)).ravel())
    whole = np.fft.rfft(signals[used], axis=0) * 2 / (P * N)
    np.testing.assert_allclose(spectra_at(signals, used, bins), whole[bins], atol=1e-14)
