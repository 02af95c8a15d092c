"""Refits of a changed model: V and x after one Gauss-Newton step, or at an optimum of a few steps.

A hypothesis on channels changes the modelled responses; data and weights stay the same. One evaluation of the model is
enough to compute V of all hypotheses after one Gauss-Newton step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.execution import SERIAL
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.problem.frf_residuals import ElasticFit, FrfResiduals
from elastid.fit.problem.least_squares import Evaluation, LeastSquares, as_real
from elastid.fit.solve.solvers import ROUGH, trust_region
from elastid.linear.response.derivatives import Columns
from elastid.parameters import Parameters


@dataclass(frozen=True, eq=False)
class EvaluatedResponse:
    """Modelled response G (F, n_y, n_u) of one configuration at x, with derivatives to free and fixed parameters.

    free (n_x, F, n_y, n_u): to x.  fixed: to fixed numbers by name, of p.  mixing: `FrfResiduals.mixing`.
    """

    frf: FrfResiduals
    mixing: ComplexArray | None
    G: ComplexArray
    free: ComplexArray
    fixed: dict[str, ComplexArray] = field(default_factory=dict)

    def whitened(self, slopes: ComplexArray) -> FloatArray:
        """Return -dr (n, N) of changes of G (n, F, n_y, n_u), N real residuals; 0 for excluded elements."""
        return as_real(-self.frf.slopes(self.G, slopes, self.mixing).reshape(len(slopes), -1))

    @property
    def residual(self) -> FloatArray:
        """Whitened residuals r (N,), 0 for excluded elements."""
        return as_real(self.frf.residual(self.G, self.mixing).ravel())


Change: TypeAlias = Callable[[EvaluatedResponse, ComplexArray], ComplexArray]  # of arrays (..., F, n_y, n_u)

STEP_STD = 0.5  # prior std of ln p that limits a step, and the distance of a stiffness from its start


@dataclass(frozen=True, eq=False)
class ResponseChange:
    """Change of the modelled responses by one hypothesis: name in words, family, and the function that applies it.

    order: index of the configuration whose model each measured response belongs to, if postures are exchanged.
    """

    name: str
    family: str
    apply: Change
    order: tuple[int, ...] = ()


UNCHANGED = ResponseChange("as read", "", lambda _, values: values)

CONFIGURATIONS = 32  # largest number of configurations in a score test


def evenly_spaced(count: int) -> slice:
    """Return the slice that selects at most CONFIGURATIONS of `count`, evenly spread."""
    return slice(None, None, max(1, math.ceil(count / CONFIGURATIONS)))


def on_line_subset(fit: ElasticFit, residuals: int = 8_000) -> ElasticFit:
    """Return the fit on a subset of lines of each configuration, with about `residuals` real residuals in total.

    Without static load tests, which do not depend on the channels of the responses.
    """
    return replace(fit, frfs=tuple(map(line_subset(fit, residuals), fit.frfs)), loads=None, home=SERIAL)


def line_subset(fit: ElasticFit, residuals: int) -> Callable[[FrfResiduals], FrfResiduals]:
    """Return a function that selects a subset of the lines of a configuration, about `residuals` residuals in total.

    At least 20 lines per configuration, 5 if there are very many: V of a single configuration is tested as well.
    """
    step, min_lines = max(1, math.ceil(fit.n_residuals / residuals)), max(5, min(20, 1280 // max(1, len(fit.frfs))))
    return partial(_on_lines, step, min_lines)


def _on_lines(step: int, min_lines: int, frf: FrfResiduals) -> FrfResiduals:
    lines = slice(None, None, min(step, max(1, len(frf.measured) // min_lines)))
    kernel = replace(frf.kernel, freq_hz=frf.kernel.freq_hz[lines])
    whitening = frf.whitening and frf.whitening.lines(lines)
    return replace(
        frf, columns=Columns(kernel), measured=frf.measured[lines], gain=frf.gain[lines], whitening=whitening
    )


def evaluate(fit: ElasticFit, x: FloatArray) -> list[EvaluatedResponse]:
    """Return every configuration at x (n_x,), with derivatives to the free parameters alone."""
    evaluated = []
    for frf in (frf for frf in fit.frfs if frf.n_residuals):
        G, slopes = frf.columns.evaluate(frf.theta(fit.parameters, x))
        free = np.tensordot(frf.chain(fit.parameters, x).T, slopes, axes=1)
        evaluated.append(EvaluatedResponse(frf, frf.mixing, G, free))
    return evaluated


def start_distance(parameters: Parameters, x: FloatArray) -> float:
    """Return -2 ln of the Cauchy prior density of the stiffnesses at x (n_x,) about their start values."""
    stiffnesses = (
        i for i, p in enumerate(parameters.free) if not p.is_nuisance and p.log and p.stands_for.startswith("k_")
    )
    return sum(2 * math.log1p(((x[i] - parameters.x[i]) / STEP_STD) ** 2) for i in stiffnesses)


def frf_costs(evaluated: Sequence[EvaluatedResponse]) -> list[float]:
    """Return V of each configuration."""
    return [float(e.residual @ e.residual) for e in evaluated]


def gauss_newton_step(
    change: ResponseChange, evaluated: Sequence[EvaluatedResponse], prior: FloatArray, free: BoolArray | bool = True
) -> tuple[float, FloatArray]:
    """Return V after one Gauss-Newton step of the free parameters, and the step (n_x,); prior (n_x,): 1 / std."""
    V, b, A = _normal_equations(change, evaluated, prior, free)
    near = V / max(sum(e.frf.n_residuals for e in evaluated), 1) / STEP_STD**2
    step = np.asarray(-np.linalg.solve(A + max(near, 1e-300) * np.eye(len(b)), b), dtype=float)
    return V + float(step @ (2 * b + A @ step)), step


def _normal_equations(
    change: ResponseChange, evaluated: Sequence[EvaluatedResponse], prior: FloatArray, free: BoolArray | bool
) -> tuple[float, FloatArray, FloatArray]:
    """Return V, J^T r (n_x,) and J^T J (n_x, n_x) of a changed model, with priors centred on the present x."""
    V, b, A = 0.0, np.zeros(len(prior)), np.diag(prior**2)
    for i, measured in enumerate(evaluated):
        model = evaluated[change.order[i]] if change.order else measured
        hypothesis = replace(measured, G=change.apply(measured, model.G))
        r, J = hypothesis.residual, -hypothesis.whitened(change.apply(measured, model.free)) * np.reshape(free, (-1, 1))
        V, b, A = V + float(r @ r), b + J @ r, A + J @ J.T
    return V, b, A


def refit(
    change: ResponseChange, fit: ElasticFit, x: FloatArray, free: BoolArray | bool = True
) -> tuple[float, FloatArray]:
    """Return V and x (n_x,) of the optimum that a short search reaches from x, first with the logarithmic criterion."""
    _, near = search(change, logarithmic(fit), x, free)
    return search(change, fit, near, free)


def search(
    change: ResponseChange, fit: ElasticFit, x: FloatArray, free: BoolArray | bool = True,
    iterations: int = LIMITS.iterations,
) -> tuple[float, FloatArray]:  # fmt: skip
    """Return V and x (n_x,) of the optimum that a search of a few iterations reaches from x."""

    def at(x: FloatArray) -> Evaluation:
        V, b, A = _normal_equations(change, evaluate(fit, x), fit.parameters.prior_slopes, free)
        return Evaluation(V, 2 * b, 2 * A)

    fixed, problem = np.logical_not(np.broadcast_to(free, len(x))), LeastSquares(fit.parameters, fit.n_residuals, at)
    end = trust_region(problem, x, at(x), ROUGH, iterations, fixed)
    return end.evaluation.cost, end.x


def logarithmic(fit: ElasticFit) -> ElasticFit:
    """Return the fit with the logarithmic criterion, element by element, and weights of at most 10."""

    def frf_residuals(frf: FrfResiduals) -> FrfResiduals:
        return replace(frf, criterion="log", gain=np.minimum(frf.gain * np.abs(frf.measured), 10.0), whitening=None)

    return replace(fit, frfs=tuple(map(frf_residuals, fit.frfs)))
