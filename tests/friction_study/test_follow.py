"""What a filter cannot know, and when it is wrong, is said with numbers and what to do next."""

from dataclasses import replace

import numpy as np
import pytest

from elastid.friction_study.extended_kalman_filter import Estimate, FilterNoise, FollowedJoint, JointSamples, Track
from elastid.friction_study.follow import FollowedFriction, Motion, _noise, consistency, follow
from tests.plants.warm_joint import COUNT, FOLLOWED, RATE_HZ, TORQUE_STD, WarmRun, rich, simulate, stops_and_moves

NOISE = FilterNoise(COUNT / np.sqrt(12), TORQUE_STD, drift={"Fc": 6e-3, "f": 25e-3, "offset": 1e-3})


def followed(run: WarmRun, joint: FollowedJoint = FOLLOWED, noise: FilterNoise = NOISE) -> FollowedFriction:
    """A run, judged after 5 s."""
    return follow("1", False, joint, [Motion(run.samples, 0.0)], RATE_HZ, noise, 5.0, find_noise=False)


def notes(found: FollowedFriction) -> dict[str, str]:
    """By their codes."""
    return {note.code: note.text for note in found.notes}


def test_constant_speed_says_what_it_cannot_know() -> None:
    """Coulomb friction and an offset are distinguished by reversals."""
    said = notes(followed(simulate(np.concatenate([np.linspace(0, 40, 500), np.full(6500, 40.0)]), 4)))
    assert "Fc and offset cannot be distinguished (correlation -0.9" in said["not-distinguished"]
    assert "reversals distinguish Coulomb friction from an offset" in said["not-distinguished"]
    assert not {"not-distinguished", "diverged"} & set(notes(followed(simulate(rich(7), 4))))


def test_a_filter_whose_nis_leaves_its_band_says_so() -> None:
    """At stops, where it takes the bristle for certain; and correlated innovations are said beside it."""
    found = notes(followed(simulate(stops_and_moves(7), 1), noise=replace(NOISE, slip=0.0)))
    assert "outside 0.5 to 1.1: innovations are larger than expected" in found["inconsistent-filter"]
    assert "give filter.correlation_time" in found["coloured-innovations"]


def test_a_filter_that_has_lost_the_log_says_so() -> None:
    """Viscous friction a thousand times too large to begin with."""
    lost = notes(followed(simulate(rich(7), 4), replace(FOLLOWED, viscous=1e3 * FOLLOWED.viscous)))
    assert "5 standard deviations from its prior" in lost["diverged"]


@pytest.mark.slow
def test_noise_is_that_of_the_longest_motion_wherever_the_first_one_begins() -> None:
    """Another motion of half a second, 1 rad away, changes nothing of the noise that is found."""
    run = simulate(rich(1.5), 5).samples
    short = JointSamples(run.torque[:500], run.load[:500], run.angle[:500] + 1.0)
    alone, after = (
        follow("1", False, FOLLOWED, motions, RATE_HZ, NOISE.scaled(torque=1 / 3), 0.5, find_noise=True)
        for motions in ([Motion(run, 0.0)], [Motion(short, 0.0), Motion(run, 1.0)])
    )
    assert after.noise == alone.noise


def test_innovations_are_judged_in_units_of_their_expected_std() -> None:
    """e = sqrt(S) (-1)^k has NIS 1 and the autocorrelation -(n - 1) / n, however S varies, and narrows no band."""
    n = 200
    S = np.geomspace(1.0, 1e4, n)
    x = np.ones((n, len(FOLLOWED.states)))
    last = Estimate(x[-1], np.eye(x.shape[1]))
    track = Track(
        FOLLOWED, RATE_HZ, x, x, np.ones((n, 3, 3)), np.sqrt(S) * (-1.0) ** np.arange(n), S, last,
        np.ones(3), np.ones(n, bool),
    )  # fmt: skip
    judged = consistency(track, 0.0)
    assert judged.nis == pytest.approx(1.0)
    assert judged.autocorrelation[1] == pytest.approx(-(n - 1) / n)
    assert not judged.is_white
    assert not list(_noise("joint 1", judged))
