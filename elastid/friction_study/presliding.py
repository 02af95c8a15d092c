r"""Presliding friction of a joint: Maxwell slip elements from torque loops, LuGre bristles from frequency responses.

With fixed thresholds D_j, the stiffnesses k_j of Maxwell slip are a convex problem:

.. math:: s_j(k) = \mathrm{clip}(s_j(k-1) + \Delta q(k), -D_j, D_j), \qquad
          \tau_f(k) = \sum_j k_j s_j(k), \quad k_j \ge 0

Non-negative least squares with many thresholds, spaced logarithmically over the travel of the joint, gives the
spectrum k_j(D_j) (Lawson and Hanson, Solving Least Squares Problems, 1974). Variable projection then estimates few
elements with free thresholds; they start where the spectrum has equal fractions of the torque. Cross-validation over
five folds of the log selects the number of elements (Rizos and Fassois, Chaos 14, 2004).

Noise of the angle lowers the estimated stiffness, because it is a random walk through the elements. A zero-phase low
pass smooths the angle first; its band is the one with the smallest residual of the torque.

sigma_0 and sigma_1 are estimated from responses in presliding to small multisines of several amplitudes. There a LuGre
contact is a spring sigma_0 and a damper sigma_1 to ground, parallel to the inertia and the joint's spring. Its bristles
slip by z' = v - |v| z / z_s with z_s = F_s / sigma_0. To second order, under a Gaussian motion of rms s_q and s_v
(statistical linearisation),

.. math:: \frac{z}{q} = (1 - \epsilon) \frac{j \omega}{j \omega + \rho}, \quad
          \rho = \sqrt{2 / \pi}\, \frac{s_v}{z_s}, \quad \epsilon = \frac{2}{\pi} \frac{s_q^2}{z_s^2}

Slip and sigma_1 are distinguishable: the loss by slip falls as 1 / omega, the loss by sigma_1 grows with omega. (For a
single sine of amplitude A, z / q = 1 - 3 A^2 / (8 z_s^2) + 4 j A / (3 pi z_s) at any frequency.) One law fits all
amplitudes and so extrapolates to amplitude zero:

.. math:: \frac{1}{G} = (\sigma_0 + j \omega \sigma_1) \frac{z}{q} + j \omega \alpha_2 + Z(\omega), \quad
          Z = -\omega^2 J \text{ or }
              -\omega^2 J_m + \frac{(k + j \omega d)(-\omega^2 J_l)}{k + j \omega d - \omega^2 J_l}
"""

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import nnls
from scipy.signal import butter, sosfiltfilt

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value
from elastid.base.errors import DataError, FitError, Note
from elastid.fit.problem.smoothed_noise import smooth_variance
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec, Method
from elastid.friction.stop_operator import Path, stop
from elastid.friction_record import FrictionRecord
from elastid.friction_study.least_squares import Optimum, minimise
from elastid.friction_study.motion_signals import MIN_COUNTS
from elastid.model.formulation import ElasticJoint
from elastid.record import Configuration, Record
from elastid.robot.friction import MaxwellSlip

# Few elements are tried up to this number.
MAX_ELEMENTS = 8


@dataclass(frozen=True)
class Elements:
    """Stiffnesses k_j and thresholds D_j, an offset of the torque, and the mean square of the residual."""

    stiffness: FloatArray
    threshold: FloatArray
    offset: float
    mean_square: float = 0.0

    def torque(self, position: FloatArray) -> FloatArray:
        """Return tau_f (n,) along positions, the elements at rest at the first."""
        return operators(position, self.threshold) @ self.stiffness + self.offset

    def to_maxwell_slip(self) -> MaxwellSlip:
        """Return Maxwell slip as a robot's file has it."""
        has_stiffness = self.stiffness > 0
        k, D = self.stiffness[has_stiffness], self.threshold[has_stiffness]
        # An attraction of 100 torques per second: a slipping element reaches its torque almost at once.
        return MaxwellSlip(tuple(k.tolist()), tuple((k * D / float(k @ D)).tolist()), 100.0 * float(k @ D))


