r"""PostureModel: the fitted robot about any posture, between forces, torques and motions, with intervals.

.. math:: G(s) = s^k\, [C + T / s^2]\, [s^2 M + s D + K + \Delta / s]^{-1} B, \qquad B = J^T, \qquad
          \text{static: } J K^{-1} J^T

J (6, n): velocity of the origin of a frame and its angular velocity, so that a force is J^T F. The coordinates are
those that can move: with the motors held (brakes) the links', with the motors free all, with the motors controlled all,
the controller's gains part of K and D and its integral Delta. Delay, lags and gains of a measurement are no part of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value
from elastid.base.display import Display, as_html, as_text, degrees
from elastid.base.errors import StudyError
from elastid.base.statistics import Spread, propagate
from elastid.linear.fitted_model import Axes, FrameStiffness, PostureModes, ResponseBand
from elastid.linear.linear_model import LinearModel, StateSpace, state_space
from elastid.linear.modes import Modes, modes, normalised
from elastid.linear.response.transfer import checked_frequencies, frequency_response
from elastid.parameters import Parameters
from elastid.record import MOTION_ORDER, HeldTorque, JointLoop, Motors
from elastid.response import Response


@dataclass(frozen=True, eq=False)
class Doubt:
    """An explanation of a misfit, as an error of unit variance: numbers that the fit held move by their steps.

    effects (n_x,): and with them the parameters.  members: the numbers; steps of each, of its logarithm where `log`.
    """

    effects: FloatArray
    members: tuple[str, ...]
    steps: tuple[float, ...]
    log: tuple[bool, ...]

    def moved(self, name: str, value: float, size: float) -> float:
        """The number of a member at so many steps."""
        i = self.members.index(name)
        return value * float(np.exp(size * self.steps[i])) if self.log[i] else value + size * self.steps[i]


@dataclass(frozen=True, eq=False)
class Estimated:
    """theta (n_theta,) of a linear model as a function of x (n_x + n_d,): parameters, then the sizes of doubts.

    fit_x (n_x,), fit_covariance (n_x, n_x): of the fit.  names: of theta.  base (n_theta,): numbers that are no
    parameters of the fit.  rows, places: which are, and where in its theta.  where: the configuration whose parameters
    count.
    """

    parameters: Parameters
    fit_x: FloatArray
    fit_covariance: FloatArray
    names: tuple[str, ...]
    base: FloatArray
    rows: IntArray
    places: IntArray
    where: str = ""
    doubts: tuple[Doubt, ...] = ()

    @cached_property
    def x(self) -> FloatArray:
        """The estimate (n_x + n_d,)."""
        return np.append(self.fit_x, np.zeros(len(self.doubts)))

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of x (n_x + n_d, n_x + n_d)."""
        n, whole = len(self.fit_x), np.eye(len(self.x))
        whole[:n, :n] = self.fit_covariance
        return whole

    def theta(self, x: FloatArray) -> FloatArray:
        """theta (n_theta,) at x (n_x + n_d,), SI."""
        n, theta = len(self.fit_x), self.base.copy()
        own = x[:n] + sum((size * doubt.effects for size, doubt in zip(x[n:], self.doubts, strict=True)), np.zeros(n))
        theta[self.rows] = self.parameters.expand(own, self.where)[self.places]
        for size, doubt in zip(x[n:].tolist(), self.doubts, strict=True):
            for name in doubt.members:
                if name in self.names:
                    row = self.names.index(name)
                    theta[row] = doubt.moved(name, float(theta[row]), size)
        return theta

    @cached_property
    def slopes(self) -> FloatArray:
        """d theta / d x (n_theta, n_x + n_d) at the estimate."""
        slopes = np.zeros((len(self.base), len(self.x)))
        of_x = self.parameters.jacobian(self.fit_x, self.where)[self.places]
        slopes[self.rows, : len(self.fit_x)] = of_x
        theta = self.theta(self.x)
        for column, doubt in enumerate(self.doubts, start=len(self.fit_x)):
            slopes[self.rows, column] = of_x @ doubt.effects
            for name, step, is_log in zip(doubt.members, doubt.steps, doubt.log, strict=True):
                if name in self.names:
                    row = self.names.index(name)
                    slopes[row, column] += step * theta[row] if is_log else step
        return slopes


