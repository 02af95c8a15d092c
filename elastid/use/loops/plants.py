r"""Robots about postures as a sampled controller sees them: torques held from sample to sample, angles of motors read.

.. math:: x_{k+1} = A x_k + B u_k, \qquad y_k = C x_k, \qquad P(z) = C\,[z I - A]^{-1} B

A = exp(A_c T_s) and B = int_0^T exp(A_c s) B_c ds are exact; lags of the drives are states, and a torque delay that the
fit has found is one of whole samples and one of a part of a sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import expm

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import StudyError
from elastid.fit.posture import Asked, Family
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.linear.fitted_model import Estimated
from elastid.linear.linear_model import LinearModel, state_space, torque_elements
from elastid.linear.modes import modes, shapes_of_all, strain_energy
from elastid.record import Configuration
from elastid.simulation.controller import tune
from elastid.use.draws import draw_robots


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

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """P (N, F, n_u, n_u), angle over torque, at freq_hz (N, F)."""
        unit, responses = np.eye(self.A.shape[-1]), []
        for A, B, C, own in zip(self.A, self.B, self.C, freq_hz, strict=True):  # all at once take gigabytes
            z = np.exp(2j * np.pi * own / self.rate_hz)[:, None, None]
            responses.append(C @ np.linalg.solve(z * unit - A, B.astype(complex)))
        return np.array(responses)


@dataclass(frozen=True)
class PlantMode:
    """A mode of the robot with motors that are free: freq_hz, and the spring with the most strain energy.

    parts (n_u,): by which it moves each motor, over that of the mode that moves it most.
    """

    freq_hz: float
    spring: str
    parts: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class PostureFamily:
    """A fitted robot linearised in Q postures, from which plants of any numbers follow."""

    family: Family
    linear: tuple[LinearModel, ...]
    inertia: FloatArray
    rate_hz: float

    @classmethod
    def of(cls, result: Result, postures: Sequence[Configuration], rate_hz: float) -> PostureFamily:
        """StudyError where a posture has no rest."""
        motors = result.known_robot.motor_locations
        family = result.family(Asked(inputs=motors, outputs=motors, motors="free"))
        linear, inertia = [], []
        for posture in postures:
            own = family.linearisation.at(posture, family.theta, family.model.inputs, "position")
            chain = torque_elements(family.robot.chain)
            linear.append(replace(own, chain=chain, gains=(), hold=None))
            q = equilibrium(family.model, family.theta, posture).q
            inertia.append(tune(family.model, q, 1 / (2 * np.pi), 1.0).kp)
        return cls(family, tuple(linear), np.array(inertia), rate_hz)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the postures."""
        return tuple(own.configuration.name for own in self.linear)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the driven joints."""
        return tuple(joint.name for joint in self.family.robot.driven)

    @cached_property
    def estimate(self) -> Plants:
        """The Q plants of the fitted numbers."""
        return self._plants(self.family.estimated.x)

    def draws(self, result: Result, count: int, seed: int) -> Plants:
        """count times Q plants of robots drawn from the fit (`draw_robots`), the postures of each robot in a row."""
        pieces = [self._plants(x) for x in draw_robots(result, count, seed).x]
        parts = (np.concatenate([getattr(own, name) for own in pieces]) for name in ("A", "B", "C", "inertia"))
        return Plants(self.rate_hz, *parts)

    @cached_property
    def modes(self) -> tuple[tuple[PlantMode, ...], ...]:
        """Modes of the fitted robot in each posture, by rising frequency; StudyError where no spring swings."""
        return tuple(map(self._modes, self.linear))

    def _modes(self, own: LinearModel) -> tuple[PlantMode, ...]:
        theta = self._theta(own)
        known = modes(own, theta)
        point = equilibrium(self.family.model, self.family.theta, own.configuration)
        energy = strain_energy(self.family.model, self.family.theta, point, shapes_of_all(own, known.shapes))
        strained, M = np.nan_to_num(energy.share).argmax(axis=0), own.matrices(theta)[0]
        parts = (
            np.abs(own.B.T @ known.shapes) ** 2 / np.einsum("im,ij,jm->m", known.shapes.conj(), M, known.shapes).real
        )
        parts = parts / np.maximum(parts.max(axis=1, initial=0.0), 1e-300)[:, None]
        # A pendulum under gravity has less than half of its strain energy in springs.
        sprung = np.flatnonzero(energy.load <= 0.5).tolist()
        if not sprung:
            raise StudyError(
                "use/gains",
                "no spring of the robot swings behind its motors, so that none limits them",
                f"posture {own.configuration.name}",
            )
        return tuple(
            PlantMode(float(known.freq_hz[m]), energy.springs[strained[m]], tuple(parts[:, m].tolist())) for m in sprung
        )

    def _theta(self, own: LinearModel, x: FloatArray | None = None) -> FloatArray:
        e = self.family.estimated
        known = Estimated.of(
            e.parameters, e.fit_x, e.fit_covariance, e.names, e.base, own.configuration.name, e.doubts
        )  # fmt: skip
        return known.theta(known.x if x is None else x)

    def _plants(self, x: FloatArray) -> Plants:
        pieces = [_sampled(own, self._theta(own, x), self.rate_hz) for own in self.linear]
        A, B, C = (np.array(part) for part in zip(*pieces, strict=True))
        return Plants(self.rate_hz, A, B, C, self.inertia)


def _sampled(linear: LinearModel, theta: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A, B, C of a robot with the delay of its torque."""
    system = state_space(linear, theta)
    n, n_u = system.B.shape
    samples, part = divmod(max(system.delay, 0.0) * rate_hz, 1.0)

    def over(share: float) -> tuple[FloatArray, FloatArray]:
        wide = np.zeros((n + n_u, n + n_u))
        wide[:n] = np.hstack([system.A, system.B])
        moved = expm(wide * share / rate_hz)
        return moved[:n, :n], moved[:n, n:]

    A, B = over(1.0)
    C = system.C
    if part > 0:  # u_(k - 1) acts for the first part of the sample
        end, now = over(1 - part)
        before = end @ over(part)[1]
        A, B, C = _with_input_states(A, before, now, C)
    for _ in range(int(samples)):
        A, B, C = _with_input_states(A, B, np.zeros_like(B), C)
    return A, B, C


def _with_input_states(
    A: FloatArray, before: FloatArray, now: FloatArray, C: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """x_(k+1) = A x_k + before u_(k-1) + now u_k as a state space of x and u_(k-1)."""
    n, n_u = before.shape
    wide = np.block([[A, before], [np.zeros((n_u, n + n_u))]])
    return wide, np.vstack([now, np.eye(n_u)]), np.hstack([C, np.zeros((len(C), n_u))])
