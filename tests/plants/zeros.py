"""Antiresonances of one element of a linear model, by python-control."""

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.linear.linear_model import LinearModel, state_space


def antiresonances(model: LinearModel, output: str, input: str) -> tuple[FloatArray, FloatArray]:
    """Frequencies in Hz, rising, and damping ratios at theta_ref; those beyond ten times the last pole are infinite."""
    system = state_space(replace(model, quantity="position"), model.theta_ref).to_control()
    element = system[model.outputs.index(output), model.inputs.index(input)]
    zeros, most = element.zeros(), 10 * np.abs(element.poles()).max()
    zeros = zeros[(zeros.imag > 1e-6 * most) & (np.abs(zeros) < most)]
    zeros = zeros[np.argsort(np.abs(zeros))]
    return np.abs(zeros) / (2 * np.pi), -zeros.real / np.abs(zeros)
