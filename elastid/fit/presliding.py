r"""Presliding friction of motors in measured responses, modelled as a relaxing spring where it lowers V significantly.

The drop of V by a linear step shows at which motors,

.. math:: \frac{\partial G}{\partial s} = -G\, e_m\, \frac{j \omega}{j \omega + a}\, e_m^T G

V has several local minima in s and a, so the solver starts from both signs of s and several rates a. Rates are bounded
to the neighbourhood of the band; outside, the element is indistinguishable from a spring or damper.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, laplace_variable, values_by_name
from elastid.base.errors import FitError, Note, notes_of
from elastid.base.execution import SERIAL
from elastid.base.statistics import chi_square_limit
from elastid.fit.diagnosis.hypothesis import Evidence
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.rank_hypotheses import drop_variance
from elastid.fit.diagnosis.refit import EvaluatedResponse, evaluate, line_subset
from elastid.fit.frf_problem import Assembly, is_distorted_by_friction, is_friction_compensated
from elastid.fit.problem.frf_residuals import ElasticFit, map_chunks
from elastid.fit.result import Result
from elastid.fit.result_rows import Presliding
from elastid.fit.solve.solvers import DAMPING_UNITS, ROUGH, solve
from elastid.linear.linear_model import is_load
from elastid.linear.presliding import AMPLITUDES, RelaxingSpring, element_names
from elastid.parameters import DELAY, Parameter, Parameters, Prior, Tie
from elastid.record import MOTION_ORDER
from elastid.response import UNEXPLAINED, Response

RESIDUALS = 6_000  # largest number of real residuals in the search
# Prior std of the logarithms of a stiffness and of a relaxation time about their start values.
STIFFNESS_STD, TIME_STD = 3.0, 1.5
# Bounds of a rate relative to the lowest and the highest angular frequency, and the number of start values of a rate.
RATE_BOUNDS, N_RATES = (1e-3, 2.4), 4
# Start value of a stiffness relative to the median of torque over angle: lower bound; value without a linear step.
FIRST_FRACTIONS = (1e-3, 0.1)
MAX_P_VALUE = 0.1  # probability of V by noise alone, below which springs are tested
MAX_STD = 0.8  # largest std of ln(stiffness) of an identified spring
PREDICTED_FRACTION = 0.5  # least drop of V by a linear step, relative to a significant drop
START_FRACTION = 0.6  # least drop by a linear step at a start rate, relative to the largest, for a solve from this rate

Springs: TypeAlias = Mapping[RelaxingSpring, tuple[float, float]]  # s, N m/rad, and a, 1/s


def find_presliding(evidence: Evidence) -> tuple[Assembly, FloatArray] | None:
    """Find relaxing springs at all motors if V or the distortion exceeds the noise, else at compensated motors.

    Return the assembly with springs and its start x (n_x,), or None: if no spring is significant, if another cause has
    better odds, without measured noise, and for references, forces at the tool and load tests.
    """
    assembly, result, dof = evidence.assembly, evidence.result, max(evidence.result.cost_dof, 1.0)
    is_large = result.cost > result.cost_expected * chi_square_limit(dof, MAX_P_VALUE) / dof
    is_large |= any(note.code == UNEXPLAINED for note in notes_of(assembly.responses))
    joints = _joints(assembly, is_large or any(map(is_distorted_by_friction, assembly.responses)))
    is_explained = evidence.best.explained_fraction > LIMITS.complete_fraction and evidence.is_unexplained
    if assembly.loads is not None or not joints or not result.noise_is_known or is_explained:
        return None
    # If V is within the noise, a negative spring is an error of the compensation, which the intervals include.
    first = _State.of(assembly, evidence.optimum.x, (1, -1) if is_large else (1,))
    last = _with_all(first, joints)
    if not last.springs or _is_rejected(evidence, first, last):
        return None
    with_springs = with_presliding(
        assembly, dict(sorted(last.springs.items(), key=lambda pair: joints.index(pair[0].joint)))
    )
    return with_springs, with_springs.parameters.x_with(values_by_name(last.fit.parameters.free_names, last.x))


def _joints(assembly: Assembly, is_large: bool) -> tuple[str, ...]:
    """Return the joints whose motors may have presliding friction."""
    motors = set[str]()
    for response in assembly.responses:
        if any(map(is_load, response.inputs)) or response.controller is not None:
            return ()
        bias = None
        if response.bias is not None and is_friction_compensated(response):
            bias = response.bias[response.image_errors : -1]
        motors |= {
            motor for j, motor in enumerate(response.inputs) if is_large or (bias is not None and bias[:, j].any())
        }
    return tuple(name for name in assembly.robot.driven_names if f"motor {name}" in motors)


def _is_rejected(evidence: Evidence, first: "_State", last: "_State") -> bool:
    """Return True if springs explain too little of the excess of V, or another cause has better odds by the BIC."""
    drop, scores, cause = first.cost - last.cost, evidence.scores, evidence.cause
    if evidence.is_unexplained and drop < LIMITS.sufficient_fraction * (
        first.cost - last.cost_ratio * first.fit.problem.dof
    ):
        return True
    if scores is None or cause is None:
        return False
    occam = 2 * len(last.springs) * math.log(last.fit.n_residuals)
    return (drop / last.fraction - cause.drop) * scores.residual_fraction / drop_variance(scores) < occam - cause.occam


@dataclass(frozen=True, eq=False)
class _State:
    """Fit with a set of springs on a subset of DFT lines: x (n_x,) and V.

    base: fit without springs.  signs: allowed signs of further springs.
    """

    base: Assembly
    signs: tuple[int, ...]
    springs: Springs
    fit: ElasticFit
    x: FloatArray
    cost: float
    fraction: float = 1.0

    @classmethod
    def of(cls, base: Assembly, x: FloatArray, signs: tuple[int, ...]) -> "_State":
        """Return the state without springs, from x (n_x,)."""
        fit, fraction = _on_line_subset(base, x)
        end = solve(fit.problem, x, ROUGH, LIMITS.iterations)
        return cls(base, signs, {}, fit, end.x, end.cost, fraction)

    @property
    def cost_ratio(self) -> float:
        """V over its degrees of freedom, 1 at least."""
        return max(self.cost / self.fit.problem.dof, 1.0)

    def predicted(self, joint: str) -> float:
        """Predict the decrease of V by a linear step in parameters and springs of a motor; infinite if undetermined."""
        if joint not in self._rows[0]:
            return math.inf
        C, _, _, r = self._steps(joint)
        return float(np.sum((np.linalg.qr(C.T)[0].T @ r) ** 2))

    def starts(self, joint: str) -> list[tuple[RelaxingSpring, float, float]]:
        """Return start values (spring, s, a) at the rates with the largest drops of V by a linear step in s.

        If the motion of the motor is not measured, all signs at two rates.
        """
        typical, (low, middle) = _torque_per_angle(self.base.responses, f"motor {joint}"), FIRST_FRACTIONS
        if joint not in self._rows[0]:
            rates = _rates(self.base.responses)[1:-1].tolist()
            return [(RelaxingSpring(joint, sign), middle * typical, a) for sign in self.signs for a in rates]
        C, steps, rates_of_steps, r = self._steps(joint)
        drops = -steps * (C @ r)
        return [
            (RelaxingSpring(joint, 1 if s > 0 else -1), float(np.clip(abs(s), low * typical, typical)), a)
            for s, a, drop in zip(steps.tolist(), rates_of_steps.tolist(), drops.tolist(), strict=True)
            if drop >= START_FRACTION * drops.max()
        ]

    def _steps(self, joint: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return dr/ds (n, N), linear steps in s (n,) with a sign in `signs`, their rates (n,), and r (N,)."""
        of_springs, r = self._rows
        C = of_springs[joint]
        steps = -(C @ r) / np.maximum(np.sum(C**2, axis=1), 1e-300)
        is_allowed = np.isin(np.sign(steps), self.signs)
        return C[is_allowed], steps[is_allowed], _rates(self.base.responses)[is_allowed], r

    @cached_property
    def _rows(self) -> tuple[dict[str, FloatArray], FloatArray]:
        """dr/ds (n_a, N) at the start rates by joint, orthogonal to dr/dx, and r (N,), both with rows of the priors."""
        rows, columns, residuals, rates = [], [], [], _rates(self.base.responses)
        for evaluated in evaluate(self.fit, self.x):
            rows.append(-evaluated.whitened(evaluated.free))
            residuals.append(evaluated.residual)
            columns.append(dict(_columns(evaluated, rates)))
        distance, slope = self.fit.parameters.priors(self.x)
        zeros = np.zeros((len(rates), len(distance)))  # derivatives of priors
        measured = [joint for joint in columns[0] if all(joint in column for column in columns)]
        spring_rows = {joint: np.hstack([*(column[joint] for column in columns), zeros]) for joint in measured}
        Q = np.linalg.qr(np.hstack([*rows, np.diag(slope)]).T)[0]
        return {joint: C - (C @ Q) @ Q.T for joint, C in spring_rows.items()}, np.concatenate([*residuals, distance])

    def trials(self, joint: str) -> "Iterator[_State]":
        """Yield the fits with a spring at another motor, from all starts; without those whose rate ends at a bound."""
        for spring, stiffness, a in self.starts(joint):
            hypothesis = {**self.springs, spring: (stiffness, a)}
            assembly = with_presliding(self.base, hypothesis)
            start = assembly.parameters.x_with(values_by_name(self.fit.parameters.free_names, self.x))
            fit, _ = _on_line_subset(assembly, start)
            try:
                end = solve(fit.problem, start, ROUGH, 2 * LIMITS.iterations)
            except FitError:
                continue
            values, index = fit.parameters.as_dict(end.x), fit.parameters.free_names.index(relaxation(joint))
            margin = np.min(np.abs([ends[index] - end.x[index] for ends in fit.parameters.x_bounds]))
            if margin > 1e-3:  # else it is a spring or a damper
                springs = {s: (values[s.names[0]], 1 / values[relaxation(s.joint)]) for s in hypothesis}
                yield replace(self, springs=springs, fit=fit, x=end.x, cost=end.cost)


