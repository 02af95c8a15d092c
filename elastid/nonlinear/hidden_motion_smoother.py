r"""Smoother of the unmeasured motion behind the gears, from measured torques and angles.

.. math:: \hat q = q_0 + H W (C H)^H [C H W (C H)^H + \sigma^2]^{-1} (y - C q_0), \qquad
          q_0 = H (B u - \sum_i f_i P_i \Phi_i(\hat q))

H (n, n): response of the coordinates to forces.  B (n, n_u), C (n_u, n): torques to forces, coordinates to measured
angles.  u, y (n_u,): measured torques and angles.  f_i, P_i (n,), Phi_i: magnitude, direction and basis function of
effect i.  W (n, n): covariance of the unexplained torque at motors and links, from the residuals.  sigma^2 (n_u,):
noise variance of the angles.  Effects that depend on the motion itself are solved with it (`implicit_motion`).

Friction and hardening move the robot at all lines below half the rate. Above, up to half the rate of the fine grid,
forces move inertias; k would be about 0.02 % too low without this motion. Sampling folds it to the lines below: with
friction of 30 % of the torque it would resemble a transmission error, with k 0.05 % too low.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import ComplexArray, FloatArray, mean_of_neighbours
from elastid.nonlinear.basis_functions import GearEffect, Place, forces
from elastid.nonlinear.implicit_motion import ImplicitMotion
from elastid.nonlinear.period_lines import PeriodLines
from elastid.nonlinear.period_model import DriveLines


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """Forces by effects along the estimated motion, and the start of the next estimate.

    Phi (F, n, M, n_f): forces on the model's coordinates by effects of magnitude 1.  folded (F, n_u, M, n_f): aliases
    of their motion beyond half the rate, in the sampled angles.  unknowns: x (n_x, n) of each experiment, of `signals`.
    loads (M, n_j, n): absolute torques of the gears, for load-dependent friction.
    """

    Phi: ComplexArray
    folded: ComplexArray
    unknowns: tuple[FloatArray, ...]
    loads: FloatArray
    signals: tuple[tuple[Place, int], ...] = ()

    @classmethod
    def start(cls, lines: PeriodLines, drive: DriveLines, n_f: int) -> "SmoothedMotion":
        """Return an estimate with zero motion."""
        (F, n_u, M), n = lines.U.shape, drive.model.n
        Phi, folded = (np.zeros((F, rows, M, n_f), complex) for rows in (n, n_u))
        return cls(Phi, folded, (np.zeros((0, 0)),) * M, np.zeros((M, len(drive.k), lines.points)))

    def on(self, lines: PeriodLines) -> "SmoothedMotion":
        """Return the estimate on a grid of more or fewer points."""

        def resampled(x: FloatArray) -> FloatArray:
            return irfft(rfft(x), lines.points) * (lines.points / x.shape[-1]) if x.size else x

        return replace(self, unknowns=tuple(map(resampled, self.unknowns)), loads=resampled(self.loads))

    def select(self, indices: Sequence[int]) -> "SmoothedMotion":
        """Return the estimate with the effects of these indices; index -1 has no force."""
        Phi, folded = (
            np.concatenate([X, np.zeros((*X.shape[:3], 1))], axis=3)[..., indices] for X in (self.Phi, self.folded)
        )
        return replace(self, Phi=Phi, folded=folded)


def residuals(lines: PeriodLines, drive: DriveLines, estimate: SmoothedMotion, magnitudes: FloatArray) -> ComplexArray:
    """Return the residuals y - G u + C H P f Phi (F, n_u, M) of the logged angles; magnitudes f (n_f,)."""
    modelled_motion = drive.C @ drive.H @ np.tensordot(estimate.Phi, magnitudes, axes=1)
    modelled_motion = modelled_motion + np.tensordot(estimate.folded, magnitudes, axes=1)
    return np.asarray(lines.Y - drive.G @ lines.U + drive.sensor[:, :, None] * modelled_motion)


def smoothed_covariance(r: ComplexArray, lines: PeriodLines, drive: DriveLines) -> ComplexArray:
    """Return E r r^H (F, n_u, n_u) of residuals r (F, n_u, M), averaged over experiments and neighbouring lines.

    The ratio to the covariance by noise of torques and angles is averaged, since residuals change near resonances and
    at high frequencies. 1e-6 of the median power of the angles keeps the covariance of exact data regular.
    """
    angle_covariance = drive.G * _relative_powers(lines) @ drive.G.conj().swapaxes(1, 2)
    angle_power = np.einsum("fii->f", angle_covariance).real
    strongest = np.argsort(angle_power)[-max(1, len(angle_power) // 4) :]  # lines where torque noise dominates
    power = np.mean(np.sum(np.abs(r[strongest]) ** 2, axis=1), axis=1) - lines.noise.sum()
    c = max(float(np.median(power / angle_power[strongest])), 1e-300)
    factor = np.linalg.cholesky(c * angle_covariance + np.diag(lines.noise + 1e-6 * c * np.median(angle_power)))
    white = np.linalg.solve(factor, r)
    S = white @ white.conj().swapaxes(1, 2) / r.shape[2]
    S = mean_of_neighbours(S, 15)  # a power of one experiment has a std of 1 / sqrt(15), 26 %, over 15 lines
    return np.asarray(factor @ S @ factor.conj().swapaxes(1, 2))


def _relative_powers(lines: PeriodLines) -> FloatArray:
    """Return the mean powers (n_u,) of the torques over the largest mean power."""
    power = np.mean(np.abs(lines.U) ** 2, axis=(0, 2))
    return np.asarray(power / power.max())


def _gain(lines: PeriodLines, drive: DriveLines, S: ComplexArray) -> ComplexArray:
    """Return the gain (F, n, n_u) from the angles' residuals, of covariance S (F, n_u, n_u), to the motion."""
    CH = drive.C @ drive.H
    P = np.concatenate([drive.B.T, drive.places["link"]]).T
    W = P * np.resize(_relative_powers(lines), P.shape[1]) @ P.T
    angle_covariance, power = CH @ W @ CH.conj().swapaxes(1, 2), np.einsum("fii->f", S).real
    # Where the noise of the angles explains all of the residuals, 0.1 % of their power stays for torques.
    scale = np.maximum(power - lines.noise.sum(), 1e-3 * power) / np.einsum("fii->f", angle_covariance).real
    covariance = scale[:, None, None] * angle_covariance + np.diag(lines.noise)
    return np.asarray(scale[:, None, None] * (drive.H @ W @ CH.conj().swapaxes(1, 2)) @ np.linalg.inv(covariance))


