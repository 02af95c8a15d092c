"""The mean frequency response and its covariances against closed forms and Monte Carlo."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.marks import slow
from plants.random_plants import ALL_PERIODS, experiments_of, periods_of, record_of
from plants.refusals import refused
from plants.two_mass import circular

from elastid.fit.problem.smoothed_noise import smooth_noise
from elastid.frf.estimate import LOCAL, estimate, motor_motion
from elastid.frf.estimators import METHODS
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Record
from elastid.response import Response

RATE = 500.0


def _record(lines: np.ndarray, U: np.ndarray, Y: np.ndarray, *, P: int = 2, experiment: int = 0) -> Record:
    """P periods of the spectra U (F, n_u), Y (F, n_y)."""
    return record_of(*periods_of(lines, 256, P, U, Y), 0, experiment, n=256, rate_hz=RATE)


def _plant(F: int, n_y: int, n_u: int, seed: int = 0) -> np.ndarray:
    return circular(np.random.default_rng(seed), (F, n_y, n_u))


def _experiments(G: np.ndarray, lines: np.ndarray, M: int, rng: np.random.Generator, **how: object) -> list[Record]:
    """M realisations of n_u experiments without references."""
    records = experiments_of(G, lines, M, rng, 256, rate_hz=RATE, **how)
    return [replace(record, r=None) for record in records]


@given(n_y=st.integers(1, 4), n_u=st.integers(1, 4), extra=st.integers(0, 2), seed=st.integers(0, 10**6))
@settings(deadline=None, max_examples=25)
def test_any_number_of_inputs_outputs_and_experiments_gives_the_plant(
    n_y: int, n_u: int, extra: int, seed: int
) -> None:
    """Without noise G is exact, with as many experiments as inputs and, by least squares, with more."""
    rng, lines = np.random.default_rng(seed), np.arange(3, 40, 3)
    G = _plant(len(lines), n_y, n_u, seed)
    records = []
    for e in range(n_u + extra):
        U = np.exp(2j * np.pi * rng.random((len(lines), n_u))) + 3 * np.eye(n_u)[e % n_u]
        records.append(_record(lines, U, np.einsum("fyu,fu->fy", G, U), experiment=e))
    response = estimate(records, ALL_PERIODS, lines)
    np.testing.assert_allclose(response.G, G, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(response.freq_hz, lines * RATE / 256)
    assert response.total is None


def test_zero_order_hold_delays_and_weakens_torque() -> None:
    """u is held for a sample: Y = G H U, so the estimate is the plant and not the plant with its hold."""
    lines = np.arange(1, 100)
    record = _experiments(np.ones((99, 1, 1), dtype=complex), lines, 1, np.random.default_rng(0))[0]
    held = replace(record, hold="zero-order")
    G = estimate([held], ALL_PERIODS, lines).G[:, 0, 0]
    np.testing.assert_allclose(G, 1 / held.hold_response(lines * RATE / 256)[:, 0], rtol=1e-10)


@pytest.mark.parametrize("injection", ["reference", "torque"])
def test_closed_loop_error_obeys_its_identity(injection: str) -> None:
    """One block in closed loop: G^ - G = V (R - V)^-1 (F^-1 + G), or V (R - F V)^-1 (I + F G), to 1e-12."""
    rng, lines, n = np.random.default_rng(3), np.arange(2, 30), 3
    shape = (len(lines), n, n)
    G, R, V, C = (circular(rng, shape) for _ in range(4))
    eye, V = np.eye(n), 0.05 * V
    R, C = R + 3 * eye, C + 2 * eye
    if injection == "reference":  # U = C (R - Y)
        U = np.linalg.solve(eye + C @ G, C @ (R - V))
        error = V @ np.linalg.inv(R - V) @ (np.linalg.inv(C) + G)
    else:  # U = R - C Y
        U = np.linalg.solve(eye + C @ G, R - C @ V)
        error = V @ np.linalg.inv(R - C @ V) @ (eye + C @ G)
    Y = G @ U + V
    records = [_record(lines, U[:, :, e], Y[:, :, e], experiment=e) for e in range(n)]
    found = estimate(records, ALL_PERIODS, lines).G - G
    assert np.max(np.abs(found - error)) < 1e-12 * max(1.0, np.max(np.abs(error)))


def _monte_carlo(
    n_y: int, n_u: int, runs: int, distortion: float = 0.0, scale: Sequence[float] = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean over lines and runs of true, noise and total covariance of vec G, each (n_y n_u, n_y n_u).

    White noise, correlated between outputs and between inputs, on both; the plant is the same at every line.
    """
    rng, lines = np.random.default_rng(7), np.arange(5, 105)
    plant = np.random.default_rng(1)
    G = np.repeat(circular(plant, (1, n_y, n_u)), len(lines), axis=0)
    mix_u = 0.05 * (np.eye(n_u) + 0.5 * np.tri(n_u))
    mix_y = 0.2 * (np.eye(n_y) + 0.5 * np.tri(n_y))
    true, noise, total = [], [], []
    for _ in range(runs):
        records = _experiments(G, lines, 3, rng, scale=scale, distortion=distortion, P=4, noise=(mix_u, mix_y))
        response = estimate(records, ALL_PERIODS, lines)
        error = (response.G - G).transpose(0, 2, 1).reshape(len(lines), -1)  # column-major vec
        true.append(np.mean(error[:, :, None] * error[:, None, :].conj(), axis=0))
        noise.append(np.mean(response.noise.full(), axis=0))
        total.append(np.mean(response.total.full(), axis=0))
    return np.mean(true, axis=0), np.mean(noise, axis=0), np.mean(total, axis=0)


