"""A record replayed through the model that made it fits but for the noise, whether or not it is periodic."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from elastid.frf.spec import EstimatorSpec
from elastid.linear.linear_model import DELAY, LinearModel, state_space
from elastid.record import Configuration, Record
from elastid.validation.elastic_twin import describe_replays, replay

RATE_HZ, N = 500.0, 1000
BAND_HZ = (2.0, 80.0)
AUTO = EstimatorSpec(transient_periods="auto")


def two_axes(stiffness=(2e4, 3e4), quantity="acceleration"):
    """Two motors, each with a link on a spring, the links coupled by their mass; modes at 7 to 20 Hz."""
    M = np.array([[4.0, 0, 0, 0], [0, 3.0, 0, 0], [0, 0, 6.0, 1.5], [0, 0, 1.5, 5.0]])
    K = np.zeros((4, 4))
    for i, k in enumerate(stiffness):
        v = np.eye(4)[i] - np.eye(4)[2 + i]
        K += k * np.outer(v, v)
    D = 2e-3 * K + np.diag([3.0, 2.0, 1.0, 1.0])
    names = ("motor 1", "motor 2")
    return LinearModel(
        Configuration("c1", np.zeros(2)),
        (DELAY,),
        np.zeros(1),
        M,
        D,
        K,
        {},
        np.eye(4)[:, :2],
        np.eye(4)[:2],
        names,
        names,
        quantity,
    )


def moved(model, u, x0=None):
    """Positions (n, n_y) under a torque (n, n_u) that is held from sample to sample: exact, step by step."""
    system = state_space(replace(model, quantity="position"), np.zeros(1))
    n, n_u = system.B.shape
    block = expm(np.block([[system.A, system.B], [np.zeros((n_u, n + n_u))]]) / RATE_HZ)
    x = np.zeros(n) if x0 is None else np.array(x0)
    y = np.empty((len(u), len(system.C)))
    for i, torque in enumerate(u):
        y[i] = system.C @ x
        x = block[:n, :n] @ x + block[:n, n:] @ torque
    return y


def torque(seed, periods=1, half_wave=False, n_u=2):
    """A multisine of random phases, or noise where periods is None."""
    rng = np.random.default_rng(seed)
    if periods is None:
        return np.cumsum(rng.standard_normal((N, n_u)), axis=0) + 20 * rng.standard_normal((N, n_u))
    lines = np.arange(5, 161, 2 if half_wave else 1)
    spectrum = np.zeros((N // 2 + 1, n_u), complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random((len(lines), n_u))) * N / 2
    return np.tile(np.fft.irfft(spectrum, n=N, axis=0), (periods, 1))


def record(model, u, settle=20, noise=0.0, seed=0, name="r1", half_wave=False, quantity="position"):
    """What is logged of the periods of u after `settle` of them."""
    y = moved(model, np.vstack([np.tile(u[:N], (settle, 1)), u]))[settle * N :]
    y = y + noise * np.random.default_rng(seed).standard_normal(y.shape)
    return Record(
        name,
        model.configuration,
        0,
        0,
        RATE_HZ,
        N,
        model.inputs,
        model.outputs,
        (quantity,) * 2,
        u,
        y,
        hold="zero-order",
        half_wave=half_wave,
    )


@pytest.mark.parametrize("half_wave", [False, True])
def test_a_periodic_record_of_the_model_itself_is_replayed_exactly(half_wave):
    """More than 99.8 % of the accelerations; the rest are images of the held torque above half the rate."""
    model = two_axes()
    found = replay([record(model, torque(1, 3, half_wave), half_wave=half_wave)], model, np.zeros(1), BAND_HZ, AUTO)
    assert found.fit_percent.shape == (1, 2)
    assert found.worst > 99.8
    np.testing.assert_allclose(found.replayed, found.measured, atol=5e-3 * np.abs(found.measured).max())
    assert found.band_hz == (2.5 if half_wave else 2.0, 80.0 - half_wave * 0.5)


@pytest.mark.parametrize("seed", range(2))
def test_one_period_that_does_not_go_round_is_replayed_with_its_ends(seed):
    """Drifting noise as torque, from a state that is not rest: more than 99.9 %."""
    model, rng = two_axes(), np.random.default_rng(seed)
    u = torque(seed, None)
    y = moved(model, u, np.r_[rng.standard_normal(4) * 0.05, rng.standard_normal(4)])
    one = Record("r1", model.configuration, 0, 0, RATE_HZ, N, model.inputs, model.outputs, ("position",) * 2, u, y)
    held = replace(one, hold="zero-order")
    found = replay([held], model, np.zeros(1), BAND_HZ, AUTO)
    assert found.worst > 99.9
    assert np.isnan(found.reachable_percent).all()


def test_the_noise_alone_is_what_a_true_model_leaves():
    """Fit and reachable fit agree within 0.3 % for the true model; 30 % of stiffness more fits far worse."""
    model = two_axes()
    rec = record(model, torque(2, 8), noise=1e-5, seed=3)
    true = replay([rec], model, np.zeros(1), BAND_HZ, AUTO)
    assert np.all(true.fit_percent < 99)
    np.testing.assert_allclose(true.fit_percent, true.reachable_percent, atol=0.3)
    wrong = replay([rec], two_axes((2.6e4, 3e4)), np.zeros(1), BAND_HZ, AUTO)
    np.testing.assert_allclose(wrong.reachable_percent, true.reachable_percent, atol=2)
    assert wrong.fit_percent[0, 0] < true.fit_percent[0, 0] - 20


def test_the_record_that_fits_worst_is_shown_and_named():
    """Two records, the second of a stiffer robot: its signals are kept, both stand in the table."""
    model, stiffer = two_axes(), two_axes((2.6e4, 3e4))
    records = [record(model, torque(4, 3), name="good"), record(stiffer, torque(5, 3), name="bad")]
    found = replay(iter(records), model, np.zeros(1), BAND_HZ, AUTO)
    assert found.records == ("good", "bad")
    assert found.shown == "bad"
    assert found.fit_percent[0].min() > 99.8
    assert found.worst == found.fit_percent[1].min() < 80
    error = found.measured - found.replayed
    left = np.sqrt(np.mean(error**2, axis=0) / np.mean(found.measured**2, axis=0))
    np.testing.assert_allclose(found.fit_percent[1], 100 * (1 - left), atol=1.0)
    assert "record bad" in describe_replays([found])


@pytest.mark.parametrize(("left_out", "dropped"), [((0,), "auto"), ((1,), "auto"), ((), 1)])
def test_where_one_period_counts_it_alone_is_replayed(left_out, dropped):
    """The other was lost, or the study drops it: spoilt here, and not seen."""
    rec = record(two_axes(), torque(9, 2))
    bad = left_out[0] if left_out else 0
    y = np.array(rec.y)
    y[bad * N : (bad + 1) * N] += 1e-2 * np.random.default_rng(0).standard_normal((N, 2))
    spoilt = replace(rec, y=y, left_out=left_out)
    found = replay([spoilt], two_axes(), np.zeros(1), BAND_HZ, EstimatorSpec(transient_periods=dropped))
    assert found.worst > 99.5
    assert np.isnan(found.reachable_percent).all()
