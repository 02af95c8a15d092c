"""A filter follows friction that warms up, through stops, with bands that hold it."""

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused

from elastid.base.arrays import FloatArray
from elastid.friction_study.extended_kalman_filter import (
    FILTER,
    FilterNoise,
    FollowedJoint,
    JointSamples,
    KalmanFilter,
    Track,
    consistency,
    estimate_noise,
)
from tests.plants.warm_joint import COUNT, FOLLOWED, RATE_HZ, TORQUE_STD, WarmRun, rich, simulate, stops_and_moves

DRIFT = {"Fc": 6e-3, "f": 25e-3, "offset": 1e-3}
NOISE = FilterNoise(angle=COUNT / np.sqrt(12), torque=TORQUE_STD, drift=DRIFT)
SETTLED_S = 10.0


@pytest.fixture(scope="module")
def kalman() -> KalmanFilter:
    """The joint's filter, compiled once."""
    return KalmanFilter(FOLLOWED, RATE_HZ)


def followed(kalman: KalmanFilter, run: WarmRun, noise: FilterNoise = NOISE) -> Track:
    """The track from rest."""
    return kalman.run([run.samples], noise)


def torque_error(track: Track, run: WarmRun) -> float:
    """Of sliding friction after settling, relative."""
    moves = (np.abs(run.velocity) > 5) & (np.arange(len(run.velocity)) > SETTLED_S * RATE_HZ)
    true = run.coulomb * np.sign(run.velocity) + run.viscous * run.velocity
    found = track.values("Fc") * np.sign(run.velocity) + track.values("f") * run.velocity
    return float(np.sqrt(np.mean((found - true)[moves] ** 2) / np.mean(true[moves] ** 2)))


def nees(track: Track, name: str, truth: FloatArray) -> float:
    """Mean squared error of a logarithm over its variance, after settling."""
    i = track.joint.states.index(name)
    return float(np.mean((((track.x[:, i] - np.log(truth)) / track.std[:, i]) ** 2)[round(SETTLED_S * RATE_HZ) :]))


def test_friction_that_warms_up_is_followed_through_stops(kalman: KalmanFilter) -> None:
    """Torque within 0.4 %, NEES at most 1.2, NIS 0.9 to 1.1."""
    run = simulate(stops_and_moves(40), seed=1)
    track = followed(kalman, run)
    judged = consistency(track, SETTLED_S)
    assert torque_error(track, run) < 0.004
    assert nees(track, "Fc", run.coulomb) < 1.2
    assert nees(track, "f", run.viscous) < 1.2
    assert 0.9 < judged.nis < 1.1
    assert abs(judged.autocorrelation[1]) < FILTER.max_correlation


@pytest.mark.slow
def test_a_bristle_taken_for_certain_is_seen() -> None:
    """Without the slip's noise a filter that is sure of all else is many std off: its innovations say so."""
    run, sure = simulate(stops_and_moves(20), seed=1), KalmanFilter(replace(FOLLOWED, tolerances={}), RATE_HZ)
    track = followed(sure, run, FilterNoise(angle=NOISE.angle, torque=NOISE.torque, drift=DRIFT, slip=0.0))
    judged = consistency(track, SETTLED_S)
    assert nees(track, "Fc", run.coulomb) > 5
    assert judged.nis > 1.5
    assert judged.doubts


@pytest.mark.slow
def test_noise_is_found_from_innovations() -> None:
    """Torque noise within 10 % from a guess of a third; a bristle that is LuGre's slips no more than guessed."""
    kalman = KalmanFilter(FOLLOWED, RATE_HZ)
    run = simulate(rich(5), seed=5)
    found = estimate_noise(kalman, run.samples, replace(NOISE, torque=NOISE.torque / 3), settled_s=2.0)
    assert found.torque == pytest.approx(TORQUE_STD, rel=0.1)
    assert found.slip == pytest.approx(NOISE.slip)


def test_samples_with_gaps_are_refused() -> None:
    """By name."""
    with refused("filter/record"):
        JointSamples(np.array([0.0, np.nan]), np.zeros(2), np.zeros(2))


def test_a_rigid_joint_has_no_stiffness_to_hold() -> None:
    rigid = FollowedJoint(motor_inertia=1.0, coulomb=1.0, viscous=0.1, bristle_stiffness=100.0)
    assert rigid.held == ("inertia", "gravity")


def test_correlated_torque_noise_keeps_its_variance() -> None:
    """w_k+1 = a w_k + e_k, a = exp(-T / tau), has std sigma where var e = sigma^2 (1 - a^2)."""
    joint, noise = replace(FOLLOWED, correlation_s=0.02), replace(NOISE, correlated=0.3)
    driving = noise.vector(joint, RATE_HZ)[2]
    fade = np.exp(-1 / (RATE_HZ * 0.02))
    assert driving / (1 - fade**2) == pytest.approx(0.3**2)