def test_noise_covariance_is_that_of_the_estimate_in_monte_carlo() -> None:
    """Noise on inputs and outputs: variances within 5 %, the whole matrix within 5 % of its diagonal."""
    true, noise, total = _monte_carlo(3, 3, runs=60)
    scale = np.sqrt(np.outer(np.diag(true).real, np.diag(true).real))
    np.testing.assert_allclose(np.diag(noise).real, np.diag(true).real, rtol=0.05)
    assert np.max(np.abs(noise - true) / scale) < 0.05
    assert np.max(np.abs(total - true) / scale) < 0.06


@pytest.mark.parametrize(("scale", "runs"), [slow((), 150), ((1.0, 0.4, 2.0), 60)])
def test_total_covariance_holds_the_distortion_that_noise_cannot_see(scale: tuple[float, ...], runs: int) -> None:
    """An error that repeats over periods and changes with the phases; also where realisations differ in amplitude."""
    true, noise, total = _monte_carlo(3, 2, runs, distortion=0.3, scale=scale)
    np.testing.assert_allclose(np.diag(total).real, np.diag(true).real, rtol=0.06)
    assert np.all(np.diag(noise).real < 0.5 * np.diag(true).real)


def test_few_degrees_of_freedom_give_singular_usable_covariance() -> None:
    """Three outputs from two periods of one input: of rank one at each line, and regular over its neighbours."""
    rng, lines = np.random.default_rng(0), np.arange(5, 50)
    records = _experiments(_plant(45, 3, 1), lines, 2, rng, noise=(0.0, 1.0))
    one = estimate(records[:1], ALL_PERIODS, lines)
    assert (one.noise.form, one.noise.dof) == ("kronecker", 1)
    assert np.linalg.matrix_rank(one.noise.full()[20]) == 1
    assert np.linalg.eigvalsh(smooth_noise(one).smooth.full()).min() > 0
    both = estimate(records, ALL_PERIODS, lines)
    assert (both.total.form, both.total.dof) == ("kronecker", 1)


def test_records_with_unequal_periods_are_weighted_by_count() -> None:
    """P = 2 in one experiment and 16 in the other: the variance of the mean of inputs is the sum of both parts."""
    rng, lines = np.random.default_rng(0), np.arange(5, 120)
    U = np.eye(2)[:, None, :] * np.ones((2, len(lines), 2))
    records = [_record(lines, U[e], U[e], P=P, experiment=e) for e, P in ((0, 2), (1, 16))]
    noisy = [replace(record, y=record.y + 0.1 * rng.normal(size=record.y.shape)) for record in records]
    response = estimate(noisy, ALL_PERIODS, lines)
    variance = response.noise.variance.mean(axis=0)
    np.testing.assert_allclose(variance[:, 0] / variance[:, 1], 8, rtol=1e-9)
    np.testing.assert_allclose(variance[:, 0], 4 * 0.01 / 256 / 2, rtol=0.08)


