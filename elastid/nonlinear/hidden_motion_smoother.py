r"""Smoother of the unmeasured motion behind the gears, from measured torques and angles.

.. math:: \hat q = q_0 + H W (C H)^H [C H W (C H)^H + \sigma^2]^{-1} (y - C q_0), \qquad
          q_0 = H (B u - \sum_i f_i P_i \Phi_i(\hat q))

H (n, n): response of the coordinates to forces.  B, C: torques to forces, coordinates to measured angles.  u, y:
measured torques and angles.  f_i, P_i, Phi_i: magnitude, direction and basis function of effect i.  W: covariance of
the unexplained torque at motors and links, from the residuals.  sigma^2: noise variance of the angles.
Implicit effects depend on the motion itself. Their deflections of gears and velocities of motors and links x(t) over a
period solve x + A f Phi(x) = x_0, with A the response of the estimate to forces. Newton's method solves this equation,
each step by GMRES with two FFTs per product. (Alternating frequency and time for a linear structure with few nonlinear
elements: Cameron and Griffin, J. Appl. Mech. 56, 1989.)

Friction and hardening move the robot at all lines below half the rate. Above, up to half the rate of the fine grid,
forces move inertias; k would be about 0.02 % too low without this motion. Sampling folds it to the lines below: with
friction of 30 % of the torque it would resemble a transmission error, with k 0.05 % too low.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import starmap

import numpy as np
from numpy.fft import irfft, rfft
from scipy.sparse.linalg import LinearOperator, gmres

from elastid.base.arrays import ComplexArray, FloatArray, mean_of_neighbours
from elastid.nonlinear.basis_functions import GearEffect, GearMotion, Place, along_period, forces, transmission_error
from elastid.nonlinear.period_lines import PeriodLines
from elastid.nonlinear.period_model import DriveLines

_STEPS, _HALVINGS = 8, 5  # most steps of Newton's method, and most halvings of a step


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

    The average is over the ratio to the covariance by noise of torques and angles, because the residuals themselves
    change with frequency near resonances and at high frequencies.
    """
    angle_covariance = drive.G * _relative_powers(lines) @ drive.G.conj().swapaxes(1, 2)
    angle_power = np.einsum("fii->f", angle_covariance).real
    strongest = np.argsort(angle_power)[-max(1, len(angle_power) // 4) :]  # lines where torque noise dominates
    power = np.mean(np.sum(np.abs(r[strongest]) ** 2, axis=1), axis=1) - lines.noise.sum()
    c = max(float(np.median(power / angle_power[strongest])), 1e-300)
    factor = np.linalg.cholesky(c * angle_covariance + np.diag(lines.noise + 1e-6 * c * np.median(angle_power)))
    white = np.linalg.solve(factor, r)
    S = white @ white.conj().swapaxes(1, 2) / r.shape[2]
    return np.asarray(factor @ mean_of_neighbours(S, 15) @ factor.conj().swapaxes(1, 2))


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
    scale = np.maximum(power - lines.noise.sum(), 1e-3 * power) / np.einsum("fii->f", angle_covariance).real
    covariance = scale[:, None, None] * angle_covariance + np.diag(lines.noise)
    return np.asarray(scale[:, None, None] * (drive.H @ W @ CH.conj().swapaxes(1, 2)) @ np.linalg.inv(covariance))


def smooth_motion(
    lines: PeriodLines,
    drive: DriveLines,
    effects: Sequence[GearEffect],
    magnitudes: FloatArray,
    previous: SmoothedMotion,
    tolerance: float = 1e-4,
) -> SmoothedMotion:
    """Estimate the motion of all experiments for effects with magnitudes (n_f,), and the effects along this motion.

    previous: previous estimate, the start.  tolerance: relative error of the implicit motion that ends the iteration.
    """
    gain = _gain(lines, drive, smoothed_covariance(residuals(lines, drive, previous, magnitudes), lines, drive))
    force_response = drive.H - gain @ (drive.C @ drive.H)
    implicit = np.array([effect.is_implicit for effect in effects], bool)
    explicit_force = np.tensordot(previous.Phi[..., ~implicit], magnitudes[~implicit], axes=1)
    base = drive.H @ (drive.B @ (drive.command[:, :, None] * lines.U) - explicit_force)
    y = (lines.Y - drive.aliases @ lines.U) / drive.sensor[:, :, None]
    y = y + np.tensordot(previous.folded, magnitudes, axes=1)
    base = base + gain @ (y - drive.C @ base)
    if lines.arm is not None:  # the arm's torques deflect the springs, too
        base = base - drive.H @ (drive.places["link"].T @ lines.arm[1:])
    end, unknowns = SmoothedMotion.start(lines, drive, len(effects)), []
    problem = _ImplicitMotion(lines, drive, tuple(effects), magnitudes, force_response, previous.loads, tolerance)
    last = (drive.C @ drive.H[-1]).T * lines.sampled  # sampled motion by force at the last line
    for m in range(lines.U.shape[2]):
        q, x, force = problem.solve(base[:, :, m], m, previous)
        unknowns.append(x)
        joints = {effect.joint for effect in effects}
        motions = {joint: problem.motion(q, drive.joints.index(joint), m, x, force) for joint in joints}
        for joint, motion in motions.items():
            end.loads[m, drive.joints.index(joint)] = np.abs(motion.torque)
        for i, effect in enumerate(effects):
            j = drive.joints.index(effect.joint)
            acting = forces(effect, motions[effect.joint])
            rows, phi = np.array([drive.directions(place, j) for place, _ in acting]), np.array([x for _, x in acting])
            amplitudes, folded = lines.folded(phi)
            end.Phi[:, :, m, i] = amplitudes.T @ rows
            end.folded[:, :, m, i] = folded.T @ (rows @ last)
    return replace(end, unknowns=tuple(unknowns), signals=tuple(problem.signals))


@dataclass(frozen=True, eq=False)
class _ImplicitMotion:
    """Equation of the implicit effects of a configuration.

    force_response (F, n, n): motion q by forces.  loads (M, n_j, n): as in `SmoothedMotion`.
    """

    lines: PeriodLines
    drive: DriveLines
    effects: tuple[GearEffect, ...]
    magnitudes: FloatArray
    force_response: ComplexArray
    loads: FloatArray
    tolerance: float

    @cached_property
    def signals(self) -> list[tuple[Place, int]]:
        """Location and joint (index) of each unknown."""
        effects = filter(lambda effect: effect.is_implicit, self.effects)
        return sorted({(effect.place, self.drive.joints.index(effect.joint)) for effect in effects})

    def solve(
        self, base: ComplexArray, m: int, previous: SmoothedMotion
    ) -> tuple[ComplexArray, FloatArray, FloatArray]:
        """Return motion (F, n), unknowns (n_x, n) and forces (n_x, n) of experiment m.

        base (F, n): motion without implicit effects.
        """
        lines, rows = self.lines, self._rows
        if not self.signals:
            return base, *(np.zeros((0, 0)),) * 2
        x_0, static = lines.fine((self._powers * (base @ rows.T)).T), self._static_deflection(m)
        for i, (place, j) in enumerate(self.signals):
            if place == "gear":
                x_0[i] += static[j] + self._transmission_error(base, j, m)
        starts = dict(zip(previous.signals, previous.unknowns[m], strict=bool(previous.signals)))
        start = np.array([starts.get(signal, x) for signal, x in zip(self.signals, x_0, strict=True)])
        x, force = newton(partial(self._law, m), self.linear, x_0, start, self.tolerance)
        return base - (self.force_response @ (rows.T @ lines.amplitudes(force).T[:, :, None]))[:, :, 0], x, force

    @cached_property
    def _rows(self) -> FloatArray:
        """Directions (n_x, n) of the unknowns."""
        return np.array(list(starmap(self.drive.directions, self.signals)))

    @cached_property
    def _powers(self) -> ComplexArray:
        """Factor (F, n_x) of the unknowns: 1 for deflections, s for velocities."""
        return self.lines.s[:, None] ** np.where([place == "gear" for place, _ in self.signals], 0, 1)

    @cached_property
    def linear(self) -> "Linear":
        """Map from forces at the unknowns to the unknowns."""
        is_gear = np.array([place == "gear" for place, _ in self.signals], bool)
        A = self._powers[:, :, None] * (self._rows @ self.force_response @ self._rows.T)
        softness = np.where(is_gear, 1 / self.drive.k[[j for _, j in self.signals]], 0.0)
        remainder = len(A) / np.arange(len(A) + 1, self.lines.points // 2)
        return Linear(A.transpose(1, 2, 0).copy(), remainder ** np.where(is_gear, 2, 1)[:, None], softness)

    def _static_deflection(self, m: int) -> FloatArray:
        """Return the mean deflections (n_j,) of the gears in experiment m, under gravity along its motion."""
        return (self.drive.torque + (0.0 if self.lines.arm is None else self.lines.arm[0, :, m].real)) / self.drive.k

    def _transmission_error(self, q: ComplexArray, j: int, m: int) -> FloatArray:
        """Return the transmission error (n,) of joint j along the motion of its motor."""
        angle, total = self._angle(q, j, m), np.zeros(self.lines.points)
        for effect, f in zip(self.effects, self.magnitudes, strict=True):
            if effect.joint == self.drive.joints[j] and effect.kind.startswith("error"):
                total += f * transmission_error(effect, angle, float(self.drive.ratios[j]))[0]
        return total

    def _angle(self, q: ComplexArray, j: int, m: int) -> FloatArray:
        row = self.drive.directions("motor", j)
        return np.asarray(self.lines.fine((q @ row)[None])[0] + row @ self.drive.B @ self.lines.mean[:, m])

    def _law(self, m: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the force (n_x, n) at each unknown of experiment m, and its slope; x (n_x, n)."""
        force, slope = np.zeros_like(x), np.zeros_like(x)
        shapes: dict[tuple[str, int, float], tuple[FloatArray, FloatArray]] = {}
        for effect, f in zip(self.effects, self.magnitudes, strict=True):
            if effect.is_implicit and f:
                j = self.drive.joints.index(effect.joint)
                i, size = self.signals.index((effect.place, j)), self.loads[m, j] if effect.kind == "load" else 1.0
                # Load-dependent friction has the sign of the other friction.
                key = "friction" if effect.kind == "load" else effect.kind, i, effect.scale
                if key not in shapes:
                    shapes[key] = along_period(effect, x[i])
                phi, dphi = shapes[key]
                force[i] += f * size * phi
                slope[i] += f * size * dphi
        return force, slope

    def motion(self, q: ComplexArray, j: int, m: int, x: FloatArray, force: FloatArray) -> GearMotion:
        """Return the motion of joint j in experiment m from q (F, n), unknowns x (n_x, n) and their forces."""
        lines, drive, signals = self.lines, self.drive, self.signals
        motor, gear, link = (q @ drive.directions(location, j) for location in ("motor", "gear", "link"))
        amplitudes = np.stack([gear, lines.s * gear, lines.s * motor, lines.s * link])
        swing, slope, velocity, link_velocity = lines.fine(amplitudes)
        motions: dict[Place, FloatArray] = {
            "gear": swing + self._static_deflection(m)[j] + self._transmission_error(q, j, m),
            "motor": velocity, "link": link_velocity,
        }  # fmt: skip
        motions |= {location: signal for (location, joint), signal in zip(signals, x, strict=False) if joint == j}
        torque = drive.k[j] * motions["gear"] + drive.d[j] * slope
        if ("gear", j) in signals:
            torque = torque + force[signals.index(("gear", j))]
        numbers = float(drive.ratios[j]), float(drive.k[j]), float(drive.d[j])
        return GearMotion(self._angle(q, j, m), motions["motor"], motions["link"], motions["gear"], torque, *numbers)


@dataclass(frozen=True, eq=False)
class Linear:
    """Map from forces to unknowns: A (n_x, n_x, F) on the lines, softness (n_x,) at zero frequency.

    remainder (n_x, K): factor of the last line's A at the lines above: (s_F / s)^2 of a deflection, s_F / s of a
    velocity.
    """

    A: ComplexArray
    remainder: FloatArray
    softness: FloatArray

    def __call__(self, force: FloatArray) -> FloatArray:
        """Return the unknowns (n_x, n) by forces (n_x, n) on the fine grid of a period."""
        F, spectrum = self.A.shape[2], rfft(force)
        X = np.zeros_like(spectrum)
        X[:, 0] = self.softness * spectrum[:, 0]
        X[:, 1 : F + 1] = (self.A * spectrum[:, 1 : F + 1]).sum(axis=1)
        X[:, F + 1 : -1] = (self.A[:, :, -1] @ spectrum[:, F + 1 : -1]) * self.remainder
        return irfft(X, force.shape[1])


def newton(
    law: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    linear: Callable[[FloatArray], FloatArray],
    x_0: FloatArray,
    x: FloatArray,
    tolerance: float = 1e-4,
) -> tuple[FloatArray, FloatArray]:
    """Solve x + linear(law(x)) = x_0 for x (n_x, n) by Newton's method. Return x and the force at x.

    law: returns force and slope at each point.  x: start, replaced by x_0 if its error exceeds 1 and the error of x_0.
    tolerance: final error over the size of x_0.  Steps are halved until the error decreases; otherwise the last x is
    returned, whose error widens the intervals.
    """
    size = np.std(x_0, axis=1)[:, None] + 1e-300

    def error(x: FloatArray) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Return rms error, error (n_x, n), slope of the law, and force."""
        force, slope = law(x)
        e = (x - x_0 + linear(force)) / size
        return float(np.sqrt(np.mean(e**2))), e, slope, force

    state = error(x)
    if state[0] > 1 and (at_0 := error(x_0))[0] < state[0]:
        x, state = x_0, at_0
    for _ in range(_STEPS):
        if state[0] < tolerance:
            break
        step = _newton_step(linear, state[2], size, -state[1] * size, 3e-2)
        trials = ((x + step / 2**halving, error(x + step / 2**halving)) for halving in range(_HALVINGS + 1))
        better = next((trial for trial in trials if trial[1][0] < state[0]), None)
        if better is None:
            break
        x, state = better
    return x, state[3]


def _newton_step(
    linear: Callable[[FloatArray], FloatArray], slope: FloatArray, size: FloatArray, x_0: FloatArray, tolerance: float
) -> FloatArray:
    """Solve x + linear(slope x) = x_0 for x (n_x, n) by GMRES; size (n_x, 1): scale of the unknowns.

    Single precision suffices for the relative tolerance of some percent.
    """
    x_slope, weight = (slope * size).astype(np.float32), (1 / size).astype(np.float32)

    def product(v: FloatArray) -> FloatArray:
        return v + (linear(x_slope * v.reshape(x_0.shape)) * weight).ravel()

    operator = LinearOperator((x_0.size, x_0.size), matvec=product, dtype=np.float32)
    step = gmres(operator, (x_0 / size).astype(np.float32).ravel(), rtol=tolerance, restart=40, maxiter=1)[0]
    return np.asarray(step.reshape(x_0.shape) * size)
