r"""FittedModel: a fitted robot about a posture, between forces, torques and motions, with standard deviations.

.. math:: G(s) = s^k\, [C + T / s^2]\, [s^2 M + s D + K + \Delta / s]^{-1} B, \qquad
          \text{static: } J K^{-1} J^T

J (6, n): velocity of the origin of a frame and its angular velocity. In a fitted configuration inputs and outputs are
the measured ones, with drives and sensors. In any other posture (`Result.at`) they are forces, torques and motions at
any location, without delay, lags and gains. With locked motors only the links move. For controlled motors the gains of
the controller are in K and D, its integral gain in Delta. Standard deviations of modes are of first order,

.. math:: \frac{d\lambda}{dx} = - \frac{\phi^T (\lambda^2\, dM + \lambda\, dD + dK)\, \phi}
                                        {\phi^T (2 \lambda M + D)\, \phi}, \qquad
          \mathrm{cov}\, y = \frac{dy}{dx}\, \mathrm{cov}\, x\, \frac{dy}{dx}^H

for symmetric M, D, K, whose left and right eigenvectors are equal (Adhikari, JSV 2000, 10). Standard deviations of
responses and stiffness are computed from posterior samples if these differ from the first order.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from scipy.linalg import block_diag

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value
from elastid.base.display import Display, as_html, as_text, degrees, number
from elastid.base.errors import StudyError
from elastid.base.propagation import ErrorMethod, principal_axes, propagate
from elastid.linear.linear_model import LinearModel, StateSpace, state_space
from elastid.linear.modes import Modes, modes, robot_shapes
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import checked_frequencies, frequency_response, to_response
from elastid.parameters import Parameters
from elastid.record import ZohTorque
from elastid.response import Response
from elastid.robot import FRAME_AXES

Axes: TypeAlias = Literal["own", "world"]


@dataclass(frozen=True, eq=False)
class ModelErrorFactor:
    """Possible cause of a misfit as a factor of unit variance on the steps of fixed numbers.

    members: the numbers.  steps: changes by a unit factor, of the logarithm if `log`.  effects (n_x,): of the
    parameters.
    """

    effects: FloatArray
    members: tuple[str, ...]
    steps: tuple[float, ...]
    log: tuple[bool, ...]

    def with_error(self, name: str, value: float, size: float) -> float:
        """Return the value of a member after `size` steps."""
        i = self.members.index(name)
        return value * float(np.exp(size * self.steps[i])) if self.log[i] else value + size * self.steps[i]


@dataclass(frozen=True, eq=False)
class EstimatedTheta:
    """Map from x (n_x + n_d,), fit parameters and model-error factors, to theta (n_theta,) of a linear model.

    fit_x (n_x,), fit_covariance (n_x, n_x): estimate and covariance of the fit.  names: of theta.  base (n_theta,):
    values of fixed parameters.  rows, places: indices in theta and in the fit's theta of the other parameters.
    configuration: name of the configuration whose group parameters apply.
    """

    parameters: Parameters
    fit_x: FloatArray
    fit_covariance: FloatArray
    names: tuple[str, ...]
    base: FloatArray
    rows: IntArray
    places: IntArray
    configuration: str = ""
    model_error_factors: tuple[ModelErrorFactor, ...] = ()

    @classmethod
    def of(
        cls, parameters: Parameters, x: FloatArray, covariance: FloatArray, names: tuple[str, ...], base: FloatArray,
        configuration: str = "", model_error_factors: tuple[ModelErrorFactor, ...] = (), fixed: Collection[str] = (),
    ) -> "EstimatedTheta":  # fmt: skip
        """Build the map for the estimate x (n_x,) of a fit.  base (n_theta,): SI.  fixed: names that keep it."""
        indices = [i for i, name in enumerate(names) if name in parameters.names and name not in fixed]
        rows = [parameters.names.index(names[i]) for i in indices]
        return cls(
            parameters, x, covariance, names, base, np.array(indices, int), np.array(rows, int), configuration,
            model_error_factors
        )  # fmt: skip

    @cached_property
    def x(self) -> FloatArray:
        """The estimate (n_x + n_d,)."""
        return np.append(self.fit_x, np.zeros(len(self.model_error_factors)))

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of x (n_x + n_d, n_x + n_d)."""
        return np.asarray(block_diag(self.fit_covariance, np.eye(len(self.model_error_factors))))

    def theta(self, x: FloatArray) -> FloatArray:
        """Return theta (n_theta,) at x (n_x + n_d,), SI."""
        n, theta = len(self.fit_x), self.base.copy()
        values = x[:n] + sum(
            (size * factor.effects for size, factor in zip(x[n:], self.model_error_factors, strict=True)), np.zeros(n)
        )
        theta[self.rows] = self.parameters.expand(values, self.configuration)[self.places]
        for size, factor in zip(x[n:].tolist(), self.model_error_factors, strict=True):
            for name in factor.members:
                if name in self.names:
                    row = self.names.index(name)
                    theta[row] = factor.with_error(name, float(theta[row]), size)
        return theta

    @cached_property
    def slopes(self) -> FloatArray:
        """d theta / d x (n_theta, n_x + n_d) at the estimate."""
        slopes = np.zeros((len(self.base), len(self.x)))
        of_x = self.parameters.jacobian(self.fit_x, self.configuration)[self.places]
        slopes[self.rows, : len(self.fit_x)] = of_x
        theta = self.theta(self.x)
        for column, factor in enumerate(self.model_error_factors, start=len(self.fit_x)):
            slopes[self.rows, column] = of_x @ factor.effects
            for name, step, is_log in zip(factor.members, factor.steps, factor.log, strict=True):
                if name in self.names:
                    row = self.names.index(name)
                    slopes[row, column] += step * theta[row] if is_log else step
        return slopes

    @cached_property
    def axes(self) -> FloatArray:
        """Changes of x (n_d, n_x + n_d) by one standard deviation in each of n_d independent directions.

        An unidentifiable parameter has the standard deviation 100, mostly of a logarithm.
        """
        C = self.covariance
        is_infinite = np.isinf(np.diag(C))
        return principal_axes(np.where(is_infinite[:, None] | is_infinite, 0.0, C) + 1e4 * np.diag(is_infinite))

    @cached_property
    def dependent(self) -> IntArray:
        """Rows of theta that depend on x."""
        return np.flatnonzero(np.any(self.slopes, axis=1))