def test_lines_without_excitation_are_left_out_with_a_word() -> None:
    """`full` where every second line is excited: the others have no answer."""
    rng, lines = np.random.default_rng(0), np.arange(5, 60, 2)
    records = _experiments(_plant(len(lines), 2, 2), lines, 2, rng, P=8, noise=(1e-3, 1e-3))
    response = estimate(records, replace(ALL_PERIODS, lines="full", band_hz=(9.0, 116.0)))
    np.testing.assert_allclose(response.freq_hz, lines * RATE / 256)
    assert response.notes[0].code == "frf/lines-discarded"


def test_lines_can_be_stated_planned_or_limited_to_a_band() -> None:
    """planned and band together; an empty band is refused."""
    lines = np.arange(5, 60, 2)
    records = _experiments(_plant(len(lines), 1, 1), lines, 1, np.random.default_rng(0))
    in_band = estimate(records, replace(ALL_PERIODS, band_hz=(20.0, 60.0)), lines).freq_hz
    assert in_band[0] >= 20.0
    assert in_band[-1] <= 60.0
    odd = estimate(records, replace(ALL_PERIODS, lines="odd", band_hz=(20.0, 60.0))).freq_hz
    np.testing.assert_array_equal(odd, in_band)
    with refused("frf/lines", place="configuration c"):
        estimate(records, replace(ALL_PERIODS, band_hz=(150.0, 200.0)), lines)
    with refused("excitation/lines"):
        estimate(records, replace(ALL_PERIODS, lines="full", band_hz=(20.0, 20.5)))


N, PERIODS, LINES = 256, 6, np.arange(3, 60)
Change = Callable[[Record], Record]


def _records() -> list[Record]:
    """Two realisations of two experiments, two inputs and outputs, with noise and the torque that was injected."""
    return experiments_of(
        _plant(len(LINES), 2, 2), LINES, 2, np.random.default_rng(0), N, PERIODS, (0.01, 0.01), rate_hz=RATE
    )