def fit_presliding(loops: FrictionRecord, frequency_hz: float | None, elements: int | None = None) -> Elements:
    """Return elements, by default as few as predict best within one std; DataError for loops of a few encoder counts.

    loops: quasi-static, and seldom out of presliding.  frequency_hz: of the motion, found in the torque for None.
    """
    u, resolution = loops.torque, loops.resolution
    if frequency_hz is None:  # of the loops, not of a dither on them
        frequency_hz = max(1, int(np.argmax(np.abs(np.fft.rfft(u - u.mean()))))) / loops.duration_s
    # The first half loop only gives the elements their start.
    n_settling = round(loops.rate_hz / frequency_hz / 2)
    reach = np.ptp(loops.position[n_settling:]) / 2
    if not reach > max(MIN_COUNTS * resolution, 0.0):
        raise DataError(
            "friction/presliding-loops",
            f"the joint moved by {2 * reach:.3g} {loops.unit}, {2 * reach / max(resolution, 1e-300):.2g} counts of its "
            f"encoder; presliding takes more than {2 * MIN_COUNTS:.0f}: raise the torque of the loops, or use a "
            "finer encoder",
            f"loops of joint {loops.joint}",
        )
    if np.count_nonzero(np.diff(np.sign(u - u.mean()))) == 1:
        text = "their torque never reverses, which friction and a spring do alike; log loops, or take purpose: motion"
        raise DataError("friction/presliding-loops", text, f"loops of joint {loops.joint}")
    thresholds = np.geomspace(max(1e-3 * reach, resolution), 2 * reach, 40)
    used = np.arange(len(u)) >= n_settling
    candidates = ((q, _fit(q, u, thresholds, used)) for q in _smooth(loops, frequency_hz))
    q, spectrum = min(candidates, key=lambda pair: pair[1].mean_square)
    if elements is not None:
        return _element_fit(q, u, spectrum, elements, used)
    folds = [np.isin(np.arange(len(used)), rows) for rows in np.array_split(np.flatnonzero(used), 5)]
    fits = [_element_fit(q, u, spectrum, count, used) for count in range(1, MAX_ELEMENTS + 1)]
    # Mean squares of what the rest of the log misses in each part of it; the best ones within one std.
    errors = np.array([
        [np.mean((u - _fit(q, u, fit.threshold, used & ~fold).torque(q))[fold] ** 2) for fold in folds] for fit in fits
    ])  # fmt: skip
    difference = errors - errors[np.argmin(errors.mean(axis=1))]
    std_of_mean = np.std(difference, axis=1, ddof=1) / np.sqrt(len(folds))
    return fits[int(np.argmax(difference.mean(axis=1) <= std_of_mean))]


def _smooth(loops: FrictionRecord, frequency_hz: float) -> Iterator[FloatArray]:
    """Yield the position as it is, and without its noise in each band, where the sensor is not exact."""
    yield loops.position
    for band in (5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0) if loops.resolution > 0 else ():
        if (hz := band * frequency_hz) < 0.45 * loops.rate_hz:
            yield np.asarray(sosfiltfilt(butter(4, hz, fs=loops.rate_hz, output="sos"), loops.position))


def operators(q: FloatArray, thresholds: FloatArray) -> FloatArray:
    """Return the stop operators (n, J) of a motion (n,), at rest at its first point."""
    path = Path.of(q)
    return np.stack([stop(path, float(D)) for D in thresholds], axis=1)


def _fit(q: FloatArray, u: FloatArray, thresholds: FloatArray, is_used: BoolArray) -> Elements:
    A = operators(q, thresholds)[is_used]
    scale = np.linalg.norm(A, axis=0)
    constant = np.ones((len(A), 1))
    x, _ = nnls(np.hstack([A / scale, constant, -constant]), u[is_used])
    k, offset = x[:-2] / scale, float(x[-2] - x[-1])
    return Elements(k, thresholds, offset, float(np.mean((u[is_used] - A @ k - offset) ** 2)))


