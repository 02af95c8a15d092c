r"""Springs that a robot's file lacks: coordinates that it has as rigid, each tried with a resonance within the band.

.. math:: k_i = m_c\, (2 \pi f_i)^2, \qquad d_i = k_i \operatorname{median} \frac{d}{k}, \qquad f_{i+1} = \sqrt 2 f_i

m_c: the inertia that moves with coordinate c while all others stand still; d / k: of the robot's springs.  The linear
step of `score_test` knows only springs that are nearly rigid: a resonance within the band is no small change.  Where
V has a minimum over the k_i (`spring_release`), and a step of the fit with such a spring leads about as low as V of the
fit without it, the solver follows with k free.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import FitError
from elastid.fit.diagnosis.modification.held_numbers import HeldNumbers
from elastid.fit.diagnosis.modification.reading import STEP_STD, evaluated_at, thinned
from elastid.fit.diagnosis.modification.spring_release import direction, released_costs
from elastid.fit.modification_index import ModificationIndex
from elastid.fit.problem.elastic import ElasticFit, kernel_of, linear_model
from elastid.fit.problem.inertia_barrier import moved_inertias
from elastid.fit.result import FitResult
from elastid.fit.setup.assembly import Assembly, RelinearisedOptimum
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.linear.linear_model import LinearModel
from elastid.parameters import Parameter, ParameterSet, Tie

# Steps of a frequency, and so many of them at most.
FREQUENCY_STEP = math.sqrt(2.0)
MAX_STIFFNESSES = 14
# d / k in s where the robot's springs have no damping.
DEFAULT_DAMPING_RATIO = 1e-3
# A minimum of V is so deep, in variances of the noise, and V there at most so many times that of the fit, with the
# derivatives of the fit and with those at the spring. So many springs are followed, for so many evaluations each.
MIN_DIP = 10.0
MAX_SCREENED_RATIO, MAX_PREDICTED_RATIO = 4.0, 1.2
MAX_FOLLOWED = 2
MAX_ITERATIONS = 12


@dataclass(frozen=True, eq=False)
class _Spring:
    """A coordinate that becomes elastic: name of its stiffness, the fit with it, x (n_x + 1,), and V after a step."""

    name: str
    fit: ElasticFit
    x: FloatArray
    predicted: float


def missing_springs(
    held: HeldNumbers,
    assembly: Assembly,
    optimum: RelinearisedOptimum,
    result: FitResult,
    noise_cost: float,
    level: float,
) -> tuple[ModificationIndex, ...]:
    """The springs that lower V from those stiffnesses on, with the step of the fit beside them.

    level: of the residuals' variance by the noise.
    """
    models = _models(held, assembly, optimum.end.x)
    tried = sorted(_promising(held.rigid, models, assembly, optimum, level), key=lambda one: -one.predicted)
    best = {one.name: one for one in tried}
    followed = sorted(best.values(), key=lambda one: one.predicted)[:MAX_FOLLOWED]
    found = (_index(one, held.rigid[one.name], optimum, result, noise_cost, level) for one in followed)
    return tuple(one for one in found if one is not None)


def _models(held: HeldNumbers, assembly: Assembly, x: FloatArray) -> list[LinearModel]:
    """Of each configuration where x (n_x,) is the estimate, the rigid coordinates with stiff springs."""
    count = len(held.linearisation.model.parameters) + 1
    thetas = [held.theta(assembly.parameters, x, one.configuration.name)[:count] for one in assembly.responses]
    linear = (linear_model(held.linearisation, *one) for one in zip(assembly.responses, thetas, strict=True))
    return [replace(model, theta_ref=theta) for model, theta in zip(linear, thetas, strict=True)]


def _promising(
    names: Iterable[str], models: Sequence[LinearModel], assembly: Assembly, optimum: RelinearisedOptimum, level: float
) -> Iterator[_Spring]:
    """The springs at the stiffnesses about which V has a minimum."""
    fit, x = thinned(optimum.fit), optimum.end.x
    there, ratio = evaluated_at(fit, x), _damping_ratio(assembly)
    used = [model for part, model in zip(fit.parts, models, strict=True) if part.n_residuals]
    here = sum(float(one.residual @ one.residual) for one in there)
    for name in names:
        stiffnesses = _stiffnesses(name, used, fit)
        costs = released_costs(there, used, name, stiffnesses, ratio, fit.prior_slopes)
        for k in stiffnesses[_minima(costs, MIN_DIP * level) & (costs < MAX_SCREENED_RATIO * here)]:
            sprung = _with_spring(
                optimum.fit, _parameters(name, float(k), ratio, models[0], assembly), models, assembly
            )
            start = _beside(x, assembly.parameters, sprung.parameters)
            step, predicted = _damped_step(thinned(sprung), start)
            if predicted < MAX_PREDICTED_RATIO * here:
                yield _Spring(name, sprung, np.clip(start + step, *sprung.parameters.x_bounds), predicted)


def _minima(costs: FloatArray, depth: float) -> BoolArray:
    """Where V (n_k,) by growing stiffness is below its neighbours and, by so much, below V of a stiffer spring."""
    stiffer = np.maximum.accumulate(costs[::-1])[::-1]
    lower = costs <= np.concatenate([[math.inf], costs[:-1]])
    return np.asarray(lower & (costs <= np.append(costs[1:], -math.inf)) & (costs < stiffer - depth))


def _damping_ratio(assembly: Assembly) -> float:
    """d / k in s of the robot's springs, in the median."""
    springs = [joint.spring for joint in assembly.linearisation.model.robot.joints if joint.spring is not None]
    ratios = [one.damping / one.stiffness for one in springs if one.damping > 0]
    return float(np.median(ratios)) if ratios else DEFAULT_DAMPING_RATIO


