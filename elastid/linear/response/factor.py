"""Factor of a response that all of its elements share: the order of its quantity, the delay, the measurement chain."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.record import MOTION_ORDER


def factor(model: LinearModel, theta: FloatArray, s: ComplexArray) -> ComplexArray:
    """c = s^k exp(-s T_d) times the factors of the chain, of the shape of s = j omega."""
    delay = model.number(theta, DELAY) if DELAY in model.parameters else 0.0
    c = s ** MOTION_ORDER[model.quantity]
    if delay:
        c = c * np.exp(-s * delay)
    for element in model.chain:
        c = c * element.response(s, model.number(theta, element.name))
    return c
