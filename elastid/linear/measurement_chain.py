r"""Elements of the measurement chain as factors of a response, with their derivatives to the one number of each.

.. math:: G(s) = H(s T)\, G_0(s), \qquad \frac{dG}{dT} = s \frac{H'(s T)}{H(s T)}\, G(s)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial

from elastid.base.arrays import ComplexArray
from elastid.robot import Chain

# The one element between command and torque.
TORQUE_LAG = "torque_lag"
# Butterworth polynomials without their leading 1: 1 + p_1 x + p_2 x^2 ...
BUTTERWORTH = {
    1: (1.0,),
    2: (2**0.5, 1.0),
    3: (2.0, 2.0, 1.0),
    4: (2.613125929752753, 3.414213562373095, 2.613125929752753, 1.0),
}


@dataclass(frozen=True)
class LagElement:
    """H(x) = 1 / P(x), x = s T, P = 1 + p_1 x + p_2 x^2 ... by (p_1, p_2 ...)."""

    name: str
    coefficients: tuple[float, ...]

    def response(self, s: ComplexArray, T: float) -> ComplexArray:
        """H(s T) of the shape of s."""
        return np.asarray(1 / polynomial.polyval(s * T, (1.0, *self.coefficients)), dtype=np.complex128)

    def log_slope(self, s: ComplexArray, T: float) -> ComplexArray:
        """d ln H / dT = -s P'(s T) / P(s T)."""
        P = (1.0, *self.coefficients)
        x = s * T
        return np.asarray(-s * polynomial.polyval(x, polynomial.polyder(P)) / polynomial.polyval(x, P))


@dataclass(frozen=True)
class DifferenceElement:
    """H(x) = (1 - e^-x) / x, x = s T: a difference over T in the place of a derivative."""

    name: str

    def response(self, s: ComplexArray, T: float) -> ComplexArray:
        """H(s T) of the shape of s."""
        half = s * T / 2  # e^(-x/2) sinh(x/2) / (x/2) keeps its digits where x is small
        return np.asarray(np.exp(-half) * _sinhc(half), dtype=np.complex128)

    def log_slope(self, s: ComplexArray, T: float) -> ComplexArray:
        """d ln H / dT = s (1 / (e^x - 1) - 1 / x), which is -s / 2 where x is small."""
        x = s * T
        small = np.abs(x) < 1e-3
        safe = np.where(small, 1.0, x)
        return np.asarray(s * np.where(small, -0.5 + x / 12, 1 / np.expm1(safe) - 1 / safe))


Element = LagElement | DifferenceElement


def elements(chain: Chain) -> tuple[Element, ...]:
    """The elements of a chain: first those of the torque, then those of the sensor."""
    return (*torque_elements(chain), *sensor_elements(chain))


def torque_elements(chain: Chain) -> tuple[LagElement, ...]:
    """Between command and torque: they are inside a control loop."""
    if chain.torque_lag is None:
        return ()
    second = (2 * chain.torque_damping, 1.0)
    return (LagElement(TORQUE_LAG, (1.0,) if chain.torque_order == 1 else second),)


def sensor_elements(chain: Chain) -> tuple[Element, ...]:
    """Between motion and log."""
    found: list[Element] = []
    if chain.sensor_lag is not None:
        found.append(LagElement("sensor_lag", BUTTERWORTH[chain.sensor_order]))
    if chain.differentiator is not None:
        found.append(DifferenceElement("differentiator"))
    return tuple(found)


def _sinhc(x: ComplexArray) -> ComplexArray:
    small = np.abs(x) < 1e-4
    safe = np.where(small, 1.0, x)
    return np.asarray(np.where(small, 1 + x**2 / 6, np.sinh(safe) / safe))
