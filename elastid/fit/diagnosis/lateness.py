r"""Lateness of a channel, or of all: a delay, a low pass, a hold, which differ in gain and curvature.

.. math:: D = e^{-j \omega T}, \qquad L = \frac{1}{1 + j \omega T}, \qquad
          H = e^{-j \omega T / 2}\, \frac{\sin \omega T / 2}{\omega T / 2}

H is that of velocities, too, which are differences of positions over T: what is meant where the study says that torques
are held. To first order all are a delay. T follows by a search in one dimension, the parameters of the fit by one
Gauss-Newton step at each. A hold is that of a torque between its samples; a negative T is one that was taken out where
none is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.fit.diagnosis.hypothesis import Evidence, Scores
from elastid.fit.diagnosis.prediction import AS_READ, Prediction, Reading, evaluate, predict, thinned
from elastid.fit.diagnosis.sensitivities import Evaluated
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.result import ModificationIndex
from elastid.robot import gain_name

OF_POSTURE = "@"  # role of a delay of all channels in one configuration
# Roles of channels, "" for all, that may have the form H by its name.
HELD_ROLES = {"hold": ("", "u"), "difference": ("", "y"), "": ("",)}
Factor: TypeAlias = Callable[[FloatArray, float], ComplexArray]


@dataclass(frozen=True)
class Limits:
    """Thresholds of the judgement of lateness."""

    edge_phase: float = 0.8  # f T at the upper edge of the longest that is sought
    evaluations: int = 14  # of the search in one dimension
    # Of the excess and of the best delay's share, from which a delay is followed by its forms.
    share: float = 0.1
    part_of_best: float = 0.5
    followed: int = 2  # delays
    # Differences of V, in variances of the noise and of what remains, below which forms cannot be distinguished.
    form_drop: float = 10.0
    form_share: float = 0.01
    std: float = 1.0  # of ln p, where the data constrain p


LIMITS = Limits()


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


def hold_amplitude(freq_hz: FloatArray, T: float) -> ComplexArray:
    """|H| (F,), its inverse where T is negative."""
    H = np.sinc(freq_hz * abs(T)).astype(complex)
    return np.asarray(H if T >= 0 else 1 / H)


@dataclass(frozen=True, eq=False)
class Late:
    """A form of lateness of all channels, of an output or of an input, with the T in s that fits best."""

    form: str
    role: str
    place: str
    time: float
    prediction: Prediction

    @property
    def name(self) -> str:
        """`delay`, `low_pass_y_motor_2` ..."""
        return late_name(self.form, self.role, self.place)

    @property
    def cost(self) -> float:
        """V with it, after a step."""
        return self.prediction.cost


def late_name(form: str, role: str, place: str) -> str:
    """The name of a form of lateness of a channel, of all channels without a role."""
    if role == OF_POSTURE:
        return f"{form}@{place}"
    return gain_name(role, place).replace("gain", form, 1) if role else form


def as_delay(name: str) -> str:
    """The delay that a form of lateness is to first order; any other name as it is."""
    form = next((form for form in ("low_pass", "hold", "difference") if name.startswith(form)), "")
    return f"delay{name.removeprefix(form)}" if form else name


@dataclass(frozen=True, eq=False)
class LatenessSearch:
    """Configurations evaluated at x (n_x,).  prior (n_x,): 1 / s of the priors.  free (n_x,): what may follow.

    held: the name of H for a positive T, `hold` or `difference`; none where a study with held torques has angles.
    """

    x: FloatArray
    evaluated: Sequence[Evaluated]
    prior: FloatArray
    free: BoolArray
    held: str = "hold"

    def best_forms(self, role: str, place: str, start: float) -> Iterator[Late]:
        """The best T of each form of an output (y), input (u), a posture (@) or all (""), near a delay of `start`."""
        forms: list[tuple[str, Factor, float]] = [("delay", delay, start)]
        forms += [("low_pass", low_pass, start)] if role != OF_POSTURE else []
        forms += [("hold", hold, 2.0 * start)] if role in HELD_ROLES[self.held] else []
        for form, factor, T in forms:
            yield from self._named(self._between(form, factor, role, place, (0.3 * T, 2.0 * T)))

    def best_filters(self, delay_is_free: bool = False) -> Iterator[Late]:
        """The best hold of all torques, and the best low pass; a hold next to a free delay by its amplitude alone."""
        # Starts by f T at the upper edge: next to a free delay the sinc is flat at zero.
        forms = (
            ("hold", hold_amplitude if delay_is_free else hold, (-0.1, 0.1, 0.4)),
            ("low_pass", low_pass, (-0.4, -0.1, 0.1)),
        )
        for form, factor, phases in forms:
            ends = [(0.2 * phase / self._edge_hz, 2 * phase / self._edge_hz) for phase in phases]
            every = [late for pair in ends for late in self._named(self._between(form, factor, "", "", pair))]
            yield min(every, key=lambda late: late.cost)

    def _named(self, late: Late) -> Iterator[Late]:
        """The form by the name that it has in this study; none where the study says that already."""
        if late.form != "hold" or late.time <= 0:
            yield late
        elif self.held:
            yield replace(late, form=self.held)

    @property
    def _edge_hz(self) -> float:
        return max(float(e.part.kernel.freq_hz.max()) for e in self.evaluated)

    def late_by(self, factor: Factor, role: str, place: str, T: float) -> Prediction:
        """The prediction with one form of lateness."""
        reading = Reading("", "time", partial(_late, factor, T, role, place))
        return predict(reading, self.evaluated, self.prior, self.free)

    def _between(self, form: str, factor: Factor, role: str, place: str, ends: tuple[float, float]) -> Late:
        from scipy.optimize import minimize_scalar  # slow to load, for the few fits that are beyond the noise

        at_time = partial(self.late_by, factor, role, place)
        limit = LIMITS.edge_phase / self._edge_hz
        low, high = (float(np.clip(T, -limit, limit)) for T in sorted(ends))
        options = {"maxiter": LIMITS.evaluations, "xatol": 1e-4 * max(abs(low), abs(high))}
        T = float(minimize_scalar(lambda T: at_time(T).cost, bounds=(low, high), method="bounded", options=options).x)
        return Late(form, role, place, T, at_time(T))


def _late(factor: Factor, T: float, role: str, place: str, evaluated: Evaluated, values: ComplexArray) -> ComplexArray:
    model = evaluated.part.kernel.model
    H = factor(evaluated.part.kernel.freq_hz, T)[:, None, None]
    if not role or (role == OF_POSTURE and evaluated.part.configuration == place):
        return np.asarray(H * values)
    if role == OF_POSTURE:
        return values
    named = np.array([name == place for name in (model.outputs if role == "y" else model.inputs)])
    return np.asarray(np.where(named[:, None] if role == "y" else named, H, 1.0) * values)


def find_lateness(indices: list[ModificationIndex], evidence: Evidence, scores: Scores) -> list[ModificationIndex]:
    """The indices with forms of lateness where a delay explains a part; a hold or a low pass of all in any case."""
    if not evidence.is_unexplained:
        return indices
    optimum, result = evidence.optimum, evidence.result
    fit, x = thinned(optimum.fit), optimum.end.x
    # Far out ln p has no slope that leads back: what the data barely constrain is at its start, too.
    weak = ~(np.sqrt(np.diag(result.covariance)) < LIMITS.std) & np.array([p.log for p in fit.parameters.free])
    points = (x, np.where(weak, fit.parameters.x, x)) if weak.any() else (x,)
    prior, held = optimum.fit.prior_slopes, _name_of_hold(fit)
    searches = [LatenessSearch(p, evaluate(fit, p), prior, ~result.at_bound, held) for p in points]
    if not searches[0].evaluated:
        return indices
    cost = predict(AS_READ, searches[0].evaluated, searches[0].prior, searches[0].free).cost
    lines = fit.n_residuals / max(optimum.fit.n_residuals, 1)
    noise = scores.noise * lines
    excess = max(cost - noise, 1e-300)

    def index(
        late: Late, linear: ModificationIndex | None, equal: list[Late], search: LatenessSearch
    ) -> ModificationIndex:
        """linear: the delay that it is to first order.  equal: all forms that cannot be distinguished."""
        share = (cost - late.cost) / excess
        return ModificationIndex(
            name=late.name,
            group="time" if linear is None else linear.group,
            members=(late.name,),
            values=linear.values if linear is not None and late.name == linear.name else np.zeros(1),
            units=("s",),
            log=(False,),
            steps=np.array([late.time]),
            std=math.nan if linear is None else linear.std,
            drop=share * scores.excess / scores.lines,
            share=share,
            effects=search.x - x + late.prediction.step,
            alike=tuple(other.name for other in equal if other is not late) + (linear.alike if linear else ()),
        )

    def equally_good(forms: Iterable[Late]) -> list[Late]:
        """The best form and those that cannot be distinguished from it."""
        best = sorted(forms, key=lambda late: late.cost)
        tolerance = LIMITS.form_drop * scores.level + LIMITS.form_share * max(best[0].cost - noise, 0.0)
        return [late for late in best if late.cost < best[0].cost + tolerance]

    is_free = "delay" in result.parameters.free_names
    delays = [linear for linear in indices if linear.name.startswith("delay") and linear.share > LIMITS.share]
    delays = [linear for linear in delays if linear.share > LIMITS.part_of_best * delays[0].share][: LIMITS.followed]
    extended = list(indices)
    for linear in delays:
        where, T = _channel(linear.name, fit), float(linear.steps[0])
        search = min(searches, key=lambda search: search.late_by(delay, *where, T).cost)
        equal = equally_good(search.best_forms(*where, T))
        place = extended.index(linear)
        extended[place : place + 1] = [index(late, linear, equal, search) for late in equal]
    if not any(linear.name == "delay" for linear in delays):
        filters = ((search, equally_good(search.best_filters(is_free))) for search in searches)
        search, equal = min(filters, key=lambda trial: trial[1][0].cost)
        drop, explained = cost - equal[0].cost, max((linear.drop * lines for linear in delays), default=0.0)
        if drop > max(scores.significant[1], LIMITS.share * (cost - noise), explained):
            extended += [index(late, None, equal, search) for late in equal]
    return extended


def _name_of_hold(fit: ElasticFit) -> str:
    """`hold` where no torque is said to be held, `difference` where motions may be, none of angles sampled with it."""
    holds = [part.kernel.model.hold for part in fit.parts]
    if any(stated is None for stated in holds):
        return "hold"
    return "" if all(stated is not None and all(stated.sampled) for stated in holds) else "difference"


def _channel(name: str, fit: ElasticFit) -> tuple[str, str]:
    """Role and place of delay_y_motor_2, none of delay."""
    if "@" in name:
        return OF_POSTURE, name.partition("@")[2]
    models = [part.kernel.model for part in fit.parts]
    channels = [
        (role, place) for m in models for role, of_role in (("y", m.outputs), ("u", m.inputs)) for place in of_role
    ]
    return next((channel for channel in channels if late_name("delay", *channel) == name), ("", ""))
