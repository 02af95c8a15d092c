r"""Fitted modes, responses and stiffness with their standard deviations: of a configuration, and in any posture.

.. math:: \frac{d\lambda}{dx} = - \frac{\phi^T (\lambda^2\, dM + \lambda\, dD + dK)\, \phi}
                                        {\phi^T (2 \lambda M + D)\, \phi}, \qquad
          \mathrm{cov}\, y = \frac{dy}{dx}\, \mathrm{cov}\, x\, \frac{dy}{dx}^H

to first order; M, D, K are symmetric, so that left and right eigenvectors are one (Adhikari, JSV 2000, 10).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.display import Display, as_html, as_text, degrees, number
from elastid.base.statistics import By, principal_axes
from elastid.linear.linear_model import LinearModel, StateSpace, state_space
from elastid.linear.modes import Modes, modes, modes_display
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import checked_frequencies, to_response
from elastid.parameters import Parameters
from elastid.response import Response
from elastid.robot import FRAME_AXES


@dataclass(frozen=True)
class UncertainModes:
    """Natural frequencies (n_m,) in Hz and damping ratios (n_m,) with their standard deviations."""

    freq_hz: FloatArray
    freq_std: FloatArray
    zeta: FloatArray
    zeta_std: FloatArray


def known_axes(covariance: FloatArray) -> FloatArray:
    """The principal axes (n_d, n_x) of x.

    A parameter that the data do not constrain counts with a standard deviation of 100, of a logarithm mostly.
    """
    unreached = np.isinf(np.diag(covariance))
    return principal_axes(np.where(unreached[:, None] | unreached, 0.0, covariance) + 1e4 * np.diag(unreached))


def _deviation(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard deviations of y (n,) with slopes dy/dx (n, n_x)."""
    unreached = np.isinf(np.diag(covariance))
    known = np.where(unreached[:, None] | unreached, 0.0, covariance)
    variance = np.einsum("ni,ni->n", slopes @ known, slopes)
    felt = np.any(np.abs(slopes[:, unreached]) > 1e-12 * np.abs(slopes).max(initial=1e-300), axis=1)
    return np.where(felt, np.inf, np.sqrt(np.maximum(variance, 0.0)))


