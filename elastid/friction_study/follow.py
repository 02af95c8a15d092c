r"""A joint's friction followed over its motions, one after the other; noise and judgement of the filter by innovations.

Between two motions the joint stands somewhere: angle, velocity and bristle start again, while the followed numbers
continue, their covariance grown by the drift of the time between. Noise of torque and
angle has the largest likelihood of the innovations over the logarithms of its standard deviations,

.. math:: \min_{\sigma} \sum_k \ln S_k(\sigma) + e_k(\sigma)^2 / S_k(\sigma)

(Mehra, IEEE Trans. Automatic Control 15(2), 1970, has the idea). The state w carries the torque noise of a real axis
that is correlated in time (ripple, cogging, cables): taken for white, it makes bands far too narrow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import DataError, Note
from elastid.friction_study.extended_kalman_filter import (
    COUNT_OVER_STD,
    FILTER,
    MOVING,
    Consistency,
    Estimate,
    FilterNoise,
    FollowedJoint,
    JointSamples,
    KalmanFilter,
    Track,
    consistency,
    first_estimate,
)
from elastid.friction_study.result import JointFriction


def unknown(track: Track, prior_std: FloatArray) -> BoolArray:
    """True (n, p) where a number is no better known than its std (n, p) or (p,) without the log, drift included."""
    std = np.sqrt(np.diagonal(track.followed_covariance, axis1=1, axis2=2))
    return np.asarray(std > FILTER.max_std_ratio * prior_std)


def estimate_noise(
    kalman: KalmanFilter, samples: JointSamples, guess: FilterNoise, start: Estimate, settled_s: float
) -> FilterNoise:
    """The most likely noise over samples that move (Track.moves); of angle and bristle's slip at least as guessed.

    The bristle's slip is found as well: what other frictions than LuGre's need would stand for noise of the torque, and
    put F_c off by 4 to 18 % where a joint slips by about z_s in a sample. A fast motion would have it at nothing, and
    innovations of a slow one would then be four times as large as expected.
    """
    names = ["angle", "torque", "slip", *(["correlated"] if kalman.joint.correlation_s > 0 else [])]
    judged = _moving(samples, COUNT_OVER_STD * guess.angle)
    judged[: round(settled_s * kalman.rate_hz)] = False
    lowest = np.log([{"angle": 1.0, "slip": 1.0}.get(name, 1e-3) for name in names])

    def noise_at(x: FloatArray) -> FilterNoise:
        factors = np.exp(np.clip(x, lowest, np.log(1e3)))
        return guess.scaled(**dict(zip(names, factors.tolist(), strict=True)))

    def cost(x: FloatArray) -> float:
        track = kalman.run(samples, noise_at(x), start)
        S, e = track.variance[judged], track.innovation[judged]
        value = float(np.mean(np.log(S) + e**2 / S))
        return value if np.isfinite(value) else 1e6

    # Factors of three about the guess; noise that is known to 5 % is known well enough.
    n = len(names)
    simplex = np.vstack([np.zeros(n), 1.1 * np.eye(n)])
    options = {"xatol": 0.05, "fatol": 1e-4, "maxfev": 150, "initial_simplex": simplex}
    return noise_at(np.asarray(minimize(cost, np.zeros(n), method="Nelder-Mead", options=options).x))


def _moving(samples: JointSamples, count: float) -> BoolArray:
    """True (n,) where the angle moves by MOVING counts a sample; everywhere if it seldom does."""
    # Where it stands the likeliest filter is one that runs after the rounded angle, with tenfold torque noise.
    reach = 5
    span = np.abs(samples.angle[2 * reach :] - samples.angle[: -2 * reach])
    moves = np.pad(span >= 2 * reach * MOVING * count, reach)
    return moves if moves.mean() > FILTER.least_moving else np.ones(len(moves), bool)


# Lags of the autocorrelation.
LAGS = 50


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
    noise: FilterNoise
    filtered: FollowedJoint
    rate_hz: float
    notes: tuple[Note, ...] = ()

    @property
    def is_honest(self) -> bool:
        """True if no test finds the bands too narrow; `notes` say which does."""
        return self.consistency.is_honest

    @property
    def verdict(self) -> str:
        """If the bands are to be believed."""
        if not self.is_honest:
            return "the bands are too narrow, as the warnings say"
        if self.consistency.nis < FILTER.nis_band[0]:
            return f"the bands are too wide: of what they allow, innovations have {self.consistency.nis:.2g}"
        return "no test doubts the bands"


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
    """Followed friction; find_noise: by innovations of the longest motion, not guessed.  DataError for short ones."""
    duration_s = sum(len(motion.samples.angle) for motion in motions) / rate_hz
    if duration_s <= settle_s + LAGS / rate_hz:
        raise DataError(
            "filter/record",
            f"its motions last {duration_s:.3g} s and the filter settles in {settle_s:g} s; record "
            "longer, or give filter.settle",
            f"joint {name}",
        )
    kalman = KalmanFilter(joint, rate_hz)
    start = _at_start(joint, motions[0].samples)
    noise = guess
    if find_noise:
        # At most half a minute of the longest motion.
        longest = max((motion.samples for motion in motions), key=lambda samples: len(samples.angle))
        cut = slice(0, round(30.0 * rate_hz))
        stretch = JointSamples(longest.torque[cut], longest.load[cut], longest.angle[cut])
        noise = estimate_noise(kalman, stretch, guess, _at_start(joint, stretch), min(settle_s, 1.0))
    tracks = _tracks(kalman, motions, noise, start)
    track = _joined(tracks)
    judged, prior = consistency(track, settle_s, LAGS), np.sqrt(np.diag(start.P))[-len(joint.followed) :]
    values, low, high, mean_nis, instants = _shown(track)
    times = np.concatenate([m.start_s + np.arange(1, len(m.samples.angle) + 1) / rate_hz for m in motions])[instants]
    place = f"joint {name}"
    # Warnings to be read before the bands of a filter are believed.
    notes = (*_excitation(place, track, prior), *_noise(place, judged))
    return FollowedFriction(
        name, slides, joint.followed, times, values, low, high, unknown(track, prior)[instants], mean_nis, judged,
        noise, joint, rate_hz, notes,
    )  # fmt: skip


def with_tolerances(joint: FollowedJoint, identified: JointFriction) -> FollowedJoint:
    """A joint whose held numbers are known as far as a study has identified them, else as is usual (TOLERANCES)."""
    known = dict(joint.tolerances)
    if identified.static is not None:
        numbers = identified.static.intervals
        for name, held in (("stiction", "stiction_ratio"), ("stribeck_velocity", "stribeck_velocity")):
            if name in numbers:
                known[held] = float(np.hypot(known[held], numbers[name][1] / numbers[name][0]))
    shared = identified.shared
    if "inertia" in shared:
        value, std = shared["inertia"]
        own = joint.motor_inertia + joint.link_inertia
        # Inertias and the spring of a robot's file are usual ones; an identified inertia may also contradict them.
        known["inertia"] = float(np.hypot(known["inertia"], own / value - 1)) if joint.is_elastic else std / value
    gravity = np.array([shared[name] for name in ("gravity.cos", "gravity.sin") if name in shared])
    if gravity.size:
        size, std = np.linalg.norm(gravity, axis=0).tolist()
        known["gravity"] = std / max(size, 1e-300)
    return replace(joint, tolerances={name: float(np.clip(std, 1e-4, 0.5)) for name, std in known.items()})


def _at_start(joint: FollowedJoint, samples: JointSamples) -> Estimate:
    return first_estimate(joint, float(samples.angle[0]), float(samples.load[0]))


def _tracks(kalman: KalmanFilter, motions: Sequence[Motion], noise: FilterNoise, start: Estimate) -> list[Track]:
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
    p, n = len(joint.followed), len(joint.states)
    begun = _at_start(joint, motion.samples)
    x, P = begun.x.copy(), begun.P.copy()
    x[-p:] = last.x[-p:]
    drift = [noise.drift.get(name, 0.0) ** 2 * pause_s for name in joint.followed]
    P[-p:] = last.P[-p:]
    P[-p:, : n - p] = 0.0
    P[-p:, n - p : n] += np.diag(drift)
    return Estimate(x, P)


def _joined(tracks: Sequence[Track]) -> Track:
    last = tracks[-1]
    parts = {
        name: np.concatenate([getattr(track, name) for track in tracks])
        for name in ("x", "std", "followed_covariance", "innovation", "variance", "moves")
    }
    starts = np.cumsum([0, *(len(track.innovation) for track in tracks[:-1])]).tolist()
    return Track(last.joint, last.rate_hz, last=last.last, drift=last.drift, starts=tuple(starts), **parts)


def _shown(track: Track) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, np.ndarray]:
    """Values, low, high (m, p) at the ends of blocks, mean NIS of each block (m,), and those ends."""
    n = len(track.innovation)
    step = max(1, n // 2000)  # a result keeps so many points
    last = np.arange(n % step + step - 1, n, step)
    nis = track.nis[n % step :].reshape(-1, step).mean(axis=1)
    columns = [(track.values(name)[last], *(end[last] for end in track.band(name))) for name in track.joint.followed]
    values, low, high = (np.stack(each, axis=1) for each in zip(*columns, strict=True))
    return values, low, high, nis, last


def _excitation(place: str, track: Track, prior: FloatArray) -> Iterator[Note]:
    names, P = track.joint.followed, track.followed_covariance[-1]
    never = np.all(unknown(track, prior), axis=0).tolist()
    held = [name for name, is_unknown in zip(names, never, strict=True) if is_unknown]
    std = np.sqrt(np.diag(P))
    correlations = np.triu(P / np.outer(std, std), 1)
    i, j = np.unravel_index(np.argmax(np.abs(correlations)), correlations.shape)
    correlation = float(correlations[i, j])  # the largest; 0 for a single number
    if held:
        text = f"the motion does not identify {', '.join(held)}, held where it began: move both ways, at several speeds"
        yield Note("filter/not-excited", text, place)
    if abs(correlation) > FILTER.distinct_correlation:
        text = (
            f"{names[i]} and {names[j]} cannot be distinguished (correlation {correlation:.2f}): reversals distinguish "
            "Coulomb friction from an offset, several speeds from viscous friction"
        )
        yield Note("filter/not-excited", text, place, severity="warning")


def _noise(place: str, judged: Consistency) -> Iterator[Note]:
    """The reasons why bands are not to be believed, in one note."""
    low, high = FILTER.nis_band
    reasons = [
        f"{moved.name} changes by {moved.change:.3g} (rms) within {moved.lag_s:.2g} s, {moved.times:.2g} times as "
        "much as noise and filter.drift allow"
        for moved in judged.restless
    ]
    if judged.autocorrelation[1] > FILTER.max_correlation:  # alternating ones make no band too narrow
        reasons.append(f"innovations are correlated by {judged.autocorrelation[1]:.2f} from sample to sample")
    if judged.nis > high:
        reasons.append(f"mean NIS is {judged.nis:.2f}, above {high}: innovations are larger than expected")
    if reasons:
        text = (
            f"{'; '.join(reasons)}; the model or its noise is wrong, and the bands are too narrow: correct inertia, "
            "spring, bristles, gravity and payload of the joint, or give filter.correlation_time, filter.torque_std or "
            "a larger filter.drift"
        )
        yield Note("filter/inconsistent", text, place, severity="warning")
    elif judged.nis < low:
        text = f"mean NIS is {judged.nis:.2f}, below {low}: the bands are too wide; give filter.torque_std"
        yield Note("filter/inconsistent", text, place, severity="information")
