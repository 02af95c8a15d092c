r"""How a channel, or all of them, may be late: by a delay, a low pass, a hold, which differ in gain and curvature.

.. math:: D = e^{-j \omega T}, \qquad L = \frac{1}{1 + j \omega T}, \qquad
          H = e^{-j \omega T / 2}\, \frac{\sin \omega T / 2}{\omega T / 2}

To first order all are a delay. T follows by a search in one dimension, the parameters of the fit by one Gauss-Newton
step at each. A hold is that of a torque between its samples; a negative T is a hold that was taken out where none is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.fit.diagnosis.modification.reading import Read, Reading, read
from elastid.fit.diagnosis.modification.sensitivities import Evaluated
from elastid.robot import gain_name

Factor: TypeAlias = Callable[[FloatArray, float], ComplexArray]

# f T at the upper edge of the longest that is looked for.
MAX_EDGE_PHASE = 0.8
# Where the search for a hold begins, of f T at the upper edge: beside a free delay the sinc is flat at zero.
STARTS = (-0.1, 0.1, 0.4)
MAX_EVALUATIONS = 14


def delay(freq_hz: FloatArray, T: float) -> ComplexArray:
    """D (F,) of a signal that is T late."""
    return np.asarray(np.exp(-2j * np.pi * freq_hz * T))


def low_pass(freq_hz: FloatArray, T: float) -> ComplexArray:
    """L (F,) of a filter of first order with the time constant T, its inverse where T is negative."""
    L = 1 / (1 + 2j * np.pi * freq_hz * abs(T))
    return np.asarray(L if T >= 0 else 1 / L)


def hold(freq_hz: FloatArray, T: float) -> ComplexArray:
    """H (F,) of a torque held for T, its inverse where T is negative."""
    H = np.exp(-1j * np.pi * freq_hz * abs(T)) * np.sinc(freq_hz * abs(T))
    return np.asarray(H if T >= 0 else 1 / H)


@dataclass(frozen=True, eq=False)
class Late:
    """A form of lateness of all channels, of an output or of an input, with the T in s that fits best."""

    form: str
    role: str
    at: str
    time: float
    read: Read

    @property
    def name(self) -> str:
        """`delay`, `low_pass_y_motor_2` ..."""
        return late_name(self.form, self.role, self.at)


def late_name(form: str, role: str, at: str) -> str:
    """The name of a form of lateness of a channel, of all channels without a role."""
    return gain_name(role, at).replace("gain", form, 1) if role else form


def forms(role: str) -> dict[str, Factor]:
    """Of all channels (""), of an output (y) or of an input (u)."""
    found: dict[str, Factor] = {"delay": delay, "low_pass": low_pass}
    return found if role == "y" else found | {"hold": hold}


def latest(
    evaluated: Sequence[Evaluated], role: str, at: str, start: float, prior: FloatArray, free: BoolArray
) -> Iterator[Late]:
    """The best T of each form, searched for about that of a delay of `start`."""
    edge_hz = max(float(one.part.kernel.freq_hz.max()) for one in evaluated)
    for form, factor in forms(role).items():
        about = start * (2.0 if form == "hold" else 1.0)
        yield _best(evaluated, form, factor, role, at, (0.3 * about, 2.0 * about), edge_hz, prior, free)


def best_hold(evaluated: Sequence[Evaluated], prior: FloatArray, free: BoolArray, delay_is_free: bool = False) -> Late:
    """A hold of all torques, wherever it is; beside a free delay, which takes its phase, by its amplitude alone."""
    edge_hz = max(float(one.part.kernel.freq_hz.max()) for one in evaluated)
    factor = _amplitude if delay_is_free else hold
    tried = [
        _best(evaluated, "hold", factor, "", "", (0.2 * phase / edge_hz, 2 * phase / edge_hz), edge_hz, prior, free)
        for phase in STARTS
    ]
    return min(tried, key=lambda one: one.read.cost)


def _amplitude(freq_hz: FloatArray, T: float) -> ComplexArray:
    """|H| (F,), its inverse where T is negative."""
    H = np.sinc(freq_hz * abs(T)).astype(complex)
    return np.asarray(H if T >= 0 else 1 / H)


def _best(
    evaluated: Sequence[Evaluated],
    form: str,
    factor: Factor,
    role: str,
    at: str,
    between: tuple[float, float],
    edge_hz: float,
    prior: FloatArray,
    free: BoolArray,
) -> Late:
    from scipy.optimize import minimize_scalar  # slow to load, for the few fits that are beyond the noise

    def at_time(T: float) -> Read:
        return read(Reading(form, "time", partial(_late, factor, T, role, at)), evaluated, prior, free)

    limit = MAX_EDGE_PHASE / edge_hz
    low, high = (float(np.clip(T, -limit, limit)) for T in sorted(between))
    options = {"maxiter": MAX_EVALUATIONS, "xatol": 1e-4 * max(abs(low), abs(high))}
    T = float(minimize_scalar(lambda T: at_time(T).cost, bounds=(low, high), method="bounded", options=options).x)
    return Late(form, role, at, T, at_time(T))


def _late(factor: Factor, T: float, role: str, at: str, one: Evaluated, values: ComplexArray) -> ComplexArray:
    model = one.part.kernel.model
    H = factor(one.part.kernel.freq_hz, T)[:, None, None]
    if not role:
        return np.asarray(H * values)
    named = np.array([name == at for name in (model.outputs if role == "y" else model.inputs)])
    return np.asarray(np.where(named[:, None] if role == "y" else named, H, 1.0) * values)
