"""Repairs do no harm: a damaged log is nearer to the clean one after them, and a clean log stays as it is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.waves import wave

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.logs.repair import Findings, LogReport
from elastid.logs.repair.masks import MASKED, step
from elastid.logs.repair.missing import repair
from elastid.logs.repair.outliers import OUTVOTED
from elastid.record import Configuration, Record

N, P = 1000, 3
LOG, ROLES = LogReport("log.csv", ("torque", "angle"), 1000.0), {"r": [], "u": [0], "y": [1]}
LINES = np.arange(2, 60)
KINDS = ("missing", "gap", "zero", "repeated", "spike", "count", "pair")
APART, MOST_PAIRS = 13, 25  # phases of pairs, which are fewer: two samples each, below 2 % of a channel


def _clean(seed: int, noise: float, q: float, transient: float) -> FloatArray:
    """Torque about 0 and angle about 5 rms of itself, of rms 1, with a start that rings, rounded to steps q."""
    t = np.arange(P * N)
    x = wave(t / 2, seed, LINES)
    x = x / x.std(axis=0) + np.array([0.0, 5.0])
    x += noise * np.random.default_rng(seed).normal(size=x.shape)
    x += (transient * np.exp(-t / 60) * np.cos(2 * np.pi * t / 40))[:, None]
    return q * np.round(x / q) if q else x


def _damaged(x: FloatArray, kind: str, k: int, q: float, seed: int) -> FloatArray:
    """Damage k samples of each channel at distinct phases after the transient, channels independent of each other.

    A gap is k missing samples in a row; a pair is two spikes, equal or not, at one phase of two of the three periods.
    """
    rng, result = np.random.default_rng(seed), x.copy()
    for c in range(x.shape[1]):
        if kind == "gap":
            start = 200 + rng.integers(N - 220 - k) + N * rng.integers(P)
            result[start : start + k, c] = np.nan
            continue
        if kind == "pair":
            phases = 200 + APART * rng.choice((N - 220) // APART, min(k, MOST_PAIRS), replace=False)
            first, second = rng.choice([-1, 1], (2, len(phases))) * rng.uniform(2, 20, (2, len(phases)))
            spikes = np.stack([first, np.where(rng.random(len(phases)) < 0.5, first, second), 0 * first])
            result[phases + N * np.arange(P)[:, None], c] += rng.permuted(spikes, axis=0)
            continue
        at = np.sort(200 + rng.choice(N - 220, k, replace=False) + N * rng.integers(0, P, k))
        values = {
            "missing": np.full(len(at), np.nan),
            "zero": np.zeros(len(at)),
            "repeated": x[at - 1, c],
            "spike": x[at, c] + rng.choice([-1, 1], len(at)) * rng.uniform(2, 20, len(at)),
            "count": x[at, c] + q * rng.choice([-1, 1], len(at)),
        }
        result[at, c] = values[kind]
        for i in at[np.isin(at - 1, at)] if kind == "repeated" else ():
            result[i, c] = result[i - 1, c]
    return result


def _repaired(x: FloatArray, findings: Findings | None = None) -> FloatArray:
    log = replace(LOG, findings=findings or Findings())
    return repair(x, ROLES, float(N), False, log, lambda drivers: None)


def _response(x: FloatArray, left_out: list[int]) -> ComplexArray:
    """Response (F,) of the angle to the torque as elastid estimates it."""
    place, posture = ("motor 1",), Configuration("a", [0.0])
    record = Record("a", posture, 0, 0, 1000.0, N, place, place, ("position",), x[:, :1], x[:, 1:])
    record = replace(record, discarded_periods=tuple(left_out))
    return estimate([record], EstimatorSpec(friction="none", quantity="position"), LINES).G[:, 0, 0]


def _spectra(x: FloatArray) -> FloatArray:
    """Spectra (P - 1, F, 2) of the periods after the first one, which has the transient."""
    return np.fft.rfft(x.reshape(P, N, 2)[1:], axis=1)[:, LINES]


@settings(max_examples=12, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    k=st.integers(1, 50),
    noise=st.sampled_from([0.0, 1e-3, 3e-2]),
    q=st.sampled_from([0.0, 1e-4, 1e-2]),
    transient=st.sampled_from([0.0, 1.0]),
    seed=st.integers(0, 10**6),
)
def test_repairs_bring_a_log_nearer_to_the_clean_one(
    kind: str, k: int, noise: float, q: float, transient: float, seed: int
) -> None:
    """In every channel; spectra and response within 0.2 of the standard deviations of noise and steps.

    Samples off by e of them make sqrt(k / n) e: an interpolation has e = 1.2 to 1.5, a count sqrt(12). A lost message
    may stay below four times the error of its interpolation, or, where steps repeat values or make zeros by chance,
    below the limit of a spike. Errors of a gap are correlated. Of a pair the only reference may contain the transient.
    """
    clean, findings = _clean(seed, noise, q, transient), Findings()
    damaged = _damaged(clean, kind, k, q, seed)
    result = _repaired(damaged, findings)
    before = np.nan_to_num(np.sum((damaged - clean) ** 2, axis=0), nan=np.inf)
    assert np.all(np.sum((result - clean) ** 2, axis=0) <= before * (1 + 1e-9))
    std = np.sqrt((noise**2 + max(q, 1e-3) ** 2 / 12) * N / (P - 1))
    error = np.sqrt(np.mean(np.abs((_spectra(result) - _spectra(clean)).mean(axis=0)) ** 2, axis=0))
    lost = 9.0 if q == 1e-2 else 6.0
    e = {"gap": 6.0, "zero": lost, "repeated": lost, "count": 4.5, "pair": 30.0 if transient else 3.5}.get(kind, 3.5)
    n_damaged = 2 * min(k, MOST_PAIRS) if kind == "pair" else k
    limit = max(0.2, e * np.sqrt(n_damaged / len(clean)))
    assert np.all(error <= limit * std)
    G, of_clean = (_response(x, findings.discarded_periods) for x in (result, clean))
    U = _spectra(clean)[:, :, 0].mean(axis=0)
    response_std = std / np.abs(U) * np.sqrt(1 + np.abs(of_clean) ** 2)
    assert np.sqrt(np.mean((np.abs(G - of_clean) / response_std) ** 2)) <= limit


def test_lost_messages_below_the_limit_of_one_are_replaced_together() -> None:
    """32 repeated values, many less than 4 errors of an interpolation off; afterwards 1.8 of the noise off."""
    clean = _clean(60802, 3e-2, 1e-4, 0.0)
    damaged = _damaged(clean, "repeated", 32, 1e-4, 60802)
    is_damaged = damaged != clean
    off, left = (np.sqrt(np.mean((x - clean)[is_damaged] ** 2)) / 3e-2 for x in (damaged, _repaired(damaged)))
    assert off > 6
    assert left < 2


def test_step_of_log_with_spikes_is_exact() -> None:
    """Of 0.01; among the different values spikes make smaller gaps."""
    damaged = _damaged(_clean(383311, 1e-3, 1e-2, 0.0), "pair", 7, 1e-2, 383311)
    assert step(damaged[:, 1]) == pytest.approx(0.01, rel=1e-6)


def test_sticking_at_reversals_is_no_outlier() -> None:
    """A joint sticks 1/16 of the time, with six reversals a period and noise of 0.3 steps."""
    t, rng = 2 * np.pi * np.arange(P * N)[:, None] / N, np.random.default_rng(0)
    speed = (1 + 0.3 * np.sin(t)) * np.sin(3 * t + np.arange(20))
    motion = 0.02 * np.cumsum(np.sign(speed) * np.maximum(np.abs(speed) - 0.1, 0.0), axis=0)
    x = 1e-3 * np.round(1e3 * motion + 0.3 * rng.normal(size=motion.shape))
    for columns in np.split(x, 10, axis=1):
        np.testing.assert_array_equal(_repaired(columns), columns)


def test_zeros_within_the_noise_of_a_torque_stay() -> None:
    """Five values within a tenth of the noise of zero that are exactly zero."""
    x = _clean(1, 3e-2, 0.0, 0.0)
    x[np.argsort(np.abs(x[:, 0]))[:5], 0] = 0.0
    np.testing.assert_array_equal(_repaired(x), x)


@pytest.mark.parametrize("seed", [8, 16, 19])
@pytest.mark.parametrize(("highest", "width"), [(60, 0.0), (250, 0.05)])
def test_reversal_within_transient_is_no_spike(seed: int, highest: int, width: float) -> None:
    """Friction that changes sign for one to three samples in the first period, which begins at rest.

    width: of the change of sign, over the standard deviation of the speed.
    """
    t = np.arange(P * N)
    x = wave(t, seed, np.arange(2, highest))
    start = np.clip(t / 250, 0, 1)
    x *= (start**3 * (10 - 15 * start + 6 * start**2))[:, None] / x[N:].std(axis=0)
    speed = np.gradient(x[:, 1])
    x[:, 0] += np.tanh(speed / (width * speed.std())) if width else np.sign(speed)
    x += 3e-3 * np.random.default_rng(seed).normal(size=x.shape)
    np.testing.assert_array_equal(_repaired(x), x)


def test_equal_disturbances_of_two_periods_are_not_denied() -> None:
    """Equal ones below the roughness of the signal outvote the third period, which is counted; rough ones do not."""
    x = wave(np.arange(P * N), 3, np.arange(2, 400))
    x = x / x.std(axis=0) + 1e-3 * np.random.default_rng(0).normal(size=x.shape)
    counts = []
    for periods, size in (((0, 1), 0.5), ((0,), 20.0), ((0, 1), 20.0)):
        damaged, log = x.copy(), LogReport("log.csv", LOG.names, 1000.0)
        damaged[300 + N * np.array(periods), 0] += size
        repair(damaged, ROLES, float(N), False, log, lambda drivers: None)
        counts.append((log.findings.repairs[MASKED], log.findings.repairs[OUTVOTED]))
    assert counts == [(1, 1), (1, 0), (2, 0)]


@pytest.mark.parametrize("transient", [0.0, 1.0])
def test_clean_logs_are_not_touched(transient: float) -> None:
    """Of 100 logs with noise and steps of several sizes none changes in a sample."""
    for seed in range(50):
        q, noise = (0.0, 1e-4, 1e-2, 0.1)[seed % 4], (0.0, 1e-3, 3e-2)[seed % 3]
        clean = _clean(seed, noise, q, transient)
        np.testing.assert_array_equal(_repaired(clean), clean)
