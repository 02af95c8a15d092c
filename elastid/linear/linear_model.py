r"""LinearModel: the elastic robot about one operating point, constraints eliminated.

.. math:: M(\theta) \ddot q + D(\theta) \dot q + K(\theta) q = B u, \qquad y = C q, \qquad u(t) = u_{ref}(t - T_d)

The signal of an accelerometer, which also measures gravity as it tilts, is C q'' + T q.

M, D, K are affine in theta about theta_ref: exact for stiffness, damping, friction, inertia and mass, first order for
centres of mass, geometry and springs in series. C and T are affine in geometry that moves an output. The operating
point is fixed; for nonlinear springs or identified geometry its change is included to first order.

Elements of the measurement chain are factors of the response, G(s) = H(s T) G_0(s), with dG / dT = s H' / H(s T) G(s).

State space of a LinearModel:

.. math:: \dot x = A x + B u(t - T_d), \quad y = C x + D u(t - T_d), \qquad x = [q;\, \dot q]

.. math:: A = \begin{bmatrix} 0 & I \\ -M^{-1} K & -M^{-1} D_q \end{bmatrix}, \qquad
          B = \begin{bmatrix} 0 \\ M^{-1} B_q \end{bmatrix}

y is position (C = [C_q, 0]), velocity (C = [0, C_q]) or acceleration (C = C_q [-M^-1 K, -M^-1 D_q] + [T, 0],
D = C_q M^-1 B_q). The lags of the measurement chain, equal for all motors, are additional states before B.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen, frozen_value, labelled, laplace_variable
from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import StudyError, check_theta, index_of
from elastid.base.escape import control_labels
from elastid.parameters import DELAY
from elastid.record import MOTION_ORDER, REFERENCE, Configuration, JointLoop, Motion, Motors, ReferenceLoop, ZohTorque
from elastid.robot import CHANNEL_NUMBERS, Chain, channel_name, low_pass_response

# Name of the lag element between command and torque.
TORQUE_LAG = "torque_lag"


def butterworth(order: int) -> tuple[float, ...]:
    """Return (p_1, ..., p_n) of the Butterworth polynomial 1 + p_1 x + ... + p_n x^n.

    p_k = p_{k-1} cos((k - 1) a) / sin(k a), p_0 = 1, a = pi / 2 n (Butterworth, 1930).
    """
    angles = np.pi / (2 * order) * np.arange(order + 1)
    return tuple(np.cumprod(np.cos(angles[:-1]) / np.sin(angles[1:])).tolist())


@dataclass(frozen=True)
class LagElement:
    """Lag element 1 / P(s T) with P(x) = 1 + p_1 x + p_2 x^2 + ...; coefficients: (p_1, p_2, ...)."""

    name: str
    coefficients: tuple[float, ...]

    def response(self, s: ComplexArray, T: float) -> ComplexArray:
        """Return H(s T) of the shape of s."""
        return np.asarray(1 / polynomial.polyval(s * T, (1.0, *self.coefficients)), dtype=np.complex128)

    def log_slope(self, s: ComplexArray, T: float) -> ComplexArray:
        """Return d ln H / dT = -s P'(s T) / P(s T)."""
        P = (1.0, *self.coefficients)
        x = s * T
        return -s * polynomial.polyval(x, polynomial.polyder(P)) / polynomial.polyval(x, P)


@dataclass(frozen=True)
class DifferenceElement:
    """Difference quotient over T instead of a derivative, H(x) = (1 - e^-x) / x, x = s T."""

    name: str

    def response(self, s: ComplexArray, T: float) -> ComplexArray:
        """Return H(s T) of the shape of s."""
        x = np.asarray(s * T, np.complex128)
        return np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x != 0)

    def log_slope(self, s: ComplexArray, T: float) -> ComplexArray:
        """Return d ln H / dT = s (1 / (e^x - 1) - 1 / x), which is -s / 2 where x is small."""
        x = s * T
        small = np.abs(x) < 1e-3
        safe = np.where(small, 1.0, x)
        return s * np.where(small, -0.5 + x / 12, 1 / np.expm1(safe) - 1 / safe)


Element = LagElement | DifferenceElement


def elements(chain: Chain) -> tuple[Element, ...]:
    """Return the elements of a measurement chain: first torque elements, then sensor elements."""
    return (*torque_elements(chain), *sensor_elements(chain))


def torque_elements(chain: Chain) -> tuple[LagElement, ...]:
    """Return the elements between command and torque, which are inside a control loop."""
    if chain.torque_lag is None:
        return ()
    return (LagElement(TORQUE_LAG, (1.0,) if chain.torque_order == 1 else (2 * chain.torque_damping, 1.0)),)


