r"""Sensitivity of joint loops that the arm couples: peaks, bandwidths, poles and limits of a controller on N plants.

.. math:: S(z) = [I + F(z) P(z)]^{-1}, \qquad M_S = \max_\omega \bar\sigma\bigl(J^{-1/2} S(e^{j \omega T_s}) J^{1/2}
          \bigr)

F: the controllers, filters and delay included, a diagonal matrix; P: from torques to the motors' angles. S is what
motors give of a torque that is injected: u = S r. J, the inertia of each axis, makes torques of all axes comparable,
and M_S the same at torques and angles for loops that are alike; no axis has a larger peak |S_ii| (Skogestad and
Postlethwaite, Multivariable Feedback Control, 2005, section 9.2): 6 dB leave each a gain margin of 6 dB and a
phase margin of 29 degrees. Bandwidth of an axis: lowest frequency at which the error of its motor behind a reference of
its position,

.. math:: E_{ii} = 1 - [P S]_{ii} F_{r,i}, \qquad F_r = k_p (1 + k_i \textstyle\sum)\, H

is -3 dB; the velocity of the reference is not fed forward.

Robots about postures as a sampled controller sees them: torques held from sample to sample, angles of motors read.

.. math:: x_{k+1} = A x_k + B u_k, \qquad y_k = C x_k, \qquad P(z) = C\,[z I - A]^{-1} B

A = exp(A_c T_s) and B = int_0^T exp(A_c s) B_c ds are exact; lags of the drives are states, and a torque delay that the
fit has found is one of whole samples and one of a part of a sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import expm

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.matrices import inverse
from elastid.fit.posture import Family, PredictionPorts
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.linear.fitted_model import EstimatedTheta, FittedModel
from elastid.linear.linear_model import LinearModel, state_space, torque_elements
from elastid.linear.modes import modes, robot_shapes, strain_energy
from elastid.record import Configuration, JointLoop, unit_delay
from elastid.simulation.controller import Filters, tune
from elastid.use.draws import draw_robots
from elastid.use.map import largest_gain


@dataclass(frozen=True, eq=False)
class Plants:
    """N plants of a robot with n_u motors: A (N, m, m), B (N, m, n_u), C (N, n_u, m); inertia (N, n_u), link side.

    inertia: of the rigid robot at each motor, other motors held.
    """

    rate_hz: float
    A: FloatArray
    B: FloatArray
    C: FloatArray
    inertia: FloatArray

    def __len__(self) -> int:
        return len(self.A)

    def with_states(self, states: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return A, B, C of P(z), zero-padded to `states` states, since delays differ between robots."""
        more, none = (0, states - self.A.shape[-1]), (0, 0)
        A = np.pad(self.A, (none, more, more))
        return A, np.pad(self.B, (none, more, none)), np.pad(self.C, (none, none, more))

    @cached_property
    def eigensystem(self) -> tuple[ComplexArray, ComplexArray]:
        """Poles (N, m) and eigenvectors (N, m, m) of A."""
        return np.linalg.eig(self.A)

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """Return P (N, F, n_u, n_u), angle over torque, at freq_hz (N, F)."""
        responses = []
        # A sum over modes, unless eigenvectors are so nearly parallel that it loses half of the digits.
        is_modal = np.linalg.cond(self.eigensystem[1]) * np.sqrt(np.finfo(float).eps) < 1
        for i, z in enumerate(1 / unit_delay(freq_hz, self.rate_hz)[..., None, None]):  # all at once take gigabytes
            A, B, C, poles, vectors = (part[i] for part in (self.A, self.B, self.C, *self.eigensystem))
            if is_modal[i]:
                responses.append((C @ vectors / (z - poles)) @ np.linalg.solve(vectors, B))
            else:
                responses.append(C @ np.linalg.solve(z * np.eye(len(A)) - A, B))
        return np.array(responses)


