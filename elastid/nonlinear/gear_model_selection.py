r"""Model selection of gear effects by cross-validation over realisations.

The normal equations of parameters and magnitudes are summed for each realisation, along the motion with the selected
effects. A candidate group (a sine with its cosine) is added if it lowers V in realisations to which its magnitudes were
not fitted. Parameters, magnitudes and motion are then estimated again, until no group is added. Magnitudes below three
standard deviations are discarded. An effect that is not selected has the upper bound

.. math:: f < \max(\hat f, 0) + 1.645\, \sigma_f \quad (95\,\%)

with f and its standard deviation by one Gauss-Newton step of parameters, selected magnitudes and this effect, along the
motion with the selected effects. The bound of a sine with its cosine applies to the amplitude.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import compress
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.statistics import ONE_SIDED_95, QUANTILE_95
from elastid.fit.covariance import compensation_error
from elastid.nonlinear.basis_functions import APART, KINDS, LOOPS, SPRINGS, GearEffect, Kind, SheetNumber
from elastid.nonlinear.basis_selection import SIGN_ERROR, SLIGHT, greedy
from elastid.nonlinear.gear_estimation import (
    MIN_SIGNIFICANCE,
    MOVE,
    ROUNDS,
    GearData,
    GearEstimate,
    Sums,
    estimate_gear_parameters,
    initial_estimate,
)
from elastid.nonlinear.period_lines import PeriodLines
from elastid.nonlinear.period_model import elastic_joints
from elastid.nonlinear.variable_projection import cross_validated_power, inverse
from elastid.parameters import Parameters

Group: TypeAlias = tuple[GearEffect, ...]

# Thresholds of the selection. Gains are decreases of V in the realisations that the magnitudes were not fitted to.
MIN_GAIN = 12.0  # by each effect of a group
MIN_GAIN_OF_SPRING = 60.0  # by each effect of a nonlinear spring
MIN_GAIN_FRACTION = 0.005  # relative to V, because residuals of the best model are not white either
MIN_PERIOD_FRACTION = 0.5  # travel of the motor, in periods of a transmission error or ripple
# Std of ln k of a gear with effects besides friction: errors were 0.05 to 0.11 % in six robots simulated by MuJoCo.
STIFFNESS_ERROR_OF_EFFECTS = 5e-4
_COLLAPSE_FACTOR = 10.0  # a logarithmic parameter that the linear fit reduced by this factor starts anew
_ROUGH = 10 * MOVE  # tolerance of estimates that are compared; the final estimate has the tolerance MOVE


def candidate_groups(data: GearData, estimate: GearEstimate, orders: Sequence[float]) -> list[Group]:
    """Return the candidate groups of every joint, with scales relative to its motion.

    A gear without a spring of its own has friction at the motor only, which acts on the other joints, too.
    """
    groups: list[Group] = []
    elastic = elastic_joints(data.linearisation)
    for j, joint in enumerate(data.joints):
        speed, deflection = _sizes(data, estimate, j)
        for kind, row in KINDS.items():
            if kind == "friction" or joint in elastic:
                size = deflection if row.place == "gear" else speed
                groups += [(GearEffect(kind, joint, fraction * size),) for fraction in row.scales]
        if joint not in elastic:
            continue
        turns = travelled_turns(data, estimate, j)
        for order in (order for order in orders if order * turns > MIN_PERIOD_FRACTION):
            groups.append((GearEffect("error sine", joint, order), GearEffect("error cosine", joint, order)))
            groups.append((GearEffect("ripple sine", joint, order), GearEffect("ripple cosine", joint, order)))
    return groups


def travelled_turns(data: GearData, estimate: GearEstimate, j: int) -> float:
    """Return the largest motor travel of all configurations at joint j, in turns."""
    pairs = zip(data.lines, estimate.drives, strict=True)
    angles = (lines.fine(np.tensordot(drive.motor_row(j), lines.Y, axes=(0, 1)).T) for lines, drive in pairs)
    return float(abs(estimate.drives[0].ratios[j]) * max(np.ptp(x, axis=1).max() for x in angles) / (2 * np.pi))


def _sizes(data: GearData, estimate: GearEstimate, j: int) -> tuple[float, float]:
    """Return the rms velocity of a motor and the rms deflection of its gear at joint j, by the linear model."""
    speeds, deflections = [], []
    for lines, drive in zip(data.lines, estimate.drives, strict=True):
        motor, gear = (drive.motion(location, j, lines.U) for location in ("motor", "gear"))
        speeds.append(np.mean(np.sum(np.abs(lines.s[:, None] * motor) ** 2, axis=0) / 2))
        deflections.append(np.mean(np.sum(np.abs(gear) ** 2, axis=0) / 2))
    return math.sqrt(np.mean(speeds)), math.sqrt(np.mean(deflections))


def choose_effects(data: GearData, parameters: Parameters, x: FloatArray, orders: Sequence[float]) -> GearEstimate:
    """Select the effects by cross-validation and estimate them.

    x (n_x,): optimum of the linear fit.  A logarithmic parameter below a tenth of its nominal value starts at this
    value, because dry friction may reduce viscous friction to nearly 0.  orders: candidates per motor revolution.
    """
    is_at_limit = parameters.is_log & (x < parameters.x - np.log(_COLLAPSE_FACTOR))
    estimate = initial_estimate(data, parameters, np.where(is_at_limit, parameters.x, x))
    groups = candidate_groups(data, estimate, orders)
    for _ in range(ROUNDS):
        further = [group for group in groups if not _conflicts(group[0], estimate.effects)]
        extra = _select_effects(data, estimate, further)
        if not extra:
            break
        kinds = _kinds(estimate.effects)
        estimate = _prune(data, estimate_gear_parameters(data, estimate, (*estimate.effects, *extra), tolerance=_ROUGH))
        for family in (SPRINGS, LOOPS):
            for joint in dict.fromkeys(effect.joint for effect in extra if effect.kind in family):
                estimate = _best_law(data, estimate, joint, family)
        if _kinds(estimate.effects) == kinds:  # no new effect remains
            break
    # On the grid of the search, backlash that is crossed between two samples would appear 8 % too soft.
    fine = [replace(lines, cells=2 * lines.cells) for lines in data.lines]
    estimate = _on_grid(_converge(replace(data, lines=fine), _on_grid(estimate, fine)), data.lines)
    if not estimate.effects:
        return estimate
    nonlinear = {f"k_{effect.joint}" for effect in estimate.effects if effect.kind not in ("friction", "behind")}
    free, by_friction = estimate.parameters.free, compensation_error(estimate.parameters)
    by_effects = STIFFNESS_ERROR_OF_EFFECTS * np.array([p.log and p.stands_for in nonlinear for p in free])
    bias_std = np.concatenate([np.maximum(by_friction, by_effects), _systematic_std(estimate)])
    return replace(estimate, covariance=estimate.covariance + np.diag(bias_std**2))


def _systematic_std(estimate: GearEstimate) -> FloatArray:
    """Return the systematic standard deviation (n_f,) of the magnitudes: SIGN_ERROR, and friction in errors.

    Friction that reverses between samples is modelled to SLIGHT of it. The remainder deflects the gear like a
    transmission error: with 32 Nm of friction, estimates of 20 urad were 1 to 2.7 urad too small on six seeds.
    """
    drive = estimate.drives[0]
    kinds, joints = np.array([(effect.kind, effect.joint) for effect in estimate.effects]).T
    friction = np.isin(kinds, ("friction", "behind")) * estimate.magnitudes
    deflection = (joints[:, None] == joints) @ friction / drive.k[[drive.joints.index(joint) for joint in joints]]
    is_error = np.isin(kinds, ("error sine", "error cosine"))
    return np.asarray(np.hypot(SIGN_ERROR * estimate.magnitudes, is_error * SLIGHT / QUANTILE_95 * deflection))


def _on_grid(estimate: GearEstimate, lines: Sequence[PeriodLines]) -> GearEstimate:
    motions = tuple(motion.on(grid) for motion, grid in zip(estimate.estimates, lines, strict=True))
    return replace(estimate, estimates=motions)


def _converge(data: GearData, estimate: GearEstimate) -> GearEstimate:
    estimate = estimate_gear_parameters(data, estimate, estimate.effects)
    smaller = _prune(data, estimate)
    return estimate if smaller is estimate else _converge(data, smaller)


def _kinds(effects: Sequence[GearEffect]) -> list[tuple[str, str]]:
    return sorted((effect.kind, effect.joint) for effect in effects)


def _best_law(data: GearData, estimate: GearEstimate, joint: str, family: tuple[Kind, ...]) -> GearEstimate:
    """Return the estimate with the spring or hysteresis law of a gear that has the lowest penalised cost."""

    def springs_of(magnitudes: GearEstimate) -> list[GearEffect]:
        return [effect for effect in magnitudes.effects if effect.joint == joint and effect.kind in family]

    springs = springs_of(estimate)
    if not springs:
        return estimate
    other_effects = tuple(effect for effect in estimate.effects if effect not in springs)
    deflection = _sizes(data, estimate, data.joints.index(joint))[1]

    def cost(magnitudes: GearEstimate) -> float:
        return magnitudes.weighted_cost + MIN_GAIN * sum(1 + (effect.edge is not None) for effect in magnitudes.effects)

    tie = sum(lines.Y.size for lines in data.lines)

    def refit(start: GearEstimate, effects: tuple[GearEffect, ...]) -> GearEstimate:
        return _prune(data, estimate_gear_parameters(data, start, effects, _ROUGH, other_effects, cost(estimate)))

    trials = [estimate]
    for kind in family:
        if not any(effect.kind == kind or {effect.kind, kind} == {"range", "gap"} for effect in springs):
            scale = KINDS[kind].scales[len(KINDS[kind].scales) // 2] * deflection
            trials.append(refit(estimate, (*other_effects, GearEffect(kind, joint, scale))))
    best = min(trials, key=cost)
    with_range = next((trial for trial in trials if [effect.kind for effect in springs_of(trial)] == ["range"]), best)
    if best.weighted_cost < with_range.weighted_cost < best.weighted_cost + tie:
        # If one range is slightly worse than a law of another kind, two ranges may be much better.
        (first,) = springs_of(with_range)
        best = min(best, refit(with_range, (*with_range.effects, replace(first, scale=APART * first.scale))), key=cost)
    if best is not estimate:  # scales of the other effects were fixed
        best = estimate_gear_parameters(data, best, best.effects, tolerance=_ROUGH)
    return _as_gap_or_range(data, best, joint)


def _as_gap_or_range(data: GearData, estimate: GearEstimate, joint: str) -> GearEstimate:
    """Replace the only range of a joint by a gap if the spring is far stiffer beyond it, otherwise a gap by a range.

    Both are the same law; k is the stiffness at zero torque for a range, beyond the ends for a gap.
    """
    springs = [i for i, effect in enumerate(estimate.effects) if effect.joint == joint and effect.kind in SPRINGS]
    names = estimate.parameters.free_names
    if len(springs) != 1 or estimate.effects[springs[0]].edge is None or f"k_{joint}" not in names:
        return estimate
    (i,), index = springs, names.index(f"k_{joint}")
    effect, f = estimate.effects[i], float(estimate.magnitudes[i])
    k = estimate.parameters.as_dict(estimate.x)[f"k_{joint}"]
    inner, outer = (k, k + f) if effect.kind == "range" else (k - f, k)
    kind: Kind = "gap" if outer > APART**2 * inner else "range"
    if kind == effect.kind or not inner > 0:
        return estimate
    x = estimate.x.copy()
    x[index] = estimate.parameters.free[index].to_x(outer if kind == "gap" else inner)
    effects = (*estimate.effects[:i], replace(effect, kind=kind), *estimate.effects[i + 1 :])
    return estimate_gear_parameters(data, replace(estimate, x=x, effects=effects), effects, tolerance=_ROUGH)


def _conflicts(effect: GearEffect, others: Sequence[GearEffect], *, alone: bool = False) -> bool:
    """Return whether an effect, or a rival at its joint that it is hardly distinguishable from, is among the others.

    alone: reject a second range or hysteresis element, too, because two that are added in one step may converge to
    one scale.
    """
    rivals = [rival for rival in others if rival.joint == effect.joint and rival.kind in effect.row.rivals]
    # Ranges (K1, K2, K3) and hysteresis elements of different scales add.
    if not alone and effect.kind in ("range", *LOOPS) and all(rival.kind == effect.kind for rival in rivals):
        return any(abs(np.log(rival.scale / effect.scale)) < np.log(APART) for rival in rivals)
    return effect in others or bool(rivals)


def _prune(data: GearData, estimate: GearEstimate) -> GearEstimate:
    """Refit without effects that are insignificant, have the wrong sign, or are negligible relative to another one.

    A sine and its cosine are significant together.
    """
    size = estimate.magnitudes / np.maximum(estimate.std, 1e-300)
    power = sum(np.sum(np.abs(e.Phi) ** 2, axis=(0, 1, 2)) for e in estimate.estimates) * estimate.magnitudes**2
    families = [(*family_of(effect), effect.scale) for effect in estimate.effects]
    sizes, powers = dict.fromkeys(families, -np.inf), dict.fromkeys(families, 0.0)
    for family, effect, z, P in zip(families, estimate.effects, size.tolist(), power.tolist(), strict=True):
        sizes[family] = max(sizes[family], z if effect.row.brakes else abs(z))
        powers[family] += P
    largest = {joint: max(P for family, P in powers.items() if family[1] == joint) for _, joint, *_ in families}
    significant = [
        sizes[family] >= MIN_SIGNIFICANCE and powers[family] > SLIGHT**2 * largest[family[1]] for family in families
    ]
    if all(significant):
        return estimate
    return estimate_gear_parameters(data, estimate, tuple(compress(estimate.effects, significant)), tolerance=_ROUGH)


def _select_effects(data: GearData, estimate: GearEstimate, groups: Sequence[Group]) -> list[GearEffect]:
    """Select by forward selection the effects of the groups that lower the cross-validated V."""
    sums, prior = data.joint_normal_equations(estimate, [effect for group in groups for effect in group])
    ends = len(estimate.x) + len(estimate.magnitudes) + np.cumsum([0, *(len(group) for group in groups)])

    def effects_of(indices: list[int]) -> list[GearEffect]:
        return [effect for i in indices for effect in groups[i]]

    def larger(indices: list[int]) -> list[list[int]]:
        effects = effects_of(indices)
        return [[*indices, i] for i, group in enumerate(groups) if not _conflicts(group[0], effects, alone=True)]

    def cost(indices: list[int]) -> float:
        members = (np.arange(ends[i], ends[i + 1]) for i in indices)
        return _cross_validated_cost(sums, prior, np.concatenate([np.arange(ends[0]), *members]))

    def pays(old_cost: float, new_cost: float, indices: list[int]) -> bool:
        group = groups[indices[-1]]
        # A nonlinear spring explains some of the distortion by approximate friction in any gear.
        gain, fraction = (MIN_GAIN_OF_SPRING, SLIGHT) if group[0].kind in SPRINGS else (MIN_GAIN, MIN_GAIN_FRACTION)
        return old_cost - new_cost > max(gain * len(group), fraction * old_cost)

    return effects_of(greedy(larger, cost, pays)[0])


def _cross_validated_cost(sums: Sums, prior: tuple[FloatArray, FloatArray], columns: IntArray) -> float:
    """Return the sum of V of each realisation with the numbers `columns` (n,) estimated from all others."""

    def step(A: FloatArray, b: FloatArray) -> FloatArray:
        A, b = A + prior[0][columns[:, None], columns], b + prior[1][columns]
        size = np.sqrt(np.maximum(np.diag(A), 1e-300))
        return np.asarray(np.linalg.lstsq(A / np.outer(size, size), b / size, rcond=1e-10)[0] / size)

    A, b, c = sums
    return cross_validated_power(A[:, columns[:, None], columns], b[:, columns], c, step)


def family_of(effect: GearEffect) -> tuple[SheetNumber, str, float]:
    """Return the number, joint and order of an effect, which its basis functions share."""
    return effect.row.number, effect.joint, effect.order


def magnitude_bounds(data: GearData, estimate: GearEstimate, orders: Iterable[float]) -> dict[Group, float]:
    """Return the upper 95 % bound of each candidate group whose family has no effect in the estimate."""
    families = {family_of(effect) for effect in estimate.effects}
    groups = [group for group in candidate_groups(data, estimate, tuple(orders)) if family_of(group[0]) not in families]
    (A, b, _), prior_equations = data.joint_normal_equations(estimate, [effect for group in groups for effect in group])
    A, b = A.sum(axis=0) + prior_equations[0], b.sum(axis=0) + prior_equations[1]
    bounds, n = dict[Group, float](), len(estimate.x) + len(estimate.magnitudes)
    first = n
    for group in groups:
        columns = [*range(n), *range(first, first + len(group))]
        covariance = inverse(A[np.ix_(columns, columns)])
        step = (covariance @ b[columns])[n:]
        size = float(max(step[0], 0.0) if group[0].row.brakes else np.hypot.reduce(step))
        bounds[group] = size + ONE_SIDED_95 * math.sqrt(np.diag(covariance)[n:].max())
        first += len(group)
    return bounds
