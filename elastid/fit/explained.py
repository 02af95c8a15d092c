r"""How much of the measured responses a model explains, and whether it would explain far more with another sign.

.. math:: \text{explained} = 1 - \frac{\sum_i w_i |\hat G_i - G_i|^2 - V_0}{\sum_i w_i |\hat G_i|^2 - V_0},
          \qquad w = 2 / \sigma^2

over all elements that count, V_0 what the noise alone leaves: 1 for all but the noise, 0 for no better than no model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import FitError
from elastid.fit.elastic import ElasticFit, Part
from elastid.fit.residuals import error_gain
from elastid.fit.solvers import ROUGH, solve

# With the right sign a cost is at most this part of what it is with the wrong one.
FAR_BETTER = 0.1
# A configuration whose residuals are so many times those of the median one is not like the others.
FAR_APART = 5.0


def explained(fit: ElasticFit, x: FloatArray, noise_cost: float) -> float:
    """The share of the measured responses that the model at x (n_x,) explains; negative where it is worse than none."""
    left, whole = 0.0, 0.0
    for part in fit.parts:
        weight = part.gain * np.abs(error_gain(part.criterion, part.measured))
        used = part.gain > 0
        error = np.where(used, weight * (part.measured - part.kernel.response(fit.theta(part, x))), 0.0)
        left += float(np.sum(np.abs(error) ** 2))
        whole += float(np.sum(np.abs(np.where(used, weight * part.measured, 0.0)) ** 2))
    return 1 - max(left - noise_cost, 0.0) / max(whole - noise_cost, 1e-300)


@dataclass(frozen=True)
class Channel:
    """An output (role y) or an input (role u) of a fit: its place on the robot."""

    role: str
    at: str

    @property
    def name(self) -> str:
        """As messages call it."""
        return f"{self.role} at {self.at}"

    def turned(self, fit: ElasticFit) -> ElasticFit:
        """The fit with this channel of all measured responses negated."""
        return replace(fit, parts=tuple(self._turned(part) for part in fit.parts))

    def _turned(self, part: Part) -> Part:
        model = part.kernel.model
        outputs = [-1.0 if self.role == "y" and name == self.at else 1.0 for name in model.outputs]
        inputs = [-1.0 if self.role == "u" and name == self.at else 1.0 for name in model.inputs]
        signs = np.outer(outputs, inputs)
        mixing = None if part.mixing is None else part.mixing * signs.ravel()
        return replace(part, measured=part.measured * signs, mixing=mixing)


def sign_words(fit: ElasticFit, x: FloatArray, cost: float) -> tuple[str, ...]:
    """A word about the channel with whose sign turned the fit, found again from its optimum x, is far better.

    Or about the phase of all responses, which some programs count the other way.

    cost: V at x.  An output and an input that do the same, as those of a single motor do, are named together.
    """
    turned_back = min(_best_cost(_conjugated(fit, sign), x) for sign in (1, -1))
    models = [part.kernel.model for part in fit.parts]
    channels = [Channel("y", at) for at in dict.fromkeys(name for model in models for name in model.outputs)]
    channels += [Channel("u", at) for at in dict.fromkeys(name for model in models for name in model.inputs)]
    costs = {channel.name: _best_cost(channel.turned(fit), x) for channel in channels}
    best = min(costs.values())
    if turned_back <= FAR_BETTER * cost and turned_back < best:
        return (
            f"the responses fit far better with all phases turned round (V = {turned_back:.4g} instead of {cost:.4g}): "
            "what wrote them counts phase by exp(-j omega t); take their complex conjugates",
        )
    if best > FAR_BETTER * cost:
        return ()
    names = " or ".join(name for name, one in costs.items() if one <= best / FAR_BETTER and one <= FAR_BETTER * cost)
    return (
        f"{names} fits far better with the other sign (V = {best:.4g} instead of {cost:.4g}): check sign, scale and "
        "gear ratio of its channel",
    )


def apart_words(fit: ElasticFit, x: FloatArray) -> tuple[str, ...]:
    """A word about each configuration that the model at x explains far worse than the others."""
    level = {}
    for part in fit.parts:
        if part.n_residuals:
            name = part.kernel.model.configuration.name
            level[name] = np.sqrt(part.normal.at(fit.theta(part, x))[0] / part.n_residuals)
    if len(level) < 3:
        return ()
    usual = float(np.median(list(level.values())))
    return tuple(
        f"configuration {name}: its residuals are {one / usual:.0f} times those of the other configurations; is it of "
        "the same robot, with the same load, at the angles that it claims?"
        for name, one in level.items()
        if one > FAR_APART * usual
    )


def _conjugated(fit: ElasticFit, sign: int) -> ElasticFit:
    """sign is -1 where an odd power of j omega made of them what is fitted: (j omega)^* = -j omega."""
    return replace(fit, parts=tuple(_as_conjugate(part, sign) for part in fit.parts))


def _as_conjugate(part: Part, sign: int) -> Part:
    mixing = None if part.mixing is None else part.mixing.conj()
    return replace(part, measured=sign * part.measured.conj(), mixing=mixing)


def _best_cost(fit: ElasticFit, x: FloatArray) -> float:
    """The lower of the optima reached from x and from the start of the fit; inf where neither leads anywhere."""
    costs = [np.inf]
    for start in (x, fit.parameters.x):
        try:
            costs.append(solve(fit.problem, start, ROUGH).cost)
        except FitError:
            continue
    return float(min(costs))
