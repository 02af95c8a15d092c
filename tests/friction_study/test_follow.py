"""What a filter cannot know, and when it is wrong, is said with numbers and what to do next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elastid.base.arrays import FloatArray
from elastid.friction_study.extended_kalman_filter import (
    FilterNoise,
    FollowedFriction,
    FollowedJoint,
    JointSamples,
    Track,
    consistency,
    follow,
    with_tolerances,
)
from elastid.friction_study.levels import Levels
from elastid.friction_study.result import JointFriction
from tests.plants.warm_joint import COUNT, FOLLOWED, RATE_HZ, TORQUE_STD, WarmRun, rich, simulate, stops_and_moves

NOISE = FilterNoise(COUNT / np.sqrt(12), TORQUE_STD, drift={"Fc": 6e-3, "f": 25e-3, "offset": 1e-3})


def followed(run: WarmRun, joint: FollowedJoint = FOLLOWED, noise: FilterNoise = NOISE) -> FollowedFriction:
    """A run, judged after 5 s."""
    return follow("1", False, joint, [run.samples], RATE_HZ, noise, 5.0, find_noise=False)


def codes(found: FollowedFriction) -> set[str]:
    return {note.code for note in found.notes}


def test_constant_speed_says_what_it_cannot_know() -> None:
    """Coulomb friction and an offset are distinguished by reversals."""
    constant = followed(simulate(np.concatenate([np.linspace(0, 40, 500), np.full(6500, 40.0)]), 4))
    assert "filter/not-excited" in codes(constant)
    assert not {"filter/not-excited", "filter/inconsistent"} & codes(followed(simulate(rich(7), 4)))


def test_a_filter_that_has_lost_the_log_says_so() -> None:
    """Viscous friction a thousand times too large to begin with."""
    lost = followed(simulate(rich(7), 4), replace(FOLLOWED, viscous=1e3 * FOLLOWED.viscous))
    assert "filter/inconsistent" in codes(lost)


@pytest.mark.slow
def test_noise_is_that_of_the_longest_motion_wherever_the_first_one_begins() -> None:
    """Another motion of half a second, 1 rad away, changes nothing of the noise that is found."""
    run = simulate(rich(1.5), 5).samples
    short = JointSamples(run.torque[:500], run.load[:500], run.angle[:500] + 1.0)
    alone, after = (
        follow("1", False, FOLLOWED, motions, RATE_HZ, replace(NOISE, torque=NOISE.torque / 3), 0.5, find_noise=True)
        for motions in ([run], [short, replace(run, start_s=1.0)])
    )
    assert after.noise == alone.noise


def test_innovations_are_judged_in_units_of_their_expected_std() -> None:
    """e = sqrt(S) (-1)^k has NIS 1 and the autocorrelation -(n - 1) / n, however S varies, and narrows no band."""
    n = 200
    S = np.geomspace(1.0, 1e4, n)
    x = np.ones((n, len(FOLLOWED.states)))
    track = Track(
        FOLLOWED, RATE_HZ, x, x, np.ones((n, 3, 3)), np.sqrt(S) * (-1.0) ** np.arange(n), S,
        np.ones(3), np.arange(n) / RATE_HZ, np.ones(n, bool),
    )  # fmt: skip
    judged = consistency(track, 0.0)
    assert judged.nis == pytest.approx(1.0)
    assert judged.autocorrelation[1] == pytest.approx(-(n - 1) / n)
    assert not judged.doubts


def test_a_band_holds_stiction_that_falls_with_warmth() -> None:
    """F_s / F_c of 1.30 for the 1.40 that the filter holds: its band has F_c, that of a filter that is sure has not."""
    run = simulate(stops_and_moves(14), 1, stiction_ratio=1.3)
    held = {}
    for name, joint in {"held": FOLLOWED, "exact": replace(FOLLOWED, tolerances={})}.items():
        found = followed(run, joint)
        i = np.minimum(np.rint(found.time_s * RATE_HZ).astype(int), len(run.coulomb)) - 1
        inside = (found.low[:, 0] < run.coulomb[i]) & (run.coulomb[i] < found.high[:, 0])
        held[name] = float(np.mean(inside[found.time_s > 5]))
    assert held["held"] > 0.95
    assert held["exact"] < 0.5


def test_what_a_study_has_identified_narrows_the_bands() -> None:
    """Inertia to 0.5 % and gravity to 1 % of a rigid joint; an identified inertia 5 % off an elastic one widens it."""
    one = np.ones(1)
    levels = Levels("motor 1", one, 0 * one, one, 0.01 * one, 0 * one, 0 * one)
    shared = {"inertia": (2.0, 0.01), "gravity.cos": (3.0, 0.03), "gravity.sin": (4.0, 0.04)}
    identified = JointFriction("1", False, levels=replace(levels, shared=shared))
    rigid = FollowedJoint(motor_inertia=2.0, coulomb=1.0, viscous=0.1, bristle_stiffness=100.0)
    known = with_tolerances(rigid, identified).tolerances
    assert known["inertia"] == pytest.approx(0.005)
    assert known["gravity"] == pytest.approx(0.01)
    elastic = replace(FOLLOWED, motor_inertia=0.9, link_inertia=1.2)
    assert with_tolerances(elastic, identified).tolerances["inertia"] == pytest.approx(np.hypot(0.02, 0.05))


TRACK_HZ, N, STD, DRIFT = 200.0, 8000, 0.02, 0.01


def track(coulomb: FloatArray, innovation: FloatArray) -> Track:
    """A filter with white S = 1, whose joint moves a second each way, with rests of a second between."""
    x = np.zeros((N, len(FOLLOWED.states)))
    cycle = np.repeat([1.0, 0.0, -1.0, 0.0], round(TRACK_HZ))
    x[:, FOLLOWED.states.index("v_m")] = np.resize(cycle, N)
    x[:, FOLLOWED.states.index("Fc")] = coulomb
    covariance = np.tile(STD**2 * np.eye(3), (N, 1, 1))
    ones = np.ones(N)
    return Track(
        FOLLOWED, TRACK_HZ, x, np.full_like(x, STD), covariance, innovation, ones, np.full(3, DRIFT),
        np.arange(N) / TRACK_HZ, ones > 0,
    )  # fmt: skip


def white(seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(N)


def test_a_number_that_moves_by_more_than_its_band_is_restless() -> None:
    """Coulomb friction that jumps by 15 std every three seconds; one that stays is honest."""
    judged = consistency(track(0.3 * np.resize(np.repeat([1.0, -1.0], 600), N), white()), 1.0)
    assert judged.restless == ("Fc",)
    assert judged.doubts
    assert not consistency(track(np.zeros(N), white()), 1.0).doubts