def _element_fit(q: FloatArray, u: FloatArray, spectrum: Elements, count: int, is_used: BoolArray) -> Elements:
    torque = np.cumsum(spectrum.stiffness * spectrum.threshold)
    start = np.log(np.interp((np.arange(count) + 0.5) / count * torque[-1], torque, spectrum.threshold))
    start = start + 1e-3 * np.arange(count)  # no two the same
    low, high = np.log(spectrum.threshold[0] / 2), np.log(spectrum.threshold[-1])
    within = np.clip(start, low + 1e-6, high - 1e-6)

    def residual(x: FloatArray) -> FloatArray:
        return (u - _fit(q, u, np.exp(x), is_used).torque(q))[is_used]

    # Steps of the thresholds are coarse: operators are piecewise linear in them.
    (end,) = minimise(residual, [within], bounds=(low, high), diff_step=1e-3, max_nfev=25)
    return _fit(q, u, np.sort(np.exp(end.x)), is_used)


# Limits of responses at rest.
EXPANSION_ERROR = 1e-3  # relative, of a response: keeps a line without noise from outweighing all others
MAX_SLIP = 0.3  # rms over z_s, above which the expansion does not hold
SAME_AMPLITUDE = 1.4  # ratio up to which amplitudes are the same: random phases change that of one peak
MIN_LINES = 8  # of the torque that stand out of noise


# Std of the logarithms of the inertias of motor and link in a robot's file, and of stiffness and damping of its spring.
OF_FILE = np.array([0.05, 0.1, 1.0, 1.0])


@frozen_value
class PreslidingFit:
    """sigma_0, Nm/rad, and sigma_1, Nms/rad, extrapolated to no amplitude, of `amplitudes`; covariance (2, 2)."""

    sigma_0: float
    sigma_1: float
    covariance: FloatArray
    amplitudes: int
    notes: tuple[Note, ...] = ()


def fit_presliding_responses(
    location: str, responses: "Sequence[PreslidingResponse]", joint: ElasticJoint | None = None,
    viscous: tuple[float, float] = (0.0, 0.0)
) -> PreslidingFit:  # fmt: skip
    """Estimate presliding from responses at one amplitude or more. joint: None for a rigid joint with unknown inertia.

    viscous: alpha_2 of sliding with its std, Nms/rad.  An elastic joint is near that of the robot's file, `OF_FILE`.
    Raises FitError where the responses do not identify all unknowns.
    """
    model = _Model(tuple(responses), joint, viscous[0])
    (fit,) = minimise(model.residual, [model.start()], x_scale="jac", method="lm", xtol=1e-10, ftol=1e-12)
    if not np.all(np.isfinite(fit.covariance)):
        raise FitError(
            "friction/presliding-test",
            "stiffness, damping and slip of bristles cannot be distinguished; excite lines "
            "below and above the resonance of inertia and bristles, at amplitudes up to a tenth of break-away",
            f"{location} at rest",
        )
    n, scale = len(fit.x) - 3, np.array([np.exp(fit.x[-3]), model.damping_unit])
    # As the residuals scatter: variances from a few periods make good weights, and poor intervals.
    covariance = model.covariance(fit)[np.ix_([n, n + 2], [n, n + 2])] * np.outer(scale, scale)
    covariance += np.diag([0.0, viscous[1] ** 2])
    slip = float(fit.x[-2])
    text = (
        f"bristles move by {slip:.2g} of what they bend at break-away (rms); above {MAX_SLIP:g} the expansion "
        "over amplitude does not hold: lower the torque at rest"
    )
    notes = (Note("friction/presliding-test", text, f"{location} at rest"),) if slip > MAX_SLIP else ()
    return PreslidingFit(float(scale[0]), float(fit.x[-1] * scale[1]), covariance, len(responses), notes)