def smooth_motion(
    lines: PeriodLines, drive: DriveLines, effects: Sequence[GearEffect], magnitudes: FloatArray,
    previous: SmoothedMotion, tolerance: float = 1e-4,
) -> SmoothedMotion:  # fmt: skip
    """Estimate the motion of all experiments for effects with magnitudes (n_f,), and the effects along this motion.

    previous: previous estimate, the start.  tolerance: relative error of the implicit motion that ends the iteration.
    """
    gain = _gain(lines, drive, smoothed_covariance(residuals(lines, drive, previous, magnitudes), lines, drive))
    base = _explicit_motion(lines, drive, effects, magnitudes, previous, gain)
    force_response = drive.H - gain @ (drive.C @ drive.H)
    problem = ImplicitMotion(lines, drive, tuple(effects), magnitudes, force_response, previous.loads, tolerance)
    end, unknowns = SmoothedMotion.start(lines, drive, len(effects)), []
    last = (drive.C @ drive.H[-1]).T * lines.sampled  # sampled motion by force at the last line
    for m in range(lines.U.shape[2]):
        starts = dict(zip(previous.signals, previous.unknowns[m], strict=bool(previous.signals)))
        q, x, force = problem.solve(base[:, :, m], m, starts)
        unknowns.append(x)
        joints = {effect.joint: drive.joints.index(effect.joint) for effect in effects}
        motions = {joint: problem.motion(q, j, m, x, force) for joint, j in joints.items()}
        for joint, motion in motions.items():
            end.loads[m, joints[joint]] = np.abs(motion.torque)
        for i, effect in enumerate(effects):
            places, phi = zip(*forces(effect, motions[effect.joint]), strict=True)
            rows = np.array([drive.directions(place, joints[effect.joint]) for place in places])
            amplitudes, folded = lines.folded(np.array(phi))
            end.Phi[:, :, m, i] = amplitudes.T @ rows
            end.folded[:, :, m, i] = folded.T @ (rows @ last)
    return replace(end, unknowns=tuple(unknowns), signals=tuple(problem.signals))


def _explicit_motion(
    lines: PeriodLines, drive: DriveLines, effects: Sequence[GearEffect], magnitudes: FloatArray,
    previous: SmoothedMotion, gain: ComplexArray,
) -> ComplexArray:  # fmt: skip
    """Return the smoothed motion (F, n, M) without implicit effects.  gain (F, n, n_u): from residuals of angles."""
    is_explicit = np.array([not effect.is_implicit for effect in effects], bool)
    force = np.tensordot(previous.Phi[..., is_explicit], magnitudes[is_explicit], axes=1)
    base = drive.H @ (drive.B @ (drive.command[:, :, None] * lines.U) - force)
    y = (lines.Y - drive.aliases @ lines.U) / drive.sensor[:, :, None]
    y = y + np.tensordot(previous.folded, magnitudes, axes=1)
    base = base + gain @ (y - drive.C @ base)
    if lines.arm is not None:  # the arm's torques deflect the springs, too
        base = base - drive.H @ (drive.places["link"].T @ lines.arm[1:])
    return base