def _with_all(state: _State, joints: Sequence[str]) -> _State:
    """Add springs motor by motor, in order of predicted drop, if the drop of V is significant."""
    by_chance, remaining = chi_square_limit(2, LIMITS.false_alarm_rate), list(joints)
    first = state
    while remaining:
        predicted = [state.predicted(joint) for joint in remaining]
        if not max(predicted) > PREDICTED_FRACTION * by_chance * state.cost_ratio:
            break
        joint = remaining.pop(int(np.argmax(predicted)))
        best = min(state.trials(joint), key=lambda trial: trial.cost, default=state)
        state = best if state.cost - best.cost > by_chance * best.cost_ratio else state
    # Residuals of compensated friction are not Gaussian.
    return state if first.cost - state.cost > LIMITS.min_drop * state.cost_ratio else first


def _on_line_subset(assembly: Assembly, x: FloatArray) -> tuple[ElasticFit, float]:
    """Return the fit linearised at x (n_x,) on some lines, and their fraction of all residuals."""
    whole = assembly.at(x)
    fit = replace(whole, frfs=tuple(map_chunks(line_subset(whole, RESIDUALS), whole.frfs, assembly.home)), home=SERIAL)
    return fit, fit.n_residuals / max(whole.n_residuals, 1)


def _columns(evaluated: EvaluatedResponse, rates: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    """Yield joint and dr/d(stiffness) (n_a, N) for each motor with a measured motion."""
    kernel, G = evaluated.frf.kernel, evaluated.G
    model, s = kernel.model, laplace_variable(kernel.freq_hz[:, None, None])
    for j, motor in enumerate(model.inputs):
        if motor in model.outputs:
            by_angle = G[:, :, [j]] * (G[:, [model.outputs.index(motor)]] / s ** MOTION_ORDER[model.quantity])
            yield motor.removeprefix("motor "), -evaluated.whitened(np.stack([-by_angle * s / (s + a) for a in rates]))


def _torque_per_angle(responses: Sequence[Response], location: str) -> float:
    """Return the median of a motor's torque over its angle, or over its largest motion, N m/rad."""
    ratios = []
    for G in (response for response in responses if location in response.inputs):
        motions = np.abs(G.G[:, :, G.inputs.index(location)])
        i = G.outputs.index(location) if location in G.outputs else int(np.argmax(motions.mean(axis=0)))
        ratios.append((2 * np.pi * G.freq_hz) ** MOTION_ORDER[G.quantity] / np.maximum(motions[:, i], 1e-300))
    return float(np.median(np.concatenate(ratios)))


def _rates(responses: Sequence[Response]) -> FloatArray:
    """Return the rates (n_a,) of the starts, 1/s."""
    return np.geomspace(*rate_band(responses), N_RATES)


def rate_band(responses: Sequence[Response]) -> tuple[float, float]:
    """Return the lowest and highest angular frequency of the lines, rad/s."""
    lines = np.concatenate([response.freq_hz for response in responses])
    return 2 * np.pi * float(lines[lines > 0].min()), 2 * np.pi * float(lines.max())


def relaxation(joint: str) -> str:
    """Return the name of the relaxation time 1 / a of a motor's friction, s."""
    return f"relaxation_{joint}"


def with_presliding(assembly: Assembly, springs: Springs) -> Assembly:
    """Return the assembly with free springs at motors; start values: stiffness s and rate a."""
    parameters = with_relaxing_springs(assembly.parameters, springs, rate_band(assembly.responses))
    linearisation = replace(assembly.linearisation, presliding=tuple(springs))
    return replace(assembly, parameters=parameters, linearisation=linearisation)


def with_relaxing_springs(parameters: Parameters, springs: Springs, band: tuple[float, float]) -> Parameters:
    """Insert stiffness and relaxation time of each spring before the delay. band: lowest and highest rad/s."""
    low, high = band
    times = 1 / (RATE_BOUNDS[1] * high), 1 / (RATE_BOUNDS[0] * low)
    middle = Prior(1 / math.sqrt(low * high), TIME_STD)
    numbers: list[Parameter] = []
    for spring, (s, a) in springs.items():
        (stiffness, damping), time = spring.names, relaxation(spring.joint)
        start = min(max(1 / a, times[0]), times[1])  # within the bounds despite rounding
        prior = Prior(s, STIFFNESS_STD)
        numbers += [
            Parameter(stiffness, s, "N*m/rad", 1e-4 * s, 1e4 * s, True, prior=prior, is_nuisance=True),
            Parameter(damping, s / a, "N*m*s/rad", log=True, tie=Tie(stiffness, 1.0, time)),
            Parameter(time, start, "s", *times, True, prior=middle, ratio=True, is_nuisance=True),
        ]
    members = parameters.parameters
    at = [p.name for p in members].index(DELAY)
    return Parameters((*members[:at], *numbers, *members[at:]))


def are_identified(result: Result, springs: Sequence[RelaxingSpring]) -> bool:
    """Return True if the stiffness of at least one spring has a standard deviation below MAX_STD.

    Not the rate: without relaxation, or for a pure damper, the rate is not identifiable.
    """
    std = values_by_name(result.parameters.free_names, result.std_of_x)
    return any(std[s.names[0]] < MAX_STD for s in springs)


def without_presliding(result: Result, assembly: Assembly, previous: Result) -> Result:
    """Return the result with the springs in `presliding` and in notes instead of among its parameters.

    The covariance of the other parameters includes their uncertainty.  previous: result of the fit without springs.
    """
    springs = assembly.linearisation.presliding
    if not springs:
        return result
    names = {*element_names(springs), *(relaxation(spring.joint) for spring in springs)}
    is_kept = np.array([name not in names for name in result.parameters.free_names])

    def rows(values: FloatArray) -> FloatArray:
        return values[is_kept] if len(values) == len(is_kept) else values

    presliding = tuple(_presliding(result, spring, assembly) for spring in springs)
    parameters = Parameters(tuple(p for p in result.parameters if p.name not in names))
    robot = replace(assembly.linearisation, presliding=())
    frfs = replace(assembly, parameters=parameters, linearisation=robot).at(rows(result.x)).frfs
    of_x = ("x", "at_bound", "profile95", "bootstrap95", "information_band_hz", "averaging_fraction")
    fields: dict[str, Any] = {name: rows(getattr(result, name)) for name in (*of_x, "persistent_fraction")}
    without = replace(
        result,
        **fields,
        parameters=parameters,
        covariance=result.covariance[np.ix_(is_kept, is_kept)],
        information_fraction=result.information_fraction[:, is_kept],
        starts=tuple(replace(start, x=rows(start.x), x_start=rows(start.x_start)) for start in result.starts),
        indices=tuple(replace(index, effects=rows(index.effects)) for index in result.indices),
        linear=tuple(frf.kernel.model for frf in frfs),
        presliding=presliding,
    )
    has_effect = _has_effect(previous, without)
    notes = (presliding_note(each, previous.exceeds_noise, has_effect) for each in presliding)
    return replace(without, notes=(*result.notes, *notes))


def _has_effect(previous: Result, current: Result) -> bool:
    """Return True if a stiffness or a damping changed by more than `LIMITS.effect` or `LIMITS.effect_on_damping`."""
    limits = {"N*m/rad": LIMITS.effect, "N/m": LIMITS.effect} | dict.fromkeys(DAMPING_UNITS, LIMITS.effect_on_damping)
    moves = zip(current.parameters.of_interest, np.abs(current.x - previous.x).tolist(), strict=False)
    return any(p.log and move > limits.get(p.unit, math.inf) for p, move in moves)


def _presliding(result: Result, spring: RelaxingSpring, assembly: Assembly) -> Presliding:
    values, free, location = result.values, result.parameters.free_names, f"motor {spring.joint}"
    s, a = values[spring.names[0]], 1 / values[relaxation(spring.joint)]
    std = values_by_name(free, result.std_of_x)
    times = [time for response in assembly.responses for time in _between_reversals(response, location)]
    unit = "N/m" if assembly.robot.sliding((location,)) else "N*m/rad"
    stds = std[spring.names[0]] * s, std[relaxation(spring.joint)] * a
    # a = E|v| / z applies to friction, not to a compensation error.
    amplitude = a * float(np.median(times)) if times and spring.sign > 0 else math.nan
    return Presliding(location, unit, spring.sign * s, stds[0], a, stds[1], amplitude)


def _between_reversals(response: Response, location: str) -> Iterator[float]:
    """Yield the mean time between two reversals of Gaussian motion, pi sigma_v / sigma_a, in s (Rice, 1945)."""
    motion = response.motion
    if motion is not None and location in motion.motors:
        j, omega = motion.motors.index(location), 2 * np.pi * motion.freq_hz
        power = motion.power[:, j, j].real
        yield float(np.pi * np.sqrt((omega**2 @ power) / max(float(omega**4 @ power), 1e-300)))


def presliding_note(spring: Presliding, exceeds_noise: bool, has_effect: bool) -> Note:
    """Return a note on a spring: a warning if V exceeds the noise without springs, or if the springs change k or d.

    No warning for a negative spring within the noise: an error of the friction compensation; F_c can still be correct.
    """
    k, a = f"{spring.stiffness:.3g} +- {spring.stiffness_std:.2g}", f"{spring.rate:.3g} +- {spring.rate_std:.2g}"
    text = (
        f"{spring.place}: model and intervals include presliding friction, a spring of {k} {spring.unit} (link side) "
        f"that relaxes at {a} 1/s"
    )
    if not (exceeds_noise or (has_effect and spring.stiffness > 0)):
        return Note("fit/presliding", text, severity="information")
    if AMPLITUDES[0] < spring.amplitude < AMPLITUDES[1]:
        text += (
            f". The motor moves about {spring.amplitude:.2g} presliding distances between two reversals (limit "
            f"{AMPLITUDES[1]:g})"
        )
    advice = "Do not use the Coulomb torque of this motor. To identify it, increase the amplitude of the excitation"
    return Note("fit/presliding", f"{text}. {advice}")
