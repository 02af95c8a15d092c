r"""Delay hypotheses: an unmodelled delay or low pass of a channel; to first order, a low pass is a delay.

.. math:: D = e^{-j \omega T}, \qquad L = \frac{1}{1 + j \omega T}

They differ in gain and curvature. T is searched in one dimension, with one Gauss-Newton step of the parameters of the
fit at each T. A negative T means that the log was corrected for a delay that does not exist.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, laplace_variable
from elastid.base.errors import ElastidError
from elastid.fit.diagnosis.hypothesis import Evidence, Scores
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.refit import (
    UNCHANGED,
    EvaluatedResponse,
    ResponseChange,
    evaluate,
    frf_costs,
    gauss_newton_step,
    logarithmic,
    on_line_subset,
    refit,
)
from elastid.fit.parameter_selection import MAX_TIME
from elastid.fit.problem.frf_residuals import ElasticFit
from elastid.fit.result_rows import ModificationIndex
from elastid.parameters import DELAY
from elastid.robot import channel_name, low_pass_response

Factor: TypeAlias = Callable[[FloatArray, float], ComplexArray]


def delay(freq_hz: FloatArray, T: float) -> ComplexArray:
    """Return D (F,) of a signal that is delayed by T seconds."""
    return np.asarray(np.exp(-2j * np.pi * freq_hz * T))


def low_pass(freq_hz: FloatArray, T: float) -> ComplexArray:
    """Return L (F,) of a first-order low pass with time constant T in s; its inverse if T is negative."""
    return low_pass_response(laplace_variable(freq_hz), T)


FORMS: dict[str, Factor] = {"delay": delay, "low_pass": low_pass}


class TimeDelay(NamedTuple):
    """Best fit of a delay or low pass (name): time T in s, cost V, and Gauss-Newton step (n_x,) of x."""

    name: str
    time: float
    cost: float
    step: FloatArray


def as_delay(name: str) -> str:
    """Return the first-order equivalent delay of a delay or filter; other names unchanged."""
    form = next((form for form in FORMS if name.startswith(form)), name)
    return f"delay{name.removeprefix(form)}" if form in FORMS else name


def fit_delay_forms(
    evaluated: Sequence[EvaluatedResponse], prior: FloatArray, free: BoolArray | bool, name: str,
    channel: tuple[str, str], T_0: float,
) -> Iterator[TimeDelay]:  # fmt: skip
    """Yield the best time of each form (delay, low pass), searched around T_0 in s.

    name: of the delay.  channel: role and location, ("", "") for all positions.  prior (n_x,): 1 / std of the
    priors.  free (n_x,): parameters that follow.
    """
    from scipy.optimize import minimize_scalar  # slow to load, needed only for fits with excess residuals

    limit = LIMITS.edge_phase / max(float(e.frf.kernel.freq_hz.max()) for e in evaluated)

    def at(T: float, form: str) -> tuple[float, FloatArray]:
        delayed = ResponseChange("", "time", partial(_delay, FORMS[form], T, *channel))
        return gauss_newton_step(delayed, evaluated, prior, free)

    for form in FORMS:
        low, high = np.clip(sorted((0.3 * T_0, 2.0 * T_0)), -limit, limit).tolist()
        options = {"maxiter": LIMITS.iterations, "xatol": 1e-4 * max(abs(low), abs(high))}
        optimum = minimize_scalar(lambda T, form=form: at(T, form)[0], bounds=(low, high), options=options)
        yield TimeDelay(name.replace("delay", form, 1), float(optimum.x), *at(float(optimum.x), form))


def _delay(
    factor: Factor, T: float, role: str, location: str, evaluated: EvaluatedResponse, values: ComplexArray
) -> ComplexArray:
    model = evaluated.frf.kernel.model
    H = factor(evaluated.frf.kernel.freq_hz, T)[:, None, None]
    if not role:
        return H * values
    # The delay of a torque divides its column.
    is_place = np.array([name == location for name in (model.outputs if role == "y" else model.driven)])
    return np.where(is_place[:, None] if role == "y" else is_place, 1 / H if role == "u" else H, 1.0) * values


def common_delay(fit: ElasticFit, x: FloatArray) -> float:
    """Return the delay in s of all motions relative to the torques at which V is least, with x (n_x,) fixed.

    Global search with the logarithmic criterion, because V is periodic in the delay at each line and has many local
    minima: their width is the shortest period, of which a step is an eighth. The range is half the inverse of the line
    spacing, beyond which the phase between neighbouring lines is ambiguous.
    """
    evaluated = evaluate(logarithmic(on_line_subset(fit, LIMITS.n_refit_residuals)), x)
    step = 0.125 / max(e.frf.kernel.freq_hz[-1] for e in evaluated)
    max_delay = min(MAX_TIME[1], *(0.5 / float(np.diff(e.frf.kernel.freq_hz).max(initial=1.0)) for e in evaluated))
    delays = step * np.array(sorted(range(-int(max_delay / step), int(max_delay / step) + 1), key=abs))
    costs = [sum(frf_costs([replace(e, G=_delay(delay, T, "", "", e, e.G)) for e in evaluated])) for T in delays]
    return float(delays[np.argmin(costs)])


@dataclass(frozen=True)
class _SearchPoint:
    """Parameters x (n_x,) from which the time of a delay is searched, and the responses there.

    free (n_x,): parameters that follow the delay; True for all.
    """

    evaluated: list[EvaluatedResponse]
    x: FloatArray
    free: BoolArray | bool


def find_delays(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """Return the indices with the forms (delay, filter) of significant delays and of `common_delay`."""
    optimum, result = evidence.optimum, evidence.result
    if not optimum.fit.n_residuals:
        return indices
    fit = on_line_subset(optimum.fit)
    point = _SearchPoint(evaluate(fit, optimum.x), optimum.x, ~result.at_bound)
    channels = _channels_by_delay(point.evaluated)
    common = next(iter(channels))
    delayed = [row for row in indices if row.name in channels and row.explained_fraction > LIMITS.min_stated_fraction]
    delayed = delayed[: LIMITS.n_refits]
    rows = [index for index in indices if index not in delayed]
    points = dict.fromkeys((row.name for row in delayed), point)
    with suppress(ElastidError):  # no equilibrium at the start
        start = evidence.assembly.parameters.x
        file = on_line_subset(evidence.assembly.at(start))
        if common not in result.parameters.free_names and (T := common_delay(file, start)):
            start = refit(ResponseChange("", "time", partial(_delay, delay, T, "", "")), file, start)[1]
            points[common] = _SearchPoint(evaluate(file, start), start, True)
            row = ModificationIndex(common, "time", (common,), np.zeros(1), ("s",), (False,), np.array([T]))
            delayed, rows = ([r for r in kind if r.name != common] for kind in (delayed, rows))
            delayed.insert(0, row)
    prior, fraction = fit.parameters.prior_slopes, fit.n_residuals / optimum.fit.n_residuals
    cost = min(gauss_newton_step(UNCHANGED, point.evaluated, prior, point.free)[0], scores.cost * fraction)
    for row in delayed:
        at = points[row.name]
        forms = [*fit_delay_forms(at.evaluated, prior, at.free, row.name, channels[row.name], row.step)]
        effects = {form.name: at.x + form.step - result.x for form in forms}
        rows += _rows_of_forms(row, forms, effects, cost, scores.noise * fraction, scores)
    return rows


def _channels_by_delay(evaluated: Sequence[EvaluatedResponse]) -> dict[str, tuple[str, str]]:
    """Return role and location of the channel of each delay; first the delay of all positions, with ("", "")."""
    models = [e.frf.kernel.model for e in evaluated]
    # With references, a delay of all positions is a delay of all references; torque delays are within the loop.
    common = DELAY if all(model.controller is None for model in models) else channel_name(DELAY, "r")
    return {common: ("", "")} | {
        channel_name(DELAY, role, location): (role, location)
        for model in models
        for role, locations in (("y", model.outputs), (model.input_role, model.driven))
        for location in locations
    }


def _rows_of_forms(
    row: ModificationIndex, forms: Sequence[TimeDelay], effects: Mapping[str, FloatArray], cost: float, noise: float,
    scores: Scores,
) -> Iterator[ModificationIndex]:  # fmt: skip
    """Yield an index for each form of a delay that cannot be distinguished from the best form.

    effects: changes (n_x,) of the fitted parameters by form.  cost: V without a delay.  noise: V of a correct model.
    """
    least = min(form.cost for form in forms)
    tolerance = LIMITS.cost_margin * scores.variance_ratio + (1 - LIMITS.complete_fraction) * max(least - noise, 0.0)
    equal = [form for form in sorted(forms, key=lambda form: form.cost) if form.cost < least + tolerance]
    for form in equal:
        explained = (cost - form.cost) / max(cost - noise, 1e-300)
        yield replace(
            row, name=form.name, members=(form.name,), values=row.values * (form.name == row.name),
            steps=np.array([form.time]), effects=effects[form.name],
            drop=explained * scores.excess / scores.residual_fraction, explained_fraction=explained,
            alike=(*(other.name for other in equal if other is not form), *row.alike),
        )  # fmt: skip