def deviation(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the standard deviations (n,) of y with slopes dy/dx (n, n_x) and covariance of x (n_x, n_x)."""
    is_infinite = np.isinf(np.diag(covariance))
    variance = np.einsum("ni,ni->n", slopes @ np.where(is_infinite[:, None] | is_infinite, 0.0, covariance), slopes)
    depends_on_infinite = np.any(np.abs(slopes[:, is_infinite]) > 1e-12 * np.abs(slopes).max(initial=1e-300), axis=1)
    return np.where(depends_on_infinite, np.inf, np.sqrt(np.maximum(variance, 0.0)))


@frozen_value
class UncertainModes(Modes):
    """Modes with standard deviations (n_m,) of frequencies in Hz and of damping ratios; shapes (n_q, n_m).

    coordinates: names of the robot's coordinates, if known.
    """

    freq_std: FloatArray
    zeta_std: FloatArray
    coordinates: tuple[str, ...] = ()

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Frequency and damping ratio of each mode with their standard deviations."""
        columns = self.freq_hz, self.freq_std, 100 * self.zeta, 100 * self.zeta_std
        rows = [tuple(map(number, row, (5, 2, 4, 2))) for row in np.transpose(columns).tolist()]
        return Display(f"{len(rows)} modes", ("natural frequency in Hz", "std", "damping ratio in %", "std"), rows)


@frozen_value
class ResponseBand:
    """Response G (F, n_y, n_u) with radii (F, n_y, n_u) of confidence regions of a probability.

    pointwise: for each line.  simultaneous: for all lines of an element.  std: E|dG|^2 ^ 1/2.  by: method,
    linearisation or posterior samples.
    """

    response: Response
    std: FloatArray
    pointwise: FloatArray
    simultaneous: FloatArray
    probability: float
    by: ErrorMethod

    @property
    def freq_hz(self) -> FloatArray:
        """The lines (F,)."""
        return self.response.freq_hz

    @property
    def G(self) -> ComplexArray:
        """The response (F, n_y, n_u)."""
        return self.response.G


@frozen_value
class FrameStiffness:
    """Compliance C = J K^-1 J^T (6, 6) of a frame with its standard deviation, and stiffness, its inverse.

    Rows: x, y, z, rx, ry, rz of the frame for forces and torques, m/N, rad/N, rad/(Nm).  matrix, std (6, 6): stiffness
    and its std; NaN for a robot without six independent springs.
    """

    compliance: FloatArray
    compliance_std: FloatArray
    matrix: FloatArray
    std: FloatArray
    frame: str
    axes: Axes
    by: ErrorMethod

    __repr__, _repr_html_ = as_text, as_html

    @property
    def principal(self) -> tuple[FloatArray, FloatArray]:
        """Compliances (3,) to forces along their principal directions (3, 3), columns; the softest first."""
        values, vectors = np.linalg.eigh(self.compliance[:3, :3])
        return values[::-1], vectors[:, ::-1]

    @property
    def display(self) -> Display:
        """Compliance of each direction with its standard deviation, and the stiffness there."""
        rows = [
            (axis, number(c, 5), number(s, 2), number(1 / c, 5) if c > 0 else "rigid")
            for axis, c, s in zip(
                FRAME_AXES, np.diag(self.compliance).tolist(), np.diag(self.compliance_std).tolist(), strict=True
            )
        ]
        heads = ("direction", "compliance in m/N, rad/(N*m)", "std", "its inverse")
        return Display(f"Static compliance of {self.frame}, {self.axes} axes", heads, rows)


@frozen_value(eq=False)
class FittedModel:
    """Linear model at the estimated parameters; link side, SI.

    full: model whose last outputs are the motion (6,) of a `frame`, if any, in `axes`.  coordinates: names of the n_q
    coordinates of the robot.
    """

    full: LinearModel
    estimated: EstimatedTheta
    coordinates: tuple[str, ...] = ()
    frame: str = ""
    axes: Axes = "own"

    __repr__, _repr_html_ = as_text, as_html

    @classmethod
    def of(cls, linear: LinearModel, parameters: Parameters, x: FloatArray, covariance: FloatArray) -> "FittedModel":
        """Return the model of a fitted configuration; covariance (n_x, n_x) of x (n_x,)."""
        none, name = np.zeros(len(linear.parameters)), linear.configuration.name
        return cls(linear, EstimatedTheta.of(parameters, x, covariance, linear.parameters, none, name))

    @cached_property
    def linear(self) -> LinearModel:
        """The linear model between inputs and outputs."""
        return self.full.with_outputs(range(len(self.full.outputs) - len(FRAME_AXES))) if self.frame else self.full

    @property
    def display(self) -> Display:
        """Posture, motors, ports and modes."""
        linear, table = self.linear, self.modes().display
        title = (
            f"FittedModel of {linear.configuration.name} ({degrees(linear.configuration.angles.tolist())}), motors "
            f"{linear.motors}: {linear.quantity} of {', '.join(linear.outputs)} by {', '.join(linear.inputs)}"
        )
        return Display(title, table.headings, table.rows)

    @property
    def theta(self) -> FloatArray:
        """The fitted numbers (n_theta,), SI, in the order of the linear model."""
        return self.estimated.theta(self.estimated.x)

    def response(self, freq_hz: FloatArray, *, sampled: bool = False, sampled_hz: float | None = None) -> Response:
        """Return the frequency response at freq_hz (F,), or at one.

        Equal to `to_control` except for the delay.  sampled: with the aliases of ZOH torques and sampled angles as in
        the measured response, 0.1 % at an eighth of the rate.  sampled_hz: with the aliases of ZOH inputs and sampled
        outputs at this rate.  ValueError for frequencies that are not positive.
        """
        hold = self.linear.hold if sampled else None
        if sampled_hz is not None:
            hold = ZohTorque((float(sampled_hz),) * len(self.linear.inputs), (True,) * len(self.linear.outputs))
        return to_response(replace(self.linear, hold=hold), self.theta, checked_frequencies(freq_hz))

    def response_band(self, freq_hz: FloatArray, probability: float = 0.95) -> ResponseBand:
        """Return the response at freq_hz (F,) with its pointwise and simultaneous bands of `probability`."""
        response, plain = self.response(freq_hz), replace(self.linear, hold=None)
        propagated = self._propagate(lambda theta: frequency_response(plain, theta, response.freq_hz))
        pointwise, simultaneous = propagated.radii(probability)
        return ResponseBand(response, propagated.std, pointwise, simultaneous, probability, propagated.by)

    def response_std(self, freq_hz: FloatArray) -> FloatArray:
        """Return the std E|dG|^2 ^ 1/2 (F, n_y, n_u) of `response` by the parameter covariance, to first order."""
        if self.linear.integral is not None:
            return self.response_band(freq_hz).std
        J = self._response_slopes(freq_hz)
        flat = J.reshape(len(J), -1).T
        deviations = (deviation(side, self.estimated.covariance) for side in (flat.real, flat.imag))
        return np.hypot(*deviations).reshape(J.shape[1:])

    def response_shifts(self, freq_hz: FloatArray) -> ComplexArray:
        """Return the changes of G (n_d, F, n_y, n_u) by the changes `EstimatedTheta.axes`."""
        return np.tensordot(self.estimated.axes, self._response_slopes(freq_hz), axes=1)

    def _response_slopes(self, freq_hz: FloatArray) -> ComplexArray:
        """Return dG/dx (n_x, F, n_y, n_u); ValueError for a frequency that is not positive."""
        rows = self.estimated.dependent
        kernel = Kernel(self.linear, checked_frequencies(freq_hz), tuple(self.estimated.names[row] for row in rows))
        return np.tensordot(self.estimated.slopes[rows].T, Columns(kernel).evaluate(self.theta)[1], axes=1)

    def modes(self) -> UncertainModes:
        """Return natural frequencies, damping ratios and mode shapes, without the integral states of a controller.

        Standard deviations are infinite if they depend on unidentifiable parameters.
        """
        theta, linear, natural = self.theta, self.linear, modes(self.linear, self.theta)
        omega, poles, phi = 2 * np.pi * natural.freq_hz, natural.poles, natural.shapes

        def form(A: FloatArray) -> ComplexArray:
            return np.asarray(np.einsum("nm,nk,km->m", phi, A, phi))

        M, D, _ = linear.matrices(theta)
        norm = 2 * poles * form(M) + form(D)
        of_theta = np.zeros((len(poles), len(theta)), complex)
        for name, slope in linear.slopes.items():
            matrices = enumerate((slope.K, slope.D, slope.M))
            change = sum(poles**power * form(matrix) for power, matrix in matrices if matrix is not None)
            of_theta[:, linear.parameters.index(name)] = -change / norm
        slopes = of_theta @ self.estimated.slopes
        # d|lambda| = Re(conj(lambda) dlambda) / |lambda|; zeta = -Re lambda / |lambda|.
        d_omega = (poles.conj()[:, None] * slopes).real / omega[:, None]
        d_zeta = -(slopes.real + natural.zeta[:, None] * d_omega) / omega[:, None]
        freq_std, zeta_std = (deviation(slope, self.estimated.covariance) for slope in (d_omega / (2 * np.pi), d_zeta))
        return UncertainModes(
            natural.freq_hz, natural.zeta, robot_shapes(linear, phi), natural.real_poles, freq_std, zeta_std,
            self.coordinates,
        )  # fmt: skip

    def stiffness(self) -> FrameStiffness:
        """Return the static stiffness and compliance (6, 6) of the frame, in its axes, with standard deviations.

        StudyError for free motors, whose compliance is infinite.
        """
        full = self.full
        if not self.frame or full.motors == "free":
            raise StudyError(
                "fit/posture",
                "a robot with free motors gives way to any constant force and has no stiffness; take `result.at` with "
                "motors='locked' (brakes) or motors='controlled'",
            )

        def compliance(theta: FloatArray) -> FloatArray:
            K, J = full.matrices(theta)[2], full.readout(theta)[0][-len(FRAME_AXES) :]
            return J @ np.linalg.solve(K, J.T)

        C, matrix, std = self._propagate(compliance), np.full((6, 6), np.nan), np.full((6, 6), np.nan)
        length = float(np.sqrt(C.value.trace() / max(C.value[3:, 3:].trace(), 1e-300)))  # length that scales rad to m
        scale = np.diag([1.0] * 3 + [length] * 3)
        if np.linalg.cond(scale @ C.value @ scale) <= 1e10:
            stiffness = self._propagate(lambda theta: np.linalg.inv(compliance(theta)))
            matrix, std = stiffness.value, stiffness.std
        return FrameStiffness(C.value, C.std, matrix, std, self.frame, self.axes, C.by)

    def _propagate(self, function: Any) -> Any:
        estimated = self.estimated
        return propagate(lambda x: function(estimated.theta(x)), estimated.x, estimated.covariance)

    def state_space(self) -> StateSpace:
        """Return A, B, C, D and the delay of the torque; StudyError as `linear.linear_model.state_space`."""
        return state_space(self.linear, self.theta)

    def to_control(self, pade: int | None = None) -> Any:
        """Return the model as `control.StateSpace`, as by `StateSpace.to_control`."""
        return self.state_space().to_control(pade)