@dataclass(frozen=True)
class PlantMode:
    """Mode of the robot with free motors: natural frequency, and the spring with the largest strain energy.

    motor_amplitudes (n_u,): modal participation of each motor, normalised by its largest one over all modes.
    """

    freq_hz: float
    spring: str
    motor_amplitudes: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class PostureFamily:
    """A fitted robot linearised in Q postures, from which plants of any numbers follow."""

    family: Family
    models: tuple[FittedModel, ...]
    inertia: FloatArray
    rate_hz: float

    @classmethod
    def of(cls, result: Result, postures: Sequence[Configuration], rate_hz: float) -> "PostureFamily":
        """Build the family of the fit in these postures; StudyError if a posture has no equilibrium."""
        motors = result.nominal_robot.motor_locations
        family = result.family(PredictionPorts(inputs=motors, outputs=motors, motors="free"))
        chain, e, models, inertia = torque_elements(family.robot.chain), family.estimated, [], []
        for posture in postures:
            linear = family.linearisation.at(posture, family.theta, family.model.inputs, "position")
            estimated = EstimatedTheta.of(
                e.parameters, e.fit_x, e.fit_covariance, e.names, e.base, posture.name, e.model_error_factors
            )
            models.append(FittedModel(replace(linear, chain=chain, channel_numbers=(), hold=None), estimated))
            q = equilibrium(family.model, family.theta, posture).q
            inertia.append(tune(family.model, q, 1 / (2 * np.pi), 1.0).kp)
        return cls(family, tuple(models), np.array(inertia), rate_hz)

    @property
    def configurations(self) -> tuple[Configuration, ...]:
        """The postures."""
        return tuple(model.linear.configuration for model in self.models)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the driven joints."""
        return self.family.robot.driven_names

    @cached_property
    def estimate(self) -> Plants:
        """The Q plants of the fitted numbers."""
        return self._plants(self.family.estimated.x)

    def draws(self, result: Result, count: int, seed: int) -> Plants:
        """Draw count times Q plants of robots from the fit (`draw_robots`), the postures of each robot in a row."""
        pieces = [self._plants(x) for x in draw_robots(result, count, seed).x]
        states = max(piece.A.shape[-1] for piece in pieces)
        A, B, C = (np.concatenate(part) for part in zip(*(piece.with_states(states) for piece in pieces), strict=True))
        return Plants(self.rate_hz, A, B, C, np.concatenate([piece.inertia for piece in pieces]))

    @cached_property
    def modes(self) -> tuple[tuple[PlantMode, ...], ...]:
        """Modes of the fitted robot in each posture whose springs swing, by rising frequency."""
        return tuple(map(self._modes, self.models))

    def _modes(self, model: FittedModel) -> tuple[PlantMode, ...]:
        linear, theta = model.linear, model.theta
        modal = modes(linear, theta)
        point = equilibrium(self.family.model, self.family.theta, linear.configuration)
        energy = strain_energy(self.family.model, self.family.theta, point, robot_shapes(linear, modal.shapes))
        M, shapes = linear.matrices(theta)[0], modal.shapes
        participation = np.abs(linear.B.T @ shapes) ** 2 / np.einsum("im,ij,jm->m", shapes.conj(), M, shapes).real
        participation = participation / np.maximum(participation.max(axis=1, initial=0.0), 1e-300)[:, None]
        springs = [energy.springs[i] for i in np.nan_to_num(energy.fraction).argmax(axis=0)]
        # A pendulum under gravity has less than half of its strain energy in springs.
        return tuple(
            PlantMode(float(modal.freq_hz[m]), springs[m], tuple(participation[:, m].tolist()))
            for m in np.flatnonzero(energy.load <= 0.5).tolist()
        )

    def _plants(self, x: FloatArray) -> Plants:
        pieces = [_sampled(model.linear, model.estimated.theta(x), self.rate_hz) for model in self.models]
        A, B, C = (np.array(matrices) for matrices in zip(*pieces, strict=True))
        return Plants(self.rate_hz, A, B, C, self.inertia)


def _sampled(linear: LinearModel, theta: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    system = state_space(linear, theta)
    n, n_u = system.B.shape
    samples, fraction = divmod(max(system.delay, 0.0) * rate_hz, 1.0)
    wide = np.zeros((n + n_u, n + n_u))
    wide[:n] = np.hstack([system.A, system.B])
    (A, B), (_, B_now) = (np.split(expm(wide * span / rate_hz)[:n], [n], axis=1) for span in (1.0, 1 - fraction))
    C = system.C
    if fraction > 0:  # u_(k - 1) acts for the first part of the sample
        A, B, C = _with_input_states(A, B - B_now, B_now, C)
    for _ in range(int(samples)):
        A, B, C = _with_input_states(A, B, np.zeros_like(B), C)
    return A, B, C


def _with_input_states(
    A: FloatArray, B_before: FloatArray, B_now: FloatArray, C: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x_(k+1) = A x_k + before u_(k-1) + now u_k as a state space of x and u_(k-1)."""
    n, n_u = B_before.shape
    wide = np.block([[A, B_before], [np.zeros((n_u, n + n_u))]])
    return wide, np.vstack([B_now, np.eye(n_u)]), np.hstack([C, np.zeros((len(C), n_u))])


