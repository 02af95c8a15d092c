r"""Smoother of the unmeasured motion behind the gears, from measured torques and angles.

.. math:: \hat q = q_0 + H W (C H)^H [C H W (C H)^H + \sigma^2]^{-1} (y - C q_0), \qquad
          q_0 = H (B u - \sum_i f_i P_i \Phi_i(\hat q))

W: covariance of the torque that the model does not explain, at motors and links, from the residuals; sigma^2: noise of
the angles. Effects that depend on the motion itself make this an equation for the deflections of gears and velocities
of motors and links x (t) over a period, x + A f Phi(x) = x_0 with A the response of the estimate to forces, which is
solved by Newton's method, each step by GMRES with two FFTs a product: only these unknowns are nonlinear. (The response
of a linear structure with few nonlinear elements by alternating frequency and time, Cameron and Griffin, J. Appl. Mech.
56, 1989.)

The lines are all below half the rate: friction and hardening move the robot there, too. Beyond them, up to
half the rate of the fine grid, forces move inertias: k some 0.02 % too low without. In sampled angles that
motion is folded to the lines below: beside friction of 30 % of the torque it would pass for a transmission error, k
0.05 % too low.
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
from elastid.nonlinear.period_model import DriveLines
from elastid.nonlinear.spectra import PeriodLines

_STEPS, _HALVINGS = 8, 5  # Newton's method


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """Phi (F, n, M, n_f): forces on the model's coordinates by effects of magnitude 1.

    folded (F, n_u, M, n_f): what they take from the sampled angles by motion beyond half the rate.
    unknowns: deflections and velocities x (n_x, n) of each experiment, of `signals`, from which the next one starts.
    loads (M, n_j, n): size of the gears' torques, by which friction of the next estimate grows with load.
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

    def of(self, places: Sequence[int]) -> "SmoothedMotion":
        """Return the estimate of effects by index; index -1 has no force."""
        Phi, folded = (
            np.concatenate([X, np.zeros((*X.shape[:3], 1))], axis=3)[..., list(places)] for X in (self.Phi, self.folded)
        )
        return replace(self, Phi=Phi, folded=folded)


def residuals(lines: PeriodLines, drive: DriveLines, estimate: SmoothedMotion, magnitudes: FloatArray) -> ComplexArray:
    """Return y - G u + C H P f Phi (F, n_u, M), of the logged angles."""
    modelled_motion = drive.C @ drive.H @ np.tensordot(estimate.Phi, magnitudes, axes=1)
    modelled_motion = modelled_motion + np.tensordot(estimate.folded, magnitudes, axes=1)
    return np.asarray(lines.Y - drive.G @ lines.U + drive.sensor[:, :, None] * modelled_motion)