@dataclass(frozen=True)
class _Model:
    """Unknowns x: ln J of a rigid joint, or ln of inertias, stiffness and damping of an elastic joint relative to the
    robot model.

    Then ln sigma_0, s_q / z_s of the largest motion, sigma_1 / unit.
    """

    responses: "tuple[PreslidingResponse, ...]"
    joint: ElasticJoint | None
    viscous: float

    def reaction(self, x: FloatArray, omega: FloatArray) -> ComplexArray:
        """Return torque per angle (F,) of the inertias, for a motor with an elastic link or a rigid joint."""
        if self.joint is None:
            return np.asarray(-(omega**2) * np.exp(x[0]) + 0j)
        joint = ElasticJoint(*(np.exp(x[:-3]) * astuple(self.joint)).tolist())
        spring, link = joint.stiffness + 1j * omega * joint.damping, -(omega**2) * joint.link_inertia
        return np.asarray(-(omega**2) * joint.motor_inertia + spring * link / (spring + link))

    @property
    def damping_unit(self) -> float:
        """Unit of sigma_1 in x: about the stiffness over the angular frequency in the middle of the band."""
        first = self.responses[0]
        middle = len(first.freq_hz) // 2
        return float(1 / np.abs(first.G[middle]) / (2 * np.pi * first.freq_hz[middle]))

    def receptance(self, x: FloatArray, response: "PreslidingResponse") -> ComplexArray:
        """Return G (F,) at one amplitude."""
        omega = 2 * np.pi * response.freq_hz
        per_bend = x[-2] / max(G.rms_position for G in self.responses)  # 1 / z_s
        bristles = (np.exp(x[-3]) + 1j * omega * x[-1] * self.damping_unit) * bristle_ratio(omega, response, per_bend)
        return np.asarray(1 / (bristles + 1j * omega * self.viscous + self.reaction(x, omega)))

    def start(self) -> FloatArray:
        """Return x (n,) of the smallest amplitude by linear regression of 1 / G."""
        first = self.responses[0]
        omega = 2 * np.pi * first.freq_hz
        is_rigid, file_deviation = self.joint is None, np.zeros(len(OF_FILE))
        Z = 1 / first.G - (0 if is_rigid else self.reaction(np.append(file_deviation, [0.0] * 3), omega))
        weight = np.abs(first.G) ** 2 / np.sqrt(first.variance)
        A = np.stack([np.ones_like(omega), -(omega**2)], axis=1)[:, : 1 + is_rigid]
        (sigma_0, *inertia), *_ = np.linalg.lstsq(weight[:, None] * A, weight * Z.real, rcond=None)
        sigma_1 = float((weight * omega) @ (weight * Z.imag) / np.sum((weight * omega) ** 2))
        sigma_0 = max(float(sigma_0), 1e-3 * float(np.median(np.abs(1 / first.G))))
        smallest = 1e-3 * sigma_0 / float(omega[0]) ** 2
        common = [np.log(max(float(J), smallest)) for J in inertia] if is_rigid else file_deviation
        return np.array([*common, np.log(sigma_0), 0.1, sigma_1 / self.damping_unit])

    def covariance(self, fit: Optimum) -> FloatArray:
        """Return covariance (n, n) of x, whatever the residual variances; numbers of the robot model keep their std."""
        n_file = len(fit.r) - sum(2 * len(G.G) for G in self.responses)
        expansion = [np.tile(G.expansion / G.variance, 2) for G in self.responses]
        correlation = [np.full(2 * len(G.G), G.correlated_lines) for G in self.responses]
        min_variance = np.concatenate([*expansion, np.ones(n_file)])
        return fit.robust_covariance(np.concatenate([*correlation, np.zeros(n_file)]), min_variance)

    def residual(self, x: FloatArray) -> FloatArray:
        """Return residuals (m,) of the responses and of the file's numbers of an elastic joint, of variance 1."""
        file_deviation, residuals = x[:0] if self.joint is None else x[:-3] / OF_FILE, list[FloatArray]()
        for response in self.responses:
            error = (response.G - self.receptance(x, response)) / np.sqrt(response.variance / 2)
            residuals += [error.real, error.imag]
        return np.concatenate([*residuals, file_deviation])


def bristle_ratio(omega: FloatArray, response: "PreslidingResponse", per_bend: float) -> ComplexArray:
    """Return z / q (F,) of bristles with 1 / z_s = per_bend under the motion of a response; at most half slips."""
    rate = np.sqrt(2 / np.pi) * response.rms_velocity * per_bend
    epsilon = min(2 / np.pi * (response.rms_position * per_bend) ** 2, 0.5)
    return np.asarray((1 - epsilon) * 1j * omega / (1j * omega + rate))