LIMIT_DB = 6.0  # of M_S
THRESHOLD = 10 ** (-3 / 20)  # of |E_ii| at the bandwidth
SQUARINGS = 30  # of A: the norm of A^(2^30) is below 1/2 only if all |z| < 1 - 1e-9, approximately


def grid(plants: Plants, lines: int, per_mode: int) -> FloatArray:
    """Return freq_hz (N, F): logarithmic up to half the rate, and denser about each mode of a plant."""
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.log(plants.eigensystem[0].astype(complex)) * plants.rate_hz
    freq_hz, zeta = np.abs(s) / (2 * np.pi), -s.real / np.maximum(np.abs(s), 1e-300)
    top = 0.499 * plants.rate_hz
    counts = (s.imag > 1e-6 * np.abs(s)) & (zeta < 0.5) & (zeta > 0) & (freq_hz < top)
    base = np.geomspace(max(freq_hz[counts].min(initial=0.2 * top) / 300, top / 5000), top, lines)
    spread = np.sinh(np.linspace(-3, 3, per_mode)) / np.sinh(3)
    n_modes = int(counts.sum(axis=1).max(initial=0))
    rows = []
    for modes_hz, z, keep in zip(freq_hz, zeta, counts, strict=True):
        centres, widths = modes_hz[keep], np.clip(8 * z[keep], 0.02, 0.4)
        near = (centres[:, None] * (1 + widths[:, None] * spread)).ravel()
        padding = np.geomspace(base[0], top, (n_modes - len(centres)) * per_mode + 2)[1:-1] * (1 + 1e-6)
        rows.append(np.sort(np.clip(np.concatenate([base, near, padding]), base[0], top)))
    return np.array(rows)


@dataclass(frozen=True, eq=False)
class Scene:
    """N plants, the grid of each freq_hz (N, F), and P (N, F, n_u, n_u) on it."""

    plants: Plants
    freq_hz: FloatArray
    P: ComplexArray

    @classmethod
    @lru_cache(maxsize=4)  # of the estimate, coarse and fine, and of draws
    def of(cls, plants: Plants, lines: int = 220, per_mode: int = 13) -> "Scene":
        """Build the scene on a grid with the given number of lines."""
        freq_hz = grid(plants, lines, per_mode)
        return cls(plants, freq_hz, plants.response(freq_hz))

    @cached_property
    def delay(self) -> ComplexArray:
        """1 / z (N, F)."""
        return unit_delay(self.freq_hz, self.plants.rate_hz)


