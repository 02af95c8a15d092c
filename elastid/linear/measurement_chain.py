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
    """H(x) = (1 - e^-x) / x, x = s T: a difference over T instead of a derivative."""

    name: str

    def response(self, s: ComplexArray, T: float) -> ComplexArray:
        """H(s T) of the shape of s."""
        half = s * T / 2  # e^(-x/2) sinh(x/2) / (x/2) keeps its digits where x is small
        small = np.abs(half) < 1e-4
        safe = np.where(small, 1.0, half)
        sinhc = np.where(small, 1 + half**2 / 6, np.sinh(safe) / safe)
        return np.asarray(np.exp(-half) * sinhc, dtype=np.complex128)

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
    return (LagElement(TORQUE_LAG, (1.0,) if chain.torque_order == 1 else (2 * chain.torque_damping, 1.0)),)


def sensor_elements(chain: Chain) -> tuple[Element, ...]:
    """Between motion and log."""
    lag = () if chain.sensor_lag is None else (LagElement("sensor_lag", BUTTERWORTH[chain.sensor_order]),)
    return lag if chain.differentiator is None else (*lag, DifferenceElement("differentiator"))