@frozen_value
class PreslidingResponse:
    """Receptance G (F,), rad/Nm at freq_hz (F,), with its variance E|dG|^2 (F,), at one amplitude.

    By noise it is that of neighbouring lines, times correlated_lines: those over which errors are correlated.
    expansion (F,): its part by the expansion over amplitude.
    rms_position, rms_velocity: of the whole motion, noise included, rad and rad/s.
    """

    freq_hz: FloatArray
    G: ComplexArray
    variance: FloatArray
    expansion: FloatArray
    rms_position: float
    rms_velocity: float
    correlated_lines: float = 1.0

    @classmethod
    def of(cls, records: Sequence[FrictionRecord]) -> "PreslidingResponse":
        """Return the response from the records of one amplitude, each a realisation of a multisine.

        DataError for motion of less than a few counts of the encoder, and as `estimate`.
        """
        first, place = records[0], f"record {records[0].name}"
        # The mean angles of the logs of one amplitude differ by what the joint creeps.
        motor, posture = (f"motor {first.joint}",), first.configuration or Configuration(first.name, np.zeros(1))
        periodic = [
            Record(
                test.name, posture, i, 0, test.rate_hz, first.period_samples or len(test.torque), motor, motor,
                ("position",), test.torque[:, None], test.position[:, None], hold=test.hold,
                sliding=motor if test.slides else (), is_periodic=first.period_samples is not None
            )
            for i, test in enumerate(records)
        ]  # fmt: skip
        method: Method = "auto" if first.period_samples else "h1"  # a local method states no noise of its own
        G = estimate(periodic, EstimatorSpec(method, quantity="position", friction="none"))
        assert G.noise is not None
        # Above one and a half times the highest line, the noise of the encoder dominates.
        highest_hz = min(1.5 * float(G.freq_hz.max(initial=1.0)), 0.45 * first.rate_hz)
        lowest_hz = 0.75 * (first.rate_hz / first.period_samples if first.period_samples else float(G.freq_hz[0]))
        position, velocity = _motion(periodic, (lowest_hz, highest_hz))
        if G.n_lines < MIN_LINES or not 2 * position > MIN_COUNTS * first.resolution:
            text = (
                f"{G.n_lines} lines of its torque stand out of the noise, {MIN_LINES} are needed, and it moves by "
                f"{position:.3g} {first.unit} (rms) with counts of {first.resolution:.3g}: raise the torque at rest, "
                "repeat its period more often, use a finer encoder, or measure presliding by loops"
            )
            raise DataError("friction/presliding-test", text, place)
        smooth, _ = smooth_variance(G.noise.variance[:, 0, 0], G.G[:, 0, 0], G.noise.dof)
        expansion = (EXPANSION_ERROR * np.abs(G.G[:, 0, 0])) ** 2
        variance = smooth * G.correlated_lines + expansion
        return cls(G.freq_hz, G.G[:, 0, 0], variance, expansion, position, velocity, G.correlated_lines)


def presliding_responses(records: Sequence[FrictionRecord]) -> tuple[PreslidingResponse, ...]:
    """Return one response for each amplitude of the torque, the smallest first."""
    ordered = sorted(records, key=lambda record: float(np.std(record.torque)))
    sizes = np.array([np.std(record.torque) for record in ordered])
    ends = np.flatnonzero(sizes[1:] > SAME_AMPLITUDE * sizes[:-1]) + 1
    return tuple(
        PreslidingResponse.of(ordered[start:stop]) for start, stop in pairwise([0, *ends.tolist(), len(ordered)])
    )


def _motion(records: Sequence[Record], band_hz: tuple[float, float]) -> tuple[float, float]:
    band = butter(4, band_hz, "bandpass", fs=records[0].rate_hz, output="sos")
    q = [sosfiltfilt(band, record.y[:, 0])[record.period_samples * (record.n_periods > 1) :] for record in records]
    v = [np.gradient(x) * records[0].rate_hz for x in q]
    return float(np.std(np.concatenate(q))), float(np.std(np.concatenate(v)))