def smoothed_covariance(r: ComplexArray, lines: PeriodLines, drive: DriveLines) -> ComplexArray:
    """Return E r r^H (F, n_u, n_u) of residuals (F, n_u, M), over experiments and neighbouring lines.

    Of neighbours their ratio to noise of torques that the model passes on, and of angles: near resonances, and where a
    robot moves less and less, they are not alike themselves.
    """
    angle_covariance = drive.G * _sizes(lines) @ drive.G.conj().swapaxes(1, 2)
    angle_power = np.einsum("fii->f", angle_covariance).real
    strongest = np.argsort(angle_power)[-max(1, len(angle_power) // 4) :]  # where torque shows most
    power = np.mean(np.sum(np.abs(r[strongest]) ** 2, axis=1), axis=1) - lines.noise.sum()
    c = max(float(np.median(power / angle_power[strongest])), 1e-300)
    factor = np.linalg.cholesky(c * angle_covariance + np.diag(lines.noise + 1e-6 * c * np.median(angle_power)))
    white = np.linalg.solve(factor, r)
    S = white @ white.conj().swapaxes(1, 2) / r.shape[2]
    return np.asarray(factor @ mean_of_neighbours(S, 15) @ factor.conj().swapaxes(1, 2))


def _sizes(lines: PeriodLines) -> FloatArray:
    """Return the mean powers (n_u,) of the torques, over the largest."""
    power = np.mean(np.abs(lines.U) ** 2, axis=(0, 2))
    return np.asarray(power / power.max())


def _gain(lines: PeriodLines, drive: DriveLines, S: ComplexArray) -> ComplexArray:
    """Return gain of the motion estimate (F, n, n_u) by residuals of the angles."""
    CH = drive.C @ drive.H
    size = _sizes(lines)
    P = np.concatenate([drive.B.T, drive.places["link"]]).T
    W = P * np.resize(size, P.shape[1]) @ P.T
    noise = np.diag(lines.noise)
    angle_covariance = CH @ W @ CH.conj().swapaxes(1, 2)
    power = np.einsum("fii->f", S).real - lines.noise.sum()
    scale = np.maximum(power, 1e-3 * np.einsum("fii->f", S).real) / np.einsum("fii->f", angle_covariance).real
    covariance = scale[:, None, None] * angle_covariance + noise
    return np.asarray(scale[:, None, None] * (drive.H @ W @ CH.conj().swapaxes(1, 2)) @ np.linalg.inv(covariance))


def smooth_motion(
    lines: PeriodLines,
    drive: DriveLines,
    effects: Sequence[GearEffect],
    magnitudes: FloatArray,
    before: SmoothedMotion,
    tolerance: float = 1e-4,
) -> SmoothedMotion:
    """Estimate the motion of all experiments for effects with magnitudes (n_f,), and the effects along this motion.

    tolerance: relative error of the implicit motion that ends the iteration.
    """
    gain = _gain(lines, drive, smoothed_covariance(residuals(lines, drive, before, magnitudes), lines, drive))
    force_response = drive.H - gain @ (drive.C @ drive.H)
    implicit = np.array([effect.is_implicit for effect in effects], bool)
    explicit_force = np.tensordot(before.Phi[..., ~implicit], magnitudes[~implicit], axes=1)
    base = drive.H @ (drive.B @ (drive.command[:, :, None] * lines.U) - explicit_force)
    y = (lines.Y - drive.images @ lines.U) / drive.sensor[:, :, None] + np.tensordot(before.folded, magnitudes, axes=1)
    base = base + gain @ (y - drive.C @ base)
    if lines.arm is not None:  # springs bend under it, too
        base = base - drive.H @ (drive.places["link"].T @ lines.arm[1:])
    end, unknowns = SmoothedMotion.start(lines, drive, len(effects)), []
    problem = _Problem(lines, drive, tuple(effects), magnitudes, force_response, before.loads, tolerance)
    last = (drive.C @ drive.H[-1]).T * lines.sampled  # sampled motion by force at the last line
    for m in range(lines.U.shape[2]):
        q, x, force = problem.solve(base[:, :, m], m, before)
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
class _Problem:
    """Unknown deflections and velocities of a configuration. force_response (F, n, n): q by force. loads: as above."""

    lines: PeriodLines
    drive: DriveLines
    effects: tuple[GearEffect, ...]
    magnitudes: FloatArray
    force_response: ComplexArray
    loads: FloatArray
    tolerance: float

    @cached_property
    def signals(self) -> list[tuple[Place, int]]:
        """Place and joint of each unknown."""
        effects = filter(lambda effect: effect.is_implicit, self.effects)
        return sorted({(effect.place, self.drive.joints.index(effect.joint)) for effect in effects})

    def solve(self, base: ComplexArray, m: int, before: SmoothedMotion) -> tuple[ComplexArray, FloatArray, FloatArray]:
        """Return motion (F, n) of an experiment from its estimate without implicit effects, the unknowns and forces."""
        lines, rows = self.lines, self._rows
        if not self.signals:
            return base, *(np.zeros((0, 0)),) * 2
        x_0, static = lines.fine((self._powers * (base @ rows.T)).T), self._static_deflection(m)
        for i, (place, j) in enumerate(self.signals):
            if place == "gear":
                x_0[i] += static[j] + self._transmission_error(base, j, m)
        previous = dict(zip(before.signals, before.unknowns[m], strict=bool(before.signals)))
        start = np.array(list(starmap(previous.get, zip(self.signals, x_0, strict=True))))
        x, force = newton(partial(self._law, m), self.linear, x_0, start, self.tolerance)
        return base - (self.force_response @ (rows.T @ lines.amplitudes(force).T[:, :, None]))[:, :, 0], x, force

    @cached_property
    def _rows(self) -> FloatArray:
        """Directions (n_x, n) of the unknowns."""
        return np.array(list(starmap(self.drive.directions, self.signals)))

    @cached_property
    def _powers(self) -> ComplexArray:
        """Powers of s on all lines, by which the unknowns (F, n_x) are derivatives of deflections."""
        return self.lines.s[:, None] ** np.where([place == "gear" for place, _ in self.signals], 0, 1)

    @cached_property
    def linear(self) -> "Linear":
        """The unknowns by forces at their places."""
        is_gear = np.array([place == "gear" for place, _ in self.signals], bool)
        A = self._powers[:, :, None] * (self._rows @ self.force_response @ self._rows.T)
        softness = np.where(is_gear, 1 / self.drive.k[[j for _, j in self.signals]], 0.0)
        remainder = len(A) / np.arange(len(A) + 1, self.lines.points // 2)
        return Linear(A.transpose(1, 2, 0).copy(), remainder ** np.where(is_gear, 2, 1)[:, None], softness)

    def _static_deflection(self, m: int) -> FloatArray:
        """Return deflections (n_j,) of the gears in the mean of an experiment, under gravity along its motion."""
        return (self.drive.torque + (0.0 if self.lines.arm is None else self.lines.arm[0, :, m].real)) / self.drive.k

    def _transmission_error(self, q: ComplexArray, j: int, m: int) -> FloatArray:
        """Return transmission error (n,) of a joint along the motion of its motor."""
        angle, total = self._angle(q, j, m), np.zeros(self.lines.points)
        for effect, f in zip(self.effects, self.magnitudes, strict=True):
            if effect.joint == self.drive.joints[j] and effect.kind.startswith("error"):
                total += f * transmission_error(effect, angle, float(self.drive.ratios[j]))[0]
        return total

    def _angle(self, q: ComplexArray, j: int, m: int) -> FloatArray:
        row = self.drive.directions("motor", j)
        return np.asarray(self.lines.fine((q @ row)[None])[0] + row @ self.drive.B @ self.lines.mean[:, m])

    def _law(self, m: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return force (n_x, n) by each unknown of an experiment, and its slope."""
        force, slope = np.zeros_like(x), np.zeros_like(x)
        shapes: dict[tuple[str, int, float], tuple[FloatArray, FloatArray]] = {}
        for effect, f in zip(self.effects, self.magnitudes, strict=True):
            if effect.is_implicit and f:
                j = self.drive.joints.index(effect.joint)
                i, size = self.signals.index((effect.place, j)), self.loads[m, j] if effect.kind == "load" else 1.0
                # Friction by load turns as that without.
                key = "friction" if effect.kind == "load" else effect.kind, i, effect.scale
                if key not in shapes:
                    shapes[key] = along_period(effect, x[i])
                phi, dphi = shapes[key]
                force[i] += f * size * phi
                slope[i] += f * size * dphi
        return force, slope

    def motion(self, q: ComplexArray, j: int, m: int, x: FloatArray, force: FloatArray) -> GearMotion:
        """Return motion of a joint in an experiment by its estimate q (F, n), unknowns x (n_x, n) and their forces."""
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
    """x by force: A (n_x, n_x, F) on the lines, softness (n_x,) at rest.

    remainder (n_x, K): what is left of the last line's above them: (s_F / s)^2 of a deflection, s_F / s of a velocity.
    """

    A: ComplexArray
    remainder: FloatArray
    softness: FloatArray

    def __call__(self, force: FloatArray) -> FloatArray:
        """Return unknowns (n_x, n) by forces (n_x, n)."""
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

    law: returns force and slope by points.  x: start; x_0 replaces a start whose error exceeds 1 and its own error.

    tolerance: error relative to the size of x_0 that ends the iteration.
    Steps are halved until the error decreases. If it does not, the last x is returned, with an error in the residuals.
    """
    size = np.std(x_0, axis=1)[:, None] + 1e-300

    def error(x: FloatArray) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Return RMS of the error, the error, slope of the law, and the force."""
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
    """Solve x + linear(slope x) = x_0 for x (n_x, n). tolerance: relative error. size (n_x, 1): scale of the
    unknowns.

    To some percent, so that numbers of four bytes do.
    """
    x_slope, weight = (slope * size).astype(np.float32), (1 / size).astype(np.float32)

    def product(v: FloatArray) -> FloatArray:
        return v + (linear(x_slope * v.reshape(x_0.shape)) * weight).ravel()

    operator = LinearOperator((x_0.size, x_0.size), matvec=product, dtype=np.float32)
    step = gmres(operator, (x_0 / size).astype(np.float32).ravel(), rtol=tolerance, restart=40, maxiter=1)[0]
    return np.asarray(step.reshape(x_0.shape) * size)
