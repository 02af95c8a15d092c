r"""A joint's friction followed over its motions, one after the other; noise and judgement of the filter by innovations.

Between two motions the joint stands somewhere: angle, velocity and bristle start again, while the followed numbers
continue, their covariance grown by the drift of the time between. Noise of torque and angle has the largest likelihood
of the innovations over the logarithms of its standard deviations,

.. math:: \min_{\sigma} \sum_k \ln S_k(\sigma) + e_k(\sigma)^2 / S_k(\sigma)

(Mehra, IEEE Trans. Automatic Control 15(2), 1970, has the idea). The state w carries the torque noise of a real axis
that is correlated in time (ripple, cogging, cables): taken for white, it makes bands far too narrow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import DataError, Note
from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.extended_kalman_filter import (
    COUNT_OVER_STD,
    FILTER,
    LAGS,
    Consistency,
    Estimate,
    FilterNoise,
    FollowedJoint,
    JointSamples,
    KalmanFilter,
    Track,
    consistency,
    first_estimate,
    most,
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
    judged = most(samples.moves(COUNT_OVER_STD * guess.angle)).copy()
    judged[: round(settled_s * kalman.rate_hz)] = False
    lowest = np.log([{"angle": 1.0, "slip": 1.0}.get(name, 1e-3) for name in names])

    def noise_at(x: FloatArray) -> FilterNoise:
        factors = zip(names, np.exp(np.clip(x, lowest, np.log(1e3))).tolist(), strict=True)
        return replace(guess, **{name: getattr(guess, name) * factor for name, factor in factors})

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
    def verdict(self) -> str:
        """Verdict whether the bands are to be believed."""
        if self.consistency.is_honest:
            return "no test doubts the bands"
        return "the bands are too narrow, as the warnings say"


def follow(
    name: str,
    slides: bool,
    joint: FollowedJoint,
    motions: Sequence[JointSamples],
    rate_hz: float,
    guess: FilterNoise,
    settle_s: float,
    find_noise: bool,
) -> FollowedFriction:
    """Followed friction; find_noise: by innovations of the longest motion, not guessed.  DataError for short ones."""
    duration_s = sum(len(motion.angle) for motion in motions) / rate_hz
    if duration_s <= settle_s + LAGS / rate_hz:
        raise DataError(
            "filter/record",
            f"its motions last {duration_s:.3g} s and the filter settles in {settle_s:g} s; record "
            "longer, or give filter.settle",
            f"joint {name}",
        )
    kalman, noise = KalmanFilter(joint, rate_hz), guess
    if find_noise:
        # At most half a minute of the longest motion.
        longest, cut = max(motions, key=lambda motion: len(motion.angle)), slice(0, round(30.0 * rate_hz))
        stretch = JointSamples(longest.torque[cut], longest.load[cut], longest.angle[cut])
        noise = estimate_noise(kalman, stretch, guess, _at_start(joint, stretch), min(settle_s, 1.0))
    track = _track(kalman, motions, noise)
    prior = np.sqrt(np.diag(_at_start(joint, motions[0]).P))[-len(joint.followed) :]
    judged = consistency(track, settle_s)
    n = len(track.innovation)
    step = max(1, n // 2000)  # a result keeps so many points
    ends = np.arange(n % step + step - 1, n, step)
    mean_nis = track.nis[n % step :].reshape(-1, step).mean(axis=1)
    values, low, high = (
        np.stack([track.values(each, stds)[ends] for each in joint.followed], axis=1)
        for stds in (0.0, -QUANTILE_95, QUANTILE_95)
    )
    place = f"joint {name}"
    # Warnings to be read before the bands of a filter are believed.
    notes = (*_excitation(place, track, prior), *_inconsistent(place, judged))
    return FollowedFriction(
        name, slides, joint.followed, track.time_s[ends], values, low, high, unknown(track, prior)[ends], mean_nis,
        judged, noise, joint, rate_hz, notes,
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


def _track(kalman: KalmanFilter, motions: Sequence[JointSamples], noise: FilterNoise) -> Track:
    """Track over all motions, one after the other."""
    tracks = [kalman.run(motions[0], noise, _at_start(kalman.joint, motions[0]))]
    for motion in motions[1:]:
        pause_s = max(0.0, motion.start_s - float(tracks[-1].time_s[-1]))
        tracks.append(kalman.run(motion, noise, _resumed(kalman.joint, tracks[-1].last, motion, noise, pause_s)))
    names = ("x", "std", "followed_covariance", "innovation", "variance", "time_s", "moves")
    joined: dict[str, Any] = {name: np.concatenate([getattr(each, name) for each in tracks]) for name in names}
    return replace(tracks[-1], **joined)


def _resumed(
    joint: FollowedJoint, last: Estimate, motion: JointSamples, noise: FilterNoise, pause_s: float
) -> Estimate:
    """Estimate at rest where the motion begins, friction as it was, less certain by the pause's drift."""
    p, n = len(joint.followed), len(joint.states)
    begun = _at_start(joint, motion)
    x, P = begun.x.copy(), begun.P.copy()
    x[-p:] = last.x[-p:]
    drift = [noise.drift.get(name, 0.0) ** 2 * pause_s for name in joint.followed]
    P[-p:] = last.P[-p:]
    P[-p:, : n - p] = 0.0
    P[-p:, n - p : n] += np.diag(drift)
    return Estimate(x, P)


def _excitation(place: str, track: Track, prior: FloatArray) -> Iterator[Note]:
    names, P = track.joint.followed, track.followed_covariance[-1]
    never = np.all(unknown(track, prior), axis=0).tolist()
    std = np.sqrt(np.diag(P))
    pairs = np.argwhere(np.triu(np.abs(P), 1) > FILTER.max_std_ratio * np.outer(std, std)).tolist()
    weak = [f"{name}, held where it began" for name, is_unknown in zip(names, never, strict=True) if is_unknown]
    weak += [f"{names[i]} apart from {names[j]}" for i, j in pairs]
    if weak:
        text = (
            f"the motion does not identify {'; '.join(weak)}: reversals distinguish Coulomb friction from an offset, "
            "several speeds from viscous friction"
        )
        yield Note("filter/not-excited", text, place, severity="warning" if pairs else "information")


def _inconsistent(place: str, judged: Consistency) -> Iterator[Note]:
    """The reasons why bands are not to be believed, in one note."""
    reasons = [f"{name} moves by more than noise and filter.drift allow" for name in judged.restless]
    if judged.autocorrelation[1] > FILTER.max_correlation:  # alternating ones make no band too narrow
        reasons.append(f"innovations are correlated by {judged.autocorrelation[1]:.2f} from sample to sample")
    if judged.nis > FILTER.nis_band[1]:
        reasons.append(f"mean NIS is {judged.nis:.2f}: innovations are larger than expected")
    if reasons:
        text = (
            f"{'; '.join(reasons)}; the model or its noise is wrong, and the bands are too narrow: correct inertia, "
            "spring, bristles, gravity and payload of the joint, or give filter.correlation_time, filter.torque_std or "
            "a larger filter.drift"
        )
        yield Note("filter/inconsistent", text, place, severity="warning")
