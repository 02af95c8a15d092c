r"""Plants of joint loops: a fitted robot in several postures as a sampled controller sees it.

.. math:: x_{k+1} = A x_k + B u_k, \qquad y_k = C x_k, \qquad P(z) = C\,[z I - A]^{-1} B

u_k: torque with zero-order hold; y_k: motor angles.  A = exp(A_c T_s) and B = int_0^T exp(A_c s) B_c ds are exact.
Lags of the drives are states; an estimated torque delay is a number of whole samples and a fraction of a sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import expm

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.posture import Family, PredictionPorts
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.linear.fitted_model import EstimatedTheta, FittedModel
from elastid.linear.linear_model import LinearModel, state_space, torque_elements
from elastid.linear.modes import modes, robot_shapes, strain_energy
from elastid.record import Configuration, unit_delay
from elastid.simulation.controller import tune
from elastid.use.draws import draw_robots


@dataclass(frozen=True, eq=False)
class Plants:
    """N plants with n_u motors: A (N, m, m), B (N, m, n_u), C (N, n_u, m), and rigid-body inertias (N, n_u) of axes."""

    rate_hz: float
    A: FloatArray
    B: FloatArray
    C: FloatArray
    inertia: FloatArray

    def __len__(self) -> int:
        return len(self.A)

    def with_states(self, states: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return A, B, C of P(z), zero-padded to `states` states, because delays differ between robots."""
        pad, none = (0, states - self.A.shape[-1]), (0, 0)
        return np.pad(self.A, (none, pad, pad)), np.pad(self.B, (none, pad, none)), np.pad(self.C, (none, none, pad))

    @cached_property
    def eigensystem(self) -> tuple[ComplexArray, ComplexArray]:
        """Poles (N, m) and eigenvectors (N, m, m) of A."""
        return np.linalg.eig(self.A)

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """Return P (N, F, n_u, n_u), angle over torque, at freq_hz (N, F)."""
        responses = []
        # A sum over modes, unless nearly parallel eigenvectors lose half of the digits.
        is_modal = np.linalg.cond(self.eigensystem[1]) * np.sqrt(np.finfo(float).eps) < 1
        for i, z in enumerate(1 / unit_delay(freq_hz, self.rate_hz)[..., None, None]):  # all at once take gigabytes
            A, B, C, poles, vectors = (array[i] for array in (self.A, self.B, self.C, *self.eigensystem))
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
    """Fitted robot linearised in Q postures; gives plants for any parameters."""

    family: Family
    models: tuple[FittedModel, ...]
    inertia: FloatArray
    rate_hz: float

    @classmethod
    def of(cls, result: Result, postures: Sequence[Configuration], rate_hz: float) -> "PostureFamily":
        """Linearise the fitted robot in these postures; StudyError if a posture has no equilibrium."""
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
            inertia.append(tune(family.model, q, 1 / (2 * np.pi), 1.0).kp)  # k_p = J omega^2 at 1 rad/s
        return cls(family, tuple(models), np.array(inertia), rate_hz)

    @property
    def configurations(self) -> tuple[Configuration, ...]:
        """Q postures."""
        return tuple(model.linear.configuration for model in self.models)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the driven joints."""
        return self.family.robot.driven_names

    @cached_property
    def estimate(self) -> Plants:
        """Q plants with the estimated parameters."""
        return self._plants(self.family.estimated.x)

    def draws(self, result: Result, count: int, seed: int) -> Plants:
        """Draw count Q plants from the posterior (`draw_robots`), robot by robot with all postures."""
        pieces = [self._plants(x) for x in draw_robots(result, count, seed).x]
        states = max(piece.A.shape[-1] for piece in pieces)
        A, B, C = map(np.concatenate, zip(*(piece.with_states(states) for piece in pieces), strict=True))
        return Plants(self.rate_hz, A, B, C, np.concatenate([piece.inertia for piece in pieces]))

    @cached_property
    def modes(self) -> tuple[tuple[PlantMode, ...], ...]:
        """Modes of the fitted robot in each posture, by rising frequency, without pendulum modes under gravity."""
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
    """Return A, B, C of the sampled model with zero-order hold and torque delay."""
    system = state_space(linear, theta)
    n, n_u = system.B.shape
    samples, fraction = divmod(max(system.delay, 0.0) * rate_hz, 1.0)
    wide = np.zeros((n + n_u, n + n_u))
    wide[:n] = np.hstack([system.A, system.B])
    (A, B), (_, B_now) = (np.split(expm(wide * span / rate_hz)[:n], [n], axis=1) for span in (1.0, 1 - fraction))
    C = system.C
    if fraction > 0:  # u_(k - 1) acts at the beginning of the sample
        A, B, C = _with_input_states(A, B - B_now, B_now, C)
    for _ in range(int(samples)):
        A, B, C = _with_input_states(A, B, np.zeros_like(B), C)
    return A, B, C


def _with_input_states(
    A: FloatArray, B_before: FloatArray, B_now: FloatArray, C: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x_(k+1) = A x_k + B_before u_(k-1) + B_now u_k as a state space of x and u_(k-1)."""
    n, n_u = B_before.shape
    wide = np.block([[A, B_before], [np.zeros((n_u, n + n_u))]])
    return wide, np.vstack([B_now, np.eye(n_u)]), np.hstack([C, np.zeros((len(C), n_u))])
