r"""Nonlinear distortion at detection lines and at excited lines, and the bias of G by dry friction.

With an odd multisine (odd lines only), even nonlinearities appear at the even lines and odd nonlinearities at excluded
odd lines.  With feedback, distortion of y also appears in u; the linear response to u is removed by

.. math:: Y_c = Y - \hat G U

with G interpolated linearly between its lines. (Pintelon and Schoukens, System Identification, 2nd ed., chapter 4.)
A superimposed slow motion on an even line mixes both kinds.

For a Gaussian velocity v with density p, Coulomb friction F sgn(v) is to first order a viscous friction 2 F p(0)
(Bussgang), which a fit identifies, and a distortion uncorrelated with v. To second order the distortion acts on the
velocity through the mobility y, which shifts the reversals. By Price's theorem this adds to the torque per velocity, up
to a constant,

.. math:: \delta Z(\omega) = -4 F^2 \int_0^\infty y(\tau)\, [p_2(\tau) - p(0)^2]\, (e^{-j \omega \tau} - 1)\, d\tau,
          \qquad \delta G = -G e_j\, \delta Z\, e_j^T G

p_2(tau): density of (v(t), v(t - tau)) at (0, 0), proportional to 1 / tau for small tau. With a superimposed slow
motion c(t), p(0) and p_2 are means over t. delta Z increases with frequency like a mass and a loss, so that stiffness
and damping absorb some of it. It is the same in all configurations, but 2 F p(0) is larger in configurations with less
motion. A fit with one viscous friction for all configurations has an error of about FIRST_ORDER_FRACTION of it.

F^2: power of the distortion over the power of sgn(v) without its linear part, both as torques at the motor. Its
accuracy is about a third for F up to 0.3 rms torques; the phase error of delta Z is about QUADRATURE_FRACTION rad.
Nonlinearities other than Coulomb friction can also cause the distortion. Therefore a fit uses delta G as standard
deviations of factors, with a further factor of j delta Z.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, interpolate
from elastid.base.fourier import real_dft
from elastid.base.large_arrays import release
from elastid.base.matrices import positive, power
from elastid.frf.estimators import equation_error
from elastid.frf.experiment_blocks import MeanSpectra
from elastid.frf.spectra import RecordSpectra
from elastid.record import MOTION_ORDER, Motion, Record
from elastid.response import SYSTEMATIC_ERRORS, LineAmplitudes


@dataclass(frozen=True)
class DetectionLines:
    """Amplitudes at the even and odd detection lines, and the distortion covariance at the odd ones.

    odd_lines (K_odd,): DFT lines.  excess (K_odd, n_y, n_y): mean of Y_c Y_c^H over `count` experiments minus its
    noise.
    """

    even: LineAmplitudes | None
    odd: LineAmplitudes | None
    odd_lines: IntArray
    excess: ComplexArray
    count: int


def detection_lines(lines: IntArray, half_wave: bool) -> IntArray:
    """Return unexcited lines (K,) inside the band of an odd multisine; empty if even lines were excited."""
    if half_wave or len(lines) < 2 or np.any(lines % 2 == 0):
        return np.zeros(0, np.int64)
    return np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)


def detect(
    detection: IntArray, lines: IntArray, spacing_hz: float, G: ComplexArray, data: MeanSpectra
) -> DetectionLines:
    """Return the distortion at the detection lines (K,) of the data; G (F, n_y, n_u) at the excited lines (F,)."""
    every, G_k = data.all_experiments, interpolate(detection, lines, G)
    Y_c = every.Y - G_k @ every.U
    C_V = equation_error(data, G_k)
    odd = detection % 2 == 1
    error = Y_c[odd] @ Y_c[odd].mT.conj() / Y_c.shape[2]
    amplitude = np.sqrt(np.mean(np.abs(Y_c) ** 2, axis=2))
    noise_cov = C_V * np.mean(1 / every.periods)
    noise = np.sqrt(power(noise_cov))

    def line_levels(mask: BoolArray) -> LineAmplitudes | None:
        columns = (np.asarray(x[mask], np.float64) for x in (detection * spacing_hz, amplitude, noise))
        return LineAmplitudes(*columns) if mask.any() else None

    return DetectionLines(line_levels(~odd), line_levels(odd), detection[odd], error - noise_cov[odd], Y_c.shape[2])


def fast_total_error(
    detection: DetectionLines, lines: IntArray, noise_cov: ComplexArray, dof: int
) -> tuple[ComplexArray, float] | None:
    """Return C_T (F, n_y, n_y) of one experiment at the excited lines (F,), and its dof, from odd detection lines.

    The fast method: with a random grid the distortion is equal at excited and excluded odd lines, so that one
    realisation is enough. The noise differs, because input noise follows the resonances: noise_cov (F, n_y, n_y), with
    `dof`, is estimated at each line.  None with too few odd detection lines.
    """
    n_y, K = detection.excess.shape[1], len(detection.odd_lines)
    window = max(3, -(-2 * n_y // detection.count))
    # In a random odd grid at least a tenth of the odd lines is excluded.
    if max(window, 0.1 * len(lines)) > K:
        return None
    first = np.clip(np.searchsorted(detection.odd_lines, lines) - window // 2, 0, K - window)
    sums = np.concatenate([np.zeros((1, n_y, n_y)), np.cumsum(detection.excess, axis=0)])
    distortion_cov = positive((sums[first + window] - sums[first]) / window)  # without negative eigenvalues
    powers = [float(np.einsum("fii->", covariance).real) for covariance in (noise_cov, distortion_cov)]
    spread = powers[0] ** 2 / dof + powers[1] ** 2 / (window * detection.count)
    return noise_cov + distortion_cov, sum(powers) ** 2 / spread if spread > 0 else float(dof)


# Fraction of the second order with 90 degrees phase shift: the phase error is 0.3 to 0.4 rad in many realisations.
QUADRATURE_FRACTION = 0.35
FIRST_ORDER_FRACTION = 0.2  # of the equivalent viscous friction, difference between configurations


def friction_bias(
    spectra: Sequence[Sequence[RecordSpectra]], lines: IntArray, G: ComplexArray, quantity: Motion,
    error: ComplexArray, noise: ComplexArray, dof: float,
) -> ComplexArray | None:  # fmt: skip
    """Return delta G (3, n_u, F, n_y, n_u) due to the friction of each input's motor, zero without friction.

    The three errors are the second order, its quadrature component (both common to all configurations), and the first
    order of this configuration.
    G (F, n_y, n_u) at DFT lines (F,), in `quantity`.  error, noise (F, n_y, n_y): covariance of Y - G U in one
    experiment, by noise and distortion with dof complex degrees of freedom, and by noise alone.  None without
    significant distortion, or if the motion of a motor was not logged.
    """
    first = spectra[0][0].record
    if first.half_wave or any(location not in first.outputs for location in first.inputs):
        return None
    rows = [first.outputs.index(location) for location in first.inputs]
    if any(first.quantities[row] == "acceleration" for row in rows):
        return None
    inverse = np.asarray(np.linalg.pinv(G[:, rows]), np.complex128)
    torque_error, torque_noise = (
        power(inverse @ covariance[:, rows][:, :, rows] @ inverse.mT.conj()) for covariance in (error, noise)
    )
    distortion = torque_error - torque_noise
    weight = 1 / (torque_noise + torque_error.mean(axis=0)) ** 2
    scatter = np.sqrt(np.sum((weight * torque_error) ** 2, axis=0) / dof)
    # With less than three standard deviations over all lines the second order is also insignificant.
    is_distorted = np.sum(weight * distortion, axis=0) > 3.0 * scatter
    if not is_distorted.any():
        return None
    V = _velocities([covariance for group in spectra for covariance in group], rows, lines)
    omega = 2j * np.pi * (lines * first.rate_hz / first.period_samples)
    bias = np.zeros((SYSTEMATIC_ERRORS, len(rows), *G.shape), complex)
    for j in np.flatnonzero(is_distorted):
        N = first.period_samples
        _, unit = sign_approximation(np.fft.irfft(V[:, :, j], N, axis=1), V[:, lines, j] * (2 / N), lines)
        F_squared = float(weight[:, j] @ distortion[:, j] / (weight[:, j] @ unit))
        mobility = G[:, rows[j], j] * omega ** (1 - MOTION_ORDER[quantity])
        density, second = unit_impedance(V[:, :, j], mobility, lines, first)
        twice = -G[:, :, j, None] * G[:, rows[j], None, :] * omega[:, None, None] ** (1 - MOTION_ORDER[quantity])
        bias[0, j] = F_squared * second[:, None, None] * twice
        bias[1, j] = QUADRATURE_FRACTION * 1j * bias[0, j]
        bias[2, j] = FIRST_ORDER_FRACTION * 2 * np.sqrt(F_squared) * density * twice
    return bias


def unit_impedance(
    V: ComplexArray, mobility: ComplexArray, lines: IntArray, record: Record
) -> tuple[float, ComplexArray]:
    """Return p(0) and the second order (F,) at DFT lines (F,) for F = 1.

    V (K, N // 2 + 1): DFT of the velocity in K experiments.  mobility (F,): velocity per torque at the lines.
    """
    N, rate_hz = record.period_samples, record.rate_hz
    step = max(1, int(N / (16 * lines[-1])))  # 16 lags in a period of the highest line
    # Lags up to a period of the lowest line; after half a period of the record odd lines repeat with inverse sign.
    lag = np.arange(0, int(N / lines[0]) + 1 if lines[0] > 1 else N // 2, step)
    y = _step_response(mobility, lines, N)[lag] * rate_hz
    moving = np.arange(V.shape[1]) >= lines[0]
    R = np.fft.irfft(np.mean(np.abs(V) ** 2, axis=0) * moving, N) / N
    carrier = np.fft.irfft(V.mean(axis=0) * ~moving, N)
    t = np.arange(0, N, max(1, N // 512))
    variance, rho, c = R[0], R[lag[1:], None] / R[0], carrier[t]
    p_0 = np.mean(np.exp(-(c**2) / (2 * variance))) / np.sqrt(2 * np.pi * variance)
    lag_carrier, innovation = carrier[t - lag[1:, None]], 1 - rho**2
    exponent = (c**2 - 2 * rho * c * lag_carrier + lag_carrier**2) / (2 * variance * innovation)
    density = np.exp(-exponent).mean(axis=1) / (2 * np.pi * variance * np.sqrt(innovation[:, 0]))
    kernel = np.append(0.0, density - p_0**2) * y
    difference = np.exp(-2j * np.pi * np.outer(lines / N, lag)) - 1
    # At lag 0 the product of the density, proportional to 1 / tau, and of -j omega tau is finite.
    start = -2j * np.pi * lines / N * lag[1] * kernel[1]
    return float(p_0), np.asarray(-4 * (difference @ kernel + start / 2) * step / rate_hz)


def _velocities(records: Sequence[RecordSpectra], rows: Sequence[int], lines: IntArray) -> ComplexArray:
    """Return DFT V (K, N // 2 + 1, n_u) of the motors' velocities, means over the periods of each experiment."""
    first = records[0].record
    k = np.arange(first.period_samples // 2 + 1)
    omega = 2j * np.pi * k * first.rate_hz / first.period_samples
    order = np.array([1 - MOTION_ORDER[first.quantities[row]] for row in rows])
    # Above four times the highest line the noise of an encoder would determine the sign of the velocity.
    gain = np.where((k <= 4 * lines[-1])[:, None], omega[:, None] ** order, 0.0)
    V, N = [], first.period_samples
    for y, P in ((spectrum.record.y, spectrum.record.n_repeats) for spectrum in records):
        V.append(real_dft((np.asarray(sum(y[p * N : (p + 1) * N] for p in range(P))) / P)[None])[0][:, rows] * gain)
        release(y)
    return np.array(V)


def sign_approximation(v: FloatArray, V: ComplexArray, lines: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return slope and residual power (F, ...) of sgn(v), v (K, N, ...), by linear approximation in V (K, F, ...)."""
    T = np.fft.rfft(np.sign(v), axis=1)[:, lines] * (2 / v.shape[1])
    slope = np.sum(V.conj() * T, axis=(0, 1)).real / np.sum(np.abs(V) ** 2, axis=(0, 1))
    return np.asarray(slope), np.asarray(np.mean(np.abs(T - slope * V) ** 2, axis=0))


def _step_response(mobility: ComplexArray, lines: IntArray, N: int) -> FloatArray:
    """Return velocity (N,) after an impulse of torque: mobility (F,) at DFT lines, a mass above, 0 at 0 Hz."""
    k = np.arange(N // 2 + 1)
    acceleration = mobility * lines
    mass = np.abs(np.mean(acceleration[-max(1, len(lines) // 8) :]))
    every = np.interp(k, lines, acceleration.real, right=0.0) + 1j * np.interp(k, lines, acceleration.imag, right=-mass)
    every[1:] /= k[1:]
    below = k < lines[0]
    every[below] = mobility[0] * k[below] / lines[0]
    return np.fft.irfft(every, N)
