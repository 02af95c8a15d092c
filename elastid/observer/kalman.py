"""A filter run over a log, in pieces of any number."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.observer.joint import FollowedJoint
from elastid.observer.noise import FilterNoise
from elastid.observer.step import filter_step

# Samples that one call of the compiled loop takes.
PIECE = 1000
# What is known of friction before the first sample: relative std, and of the offset as a share of F_c.
PRIOR = {"Fc": 0.3, "f": 0.5, "f+": 0.5, "f-": 0.5, "offset": 0.5}


@frozen_value
class JointSamples:
    """Torque and load (n,), each held until the sample's end, and the motor's angle (n,) there; one side, SI."""

    torque: FloatArray
    load: FloatArray
    angle: FloatArray

    def __post_init__(self) -> None:
        """Check that they belong together."""
        if not len(self.torque) == len(self.load) == len(self.angle):
            raise ValueError("a filter takes as many torques and loads as angles")
        if not all(np.all(np.isfinite(part)) for part in (self.torque, self.load, self.angle)):
            raise DataError("a filter's samples have NaN or infinite values; mend the gaps of the log first")


@frozen_value
class Estimate:
    """What a filter knows after a sample: states x (n,) and their covariance P (n, n)."""

    x: FloatArray
    P: FloatArray


@frozen_value
class Track:
    """A filter over n samples: states (n, n_x), their variances (n, n_x), covariance of what is followed (n, p, p).

    innovation, variance (n,): what the angle was off from its prediction, and the variance that the filter expected.
    """

    joint: FollowedJoint
    rate_hz: float
    x: FloatArray
    std: FloatArray
    followed_covariance: FloatArray
    innovation: FloatArray
    variance: FloatArray
    last: Estimate

    @property
    def nis(self) -> FloatArray:
        """e^2 / S (n,): chi-squared of one degree of freedom where the filter's noise is right."""
        return np.asarray(self.innovation**2 / self.variance)

    def values(self, name: str) -> FloatArray:
        """A state over time (n,); of a followed logarithm the number itself."""
        column = self.x[:, self.joint.states.index(name)]
        return column if name not in self.joint.followed or name == "offset" else np.exp(column)

    def band(self, name: str) -> tuple[FloatArray, FloatArray]:
        """The 95 % interval of a state over time, each (n,)."""
        i = self.joint.states.index(name)
        low, high = (self.x[:, i] + sign * 1.959964 * self.std[:, i] for sign in (-1, 1))
        if name not in self.joint.followed or name == "offset":
            return low, high
        return np.exp(low), np.exp(high)


def first_estimate(joint: FollowedJoint, angle: float, load: float = 0.0) -> Estimate:
    """At rest at an angle, the spring bent by the load, the bristle anywhere, friction within PRIOR of the joint's."""
    names = joint.states
    bend = joint.coulomb / joint.bristle_stiffness
    start = {"q_m": angle, "q_l": angle - (load / joint.stiffness if joint.is_elastic else 0.0)}
    std = {"q_m": bend, "q_l": 2 * bend, "v_m": 1e-2, "v_l": 1e-2, "z": bend / 2, "w": 0.1 * joint.coulomb}
    for name in joint.followed:
        start[name] = 0.0 if name == "offset" else float(np.log(joint.start_of(name)))
        std[name] = PRIOR[name] * (joint.coulomb if name == "offset" else 1.0)
    x = np.array([start.get(name, 0.0) for name in names])
    return Estimate(x, np.diag([std[name] ** 2 for name in names]))


class KalmanFilter:
    """A joint's filter at a rate, compiled once; run(...) carries an estimate over samples."""

    def __init__(self, joint: FollowedJoint, rate_hz: float) -> None:
        """Compile the step, alone and as a loop of PIECE samples."""
        self.joint, self.rate_hz = joint, rate_hz
        self._step = filter_step(joint, rate_hz)
        self._loop = self._step.mapaccum("filter", PIECE, 2)

    def run(self, samples: JointSamples, noise: FilterNoise, start: Estimate) -> Track:
        """The track over samples, from what was known before them."""
        n, n_x = len(samples.angle), len(self.joint.states)
        given = noise.vector(self.joint, self.rate_hz)
        x, P = np.empty((n, n_x)), np.empty((n, n_x, n_x))
        e, S = np.empty(n), np.empty(n)
        estimate = start
        for piece in _pieces(n):
            out = self._piece(samples, piece, given, estimate)
            x[piece], P[piece], e[piece], S[piece] = out
            estimate = Estimate(x[piece.stop - 1].copy(), P[piece.stop - 1].copy())
        first = n_x - len(self.joint.followed)
        variances = np.diagonal(P, axis1=1, axis2=2)
        return Track(self.joint, self.rate_hz, x, np.sqrt(variances), P[:, first:, first:].copy(), e, S, estimate)

    def stream(self, pieces: Iterable[JointSamples], noise: FilterNoise, start: Estimate) -> Iterator[Track]:
        """A track of each piece of a log too long to hold, each from the end of the one before."""
        estimate = start
        for samples in pieces:
            track = self.run(samples, noise, estimate)
            estimate = track.last
            yield track

    def _piece(
        self, samples: JointSamples, piece: slice, noise: FloatArray, start: Estimate
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """States, covariances, innovations and variances of a slice of at most PIECE samples."""
        count, n_x = piece.stop - piece.start, len(start.x)
        rows = [part[piece][None, :] for part in (samples.torque, samples.load, samples.angle)]
        function = self._loop if count == PIECE else self._step.mapaccum("rest", count, 2)
        x, P, e, S = function(start.x, start.P, *rows, ca.repmat(ca.DM(noise), 1, count))
        covariance = P.full().reshape(n_x, count, n_x).transpose(1, 0, 2)
        return x.full().T, covariance, e.full().ravel(), S.full().ravel()


def _pieces(n: int) -> list[slice]:
    """Slices of at most PIECE samples."""
    return [slice(i, min(i + PIECE, n)) for i in range(0, n, PIECE)]
