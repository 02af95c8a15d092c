r"""LinearModel -> state space, the form that control engineers' tools read.

.. math:: \dot x = A x + B u(t - T_d), \quad y = C x + D u(t - T_d), \qquad x = [q;\, \dot q]

.. math:: A = \begin{bmatrix} 0 & I \\ -M^{-1} K & -M^{-1} D_q \end{bmatrix}, \qquad
          B = \begin{bmatrix} 0 \\ M^{-1} B_q \end{bmatrix}

y is position (C = [C_q, 0]), velocity (C = [0, C_q]) or acceleration (C = C_q [-M^-1 K, -M^-1 D_q], D = C_q M^-1 B_q);
gravity in accelerometers, [T, 0], adds to the last alone.
The lags of the measurement chain, the same for every motor, are states of their own in front of B.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import StudyError
from elastid.base.escape import control_label
from elastid.linear.linear_model import DELAY, LagElement, LinearModel
from elastid.record import Configuration, Motion


@frozen_value
class StateSpace:
    """A (2n, 2n), B (2n, n_u), C (n_y, 2n), D (n_y, n_u) of one configuration and the delay T_d in s; link side, SI."""

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
        """Sizes, and the places between which it acts."""
        n_y, n_u = self.D.shape
        title = f"StateSpace of {self.configuration.name}: {len(self.A)} states, {n_u} inputs, {n_y} outputs"
        late = f", inputs delayed by {1e3 * self.delay:.4g} ms" if self.delay else ""
        rows = [("input", place, "torque or force") for place in self.inputs]
        rows += [("output", place, self.quantity) for place in self.outputs]
        return Display(title + late, ("signal", "at", "quantity"), rows)

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """G (F, n_y, n_u) = [C (s I - A)^-1 B + D] exp(-s T_d) on the lines freq_hz (F,)."""
        s = (2j * np.pi * np.asarray(freq_hz)[:, None, None]).astype(complex)
        X = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B.astype(complex))
        return np.asarray((self.C @ X + self.D) * np.exp(-s * self.delay))

    def to_control(self, pade: int | None = None) -> Any:
        """The system as `control.StateSpace` with the names of its inputs and outputs.

        The delay is not part of it, unless `pade` gives the order of an approximation by Pade in front of each input;
        ValueError for another than a positive integer.
        """
        if pade is not None and not (isinstance(pade, int) and pade > 0):
            raise ValueError(f"pade is {pade!r}; give the order of the approximation, commonly 2 to 6")
        import control  # takes a second or two

        names = {"inputs": [*map(control_label, self.inputs)], "outputs": [*map(control_label, self.outputs)]}
        labels = {"name": control_label(self.configuration.name), **names}
        system = control.ss(self.A, self.B, self.C, self.D)
        if pade is not None and self.delay > 0:
            late = control.tf2ss(*control.pade(self.delay, pade))
            system = system * control.append(*[late] * len(self.inputs))
        return control.ss(system, **labels)


def state_space(model: LinearModel, theta: FloatArray) -> StateSpace:
    """The state space of a LinearModel at theta (n_theta,), model.parameters in SI.

    StudyError where an accelerometer's reading is turned into a velocity or a position: gravity would be integrated;
    and for a differentiator in the chain, which no finite number of states makes.
    """
    if model.quantity != "acceleration" and model.tilt.any():
        place = model.outputs[int(np.argmax(model.tilt.any(axis=1)))]
        raise StudyError(
            "linear/state-space",
            f"{place} sees gravity, which has no {model.quantity}; set estimator.quantity: acceleration",
        )
    (M, D, K), (C, tilt) = model.matrices(theta), model.readout(theta)
    n, n_u = model.B.shape
    motion = np.linalg.solve(M, np.hstack([-K, -D, model.B]))  # q'' = motion [q; q'; u]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [motion[:, : 2 * n]]])
    B = np.vstack([np.zeros((n, n_u)), motion[:, 2 * n :]])
    still, through = np.zeros_like(C), np.zeros((len(C), n_u))
    C, D_y = {
        "position": (np.hstack([C, still]), through),
        "velocity": (np.hstack([still, C]), through),
        "acceleration": (C @ motion[:, : 2 * n] + np.hstack([tilt, still]), C @ motion[:, 2 * n :]),
    }[model.quantity]
    of_outputs, of_inputs = model.channel_gains(theta)
    B, C, D_y = B * of_inputs, of_outputs[:, None] * C, of_outputs[:, None] * D_y * of_inputs
    for element in model.chain:
        if not isinstance(element, LagElement):
            raise StudyError(
                "linear/state-space",
                "a state space cannot hold the difference of a motion over a time; leave it out "
                "of the robot's chain, and estimate and export another quantity",
                f"chain.{element.name}",
            )
        T = model.number(theta, element.name)
        A, B, C, D_y = _behind_a_lag(A, B, C, D_y, element.coefficients, T)
    delay = model.number(theta, DELAY) if DELAY in model.parameters else 0.0
    return StateSpace(model.configuration, A, B, C, D_y, delay, model.inputs, model.outputs, model.quantity)


def _behind_a_lag(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, coefficients: tuple[float, ...], T: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The same system with each input behind 1 / P(s T), P = 1 + p_1 x + p_2 x^2 ...; w = [u_1; T u_1'; ...]."""
    n, order, n_u = len(A), len(coefficients), B.shape[1]
    shift = np.eye(order, k=1)
    shift[-1] = -np.array([1.0, *coefficients[:-1]]) / coefficients[-1]
    A_lag = np.kron(shift / T, np.eye(n_u))
    B_lag = np.kron(np.eye(order)[:, -1:] / (coefficients[-1] * T), np.eye(n_u))
    held = np.kron(np.eye(order)[:1], np.eye(n_u))
    return (
        np.block([[A, B @ held], [np.zeros((order * n_u, n)), A_lag]]),
        np.vstack([np.zeros((n, n_u)), B_lag]),
        np.hstack([C, D @ held]),
        np.zeros_like(D),
    )
