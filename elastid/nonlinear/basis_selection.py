"""Selection of friction basis functions, and of the torque delay, by cross-validation over realisations.

The motion of a motor gives the scales of its candidates.  A candidate is compensated only if it improves the
prediction.  Signs tanh(v / D) have speeds D a factor 2 apart.  If friction reverses over a speed between two of them,
both together overestimate sliding friction by 0.1 to 0.2 %; two signs near their mean reduce this error to a tenth
(`refine_basis`).  If no function explains the torque, its delay behind the motion is estimated (`torque_delay`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import FloatArray, IntArray, quotient
from elastid.nonlinear.friction_basis import BasisFunction, Kind
from elastid.nonlinear.motion import Motion, motion_of
from elastid.nonlinear.spectra import ConfigurationSpectra
from elastid.nonlinear.variable_projection import (
    NormalEquations,
    estimate_coefficients,
    inverse,
    normal_equations,
    residual_power,
)
from elastid.record import Record

# Least nonlinear fraction of a basis function's power, over the sign's. A sign has a nonlinear fraction of 0.36 to 0.6
# in a multisine, of 0.02 or less with strong slow lines such as a carrier's; a stop longer than the motion has 0.
MIN_NONLINEAR_FRACTION = 0.14
MAX_RESIDUAL_FRACTION = 0.5  # largest cross-validated residual power ratio of a motor with compensated friction
# Apparent smoothing velocity of a sign over the velocity noise: 1.25 for a motor that never sticks, with the mean sign
# erf(v / (sqrt(2) sigma)).  For motors that stick, calibrated by scripts/studies/outside_coverage.py: 2 removes the
# bias of the coefficients, with and without a carrier.
SIGN_BLUR = 2.0
# Residual power of an alternative relative to the selected basis functions, below which it is preferred. Alternatives:
# basis functions that begin with a damped element (if damping dominates, a sign is selected first and no element after
# it), and a delay of the torque near 0, for which a linear step must reach this ratio, too.
PREFERRED_POWER = 0.9
SLIGHT = 0.02  # least relative gain in power, V or torque by another function: the functions are approximate
# Relative std of a motor's coefficients, as one factor, by approximate basis functions.  Calibrated, not derived: with
# signs alone, F_c of two outside rigs was up to 1 % off (0.4 % by noise) and up to 0.3 % off.
SIGN_ERROR = 4e-3
SHAPE_ERROR = 0.015  # likewise with curves or bristles, where coefficients were up to 2.5 % off


@dataclass(frozen=True)
class Basis:
    """Selected basis functions with the motor of each (n_f,), and their cross-validated residual power ratio (n_m,)."""

    shapes: tuple[BasisFunction, ...]
    motor_of: IntArray
    residual_power_ratio: FloatArray

    @property
    def delay_s(self) -> float:
        """Delay of the logged torques behind the motions."""
        return self.shapes[0].delay_s if self.shapes else 0.0


def select_basis(
    data: Sequence[ConfigurationSpectra], candidates: Sequence[BasisFunction], locations: Sequence[str], auto: bool
) -> tuple[Basis, IntArray]:
    """Select basis functions by cross-validation; return them and their indices (n,) among the candidates."""
    motor_of = motors_of(candidates, locations)
    _, equations = estimate_coefficients(data, motor_of)
    groups = identifiable_basis(data, motor_of)
    choices = [select_motor_basis(equations, i, members, candidates) for i, members in enumerate(groups)]
    choices = [pair if not auto or pair[1] <= MAX_RESIDUAL_FRACTION else (pair[0][:0], 1.0) for pair in choices]
    indices = np.concatenate([members for members, _ in choices])
    ratios = np.array([ratio for _, ratio in choices])
    return Basis(tuple(candidates[i] for i in indices), motor_of[indices], ratios), indices


def motors_of(shapes: Sequence[BasisFunction], locations: Sequence[str]) -> IntArray:
    """Return the index (n_f,) of the motor of each basis function in `locations`."""
    return np.array([locations.index(shape.place) for shape in shapes], np.int64)


def identifiable_basis(data: Sequence[ConfigurationSpectra], motor_of: IntArray) -> list[IntArray]:
    """Select the basis functions of each motor that are identifiable from nonlinear distortion, one index array each.

    A function linear in position or velocity is indistinguishable from stiffness or damping and is dropped. The first
    function of a motor is Coulomb friction.
    """
    fraction = np.mean([configuration.nonlinear_fraction() for configuration in data], axis=0)
    members = [np.flatnonzero(motor_of == i) for i in np.unique(motor_of)]
    return [rows[fraction[rows] > MIN_NONLINEAR_FRACTION * fraction[rows[0]]] for rows in members]


# Smoothing velocities of a sign, over the rms speed.
_SIGN_SPEEDS = (0.0, *(0.005 * 2**i for i in range(5)))
# Stribeck velocities, over the rms speed; larger ones are indistinguishable from viscous friction.
_STRIBECK_SPEEDS = tuple(0.1 * 2 ** (i / 2) for i in range(8))
# Refined speeds over the mean speed of the selected functions: with a neighbour's speed F_c is up to 2 % off.
_REFINED: dict[Kind, tuple[float, ...]] = {"sign": (0.9, 1.1), "stribeck": (0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4)}
# Deflections of a bristle, over the median distance between reversals. A much longer bristle is a spring, which is part
# of the response. With steps of 2 instead of its root the error of k under LuGre friction is up to four times as large.
_DEFLECTIONS = tuple(0.025 * 2 ** (i / 2) for i in range(15))


def candidate_basis(records: Sequence[Record], signs_alone: bool) -> tuple[BasisFunction, ...]:
    """Return the candidates of every motor: signs, and unless signs_alone Stribeck curves, bristles and damping."""
    shapes = []
    for location in records[0].inputs:
        motions = [motion_of(record, location) for record in records]
        speed = math.sqrt(np.mean([motion.speed**2 for motion in motions]))
        shapes += [BasisFunction(location, "sign", fraction * speed) for fraction in _SIGN_SPEEDS]
        if signs_alone:
            continue
        shapes += [BasisFunction(location, "stribeck", fraction * speed) for fraction in _STRIBECK_SPEEDS if speed > 0]
        if (swing := median_swing(motions)) > 0:
            kinds: tuple[Kind, ...] = ("stop", "bristle", "stop damping", "bristle damping")
            shapes += [BasisFunction(location, kind, fraction * swing) for kind in kinds for fraction in _DEFLECTIONS]
    return tuple(shapes)


def median_swing(motions: Sequence[Motion]) -> float:
    """Return the median distance between two reversals, rad (m); 0 without any."""
    swings = np.concatenate([motion.swings for motion in motions])
    return float(np.median(swings)) if swings.size else 0.0


def greedy(
    larger: Callable[[list[int]], list[list[int]]],
    cost: Callable[[list[int]], float],
    pays: Callable[[float, float, list[int]], bool],
) -> tuple[list[int], float]:
    """Select members by forward selection; return them and their cost.

    larger(members): sets with one more member.  In each step the set of lowest cost among those that pay is selected;
    pays(old cost, new cost, set).
    """
    members: list[int] = []
    best_cost = cost(members)
    while better := [(new_total, sets) for sets in larger(members) if pays(best_cost, new_total := cost(sets), sets)]:
        best_cost, members = min(better)
    return members, best_cost


def is_admissible(shape: BasisFunction, shapes: Sequence[BasisFunction]) -> bool:
    """Return whether a motor with basis functions `shapes` admits another one.

    A Stribeck curve needs another function and is unique; damping needs a stop or a bristle.
    """
    kinds = {s.kind for s in shapes}
    if shape.kind == "stribeck":
        return bool(kinds) and "stribeck" not in kinds
    return not shape.is_damping or not kinds.isdisjoint(("stop", "bristle"))


def select_motor_basis(
    equations: NormalEquations, motor: int, candidates: IntArray, shapes: Sequence[BasisFunction]
) -> tuple[IntArray, float]:
    """Select a motor's basis functions by forward selection; return their indices and residual power ratio.

    candidates (n,): indices of the motor's candidates in `shapes`.
    """

    def power(members: list[int]) -> float:
        return residual_power(equations, motor, np.array(members, np.int64))

    def pays(cost: float, new_cost: float, _: list[int]) -> bool:
        return new_cost < (1 - SLIGHT) * cost  # False without residual power

    def larger(members: list[int], firsts: list[list[int]]) -> list[list[int]]:
        member_shapes = [shapes[i] for i in members]
        free_indices = [i for i in indices if i not in members and is_admissible(shapes[i], member_shapes)]
        return firsts if not members else [[*members, i] for i in free_indices]

    total, indices = power([]), candidates.tolist()
    singles = [[i] for i in indices if is_admissible(shapes[i], ())]
    elements = [[i, j] for i in indices for j in indices if shapes[i].element == shapes[j].element]
    pairs = [[i, j] for i, j in elements if shapes[j].is_damping and not shapes[i].is_damping]
    members, cost_of_members = greedy(partial(larger, firsts=singles), power, pays)
    if pairs and (damping := greedy(partial(larger, firsts=pairs), power, pays))[1] < PREFERRED_POWER * cost_of_members:
        members, cost_of_members = damping
    return np.array(sorted(members), np.int64), cost_of_members / total if total > 0 else 1.0


def refine_basis(choice: Basis, coefficients: FloatArray, motors: Sequence[str], velocity_noise: FloatArray) -> Basis:
    """Replace the selected signs and Stribeck curves of a motor by functions with speeds near their mean speed D.

    A sign has the smoothing velocity sqrt(D^2 - (c sigma)^2), with sigma (n_m,) = velocity_noise and c = SIGN_BLUR:
    velocity noise smooths a jump of friction, which would bias its coefficient in sliding upwards.  Signs with speeds
    that differ by more than a factor 3 are not changed.
    """
    shapes = []
    for motor, noise in zip(motors, velocity_noise.tolist(), strict=True):
        pairs = [
            (shape, f) for shape, f in zip(choice.shapes, coefficients.tolist(), strict=True) if shape.place == motor
        ]
        for kind, factors in _REFINED.items():
            members = [(shape.threshold, f) for shape, f in pairs if shape.kind == kind and f > 0]
            gradual = [speed for speed, _ in members if speed > 0]
            if not gradual or max(gradual) > 3 * min(gradual):
                continue
            mean = sum(speed * f for speed, f in members) / sum(f for _, f in members)
            if kind == "sign":
                mean = math.sqrt(max(mean**2 - (SIGN_BLUR * noise) ** 2, 0.0))
            pairs = [(shape, f) for shape, f in pairs if shape.kind != kind]
            pairs += [(BasisFunction(motor, kind, factor * mean), 0.0) for factor in (factors if mean else factors[:1])]
        shapes += [replace(shape, delay_s=choice.delay_s) for shape, _ in pairs]
    return Basis(tuple(shapes), motors_of(shapes, motors), choice.residual_power_ratio)


def basis_error_covariance(choice: Basis, coefficients: FloatArray) -> FloatArray:
    """Return the covariance (n_f, n_f) of coefficients (n_f,) by approximate basis functions, one factor per motor."""
    is_smooth = np.array([shape.kind != "sign" for shape in choice.shapes], np.bool_) & (coefficients > 0)
    error = np.where(np.isin(choice.motor_of, choice.motor_of[is_smooth]), SHAPE_ERROR, SIGN_ERROR) * coefficients
    return np.where(choice.motor_of[:, None] == choice.motor_of, np.outer(error, error), 0.0)


# Residual power ratio of the basis above which all delays are searched, and the largest ratio of the residual powers
# with and without such a delay.
SEARCHED_ABOVE, DELAYED_POWER = 0.05, 0.5
MAX_DELAY_S = 0.025
DELAY_ITERATIONS = 2  # of the coefficients at a delay: the power has an error of 1e-4


def torque_delay(
    data: Sequence[ConfigurationSpectra], candidates: Sequence[BasisFunction], choice: Basis, locations: Sequence[str]
) -> float:
    """Estimate the delay of the logged torques behind the motions, in s; 0 if the gain is small.

    It minimises the cross-validated residual power, geometric mean over motors.
    """
    if not choice.shapes:
        return 0.0
    is_wide = choice.residual_power_ratio.max(initial=0.0) >= SEARCHED_ABOVE
    if not is_wide and delay_step_power(data, candidates, choice) > PREFERRED_POWER:
        return 0.0
    from scipy.optimize import minimize_scalar

    motor_of = motors_of(candidates, locations)
    groups = identifiable_basis(data, motor_of)  # a delay does not change the power of a basis function

    def power(delay_s: float) -> float:
        _, equations = estimate_coefficients(delay_spectra(data, delay_s), motor_of, DELAY_ITERATIONS)
        ratios = [select_motor_basis(equations, i, rows, candidates)[1] for i, rows in enumerate(groups)]
        return float(np.mean(np.log(np.maximum(ratios, 1e-12))))

    step = 1 / (8 * max(float(spectra.freq_hz[spectra.excited].max()) for spectra in data))
    n_steps = math.ceil(MAX_DELAY_S / step) if is_wide else 0
    grid = step * np.arange(-n_steps, n_steps + 1)
    powers = [power(delay) for delay in grid]
    best = float(grid[np.argmin(powers)])
    search = minimize_scalar(power, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-2 * step})
    limit = powers[n_steps] + math.log(DELAYED_POWER if is_wide else PREFERRED_POWER)
    return float(search.x) if search.fun < limit else 0.0


def delay_step_power(data: Sequence[ConfigurationSpectra], candidates: Sequence[BasisFunction], choice: Basis) -> float:
    r"""Return the cross-validated residual power after one linear step in the delays, over the power without delay.

    Geometric mean over motors.  Delayed friction is :math:`\Phi f - j \omega T \Phi f`: one more column per motor.
    """
    indices, motor_of = [candidates.index(shape) for shape in choice.shapes], choice.motor_of
    motors = np.unique(motor_of)
    data = [replace(spectra, Phi=spectra.Phi[:, indices]) for spectra in data]
    f, _ = estimate_coefficients(data, motor_of)
    to_motors = f * (motors[:, None] == motor_of)
    delayed = [
        replace(s, Phi=np.concatenate([s.Phi, -2j * np.pi * s.freq_hz[:, None, None] * (to_motors @ s.Phi)], axis=1))
        for s in data
    ]
    f_0 = np.concatenate([f, np.zeros(len(motors))])
    equations = normal_equations(delayed, f_0, np.concatenate([motor_of, motors]))
    powers = []
    for column, motor in enumerate(motors.tolist(), len(f)):
        acting = np.flatnonzero((motor_of == motor) & (f > 0))
        sets = np.append(acting, column), acting
        powers.append([residual_power(equations, motor, rows, lambda A, b: inverse(A) @ b) for rows in sets])
    delayed_power, power_at_0 = np.array(powers).T
    return float(np.exp(np.mean(np.log(np.maximum(quotient(delayed_power, power_at_0, 1.0), 1e-12)))))


def delay_spectra(data: Sequence[ConfigurationSpectra], delay_s: float) -> list[ConfigurationSpectra]:
    """Return spectra with basis functions that are delayed by delay_s."""
    return [replace(s, Phi=np.exp(-2j * np.pi * delay_s * s.freq_hz)[:, None, None] * s.Phi) for s in data]