@dataclass(frozen=True, eq=False)
class Ports:
    """Ports at which forces act and motions are read, as sums of the places of a linear model.

    inputs, outputs: their names.  act (n_u, n_p), by_motor (n_u, n_m): forces at its outputs, torques at its inputs.
    read (n_y, n_p).  at_frame (6, n_p): the frame of stiffness and compliance.  frame: its name.  axes: of all frames.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    act: FloatArray
    by_motor: FloatArray
    read: FloatArray
    at_frame: FloatArray
    frame: str
    axes: Axes
    sliding: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Matrices:
    M: FloatArray
    D: FloatArray
    K: FloatArray
    Delta: FloatArray
    B: FloatArray
    C: FloatArray
    T: FloatArray
    J: FloatArray


@frozen_value(eq=False)
class PostureModel:
    """A fitted robot about one posture (`Result.at`); link side, SI.

    linear: about the equilibrium, all its coordinates, its outputs the places of `ports`.  moving (n, m): how these
    move with the m coordinates that can.  coordinates: names of the robot's, n_q.
    """

    linear: LinearModel
    estimated: Estimated
    ports: Ports
    moving: FloatArray
    motors: Motors
    coordinates: tuple[str, ...]
    loop: JointLoop | None = field(default=None)

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Posture, motors, ports and modes."""
        where = degrees(self.linear.configuration.angles.tolist())
        title = f"Robot at {where}, motors {self.motors}: {', '.join(self.outputs)} by {', '.join(self.inputs)}"
        inner = self.modes().display
        return Display(title, inner.headings, inner.rows)

    @property
    def inputs(self) -> tuple[str, ...]:
        """The inputs of `response`."""
        return self.ports.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs of `response`."""
        return self.ports.outputs

    def matrices(self, x: FloatArray) -> _Matrices:
        """M, D, K, Delta, B, C, T, J in the coordinates that can move, at x (n_x,)."""
        theta, N, ports = self.estimated.theta(x), self.moving, self.ports
        (M, D, K), (C, T), B = self.linear.matrices(theta), self.linear.readout(theta), self.linear.B
        Delta = np.zeros_like(K)
        if self.loop is not None:
            kp, kd, ki = self.loop.kp, self.loop.kd, self.loop.ki
            D, K = D + (B * kd) @ B.T, K + (B * (kp + ki * kd)) @ B.T
            Delta = (B * (ki * kp)) @ B.T
        M, D, K, Delta = (N.T @ A @ N for A in (M, D, K, Delta))
        force = ports.act @ C + ports.by_motor @ B.T
        return _Matrices(M, D, K, Delta, (force @ N).T, ports.read @ C @ N, ports.read @ T @ N, ports.at_frame @ C @ N)

    def _G(self, x: FloatArray, s: ComplexArray) -> ComplexArray:
        A = self.matrices(x)
        X = np.linalg.solve(s**2 * A.M + s * A.D + A.K + A.Delta / s, A.B.astype(complex))
        return np.asarray(s ** MOTION_ORDER[self.linear.quantity] * (A.C @ X + A.T @ X / s**2))

    def response(self, freq_hz: FloatArray, *, sampled_hz: float | None = None) -> Response:
        """G (F, n_y, n_u) at freq_hz (F,), the same numbers as `state_space` and `to_control` give.

        sampled_hz: inputs are held, and outputs sampled, at this rate, as a drive and its log do; the response then
        contains the images of each line.  ValueError for frequencies that are not positive.
        """
        lines = checked_frequencies(freq_hz)
        if sampled_hz is None:
            G = self._G(self.estimated.x, (2j * np.pi * lines[:, None, None]).astype(complex))
        else:
            held = HeldTorque((float(sampled_hz),) * len(self.inputs), (True,) * len(self.outputs))
            G = frequency_response(replace(self.as_linear(), hold=held), np.zeros(0), lines)
        return Response(
            lines, G, self.inputs, self.outputs, self.linear.quantity, self.linear.configuration,
            sliding=self.ports.sliding,
        )  # fmt: skip

    def response_band(self, freq_hz: FloatArray, level: float = 0.95) -> ResponseBand:
        """The response at freq_hz (F,) with its pointwise and simultaneous bands of probability `level`."""
        response = self.response(freq_hz)
        s = (2j * np.pi * response.freq_hz[:, None, None]).astype(complex)
        spread = self._spread(lambda x: self._G(x, s))
        return ResponseBand(response, spread.std, *spread.radii(level), level, spread.by)

    def response_std(self, freq_hz: FloatArray) -> FloatArray:
        """Standard deviation (F, n_y, n_u) of `response`."""
        return self.response_band(freq_hz).std

    def modes(self) -> PostureModes:
        """Natural frequencies, damping ratios and shapes of what can move, with standard deviations."""
        nominal = self._modes_at(self.estimated.x)
        count = len(nominal.freq_hz)

        def packed(x: FloatArray) -> FloatArray:
            own = nominal if x is self.estimated.x else self._modes_at(x)
            poles = own.poles
            order = [int(np.argmin(np.abs(poles - pole))) for pole in nominal.poles] if len(poles) else []
            if len(order) < count:  # nothing swings with numbers so far off
                return np.full((2, count), np.nan)
            return np.vstack([own.freq_hz[order], own.zeta[order]])

        spread = self._spread(packed) if count else None
        freq_std, zeta_std = np.zeros((2, count)) if spread is None else spread.std
        Z = np.asarray(self.linear.Z) @ self.moving
        return PostureModes(
            nominal.freq_hz, freq_std, nominal.zeta, zeta_std, normalised(Z @ nominal.shapes), self.coordinates,
            nominal.real_poles, "linearisation" if spread is None else spread.by,
        )  # fmt: skip

    def _modes_at(self, x: FloatArray) -> Modes:
        return modes(self.as_linear(x, with_integral=False), np.zeros(0))

    def stiffness(self) -> FrameStiffness:
        """Static stiffness and compliance (6, 6) of the frame, in its axes, with standard deviations.

        StudyError where motors are free, which give way to any force.
        """
        if self.motors == "free":
            raise StudyError(
                "fit/posture",
                "a robot with free motors gives way to any constant force and has no stiffness; ask with motors='held' "
                "(brakes) or motors='controlled'",
            )

        def compliance(x: FloatArray) -> FloatArray:
            A = self.matrices(x)
            return np.asarray(A.J @ np.linalg.solve(A.K, A.J.T))

        C = self._spread(compliance)
        nan = np.full((6, 6), np.nan)
        length = float(np.sqrt(C.value.trace() / max(C.value[3:, 3:].trace(), 1e-300)))  # m and rad on one scale
        scale = np.diag([1.0] * 3 + [length] * 3)
        if np.linalg.cond(scale @ C.value @ scale) > 1e10:
            return FrameStiffness(C.value, C.std, nan, nan, self.ports.frame, self.ports.axes, C.by)
        stiffness = self._spread(lambda x: np.linalg.inv(compliance(x)))
        matrix, std = stiffness.value, stiffness.std
        return FrameStiffness(C.value, C.std, matrix, std, self.ports.frame, self.ports.axes, C.by)

    def _spread(self, function: Any) -> Spread:
        return propagate(function, self.estimated.x, self.estimated.covariance)

    def as_linear(self, x: FloatArray | None = None, with_integral: bool = True) -> LinearModel:
        """M, D, K, B, C, T as numbers; ValueError with an integral, which second-order equations cannot hold."""
        A = self.matrices(self.estimated.x if x is None else x)
        if with_integral and np.any(A.Delta):
            raise ValueError("the controller has an integral, which this form lacks; take response or state_space")
        return LinearModel(
            self.linear.configuration, (), np.zeros(0), A.M, A.D, A.K, {}, A.B, A.C, self.inputs, self.outputs,
            self.linear.quantity, A.T, sliding=self.ports.sliding,
        )  # fmt: skip

    @cached_property
    def _state_space(self) -> StateSpace:
        plain = state_space(self.as_linear(with_integral=False), np.zeros(0))
        A = self.matrices(self.estimated.x)
        if not np.any(A.Delta):
            return plain
        # A further state z' = q, which acts on the acceleration as -M^-1 Delta z and is read with it.
        n = len(A.M)
        pull = -np.linalg.solve(A.M, A.Delta)
        wide = np.block([
            [plain.A, np.vstack([np.zeros((n, n)), pull])], [np.eye(n), np.zeros((n, 2 * n))],
        ])  # fmt: skip
        felt = A.C @ pull if self.linear.quantity == "acceleration" else np.zeros((len(A.C), n))
        B, C = np.vstack([plain.B, np.zeros((n, plain.B.shape[1]))]), np.hstack([plain.C, felt])
        return replace(plain, A=wide, B=B, C=C)

    def state_space(self) -> StateSpace:
        """A, B, C, D of the same response; StudyError for positions or velocities of an accelerometer."""
        return self._state_space

    def to_control(self) -> Any:
        """The model as `control.StateSpace`: its response is that of `response` to rounding."""
        return self.state_space().to_control()