@frozen_value
class FittedModel:
    """A linear model at the estimate x (n_x,) of its parameters, of covariance (n_x, n_x)."""

    linear: LinearModel
    parameters: Parameters
    x: FloatArray
    covariance: FloatArray

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """The modes with their standard deviations."""
        uncertain, linear = self.uncertain_modes(), self.linear
        title = (
            f"FittedModel of {linear.configuration.name} ({degrees(linear.configuration.angles.tolist())}): "
            f"{linear.quantity} of {', '.join(linear.outputs)} by {', '.join(linear.inputs)}"
        )
        return modes_display(title, uncertain.freq_hz, uncertain.freq_std, uncertain.zeta, uncertain.zeta_std)

    @property
    def theta(self) -> FloatArray:
        """The fitted numbers (n_theta,) in this configuration, SI, in the order of the linear model."""
        return self.parameters.expand(self.x, self.linear.configuration.name)

    def response(self, freq_hz: FloatArray, *, sampled: bool = False) -> Response:
        """The frequency response at freq_hz (F,), or at one, between the inputs and outputs that were measured.

        Without the delay these are the numbers of `to_control`.  sampled: with the images of torques that are held and
        angles that are sampled, as a measured response contains them: 0.1 % at an eighth of the rate.
        """
        linear = self.linear if sampled else replace(self.linear, hold=None)
        return to_response(linear, self.theta, freq_hz)

    def response_std(self, freq_hz: FloatArray) -> FloatArray:
        """Standard deviation E|dG|^2 ^ 1/2 (F, n_y, n_u) of `response` by that of the parameters, to first order."""
        J = self._response_slopes(freq_hz)
        flat = J.reshape(len(J), -1).T
        parts = (_deviation(part, self.covariance) for part in (flat.real, flat.imag))
        return np.asarray(np.hypot(*parts).reshape(J.shape[1:]))

    def response_shifts(self, freq_hz: FloatArray) -> ComplexArray:
        """Changes of G (n_d, F, n_y, n_u) by one standard deviation of x in each of n_d independent directions."""
        return np.asarray(np.tensordot(known_axes(self.covariance), self._response_slopes(freq_hz), axes=1))

    def _response_slopes(self, freq_hz: FloatArray) -> ComplexArray:
        """dG/dx (n_x, F, n_y, n_u); ValueError for a frequency that is not positive."""
        where = self.linear.configuration.name
        kernel = Kernel(self.linear, checked_frequencies(freq_hz), self.parameters.moved(where))
        moved = [self.parameters.index(name) for name in kernel.wanted]
        slopes = self.parameters.jacobian(self.x, where)[moved]
        return np.asarray(np.tensordot(slopes.T, kernel.evaluate(self.theta)[1], axes=1))

    def modes(self) -> Modes:
        """Natural frequencies, damping ratios and shapes with the motors free."""
        return modes(self.linear, self.theta)

    def uncertain_modes(self) -> UncertainModes:
        """Frequencies and damping ratios of `modes` with their deviations; infinite where they need infinite ones."""
        theta, natural = self.theta, self.modes()
        omega, poles, phi = 2 * np.pi * natural.freq_hz, natural.poles, natural.shapes

        def form(A: FloatArray) -> ComplexArray:
            return np.asarray(np.einsum("nm,nk,km->m", phi, A, phi))

        M, D, _ = self.linear.matrices(theta)
        norm = 2 * poles * form(M) + form(D)
        of_theta = np.zeros((len(poles), len(theta)), complex)
        for name, slope in self.linear.slopes.items():
            parts = enumerate((slope.K, slope.D, slope.M))
            change = sum(poles**power * form(matrix) for power, matrix in parts if matrix is not None)
            of_theta[:, self.linear.parameters.index(name)] = -change / norm
        slopes = of_theta @ self.parameters.jacobian(self.x, self.linear.configuration.name)
        # d|lambda| = Re(conj(lambda) dlambda) / |lambda|; zeta = -Re lambda / |lambda|.
        d_omega = (poles.conj()[:, None] * slopes).real / omega[:, None]
        d_zeta = -(slopes.real + natural.zeta[:, None] * d_omega) / omega[:, None]
        freq_std, zeta_std = (_deviation(each, self.covariance) for each in (d_omega / (2 * np.pi), d_zeta))
        return UncertainModes(natural.freq_hz, freq_std, natural.zeta, zeta_std)

    def state_space(self) -> StateSpace:
        """A, B, C, D and the delay of the torque; StudyError as `linear.statespace.state_space`."""
        return state_space(self.linear, self.theta)

    def to_control(self, pade: int | None = None) -> Any:
        """The model as `control.StateSpace`, as by `StateSpace.to_control`."""
        return self.state_space().to_control(pade)


Axes: TypeAlias = Literal["own", "world"]


@frozen_value
class ResponseBand:
    """G (F, n_y, n_u) with bands: distances (F, n_y, n_u) from it within which the truth is with probability `level`.

    pointwise: at each line by itself.  simultaneous: at all lines of an element together.  std: E|dG|^2 ^ 1/2.
    by: linearisation where draws agree with it, else draws.
    """

    response: Response
    std: FloatArray
    pointwise: FloatArray
    simultaneous: FloatArray
    level: float
    by: By

    @property
    def freq_hz(self) -> FloatArray:
        """The lines (F,)."""
        return self.response.freq_hz

    @property
    def G(self) -> ComplexArray:
        """The response (F, n_y, n_u)."""
        return self.response.G


@frozen_value
class PostureModes(UncertainModes):
    """Oscillating modes by rising frequency with standard deviations, and shapes (n_q, n_m).

    shapes: in `coordinates`, all of the robot's, largest entry 1.
    """

    shapes: ComplexArray
    coordinates: tuple[str, ...]
    real_poles: FloatArray
    by: By

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Frequency and damping ratio of each mode with their standard deviations."""
        columns = self.freq_hz, self.freq_std, self.zeta, self.zeta_std
        return modes_display(f"{len(self.freq_hz)} modes", *columns)


@frozen_value
class FrameStiffness:
    """Compliance C = J K^-1 J^T (6, 6) of a frame with its standard deviation, and stiffness, its inverse.

    Rows: x, y, z, rx, ry, rz of the frame by forces and torques, m/N, rad/N, rad/(Nm).  matrix, std (6, 6): stiffness;
    infinite numbers of a robot without six independent springs have none, and both are NaN.
    """

    compliance: FloatArray
    compliance_std: FloatArray
    matrix: FloatArray
    std: FloatArray
    frame: str
    axes: Axes
    by: By

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
