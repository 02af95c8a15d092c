r"""A joint's friction followed over its motions, one after the other, and the judgement of the filter.

Between two motions the joint stands somewhere: angle, velocity and bristle start again, while the followed numbers
continue, their covariance grown by the drift of the time between.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.friction_study.extended_kalman_filter import (
    Estimate,
    FilterNoise,
    FollowedJoint,
    JointSamples,
    KalmanFilter,
    Track,
    first_estimate,
)
from elastid.friction_study.innovations import (
    FILTER,
    Consistency,
    Direction,
    consistency,
    estimate_noise,
    most_correlated,
    unknown,
    weakest_direction,
)

# Lags of the autocorrelation.
LAGS = 50
REVERSALS = (
    "reversals distinguish Coulomb friction from an offset, several speeds from viscous friction; move both ways, at "
    "several speeds"
)


@frozen_value
class Motion:
    """Samples of one motion that begins start_s after the first one."""

    samples: JointSamples
    start_s: float


@frozen_value
class FollowedFriction:
    """Knowledge of a filter of a joint over time_s (m,): values, low, high (m, p) of the followed numbers, 95 % bands.

    unknown (m, p): where the motion does not identify a number, so that it is held.  nis (m,): mean up to each time
    since the one before.  torque_std: of white noise, found or given.
    """

    joint: str
    slides: bool
    names: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray
    low: FloatArray
    high: FloatArray
    unknown: BoolArray
    nis: FloatArray
    consistency: Consistency
    weakest: Direction
    noise: FilterNoise
    filtered: FollowedJoint
    rate_hz: float
    notes: tuple[Note, ...] = ()


def follow(
    name: str,
    slides: bool,
    joint: FollowedJoint,
    motions: Sequence[Motion],
    rate_hz: float,
    guess: FilterNoise,
    settle_s: float,
    find_noise: bool,
) -> FollowedFriction:
    """The followed friction of a joint; find_noise: from the innovations of the longest motion, else as guessed.

    Raises DataError where the motions are shorter than the filter takes to settle.
    """
    kalman = KalmanFilter(joint, rate_hz)
    start = _at_start(joint, motions[0].samples)
    noise = guess
    if find_noise:
        # At most a minute of the longest motion.
        longest = max((motion.samples for motion in motions), key=lambda samples: len(samples.angle))
        cut = slice(0, round(60.0 * rate_hz))
        stretch = JointSamples(longest.torque[cut], longest.load[cut], longest.angle[cut])
        noise = estimate_noise(kalman, stretch, guess, _at_start(joint, stretch), min(settle_s, 1.0))
    tracks = _tracks(kalman, motions, noise, start)
    track = _joined(tracks)
    if len(track.innovation) / rate_hz <= settle_s + LAGS / rate_hz:
        raise DataError(
            f"joint {name}: its motions last {len(track.innovation) / rate_hz:.3g} s and the filter settles in "
            f"{settle_s:g} s; record longer, or give filter.settle"
        )
    judged = consistency(track, settle_s, LAGS)
    prior = np.sqrt(np.diag(start.P))[-len(joint.followed) :]
    weakest = weakest_direction(track, prior)
    values, low, high, mean_nis, instants = _shown(track, [len(each.innovation) for each in tracks])
    times = np.concatenate([m.start_s + np.arange(1, len(m.samples.angle) + 1) / rate_hz for m in motions])[instants]
    place = f"joint {name}"
    # Warnings to be read before the bands of a filter are believed.
    notes = (*_excitation(place, track, weakest, prior), *_divergence(place, track, prior), *_noise(place, judged))
    return FollowedFriction(
        name, slides, joint.followed, times, values, low, high, unknown(track, prior)[instants], mean_nis, judged,
        weakest, noise, joint, rate_hz, notes,
    )  # fmt: skip


def _at_start(joint: FollowedJoint, samples: JointSamples) -> Estimate:
    """The joint at rest where a motion begins."""
    return first_estimate(joint, float(samples.angle[0]), float(samples.load[0]))


def _tracks(kalman: KalmanFilter, motions: Sequence[Motion], noise: FilterNoise, start: Estimate) -> list[Track]:
    """One of each motion, the followed numbers carried on."""
    tracks: list[Track] = []
    estimate, ended_s = start, motions[0].start_s
    for motion in motions:
        if tracks:
            pause = max(0.0, motion.start_s - ended_s)
            estimate = _resumed(kalman.joint, tracks[-1].last, motion, noise, pause)
        tracks.append(kalman.run(motion.samples, noise, estimate))
        ended_s = motion.start_s + len(motion.samples.angle) / kalman.rate_hz
    return tracks


def _resumed(joint: FollowedJoint, last: Estimate, motion: Motion, noise: FilterNoise, pause_s: float) -> Estimate:
    """At rest where the motion begins, friction as it was, less certain by the drift of the pause."""
    p = len(joint.followed)
    begun = _at_start(joint, motion.samples)
    x, P = begun.x.copy(), begun.P.copy()
    x[-p:] = last.x[-p:]
    drift = [noise.drift.get(name, 0.0) ** 2 * pause_s for name in joint.followed]
    P[-p:, -p:] = last.P[-p:, -p:] + np.diag(drift)
    return Estimate(x, P)


def _joined(tracks: Sequence[Track]) -> Track:
    """The tracks of all motions as one, the time between them left out."""
    last = tracks[-1]
    parts = {
        name: np.concatenate([getattr(track, name) for track in tracks])
        for name in ("x", "std", "followed_covariance", "innovation", "variance")
    }
    return Track(last.joint, last.rate_hz, last=last.last, **parts)


def _shown(track: Track, lengths: Sequence[int]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, np.ndarray]:
    """Values, low, high (m, p) at the ends of blocks, mean NIS of each block (m,), and those ends."""
    n = len(track.innovation)
    step = max(1, n // 2000)  # a result keeps so many points
    ends = np.cumsum(lengths)
    last = np.unique(np.concatenate([np.arange(step - 1, n, step), ends - 1]))
    sums = np.concatenate([[0.0], np.cumsum(track.nis)])
    first = np.concatenate([[0], last[:-1] + 1])
    nis = (sums[last + 1] - sums[first]) / (last + 1 - first)
    columns = [(track.values(name)[last], *(end[last] for end in track.band(name))) for name in track.joint.followed]
    values, low, high = (np.stack(each, axis=1) for each in zip(*columns, strict=True))
    return values, low, high, nis, last


def _excitation(place: str, track: Track, weakest: Direction, prior: FloatArray) -> Iterator[Note]:
    """Numbers that the motion does not identify, and those that cannot be distinguished."""
    never = np.all(unknown(track, prior), axis=0).tolist()
    held = [number for number, is_unknown in zip(track.joint.followed, never, strict=True) if is_unknown]
    pair, correlation = most_correlated(track)
    if held:
        text = f"the motion does not identify {', '.join(held)}, held where it began: move both ways, at several speeds"
        yield Note("not-excited", text, place)
    elif weakest.ratio > FILTER.weak_std_ratio:
        text = f"{weakest.words} is known to {weakest.ratio:.0%} of what it was before: {REVERSALS}"
        yield Note("weakly-excited", text, place)
    if abs(correlation) > FILTER.distinct_correlation:
        text = f"{' and '.join(pair)} cannot be distinguished (correlation {correlation:.2f}): {REVERSALS}"
        yield Note("not-distinguished", text, place, severity="warning")


def _divergence(place: str, track: Track, prior: FloatArray) -> Iterator[Note]:
    """Numbers that ended far outside of their prior."""
    names = track.joint.followed
    p, start = len(names), first_estimate(track.joint, 0.0).x[-len(names) :]
    for i in np.flatnonzero(np.abs(track.last.x[-p:] - start) > FILTER.diverged_stds * prior):
        text = (
            f"{names[i]} went to {track.values(names[i])[-1]:.4g}, {FILTER.diverged_stds:g} standard deviations from "
            "its prior: the filter has lost the log; correct inertia, spring and friction of the joint, or give "
            "filter.torque_std"
        )
        yield Note("diverged", text, place, severity="warning")


def _noise(place: str, judged: Consistency) -> Iterator[Note]:
    """Innovations that are correlated, or larger or smaller than the filter expects."""
    if not judged.is_white:
        text = (
            f"innovations are correlated by {judged.autocorrelation[1]:.2f} from sample to sample, and only "
            f"{judged.n_eff:.3g} samples are independent: the torque noise is not white or the model is wrong, and the "
            "bands are too narrow; give filter.correlation_time, or correct inertia, spring and bristles"
        )
        yield Note("coloured-innovations", text, place, severity="warning")
    means = {"over all": judged.nis, "around stops": judged.nis_at_stops}
    low, high = FILTER.nis_band
    outside = {words: mean for words, mean in means.items() if not np.isnan(mean) and not low <= mean <= high}
    for words, mean in list(outside.items())[:1]:
        than, bands = ("larger", "narrow") if mean > 1 else ("smaller", "wide")
        text = (
            f"mean NIS {words} is {mean:.2f}, outside {low} to {high}: innovations are {than} than expected and the "
            f"bands too {bands}; correct inertia, spring or bristles of the joint, or give filter.torque_std"
        )
        yield Note("inconsistent-filter", text, place, severity="warning" if mean > 1 else "information")
