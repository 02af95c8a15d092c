r"""Missing springs: rigid coordinates of the robot model, each fitted with a resonance within the band.

.. math:: k_i = m_c\, (2 \pi f_i)^2, \qquad d_i = k_i \operatorname{median} \frac{d}{k}, \qquad f_{i+1} = \sqrt 2 f_i

m_c: inertia of coordinate c with all others fixed.  d / k: ratio of damping to stiffness of the robot's springs.  The
linear step of `score_test` is valid only for nearly rigid springs, not for a resonance within the band.  The solver
continues from the best f_i if V after one step is below `LIMITS.predicted_ratio` times V without the spring.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, values_by_name
from elastid.base.errors import FitError
from elastid.fit.diagnosis.extended_model import ExtendedModel
from elastid.fit.diagnosis.hypothesis import Evidence, Scores, with_refit
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.refit import UNCHANGED, evaluate, evenly_spaced, frf_costs, gauss_newton_step, on_line_subset
from elastid.fit.frf_problem import Assembly
from elastid.fit.problem.frf_residuals import ElasticFit, kernel_of, linear_model
from elastid.fit.problem.inertia_barrier import free_inertias
from elastid.fit.result_rows import ModificationIndex
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.derivatives import Columns
from elastid.parameters import Parameter, Parameters, Tie
from elastid.response import Response


def find_missing_springs(
    indices: list[ModificationIndex], evidence: Evidence, scores: Scores
) -> list[ModificationIndex]:
    """Return the indices with missing springs instead of their linear steps, if no cause explains V."""
    fraction = max((index.explained_fraction for index in indices), default=0.0)
    if evidence.result.exceeds_noise and fraction > LIMITS.certain_fraction:
        return indices
    candidates = sorted(_promising(evidence, scores), key=lambda spring: spring.predicted)[: LIMITS.n_refits]
    springs = [index for index in (_fit_spring(spring, evidence, scores) for spring in candidates) if index is not None]
    springs = sorted((i for i in springs if i.drop > scores.significant[1]), key=lambda index: index.drop)
    by_name = {index.name: index for index in springs}
    return [*(index for index in indices if index.name not in by_name), *by_name.values()]


@dataclass(frozen=True, eq=False)
class _Spring:
    """Coordinate that becomes elastic: name of the stiffness k, k, d / k in s, x (n_x + 1,), and V after one step."""

    name: str
    stiffness: float
    damping_ratio: float
    x: FloatArray
    predicted: float


def _promising(evidence: Evidence, scores: Scores) -> Iterator[_Spring]:
    assembly, optimum, extended = evidence.assembly, evidence.optimum, scores.extended
    selection, x = evenly_spaced(len(optimum.fit.frfs)), optimum.x
    models = _models(evidence, extended, assembly.responses[selection])
    springs = [joint.spring for joint in assembly.robot.joints if joint.spring is not None]
    time_constants = [spring.damping / spring.stiffness for spring in springs if spring.damping > 0]
    subset = on_line_subset(replace(optimum.fit, frfs=optimum.fit.frfs[selection]), LIMITS.n_refit_residuals)
    ratio = float(np.median(time_constants)) if time_constants else 1e-3
    V, estimates = sum(frf_costs(evaluate(subset, x))), values_by_name(assembly.parameters.free_names, x)
    for name in extended.rigid:
        trials = []
        for k in _stiffnesses(name, models, subset).tolist():
            sprung = _with_spring(subset, name, k, ratio, models, assembly)
            start = sprung.parameters.x_with(estimates)
            cost, step = gauss_newton_step(UNCHANGED, evaluate(sprung, start), sprung.parameters.prior_slopes)
            trials.append(_Spring(name, k, ratio, np.clip(start + step, *sprung.parameters.x_bounds), cost))
        least = _minima(np.array([spring.predicted for spring in trials]), LIMITS.cost_margin * scores.variance_ratio)
        yield from (trials[i] for i in np.flatnonzero(least) if trials[i].predicted < LIMITS.predicted_ratio * V)


def _models(evidence: Evidence, extended: ExtendedModel, responses: Sequence[Response]) -> list[LinearModel]:
    x, parameters, models = evidence.optimum.x, evidence.assembly.parameters, []
    names = {*parameters.names, *extended.rigid, *(f"d{name[1:]}" for name in extended.rigid)}
    for response in responses:
        theta = extended.theta(parameters, x, response.configuration.name)
        models.append(linear_model(extended.linearisation, response, theta, names))
    return models


def _minima(costs: FloatArray, depth: float) -> BoolArray:
    """Flag local minima of V (n_k,) over increasing stiffness, `depth` below the largest V of stiffer springs."""
    stiffer = np.maximum.accumulate(costs[::-1])[::-1]
    lower = costs <= np.concatenate([[math.inf], costs[:-1]])
    return lower & (costs <= np.append(costs[1:], -math.inf)) & (costs < stiffer - depth)


def _stiffnesses(name: str, models: Sequence[LinearModel], fit: ElasticFit) -> FloatArray:
    """Return the trial stiffnesses k_i (n_k,); the last resonance is one step above the band."""
    index = int(np.argmax(np.diag(np.asarray(models[0].slopes[name].K))))  # of its coordinate
    inertia = float(np.mean([model.M[index, index] for model in models]))
    freq_hz = np.concatenate([frf.kernel.freq_hz for frf in fit.frfs])
    low, high = float(freq_hz[freq_hz > 0].min()), float(freq_hz.max())
    count = min(LIMITS.n_stiffnesses, 2 + math.ceil(math.log(high / low) / math.log(LIMITS.frequency_step)))
    return np.asarray(inertia * (2 * np.pi * (high * LIMITS.frequency_step ** np.arange(2 - count, 2))) ** 2)


def _with_spring(
    fit: ElasticFit, name: str, k: float, damping_ratio: float, models: Sequence[LinearModel], assembly: Assembly
) -> ElasticFit:
    """Return the fit with an elastic coordinate: its stiffness is free, other new parameters are fixed."""
    fitted, damping = {p.name: p for p in assembly.parameters}, f"d{name[1:]}"
    values = values_by_name(models[0].parameters, models[0].theta_ref)
    of_model = {key: Parameter(key, value, free=False) for key, value in values.items()}
    of_model |= {key: fitted[key] for key in values if key in fitted}
    of_model[name] = Parameter(name, k, "N*m/rad", log=True)
    of_model[damping] = Parameter(damping, 0.0, tie=Tie(name, damping_ratio))
    parameters = Parameters((*of_model.values(), *(p for p in assembly.parameters if not p.is_of_model)))
    kernels = (kernel_of(m, parameters, p.kernel.freq_hz) for p, m in zip(fit.frfs, models, strict=True))
    frfs = tuple(replace(frf, columns=Columns(kernel)) for frf, kernel in zip(fit.frfs, kernels, strict=True))
    return ElasticFit(parameters, frfs, free_inertias(parameters, assembly.robot))


def _fit_spring(spring: _Spring, evidence: Evidence, scores: Scores) -> ModificationIndex | None:
    assembly, optimum, result = evidence.assembly, evidence.optimum, evidence.result
    models = _models(evidence, scores.extended, assembly.responses)
    fit = _with_spring(optimum.fit, spring.name, spring.stiffness, spring.damping_ratio, models, assembly)
    try:
        end = solve(fit.problem, spring.x, ROUGH, LIMITS.iterations)
    except FitError:
        return None
    drop = min(replace(optimum.fit, loads=None).evaluate(optimum.x).cost, scores.cost) - end.cost
    if not drop > 0:
        return None
    estimates = values_by_name(fit.parameters.free_names, end.x)
    k = math.exp(estimates[spring.name])
    i = fit.parameters.free_names.index(spring.name)
    variance = np.linalg.pinv(fit.evaluate(end.x).hessian / 2, hermitian=True)[i, i]
    name = scores.extended.rigid[spring.name]
    std, x = (
        math.sqrt(max(float(variance) * scores.variance_ratio, 0.0)) / k,
        [estimates[p.name] for p in result.parameters.free],
    )
    number = (name,), np.zeros(1), ("rad/(N*m)",), (False,), np.array([1 / k])
    index = ModificationIndex(name, "compliance", *number, std)
    return with_refit(index, scores.cost - drop, np.array(x), evidence, scores)