def _stiffnesses(name: str, models: Sequence[LinearModel], fit: ElasticFit) -> FloatArray:
    """k_i (n_k,), the last a step above the band."""
    directions = [direction(model, name) for model in models]
    inertia = np.mean([y @ model.M @ y / (y @ y) ** 2 for model, y in zip(models, directions, strict=True)])
    freq_hz = np.concatenate([part.kernel.freq_hz for part in fit.parts])
    low, high = float(freq_hz[freq_hz > 0].min()), float(freq_hz.max())
    count = min(MAX_STIFFNESSES, 2 + math.ceil(math.log(high / low) / math.log(FREQUENCY_STEP)))
    f = high * FREQUENCY_STEP ** np.arange(2 - count, 2)
    return np.asarray(inertia * (2 * np.pi * f) ** 2)


def _with_spring(
    fit: ElasticFit, parameters: ParameterSet, models: Sequence[LinearModel], assembly: Assembly
) -> ElasticFit:
    """The fit with a coordinate elastic, by the parameters of `_parameters`."""
    parts = tuple(
        replace(part, kernel=kernel_of(model, parameters, part.kernel.freq_hz))
        for part, model in zip(fit.parts, models, strict=True)
    )
    return ElasticFit(parameters, parts, moved_inertias(parameters, assembly.linearisation.model.robot))


def _parameters(name: str, k: float, damping_ratio: float, model: LinearModel, assembly: Assembly) -> ParameterSet:
    """Those of the fit, the spring's stiffness k free beside them, and all others of the model held."""
    fitted, damping = {one.name: one for one in assembly.parameters}, f"d{name[1:]}"
    own = {
        name: Parameter(name, k, "N*m/rad", log=True),
        damping: Parameter(damping, 0.0, tie=Tie(name, damping_ratio)),
    }
    known = dict(zip(model.parameters, model.theta_ref.tolist(), strict=True))
    of_model = [
        own.get(each) or fitted.get(each) or Parameter(each, known[each], free=False) for each in model.parameters
    ]
    return ParameterSet((*of_model, *(one for one in assembly.parameters if not one.is_of_model)))


def _beside(x: FloatArray, fitted: ParameterSet, extended: ParameterSet) -> FloatArray:
    """x (n_x,) in the order of the extended set (n_x + 1,), whose spring is at its start."""
    known = dict(zip(fitted.free_names, x.tolist(), strict=True))
    return np.array([known.get(p.name, p.to_x(p.value)) for p in extended.free])


def _damped_step(fit: ElasticFit, x: FloatArray) -> tuple[FloatArray, float]:
    """A Gauss-Newton step (n_x + 1,) with a prior that keeps it near, and V after it."""
    here = fit.evaluate(x)
    if not math.isfinite(here.cost):
        return np.zeros(len(x)), math.inf
    near = here.cost / max(fit.n_residuals, 1) / STEP_STD**2
    step = -np.linalg.solve(here.hessian / 2 + max(near, 1e-300) * np.eye(len(x)), here.gradient / 2)
    return np.asarray(step), here.cost + float(step @ (here.gradient + here.hessian @ step / 2))


def _index(
    spring: _Spring, name: str, optimum: RelinearisedOptimum, result: FitResult, noise_cost: float, level: float
) -> ModificationIndex | None:
    """What V and the parameters of the fit do when the solver follows a spring; None where V does not fall."""
    try:
        end = solve(spring.fit.problem, spring.x, ROUGH, MAX_ITERATIONS)
    except FitError:
        return None
    drop = optimum.fit.evaluate(optimum.end.x).cost - end.cost
    if not drop > 0:
        return None
    found = dict(zip(spring.fit.parameters.free_names, end.x.tolist(), strict=True))
    k = math.exp(found[spring.name])
    place = spring.fit.parameters.free_names.index(spring.name)
    variance = np.linalg.pinv(spring.fit.evaluate(end.x).hessian / 2, hermitian=True)[place, place]
    return ModificationIndex(
        name=name,
        group="compliance",
        members=(name,),
        values=np.zeros(1),
        units=("rad/(N*m)",),
        log=(False,),
        steps=np.array([1 / k]),
        std=math.sqrt(max(float(variance) * level, 0.0)) / k,
        drop=drop,
        share=drop / max(result.cost - noise_cost, 1e-300),
        effects=np.array([found[each] for each in result.parameters.free_names]) - result.x,
    )