@dataclass(frozen=True, eq=False)
class Closed:
    """Loops of N plants closed by a controller with gains (n_u,) or (N, n_u)."""

    scene: Scene
    gains: JointLoop
    filters: Filters | None

    def _controller(self, has_damping: bool) -> ComplexArray:
        """Return F or F_r (N, F, n_u)."""
        delay = self.scene.delay
        stack = self.gains.gain_derivatives(lambda gain: np.atleast_2d(gain)[:, None])
        H = 1.0 if self.filters is None else self.filters.response(delay)
        return replace(stack, kd=has_damping * stack.kd).response(delay, self.scene.plants.rate_hz) * H

    @cached_property
    def F(self) -> ComplexArray:
        """Controllers (N, F, n_u)."""
        return self._controller(True)

    @cached_property
    def S(self) -> ComplexArray:
        """Sensitivity (N, F, n_u, n_u)."""
        P = self.scene.P
        difference = np.eye(P.shape[-1]) + self.F[..., :, None] * P
        return inverse(difference.reshape(-1, *P.shape[2:])).reshape(P.shape)

    @cached_property
    def E(self) -> ComplexArray:
        """E_ii (N, F, n_u)."""
        return np.asarray(1 - np.einsum("...ij,...ji->...i", self.scene.P, self.S) * self._controller(False))

    @cached_property
    def size(self) -> FloatArray:
        """Largest singular value (N, F), torques of the axes compared by their inertias."""
        return largest_gain(scaled(self.S, self.scene.plants.inertia))

    @cached_property
    def stable(self) -> BoolArray:
        """Flag stable loops (N,): powers of A converge to 0. Takes a quarter of the time of eigenvalues."""
        A = closed_loop_matrices(self.scene.plants, self.gains, self.filters)
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(SQUARINGS):
                A = A @ A
                norm = np.linalg.norm(A, np.inf, (1, 2))
                if not np.any(norm >= 0.5):  # the norms of unstable loops become NaN
                    break
        return np.asarray(norm < 0.5)

    @property
    def peaks_db(self) -> FloatArray:
        """M_S in dB (N,), infinite where a loop is unstable."""
        return np.where(self.stable, 20 * np.log10(self.size.max(axis=1)), np.inf)

    @property
    def bandwidth_hz(self) -> FloatArray:
        """Bandwidth of each axis (N, n_u)."""
        return bandwidths(self.E, self.scene.freq_hz)


def scaled(S: ComplexArray, inertia: FloatArray) -> ComplexArray:
    """Return J^-1/2 S J^1/2 of S (N, F, n_u, n_u) with inertia (N, n_u)."""
    root = np.sqrt(inertia)[:, None]
    return S / root[..., :, None] * root[..., None, :]


def bandwidths(E: ComplexArray, freq_hz: FloatArray) -> FloatArray:
    """Return frequencies (N, n_u), Hz, where |E| of E (N, F, n_u) first rises to -3 dB, or ends of the grid."""
    size = np.abs(E)
    above = size >= THRESHOLD
    last = np.where(above.any(axis=1), above.argmax(axis=1), size.shape[1] - 1)
    first = np.maximum(last - 1, 0)
    rows = np.arange(len(E))[:, None]
    axes = np.arange(size.shape[2])[None]
    low, high = np.log(size[rows, first, axes]), np.log(size[rows, last, axes])
    fraction = np.clip((np.log(THRESHOLD) - low) / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    ends = np.log(freq_hz)[rows, first], np.log(freq_hz)[rows, last]
    return np.asarray(np.exp(ends[0] + fraction * (ends[1] - ends[0])))


def closed_loop_matrices(plants: Plants, gains: JointLoop, filters: Filters | None) -> FloatArray:
    """Return A (N, n, n) of the loops; gains that differ from plant to plant are (N, n_u)."""
    N, _, n_u = plants.B.shape
    T, unit, zeros = 1 / plants.rate_hz, np.eye(n_u), np.zeros((n_u, n_u))
    kp, kd, ki = (np.broadcast_to(gain, (N, n_u))[:, :, None] * unit for gain in (gains.kp, gains.kd, gains.ki))
    # States y_(k-1) and T sum e of e_k = -(k_p + k_d / T) y_k + k_d / T y_(k-1).
    A, B = _blocks([[zeros, zeros], [kd, unit]]), _blocks([[unit], [-T * kp - kd]])
    C, D = _blocks([[kd / T, ki]]), -kp - kd / T
    if not np.any(ki):
        A, B, C = A[:, :n_u, :n_u], B[:, :n_u], C[:, :, :n_u]
    if filters is not None:
        Af, Bf, Cf, Df = filters.matrices
        A, B = _blocks([[A, np.zeros((A.shape[1], len(Af)))], [Bf @ C, Af]]), _blocks([[B], [Bf @ D]])
        C, D = _blocks([[Df @ C, Cf]]), Df * D  # both diagonal
    return _blocks([[plants.A + plants.B @ D @ plants.C, plants.B @ C], [B @ plants.C, A]])


def _blocks(rows: list[list[FloatArray]]) -> FloatArray:
    """Return block matrices (N, m, n) of blocks (N, ., .) or (., .)."""
    N = np.broadcast_shapes(*((1, *block.shape)[-3:-2] for row in rows for block in row))
    return np.block([[np.broadcast_to(block, (*N, *block.shape[-2:])) for block in row] for row in rows])
