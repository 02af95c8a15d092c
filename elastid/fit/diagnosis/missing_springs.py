r"""Missing springs: coordinates that the robot's file has as rigid, each tried with a resonance within the band.

.. math:: k_i = m_c\, (2 \pi f_i)^2, \qquad d_i = k_i \operatorname{median} \frac{d}{k}, \qquad f_{i+1} = \sqrt 2 f_i

m_c: the inertia that moves with coordinate c while all others stand still; d / k: of the robot's springs.  The linear
step of `score_test` knows only springs that are nearly rigid: a resonance within the band is no small change.  A stiff
spring stands in for each rigid coordinate and is made softer without a further solution:

.. math:: Z_k = Z + \delta\, y y^T, \quad \delta = k (1 + j \omega \eta) - k_s, \quad h = y^T Z^{-1} y, \qquad
          G_k = G - c\, \frac{\delta}{1 + \delta h}\, (C Z^{-1} y)(y^T Z^{-1} B)

(Sherman and Morrison 1950), and with the derivatives J of the residuals r at the optimum V after a step of the
parameters is

.. math:: V_k \approx r^T r - r^T \bar J (\bar J^T \bar J + \text{priors})^{-1} \bar J^T r, \qquad
          \bar J = [J, \partial r / \partial \ln k], \quad r = r(G_k)

J is that without the spring, so V_k shows where it has a minimum rather than how deep that is.  Where it has one, and a
step of the fit with such a spring leads about as low as V of the fit without it, the solver follows with k free.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import FitError
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import LIMITS, Evidence, Scores, against
from elastid.fit.diagnosis.sensitivities import (
    AS_READ,
    Evaluated,
    HeldModel,
    evaluate,
    predict,
    spread_out,
    squares,
    thinned,
)
from elastid.fit.problem.elastic import ElasticFit, kernel_of, linear_model
from elastid.fit.problem.inertia_barrier import moved_inertias
from elastid.fit.result import ModificationIndex
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.linear.linear_model import LinearModel
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.transfer import factor
from elastid.parameters import Parameter, Parameters, Tie
from elastid.response import Response


def find_missing_springs(
    indices: list[ModificationIndex], evidence: Evidence, scores: Scores
) -> list[ModificationIndex]:
    """The indices with springs that the robot lacks, each replacing its linear step, where nothing explains V."""
    explained = max((index.explained_fraction for index in indices), default=0.0)
    if evidence.result.exceeds_noise and explained > LIMITS.certain_share:
        return indices
    candidates = sorted(_promising(evidence, scores), key=lambda spring: -spring.predicted)
    best = {spring.name: spring for spring in candidates}
    followed = sorted(best.values(), key=lambda spring: spring.predicted)[: LIMITS.followed]
    springs = (_followed(spring, evidence, scores) for spring in followed)
    by_name = {index.name: index for index in springs if index is not None and index.drop > scores.significant[1]}
    return [*(index for index in indices if index.name not in by_name), *by_name.values()]


@dataclass(frozen=True, eq=False)
class _Spring:
    """A coordinate that becomes elastic: name of its stiffness k, d / k in s, x (n_x + 1,), and V after a step."""

    name: str
    stiffness: float
    damping_ratio: float
    x: FloatArray
    predicted: float


def _promising(evidence: Evidence, scores: Scores) -> Iterator[_Spring]:
    assembly, optimum, held = evidence.assembly, evidence.optimum, scores.held
    every, x = spread_out(len(optimum.fit.parts)), optimum.end.x
    part_of_fit = replace(optimum.fit, parts=optimum.fit.parts[every])
    fit, models = thinned(part_of_fit), _models(evidence, held, assembly.responses[every])
    springs = [joint.spring for joint in assembly.linearisation.model.robot.joints if joint.spring is not None]
    damped = [spring.damping / spring.stiffness for spring in springs if spring.damping > 0]
    evaluated, ratio = evaluate(fit, x), float(np.median(damped)) if damped else 1e-3
    used = [model for part, model in zip(fit.parts, models, strict=True) if part.n_residuals]
    V = sum(squares(evaluated))
    for name in held.rigid:
        stiffnesses = _stiffnesses(name, used, fit)
        costs = released_costs(evaluated, used, name, stiffnesses, ratio, fit.prior_slopes)
        for k in stiffnesses[_minima(costs, LIMITS.variances * scores.level) & (costs < LIMITS.screened_ratio * V)]:
            sprung = _with_spring(part_of_fit, name, float(k), ratio, models, assembly)
            known = dict(zip(assembly.parameters.free_names, x.tolist(), strict=True))
            start = np.array([known.get(p.name, p.to_x(p.value)) for p in sprung.parameters.free])
            thin, every_one = thinned(sprung), np.ones(len(start), dtype=bool)
            cost, step = predict(AS_READ, evaluate(thin, start), thin.prior_slopes, every_one)
            if cost < LIMITS.predicted_ratio * V:
                end = np.clip(start + step, *sprung.parameters.x_bounds)
                yield _Spring(name, float(k), ratio, end, cost)


def _models(evidence: Evidence, held: HeldModel, responses: Sequence[Response]) -> list[LinearModel]:
    x, fitted = evidence.optimum.end.x, evidence.assembly.parameters
    count, rigid = len(held.linearisation.model.parameters) + 1, held.rigid
    kept = {*fitted.names, *rigid, *(f"d{name[1:]}" for name in rigid)}
    models = []
    for response in responses:
        theta = held.theta(fitted, x, response.configuration.name)[:count]
        model = linear_model(held.linearisation, response, theta)
        slopes = {name: slope for name, slope in model.slopes.items() if name in kept}
        models.append(replace(model, theta_ref=theta, slopes=slopes))
    return models


def _minima(costs: FloatArray, depth: float) -> BoolArray:
    """Flags where V (n_k,) by growing stiffness is below its neighbours and, by so much, a stiffer spring's."""
    stiffer = np.maximum.accumulate(costs[::-1])[::-1]
    lower = costs <= np.concatenate([[math.inf], costs[:-1]])
    return lower & (costs <= np.append(costs[1:], -math.inf)) & (costs < stiffer - depth)


