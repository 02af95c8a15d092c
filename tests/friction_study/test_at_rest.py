"""Presliding friction: bristles from responses at rest, Maxwell slip elements from loops."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from plants import lugre_joint as plant
from plants.lugre_joint import moved, multisine
from plants.marks import slow
from plants.refusals import advised, refused
from scipy.signal import butter, cont2discrete, lfilter, sosfilt

from elastid.base.arrays import FloatArray
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.constant_velocity import FrictionCurve
from elastid.friction_study.presliding import (
    Elements,
    PreslidingFit,
    PreslidingResponse,
    _fit,
    bristle_ratio,
    fit_presliding,
    fit_presliding_responses,
    presliding_responses,
)
from elastid.friction_study.result import identify_friction
from elastid.friction_study.sliding_friction import SlidingFriction
from elastid.friction_study.spec import FrictionSpec
from elastid.model.formulation import ElasticJoint
from elastid.study import load_robot

JOINT = ElasticJoint(plant.MOTOR, plant.LINK, plant.STIFFNESS, plant.DAMPING)
RATE, PERIOD, COUNT = plant.RATE_HZ, plant.PERIOD, plant.COUNT


def record(name: str, peak: float, seed: int, noise: float, count: float, *, is_noise: bool = False) -> FrictionRecord:
    """From rest, torque held from sample to sample, with noise that is not logged."""
    rng = np.random.default_rng(seed)
    u = multisine(peak, rng)
    if is_noise:
        u = sosfilt(butter(4, (3, 90), "bandpass", fs=RATE, output="sos"), rng.standard_normal(20_000))
        u *= peak / 3 / u.std()
    q = moved(u + noise * rng.standard_normal(len(u)))
    return FrictionRecord(
        name, "1", "presliding_test", RATE, np.round(q / count) * count if count else q, u, resolution=count,
        period_samples=None if is_noise else PERIOD, hold="zero-order",
    )  # fmt: skip


def measured(peaks: Sequence[float], seed: int, noise: float = 0.0, count: float = 0.0) -> list[FrictionRecord]:
    return [
        record(f"{peak} {r}", peak, 100 * seed + 10 * i + r, noise, count)
        for i, peak in enumerate(peaks)
        for r in range(2)
    ]


def errors(found: PreslidingFit) -> tuple[float, float]:
    return found.sigma_0 / plant.SIGMA_0 - 1, found.sigma_1 / plant.SIGMA_1 - 1


def test_identified_bristles_are_passive(tmp_path):
    """Damping of bristles falls over at most 4 sqrt(2 e) F_c / sigma_1."""
    (tmp_path / "robot.yml").write_text(plant.ROBOT)
    v = np.geomspace(0.5, 60, 12)
    torque = plant.COULOMB + plant.VISCOUS * v
    curve = FrictionCurve("joint 1", v, 0 * v, torque, 0 * v + 0.002, 0 * v, np.full(12, np.nan))
    records = FrictionRecords(tuple(measured((0.075, 0.15), 1)))
    found = identify_friction(
        load_robot(tmp_path / "robot.yml"), [SlidingFriction("1", False, curve)], records, FrictionSpec()
    )
    numbers, (joint,) = {number.name: number for number in found.numbers}, found.joints
    truth = {"Fc_m1": plant.COULOMB, "f_m1": plant.VISCOUS, "s0_m1": plant.SIGMA_0, "s1_m1": plant.SIGMA_1}
    assert {name: number.value for name, number in numbers.items()} == pytest.approx(truth, rel=0.01)
    assert joint.viscous == numbers["f_m1"].value
    bristles = joint.friction.lugre
    assert (bristles.stiffness, bristles.damping) == (numbers["s0_m1"].value, numbers["s1_m1"].value)
    largest = 4 * np.sqrt(2 * np.e) * joint.friction.coulomb / bristles.damping
    assert 0.8 * largest < bristles.damping_velocity < largest


def test_noise_without_a_period_identifies_bristles() -> None:
    """20 s of noise from 3 to 90 Hz at two amplitudes, within 1 and 2 %."""
    logs = [record("", peak, round(100 * peak), 0.005, plant.FINE_COUNT, is_noise=True) for peak in (0.1, 0.2)]
    found = fit_presliding_responses("joint 1", presliding_responses(logs), JOINT, (plant.VISCOUS, 0.0))
    assert np.all(np.abs(errors(found)) < [0.01, 0.02])


@pytest.mark.parametrize("inertias", [(1.0, 1.0), (1.05, 0.875)])
@pytest.mark.parametrize("factor", [0.8, 1.0, 1.2])
def test_noise_and_counts_leave_the_numbers_inside_their_intervals(
    inertias: tuple[float, float], factor: float
) -> None:
    """16 bit, torque noise of a seventh of the torque, a spring of the file that is off, or inertias as well."""
    of_motor, of_link = inertias
    joint = ElasticJoint(of_motor * plant.MOTOR, of_link * plant.LINK, factor * plant.STIFFNESS, plant.DAMPING)
    found = fit_presliding_responses("joint 1", noisy_responses(), joint, (plant.VISCOUS, 0.0))
    std = np.sqrt(np.diag(found.covariance)) / [plant.SIGMA_0, plant.SIGMA_1]
    assert np.all(np.abs(errors(found)) < 3 * std)
    assert std[0] < 0.008


@cache
def noisy_responses() -> tuple[PreslidingResponse, ...]:
    return presliding_responses(measured((0.15, 0.3), 2, 0.02, COUNT))


@pytest.mark.parametrize(("inertia", "sigma_0", "sigma_1"), [(0.03, 300.0, 0.5), (0.5, 4000.0, 3.0)])
def test_bristles_of_a_rigid_joint_are_found_with_its_inertia(inertia: float, sigma_0: float, sigma_1: float) -> None:
    """That never slip: a spring and a damper to ground, exactly, its torque held from sample to sample."""
    b, a, _ = cont2discrete(([1.0], [inertia, sigma_1, sigma_0]), 1 / RATE)
    torques = [multisine(peak, np.random.default_rng(r)) for peak in (0.05, 0.1) for r in range(2)]
    records = [
        FrictionRecord(
            f"{i}", "1", "presliding_test", RATE, lfilter(b.ravel(), a, u), u, period_samples=PERIOD, hold="zero-order"
        )
        for i, u in enumerate(torques)
    ]
    found = fit_presliding_responses("joint 1", presliding_responses(records))
    assert found.sigma_0 == pytest.approx(sigma_0, rel=3e-3)
    assert found.sigma_1 == pytest.approx(sigma_1, rel=0.02)


@pytest.mark.parametrize("amplitude", [0.1, 0.3])
def test_slip_under_a_gaussian_motion_is_as_it_is_linearised(amplitude: float) -> None:
    """z' = v - |v| z / z_s by steps of a millisecond: z over q, in the mean over all lines, to a tenth of the slip."""
    n, lines = 1 << 14, np.arange(50, 500)
    Q = np.zeros(n // 2 + 1, complex)
    Q[lines] = np.exp(2j * np.pi * np.random.default_rng(0).random(len(lines)))
    omega = 2 * np.pi * np.arange(len(Q)) * 1000.0 / n
    Q *= amplitude / np.fft.irfft(Q).std()
    q, v = np.fft.irfft(Q), np.fft.irfft(1j * omega * Q)
    z = np.zeros(2 * n)
    for i in range(1, 2 * n):
        change, slip = q[i % n] - q[(i - 1) % n], abs(q[i % n] - q[(i - 1) % n]) / 2
        z[i] = (z[i - 1] * (1 - slip) + change) / (1 + slip)
    motion = SimpleNamespace(rms_position=q.std(), rms_velocity=v.std())
    linearised = bristle_ratio(omega[lines], motion, 1.0)
    error = np.fft.rfft(z[n:])[lines] / Q[lines] - linearised
    assert abs(np.mean(error)) < 0.1 * np.mean(np.abs(1 - linearised))


RATE_PRESLIDING, COUNT_PRESLIDING = 200.0, 2 * np.pi / 2**16
# Ten elements, 790 Nm/rad, break-away 1.6 Nm.
THRESHOLDS = np.geomspace(6e-4, 8e-3, 10)
STIFFNESS = 1.6 / 10 / THRESHOLDS * 790 / np.sum(1.6 / 10 / THRESHOLDS)
TRUTH_PRESLIDING = Elements(STIFFNESS, THRESHOLDS * 1.6 / float(STIFFNESS @ THRESHOLDS), 0.0)
REACH = 0.012


def growing() -> FloatArray:
    """Loops of 0.5 Hz that grow from 2 to 100 % of the reach."""
    t = np.arange(8000) / RATE_PRESLIDING
    return REACH * np.clip(0.02 + 0.98 * t / 40, 0, 1) * np.sin(2 * np.pi * 0.5 * t)


def loops(q: FloatArray, torque: FloatArray, counts: float = 0.0) -> FrictionRecord:
    return FrictionRecord("loops", "1", "presliding_loops", RATE_PRESLIDING, q, torque, resolution=counts)


def log(seed: int) -> FrictionRecord:
    """Measured with torque noise and an encoder."""
    q = growing()
    torque = TRUTH_PRESLIDING.torque(q) + 0.1 + 0.02 * np.random.default_rng(seed).standard_normal(len(q))
    return loops(np.round(q / COUNT_PRESLIDING) * COUNT_PRESLIDING, torque, COUNT_PRESLIDING)


def error(found: Elements) -> float:
    """Rms on the unseen loops, in parts of break-away, after the first half loop."""
    t = np.arange(4000) / RATE_PRESLIDING
    q = REACH * (0.55 * np.sin(2 * np.pi * 0.3 * t) + 0.25 * np.sin(2 * np.pi * 1.1 * t + 1))  # loops in loops
    missed = found.torque(q) - found.offset - TRUTH_PRESLIDING.torque(q)
    return float(np.sqrt(np.mean(missed[400:] ** 2))) / 1.6


@pytest.mark.slow
def test_few_elements_are_chosen_and_nearly_as_good() -> None:
    found = fit_presliding(log(1), 0.5)
    assert 3 <= np.sum(found.stiffness > 0) <= 8
    assert error(found) < 0.025
    assert error(fit_presliding(log(1), 0.5, elements=1)) > 3 * error(found)
    assert found.offset == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize("elements", [slow(None), 1])
def test_one_bristle_is_one_element(elements):
    """A single stop operator: thresholds elsewhere get nothing, and one element is enough."""
    one = Elements(np.array([300.0]), np.array([4e-3]), 0.0)
    q = growing()
    torque = one.torque(q) + 0.3 + 0.01 * np.random.default_rng(0).standard_normal(len(q))
    found = fit_presliding(loops(q, torque), None, elements)
    assert len(found.stiffness) == 1
    assert (found.offset, found.mean_square) == pytest.approx((0.3, 1e-4), rel=0.05)
    assert found.stiffness[0] == pytest.approx(300, rel=0.01)
    assert found.threshold[0] == pytest.approx(4e-3, rel=0.01)


def test_loops_of_a_few_counts_are_refused() -> None:
    with refused("friction/presliding-loops", place="loops of joint 1") as caught:
        fit_presliding(replace(log(0), resolution=5e-3), None)
    moved, least = advised(caught, "moved by"), advised(caught, "more than")
    assert moved == pytest.approx(np.ptp(log(0).position), rel=0.02)
    assert advised(caught, "rad,") == pytest.approx(moved / 5e-3, rel=0.02)
    fit_presliding(replace(log(0), resolution=0.99 * moved / least), None)


@pytest.mark.parametrize("offset", [-3.0, 3.0])
def test_stiffnesses_and_offset_of_exact_loops_are_recovered(offset: float) -> None:
    """From the used samples only, with given thresholds."""
    q = 1e-3 * np.cumsum(np.random.default_rng(0).standard_normal(400))
    true = Elements(np.array([500.0, 200.0]), np.array([1e-3, 8e-3]), offset)
    used = np.arange(len(q)) >= 50
    torque = np.where(used, true.torque(q), 99.0)
    fit = _fit(q, torque, true.threshold, used)
    np.testing.assert_allclose(fit.stiffness, true.stiffness)
    assert fit.offset == pytest.approx(offset)
    assert fit.mean_square < 1e-20
    slip = true.to_maxwell_slip()
    assert (slip.stiffness, slip.shares) == ((500, 200), pytest.approx((0.5 / 2.1, 1.6 / 2.1)))
    assert slip.attraction == pytest.approx(210)