def sensor_elements(chain: Chain) -> tuple[Element, ...]:
    """Return the elements between motion and log."""
    lag = () if chain.sensor_lag is None else (LagElement("sensor_lag", butterworth(chain.sensor_order)),)
    return lag if chain.differentiator is None else (*lag, DifferenceElement("differentiator"))


def is_load(location: str) -> bool:
    """Return True for a force or a torque at a frame: `force tool x`."""
    return location.startswith(("force ", "torque "))


def project(Z: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return Z^T matrix Z (n, n), symmetric to the last bit; Z (n_q, n), matrix (n_q, n_q)."""
    if len(Z) == Z.shape[1]:
        return matrix  # without elimination, Z is the unit matrix
    product = Z.T @ matrix @ Z
    return (product + product.T) / 2


@frozen_value
class Slope:
    """d(M, D, K) / d theta_p of one parameter, each symmetric (n, n), or None without dependence.

    C, T (n_y, n): of the outputs.  B (n, n_u): of forces and torques at frames.
    """

    M: FloatArray | None = None
    D: FloatArray | None = None
    K: FloatArray | None = None
    C: FloatArray | None = None
    T: FloatArray | None = None
    B: FloatArray | None = None


@frozen_value
class LinearModel:
    """Linear equations of one configuration: M, D, K (n, n), B (n, n_u), C and T (n_y, n) at theta_ref (n_theta,).

    quantity: position, velocity or acceleration of the outputs.  Parameters without a slope have no effect on M, D, K;
    `delay`, the torque delay T_d, multiplies the response by exp(-j omega T_d), and lag elements have parameters, too.
    chain: lag elements.  Z (n_q, n): dq = Z dy, robot coordinates q by coordinates y of the model; unit matrix without
    elimination.  channel_numbers: names of channel parameters.  hold: ZOH torques whose aliases the response contains;
    None without aliases.  sliding: inputs and outputs in N and m instead of Nm and rad.  motors, loop: as in
    `Response`; their effect is in M, D, K.  controller: the inputs are its references, and B has a column for each
    motor.  integral (n, n): Delta of an integral controller, whose force is -Delta / s q.  Link side, SI.
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
    T: FloatArray = None  # type: ignore[assignment]  # `__post_init__` sets the defaults of T and Z
    chain: tuple[Element, ...] = ()
    Z: FloatArray = None  # type: ignore[assignment]
    channel_numbers: tuple[str, ...] = ()
    hold: ZohTorque | None = None
    sliding: tuple[str, ...] = ()
    motors: Motors = "free"
    loop: JointLoop | None = None
    integral: FloatArray | None = None
    controller: ReferenceLoop | None = None

    def __post_init__(self) -> None:
        """Set T (default: no accelerometer) and Z. Raises UnknownNameError for an unknown quantity."""
        if self.T is None:
            object.__setattr__(self, "T", frozen(np.zeros(self.C.shape)))
        if self.Z is None:
            object.__setattr__(self, "Z", frozen(np.eye(len(self.M))))
        index_of(self.quantity, tuple(MOTION_ORDER), "quantity")

    @property
    def n(self) -> int:
        """Number of independent coordinates."""
        return int(self.M.shape[0])

    @cached_property
    def output_parameters(self) -> tuple[str, ...]:
        """Names of parameters that C, T or B depend on."""
        return tuple(name for name, s in self.slopes.items() if any(matrix is not None for matrix in (s.C, s.T, s.B)))

    @property
    def is_delayed(self) -> bool:
        """True if the inputs are motor torques; the delay and the lag elements apply only to them."""
        return not any(is_load(location) for location in self.inputs)

    @property
    def driven(self) -> tuple[str, ...]:
        """Motor of each input that is a torque or a reference."""
        return tuple(location.replace(REFERENCE, "motor ") for location in self.inputs)

    @property
    def by_torques(self) -> "LinearModel":
        """Open-loop model: inputs are the torques of the controlled motors."""
        return self if self.controller is None else replace(self, controller=None, inputs=self.controller.motors)

    @property
    def input_role(self) -> str:
        """Role of the inputs in names of channels."""
        return "u" if self.controller is None else "r"

    def number(self, theta: FloatArray, name: str, absent: float | None = None) -> float:
        """Return the value of one parameter in theta (n_theta,).

        absent: default if the model has no such parameter; None: raise UnknownNameError with all names.
        """
        if absent is not None and name not in self.parameters:
            return absent
        return float(theta[index_of(name, self.parameters, "parameter")])

    def channel_factors(self, theta: FloatArray, s: ComplexArray | None = None) -> tuple[ComplexArray, ComplexArray]:
        """Return F_y (..., n_y) and 1 / F_u (..., n_u), factors of rows and columns of G due to channel errors.

        s (...,): j omega; None for the gains alone, without delays and low passes of the log.
        """

        def number(kind: str, role: str, location: str) -> float:
            name = channel_name(kind, role, location)
            return self.number(theta, name) if name in self.channel_numbers else CHANNEL_NUMBERS[kind][1]

        def factors(role: str, locations: Sequence[str]) -> ComplexArray:
            gains = np.array([number("gain", role, location) for location in locations], np.complex128)
            if s is None or not self.channel_numbers:
                return gains
            delays = np.array([number("delay", role, "") + number("delay", role, location) for location in locations])
            common = low_pass_response(s, number("low_pass", role, ""))[..., None]
            filters = [low_pass_response(s, number("low_pass", role, location)) for location in locations]
            return np.asarray(gains * np.exp(-s[..., None] * delays) * common * np.stack(filters, axis=-1))

        of_inputs = factors(self.input_role, self.driven)
        return factors("y", self.outputs), 1 / of_inputs if self.controller is None else of_inputs

    def readout(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return C and T (n_y, n) at theta (n_theta,) in SI."""
        return self._first_order("C", theta), self._first_order("T", theta)

    def input_matrix(self, theta: FloatArray) -> FloatArray:
        """Return B (n, n_u) at theta (n_theta,) in SI."""
        return self._first_order("B", theta)

    def _first_order(self, letter: str, theta: FloatArray) -> FloatArray:
        slopes = {name: getattr(self.slopes[name], letter) for name in self.output_parameters}
        change = np.asarray(theta) - self.theta_ref
        parts = (self.number(change, name) * slope for name, slope in slopes.items() if slope is not None)
        return sum(parts, getattr(self, letter))  # type: ignore[no-any-return]

    def with_outputs(self, rows: Sequence[int]) -> "LinearModel":
        """Return the model with a selection of its outputs; rows: indices."""
        rows = list(rows)

        def part(matrix: FloatArray | None) -> FloatArray | None:
            return None if matrix is None or not np.any(matrix[rows]) else matrix[rows]

        slopes_of_outputs = {name: self.slopes[name] for name in self.output_parameters}
        slopes = self.slopes | {name: replace(s, C=part(s.C), T=part(s.T)) for name, s in slopes_of_outputs.items()}
        outputs = tuple(self.outputs[row] for row in rows)
        zoh = self.hold and replace(self.hold, sampled=tuple(self.hold.sampled[row] for row in rows))
        return replace(self, C=self.C[rows], T=self.T[rows], outputs=outputs, slopes=slopes, hold=zoh)

    def matrices(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return M, D, K (n, n) at theta (n_theta,) in SI; ValueError unless theta has one value per parameter."""
        check_theta(theta, self.parameters)
        change = np.asarray(theta) - self.theta_ref
        terms = ((getattr(self, letter), *self.terms[letter]) for letter in "MDK")
        M, D, K = (A + (change[at] @ slopes.reshape(len(at), A.size)).reshape(A.shape) for A, at, slopes in terms)
        return M, D, K

    @cached_property
    def terms(self) -> dict[str, tuple[IntArray, FloatArray]]:
        """Indices in theta of parameters that M, D, K depend on, and their slopes (n_p, n, n)."""
        of_letter = {
            letter: {name: slope for name, s in self.slopes.items() if (slope := getattr(s, letter)) is not None}
            for letter in "MDK"
        }
        indices = {letter: [self.parameters.index(name) for name in slopes] for letter, slopes in of_letter.items()}
        return {x: (np.array(indices[x], np.int64), np.array([*slopes.values()])) for x, slopes in of_letter.items()}


@frozen_value
class StateSpace:
    """State space A (2n, 2n), B (2n, n_u), C (n_y, 2n), D (n_y, n_u), and input delay T_d in s; link side, SI."""

    configuration: Configuration
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    delay: float
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    quantity: Motion

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Sizes, inputs and outputs."""
        n_y, n_u = self.D.shape
        title = f"StateSpace of {self.configuration.name}: {len(self.A)} states, {n_u} inputs, {n_y} outputs"
        delay = f", inputs delayed by {1e3 * self.delay:.4g} ms" if self.delay else ""
        rows = [("input", location, "torque or force") for location in self.inputs]
        rows += [("output", location, self.quantity) for location in self.outputs]
        return Display(title + delay, ("signal", "at", "quantity"), rows)

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """Return G (F, n_y, n_u) = [C (s I - A)^-1 B + D] exp(-s T_d) on the lines freq_hz (F,)."""
        s = laplace_variable(np.asarray(freq_hz)[:, None, None])
        X = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B.astype(complex))
        return np.asarray((self.C @ X + self.D) * np.exp(-s * self.delay))

    def to_control(self, pade: int | None = None) -> Any:
        """Return the system as `control.StateSpace` with the names of its inputs and outputs.

        pade: order of the Pade approximation of the delay; None omits the delay. ValueError unless positive.
        """
        if pade is not None and not (isinstance(pade, int) and pade > 0):
            raise ValueError(f"pade is {pade!r}; give the order of the approximation, commonly 2 to 6")
        import control  # takes a second or two

        labels = control_labels(self.configuration.name, self.inputs, self.outputs)
        system = control.ss(self.A, self.B, self.C, self.D)
        if pade is not None and self.delay > 0:
            system = system * control.append(*[control.tf2ss(*control.pade(self.delay, pade))] * len(self.inputs))
        return control.ss(system, **labels)


def state_space(model: LinearModel, theta: FloatArray) -> StateSpace:
    """Return the state space of a LinearModel at theta (n_theta,), model.parameters in SI.

    Inputs are torques, even if the inputs of the model are references.
    StudyError for velocities or positions of accelerometers, which would integrate gravity, and for a differentiator in
    the chain, which has no finite state space.
    """
    model = model.by_torques
    if model.quantity != "acceleration" and model.T.any():
        index = model.outputs[int(np.argmax(model.T.any(axis=1)))]
        raise StudyError(
            "linear/state-space",
            f"{index} measures gravity, too: its {model.quantity} is not defined. Set estimator.quantity: acceleration",
        )
    (M, D, K), (C, tilt) = model.matrices(theta), model.readout(theta)
    n, n_u = model.B.shape
    integral = () if model.integral is None else (-model.integral,)  # of further states z, z' = q
    m = (2 + len(integral)) * n
    motion, q, v = np.linalg.solve(M, np.hstack([-K, -D, *integral, model.B])), np.eye(n, m), np.eye(n, m, n)
    A = np.vstack([v, motion[:, :m], *(q for _ in integral)])  # q'' = motion [q; q'; z; u]
    B = np.zeros((m, n_u))
    B[n : 2 * n] = motion[:, m:]
    C, D_y = {
        "position": (C @ q, np.zeros((len(C), n_u))),
        "velocity": (C @ v, np.zeros((len(C), n_u))),
        "acceleration": (C @ motion[:, :m] + tilt @ q, C @ motion[:, m:]),
    }[model.quantity]
    of_outputs, of_inputs = (gains.real for gains in model.channel_factors(theta))
    B, C, D_y = B * of_inputs, of_outputs[:, None] * C, of_outputs[:, None] * D_y * of_inputs
    for element in model.chain:
        if not isinstance(element, LagElement):
            raise StudyError(
                "linear/state-space",
                "a state space cannot hold the difference of a motion over a time; leave it out "
                "of the robot's chain, and estimate and export another quantity",
                f"chain.{element.name}",
            )
        A, B, C, D_y = _behind_a_lag(A, B, C, D_y, element.coefficients, model.number(theta, element.name))
    delay = model.number(theta, DELAY, absent=0.0)
    return StateSpace(model.configuration, A, B, C, D_y, delay, model.inputs, model.outputs, model.quantity)


def _behind_a_lag(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, coefficients: tuple[float, ...], T: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Filter each input by 1 / P(s T), P = 1 + p_1 x + p_2 x^2 ..., with states w = [u_1, T u_1', ...]."""
    n, order, n_u = len(A), len(coefficients), B.shape[1]
    shift = np.eye(order, k=1)
    shift[-1] = -np.array([1.0, *coefficients[:-1]]) / coefficients[-1]
    A_lag = np.kron(shift / T, np.eye(n_u))
    B_lag = np.kron(np.eye(order)[:, -1:] / (coefficients[-1] * T), np.eye(n_u))
    lagged_input = np.kron(np.eye(order)[:1], np.eye(n_u))
    return (
        np.block([[A, B @ lagged_input], [np.zeros((order * n_u, n)), A_lag]]),
        np.vstack([np.zeros((n, n_u)), B_lag]),
        np.hstack([C, D @ lagged_input]),
        np.zeros_like(D),
    )