def _stiffnesses(name: str, models: Sequence[LinearModel], fit: ElasticFit) -> FloatArray:
    """k_i (n_k,), the last a step above the band."""
    directions = [direction(model, name) for model in models]
    inertia = np.mean([y @ model.M @ y / (y @ y) ** 2 for model, y in zip(models, directions, strict=True)])
    freq_hz = np.concatenate([part.kernel.freq_hz for part in fit.parts])
    low, high = float(freq_hz[freq_hz > 0].min()), float(freq_hz.max())
    count = min(LIMITS.stiffnesses, 2 + math.ceil(math.log(high / low) / math.log(LIMITS.frequency_step)))
    f = high * LIMITS.frequency_step ** np.arange(2 - count, 2)
    return inertia * (2 * np.pi * f) ** 2


def _with_spring(
    fit: ElasticFit, name: str, k: float, damping_ratio: float, models: Sequence[LinearModel], assembly: Assembly
) -> ElasticFit:
    """The fit with a coordinate elastic: its stiffness is a further free parameter, all other new ones are held."""
    fitted, damping = {p.name: p for p in assembly.parameters}, f"d{name[1:]}"
    known = dict(zip(models[0].parameters, models[0].theta_ref.tolist(), strict=True))
    of_model = {key: Parameter(key, value, free=False) for key, value in known.items()}
    of_model |= {key: fitted[key] for key in known if key in fitted}
    of_model[name] = Parameter(name, k, "N*m/rad", log=True)
    of_model[damping] = Parameter(damping, 0.0, tie=Tie(name, damping_ratio))
    parameters = Parameters((*of_model.values(), *(p for p in assembly.parameters if not p.is_of_model)))
    kernels = (kernel_of(m, parameters, p.kernel.freq_hz) for p, m in zip(fit.parts, models, strict=True))
    parts = tuple(replace(part, columns=Columns(kernel)) for part, kernel in zip(fit.parts, kernels, strict=True))
    return ElasticFit(parameters, parts, moved_inertias(parameters, assembly.linearisation.model.robot))


