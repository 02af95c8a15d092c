r"""LinearModel: the elastic robot about one operating point, constraints eliminated.

.. math:: M(\theta) \ddot q + D(\theta) \dot q + K(\theta) q = B u, \qquad y = C q, \qquad u(t) = u_{ref}(t - T_d)

Of an accelerometer, which sees gravity turn as it tilts, the reading is C q'' + T q.

M, D, K are affine in theta about theta_ref: exact for stiffness, damping, friction, inertia and mass, first order for
centres of mass, geometry and springs in series; so are C and T, where the geometry moves an output. The
operating point is frozen, or followed to first order where springs are nonlinear or the geometry is identified; the fit
linearises again at its result until nothing moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import FloatArray, frozen, frozen_value, labelled
from elastid.base.errors import check_theta, index_of
from elastid.linear.measurement_chain import Element
from elastid.record import MOTION_ORDER, Configuration, HeldTorque, Motion
from elastid.robot import gain_name

DELAY = "delay"


@frozen_value
class Slope:
    """d(M, D, K) / d theta_p of one parameter, each symmetric (n, n) or None where the parameter does not enter.

    C, T (n_y, n): of the outputs.
    """

    M: FloatArray | None = None
    D: FloatArray | None = None
    K: FloatArray | None = None
    C: FloatArray | None = None
    T: FloatArray | None = None


@frozen_value
class LinearModel:
    """M, D, K (n, n) symmetric at theta_ref (n_theta,), slopes by parameter name, B (n, n_u), C and T (n_y, n).

    quantity: y is the position, velocity or acceleration of the outputs.  Parameters without a slope do not enter this
    model, but for `delay`, the torque delay T_d, which multiplies the response by exp(-j omega T_d), and those of the
    chain's elements.  Z (n_q, n): how the robot's coordinates move with these, dq = Z y; the unit matrix where nothing
    was eliminated.  gains: names of the parameters that are gains of channels.  hold: torques of which the response
    contains images; None for the motion itself.  sliding: inputs and outputs that translate, in N and m instead of Nm
    and rad.  Link side, SI.
    """

    configuration: Configuration
    parameters: tuple[str, ...]
    theta_ref: FloatArray = labelled("parameters at the operating point", "SI", "parameters")
    M: FloatArray
    D: FloatArray
    K: FloatArray
    slopes: dict[str, Slope] = labelled(rows=True)
    B: FloatArray
    C: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    quantity: Motion
    T: FloatArray | None = None
    chain: tuple[Element, ...] = ()
    Z: FloatArray | None = None
    gains: tuple[str, ...] = ()
    hold: HeldTorque | None = None
    sliding: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check shapes; without T no output is an accelerometer."""
        n = self.M.shape[0]
        if self.T is None:
            object.__setattr__(self, "T", frozen(np.zeros(self.C.shape)))
        if self.Z is None:
            object.__setattr__(self, "Z", frozen(np.eye(n)))
        square, read = (n, n), (len(self.outputs), n)
        expected = {"M": square, "D": square, "K": square, "B": (n, len(self.inputs)), "C": read, "T": read}
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected {shape}")
        index_of(self.quantity, tuple(MOTION_ORDER), "quantity")

    @property
    def tilt(self) -> FloatArray:
        """T (n_y, n), zero for all outputs but accelerometers."""
        return np.zeros(self.C.shape) if self.T is None else self.T

    @property
    def n(self) -> int:
        """Number of independent coordinates."""
        return int(self.M.shape[0])

    @cached_property
    def moved_outputs(self) -> tuple[str, ...]:
        """The parameters that move C or T."""
        return tuple(name for name, slope in self.slopes.items() if slope.C is not None or slope.T is not None)

    def number(self, theta: FloatArray, name: str) -> float:
        """The value of one parameter in theta (n_theta,); UnknownNameError names those there are."""
        return float(theta[index_of(name, self.parameters, "parameter")])

    def channel_gains(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """g_y (n_y,) and 1 / g_u (n_u,): factors of rows and columns of G where channels are not calibrated, or 1."""

        def gains(role: str, places: Sequence[str]) -> FloatArray:
            names = [gain_name(role, place) for place in places]
            return np.array([self.number(theta, name) if name in self.gains else 1.0 for name in names])

        return gains("y", self.outputs), 1 / gains("u", self.inputs)

    def readout(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """C and T (n_y, n) at theta (n_theta,) in SI."""
        if not self.moved_outputs:
            return self.C, self.tilt
        C, T = np.array(self.C), np.array(self.tilt)
        for name in self.moved_outputs:
            place, slope = self.parameters.index(name), self.slopes[name]
            change = theta[place] - self.theta_ref[place]
            C += 0.0 if slope.C is None else change * slope.C
            T += 0.0 if slope.T is None else change * slope.T
        return C, T

    def with_outputs(self, rows: Sequence[int]) -> LinearModel:
        """The same with some of its outputs, by their places."""
        rows = list(rows)

        def part(matrix: FloatArray | None) -> FloatArray | None:
            return None if matrix is None or not np.any(matrix[rows]) else matrix[rows]

        moved = {name: self.slopes[name] for name in self.moved_outputs}
        slopes = self.slopes | {name: replace(s, C=part(s.C), T=part(s.T)) for name, s in moved.items()}
        outputs = tuple(self.outputs[row] for row in rows)
        hold = self.hold and replace(self.hold, sampled=tuple(self.hold.sampled[row] for row in rows))
        return replace(self, C=self.C[rows], T=self.tilt[rows], outputs=outputs, slopes=slopes, hold=hold)

    def matrices(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """M, D, K (n, n) at theta (n_theta,) in SI; ValueError where theta is not one number for each parameter."""
        check_theta(theta, self.parameters)
        change = dict(zip(self.parameters, np.asarray(theta) - self.theta_ref, strict=True))
        M, D, K = self.M.copy(), self.D.copy(), self.K.copy()
        for name, slope in self.slopes.items():
            for matrix, gradient in ((M, slope.M), (D, slope.D), (K, slope.K)):
                if gradient is not None:
                    matrix += change[name] * gradient
        return M, D, K