def _with(channel: int, value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.where(np.arange(2) == channel, value, x)


def _noise(record: Record) -> Record:
    rng = np.random.default_rng(10 * record.realisation + record.experiment)
    return replace(record, u=rng.normal(size=record.u.shape), y=rng.normal(size=record.y.shape))


NO_INPUT = {
    "no torque": lambda r: replace(r, u=0 * r.u),
    "one motor at rest": lambda r: replace(r, u=_with(1, 0.0)(r.u)),
    "one torque logged twice": lambda r: replace(r, u=np.repeat(r.u[:, :1], 2, axis=1)),
    "noise alone": _noise,
}
ABSURD = {
    "huge torque": lambda r: replace(r, u=1e200 * r.u),
    "huge motion": lambda r: replace(r, y=1e250 * r.y),
    "vanishing torque": lambda r: replace(r, u=1e-200 * r.u),
    "vanishing motion": lambda r: replace(r, y=1e-160 * r.y),
}


@pytest.mark.parametrize("method", [*METHODS, *LOCAL])
@pytest.mark.parametrize("change", NO_INPUT.values(), ids=NO_INPUT)
def test_inputs_that_tell_nothing_are_refused(change: Change, method: str) -> None:
    """By mean over realisations, pooled, and local methods alike; the message names the inputs."""
    with refused("frf/inputs-not-separable", "frf/lines"):
        estimate([change(r) for r in _records()], EstimatorSpec(method=method), LINES)


@pytest.mark.parametrize("method", ["arithmetic", "errors_in_variables", "local_rational"])
@pytest.mark.parametrize("change", ABSURD.values(), ids=ABSURD)
def test_sizes_beyond_any_sensor_are_refused_with_their_channel(change: Change, method: str) -> None:
    """A wrong unit, or a placeholder for a missing value; squares of it would overflow."""
    with refused("records/missing-samples", place="record c-r0-e0"):
        estimate([change(r) for r in _records()], EstimatorSpec(method=method), LINES)


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_an_output_that_does_not_move_is_named(value: float) -> None:
    records = [replace(r, y=_with(1, value)(r.y)) for r in _records()]
    response = estimate(records, EstimatorSpec(method="arithmetic"), LINES)
    (note,) = [note for note in response.notes if note.code == "frf/low-signal-to-noise"]
    assert "joint 2" in note.text
    assert np.abs(response.G[:, 1]).max() < 1e-9
    assert "frf/low-signal-to-noise" not in [n.code for n in estimate(_records(), EstimatorSpec(), LINES).notes]


RATE_HZ, N, PERIODS = 500.0, 1000, 3
EXCITED, CARRIER, DISTORTED = np.arange(9, 90, 4), 2, np.arange(10, 90, 8)
MOTORS = ("motor 1", "motor 2")
POSTURE = np.array([0.4, -0.9])
FEEDBACK = np.array([np.diag([3e4, 0.0]), [[9e3, 100.0], [50.0, 4e3]], np.diag([300.0, 120.0])])


def records(velocities: bool = False) -> tuple[tuple[Record, ...], np.ndarray]:
    """Two experiments of motors under a controller, and the mean squares (2, 2) of the excited lines together."""
    rng, t, known, power = np.random.default_rng(3), np.arange(N * PERIODS) / RATE_HZ, [], np.zeros((2, 2))
    s = 2j * np.pi * RATE_HZ / N * np.arange(N // 2)
    for e in range(2):
        q = np.zeros((N // 2, 2), complex)
        for lines, size in ((EXCITED, 1e-3), ([CARRIER], 1e-2), (DISTORTED, 2e-5)):
            q[lines] = size * circular(rng, (len(lines), 2))
        power += np.real(q[EXCITED].T @ q[EXCITED].conj()) / 4
        r = np.zeros_like(q)
        r[EXCITED] = 50.0 * rng.standard_normal((len(EXCITED), 2))
        over = np.where(s == 0, 1, s)[:, None]
        u = r - np.einsum("iab,kib->ka", FEEDBACK, np.stack([q / over, q, q * s[:, None]], axis=1))
        wave = np.exp(np.outer(t, s))
        y = (wave @ (q * s[:, None] if velocities else q)).real + (0 if velocities else POSTURE)
        quantity = ("velocity" if velocities else "position",) * 2
        fixed = f"{e}", Configuration("c", POSTURE), 0, e, RATE_HZ, N, MOTORS, MOTORS, quantity
        known.append(Record(*fixed, (wave @ u).real, y, (wave @ r).real))
    return tuple(known), power


def response() -> Response:
    G = np.ones((len(EXCITED), 2, 2), complex)
    return Response(EXCITED * RATE_HZ / N, G, MOTORS, MOTORS, "acceleration", Configuration("c", POSTURE))


@pytest.mark.parametrize("velocities", [False, True])
@pytest.mark.parametrize("injected", [False, True])
def test_motion_and_feedback_are_those_of_the_records(velocities: bool, injected: bool) -> None:
    """Mean squares of angles, the carrier's among them, and F at all lines where the injected torque is known.

    Without it the lines between the excited ones show F, where distortion moves the motors.
    """
    logs, power = records(velocities)
    found = motor_motion(logs if injected else [replace(log, r=None) for log in logs], response())
    assert found.feedback is not None
    in_band = np.isin(np.rint(found.freq_hz * N / RATE_HZ), EXCITED)
    np.testing.assert_allclose(found.power[in_band].sum(axis=0).real, power, rtol=1e-9)
    assert found.freq_hz[0] == CARRIER * RATE_HZ / N
    assert found.rms.min() > 1e-3
    np.testing.assert_allclose(found.mean, np.full(2, np.nan) if velocities else POSTURE, atol=1e-9)
    np.testing.assert_allclose(found.feedback, FEEDBACK, rtol=1e-6, atol=0.1)


def test_torques_that_no_feedback_explains_show_none() -> None:
    """Of torques that are noise; and nothing is known of motion where no motor was logged."""
    logs, _ = records()
    rng = np.random.default_rng(0)
    noise = [replace(log, u=1e5 * rng.standard_normal(log.u.shape)) for log in logs]
    assert motor_motion(noise, response()).feedback is None
    assert motor_motion([replace(log, outputs=("joint 1", "joint 2")) for log in logs], response()) is None