def _followed(spring: _Spring, evidence: Evidence, scores: Scores) -> ModificationIndex | None:
    assembly, optimum, result = evidence.assembly, evidence.optimum, evidence.result
    models = _models(evidence, scores.held, assembly.responses)
    fit = _with_spring(optimum.fit, spring.name, spring.stiffness, spring.damping_ratio, models, assembly)
    try:
        end = solve(fit.problem, spring.x, ROUGH, LIMITS.iterations)
    except FitError:
        return None
    before = replace(optimum.fit, loads=None).evaluate(optimum.end.x).cost
    drop = min(before, scores.cost) - end.cost
    if not drop > 0:
        return None
    estimates = dict(zip(fit.parameters.free_names, end.x.tolist(), strict=True))
    k = math.exp(estimates[spring.name])
    place = fit.parameters.free_names.index(spring.name)
    variance = np.linalg.pinv(fit.evaluate(end.x).hessian / 2, hermitian=True)[place, place]
    name = scores.held.rigid[spring.name]
    std, x = (
        math.sqrt(max(float(variance) * scores.level, 0.0)) / k,
        [estimates[p.name] for p in result.parameters.free],
    )
    number = (name,), np.zeros(1), ("rad/(N*m)",), (False,), np.array([1 / k])
    index = ModificationIndex(name, "compliance", *number, std)
    return against(index, scores.cost - drop, np.array(x), evidence, scores)


def released_costs(
    evaluated: Sequence[Evaluated],
    models: Sequence[LinearModel],
    name: str,
    stiffnesses: FloatArray,
    damping_ratio: float,
    prior: FloatArray,
) -> FloatArray:
    """V_k (n_k,) of a stiff spring, `name` its parameter, at some stiffnesses.

    evaluated: all configurations at the optimum; models: the same with the stiff spring.  damping_ratio: d / k in s.
    prior (n_x,): 1 / s of the priors.
    """
    n_x = len(prior)
    A = np.zeros((len(stiffnesses), n_x + 1, n_x + 1))
    A[:, range(n_x), range(n_x)] += prior**2
    b, V = np.zeros((len(stiffnesses), n_x + 1)), np.zeros(len(stiffnesses))
    for rigid, model in zip(evaluated, models, strict=True):
        for i, (dG, slope) in enumerate(released(model, rigid.part.kernel.freq_hz, name, stiffnesses, damping_ratio)):
            soft = replace(rigid, G=rigid.G + dG)
            fitted = rigid if rigid.part.criterion == "complex" else soft  # slopes of a difference are those of any G
            r, J, j = soft.residual, fitted.rows, -soft.whitened(slope[None])[0]
            A[i, :n_x, :n_x] += fitted.information
            A[i, :n_x, n_x] += J @ j
            A[i, n_x, n_x] += j @ j
            b[i] += np.append(J @ r, j @ r)
            V[i] += float(r @ r)
    A[:, n_x, :n_x] = A[:, :n_x, n_x]
    size = np.sqrt(np.maximum(np.einsum("kii->ki", A), 1e-300))
    scaled = A / (size[:, :, None] * size[:, None, :]) + 1e-12 * np.eye(n_x + 1)  # regular
    steps = np.linalg.solve(scaled, (b / size)[:, :, None])[:, :, 0]
    return np.asarray(V - np.sum(steps * b / size, axis=1))


def released(
    model: LinearModel, freq_hz: FloatArray, name: str, stiffnesses: FloatArray, damping_ratio: float
) -> Iterator[tuple[ComplexArray, ComplexArray]]:
    """G_k - G and its derivative to ln k (F, n_y, n_u) at each stiffness."""
    theta, s = model.theta_ref, np.asarray(2j * np.pi * freq_hz, np.complex128)
    (M, D, K), (C, T) = model.matrices(theta), model.readout(theta)
    y = direction(model, name)
    of_outputs, of_inputs = model.channel_factors(theta, s)
    gain = factor(model, theta, s)[:, None, None] * of_outputs[..., :, None] * of_inputs[..., None, :]
    Z = K + s[:, None, None] * D + s[:, None, None] ** 2 * M
    reached = np.linalg.solve(Z, y[:, None])[:, :, 0]  # Z^-1 y (F, n)
    across = (reached @ C.T + reached @ T.T / s[:, None] ** 2)[:, :, None] * (reached @ model.B)[:, None, :]
    h, stiff = reached @ y, model.number(theta, name)
    for k in stiffnesses:
        softer = k * (1 + s * damping_ratio)
        delta = softer - stiff
        taken = 1 / (1 + delta * h)
        change, slope = ((w[:, None, None] * across) for w in (delta * taken, softer * taken**2))
        yield -gain * change, -gain * slope


def direction(model: LinearModel, name: str) -> FloatArray:
    """y (n,) of the coordinate that a spring acts on: its dK / dk is y y^T."""
    K = model.slopes[name].K
    if K is None:
        raise ValueError(f"{name} does not enter the model of {model.configuration.name}")
    i = int(np.argmax(np.diag(K)))
    return np.asarray(K[:, i] / np.sqrt(K[i, i]))
