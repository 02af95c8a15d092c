r"""Presliding friction in measured responses: relaxing springs of motors, freed where V falls by more than chance.

V has many valleys in s and a, so that a solve starts from either sign of s and from rates in the band; rates stay near
the band, where a spring that relaxes is neither a spring nor a damper.  Springs are added motor by motor, and count
against the likeliest other cause by the odds of both, with the Bayesian information criterion for their numbers.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError, Note
from elastid.base.statistics import chi_square_limit
from elastid.fit.assembly import Assembly, is_friction_taken_out
from elastid.fit.diagnosis.hypothesis import Evidence
from elastid.fit.diagnosis.judge import RESIDUALS, temper
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.sensitivities import thinning
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.result import Presliding, Result
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.linear.linear_model import DELAY, LinearModel, is_load
from elastid.linear.presliding import RelaxingSpring, element_names, without_springs
from elastid.parameters import Parameter, Parameters, Prior, Tie
from elastid.response import Response
from elastid.robot import Robot

# Std of the logarithms of a stiffness and of a relaxation time about their starts.
STIFFNESS_STD, TIME_STD = 3.0, 1.5
# Bounds of a rate over the lowest and the highest angular frequency of the lines; where in the band (of its logarithm)
# rates start.
RATE_BOUNDS, STARTS = (1 / 30, 2.4), (0.25, 0.75)
FIRST_SHARE = 0.1  # of a motor's median dynamic stiffness, at which a stiffness starts
ROUNDS = 2  # over all motors
# Probability of V, by the noise alone, below which springs are sought, and of a drop by one of all springs tried.
SOUGHT, CHANCE = 0.1, 1e-3
# Of the motion between two reversals over the presliding distance, between which a linear model is off.
AMPLITUDE = (0.2, 4.0)

Springs = Mapping[RelaxingSpring, tuple[float, float]]  # s and a of each


def find_presliding(evidence: Evidence) -> tuple[Assembly, FloatArray] | None:
    """Assembly with the relaxing springs of motors, and its start x (n_x,); None where V shows none.

    Motors whose friction was compensated, or all where V is above the noise.  None for responses by forces at the tool
    and for load tests, and where another cause has better odds.
    """
    assembly, result = evidence.assembly, evidence.result
    dof = max(result.cost_dof, 1.0)
    is_large = result.cost > result.cost_expected * chi_square_limit(dof, SOUGHT) / dof
    motors = _motors(assembly.responses, assembly.linearisation.model.robot, is_large)
    if assembly.loads is not None or not motors or not result.noise_is_known:
        return None
    bare = assembly if assembly.spec.weights.model_error is not None else assembly.with_floor(None)
    search = _Search(bare, evidence.optimum.end.x)
    if not search.run(motors):
        return None
    drop, count = search.first - search.cost, len(search.springs)
    excess = search.first - search.level * search.dof
    if evidence.is_unexplained and drop < LIMITS.explained_share * excess:
        return None
    if evidence.scores is not None and (cause := evidence.cause) is not None:
        scale = temper(evidence.scores)
        odds = drop * evidence.scores.lines / scale - 2 * count * math.log(evidence.optimum.fit.n_residuals)
        if odds < cause.drop * evidence.scores.lines / scale - cause.occam:
            return None
    freed = with_presliding(assembly, search.springs)
    return freed, start_of(freed.parameters, search.parameters, search.x)


def _motors(responses: Sequence[Response], robot: Robot, is_all: bool) -> list[str]:
    """Joints of the motors that may have presliding friction."""
    if any(map(is_load, (place for response in responses for place in response.inputs))):
        return []
    places = {
        place
        for response in responses
        for j, place in enumerate(response.inputs)
        if is_all
        or (is_friction_taken_out(response) and response.bias is not None and np.any(response.bias[:-1, j]))
    }
    return [joint for joint in robot.driven_names if f"motor {joint}" in places]


class _Search:
    """Springs found so far, the parameters with their numbers, x (n_x,) and V there, on thinned lines."""

    def __init__(self, assembly: Assembly, x: FloatArray) -> None:
        self.assembly, self.springs, self.parameters = assembly, dict[RelaxingSpring, tuple[float, float]](), assembly.parameters
        whole = assembly.at(x, assembly.spec.criterion)
        self.thin = thinning(whole, RESIDUALS // 10)
        fit = replace(whole, parts=tuple(map(self.thin, whole.parts)))
        self.dof = fit.problem.dof
        self.share = fit.n_residuals / max(whole.n_residuals, 1)
        end = solve(fit.problem, x, ROUGH, LIMITS.iterations)
        self.x, self.cost, self.first = end.x, end.cost, end.cost
        self.stiffness = _dynamic_stiffness(assembly.responses)

    @property
    def level(self) -> float:
        """V over its degrees of freedom, 1 at least: a drop by chance grows with it."""
        return max(self.cost / self.dof, 1.0)

    def run(self, motors: Sequence[str]) -> bool:
        """Add springs as long as V falls by more than chance; True if there are any."""
        self.limit = chi_square_limit(2, CHANCE / (len(motors) * 2 * len(STARTS)))
        for joint in list(motors) * ROUNDS:
            if joint not in {spring.joint for spring in self.springs}:
                self._add(joint)
        return bool(self.springs)

    def _add(self, joint: str) -> None:
        low, high = rate_band(self.assembly.responses)
        best = None
        for sign, part in product((1, -1), STARTS):
            start = FIRST_SHARE * self.stiffness[joint], low * (high / low) ** part
            trial = with_presliding(self.assembly, {**self.springs, RelaxingSpring(joint, sign): start})
            fit = trial.at(start_of(trial.parameters, self.parameters, self.x), trial.spec.criterion)
            fit = replace(fit, parts=tuple(map(self.thin, fit.parts)))
            try:
                end = solve(fit.problem, start_of(trial.parameters, self.parameters, self.x), ROUGH, 2 * LIMITS.iterations)
            except FitError:
                continue
            if best is None or end.cost < best[0].cost:
                best = end, trial.parameters, RelaxingSpring(joint, sign)
        if best is None:
            return
        end, parameters, spring = best
        if self.cost - end.cost < self.limit * max(end.cost / self.dof, 1.0) or _is_at_bound(parameters, end.x, joint):
            return
        values = parameters.as_dict(end.x)
        every = (*self.springs, spring)
        self.springs = {s: (values[s.names[0]], 1 / values[relaxation(s.joint)]) for s in every}
        self.parameters, self.x, self.cost = parameters, end.x, end.cost


def _is_at_bound(parameters: Parameters, x: FloatArray, joint: str) -> bool:
    i = parameters.free_names.index(relaxation(joint))
    low, high = (ends[i] for ends in parameters.x_bounds)
    return not low + 1e-3 < x[i] < high - 1e-3


def _dynamic_stiffness(responses: Sequence[Response]) -> dict[str, float]:
    """Median torque over angle of each motor, by its joint, N m/rad; those that measure other places alone have none."""
    found: dict[str, list[FloatArray]] = {}
    for G in responses:
        s = 2 * np.pi * G.freq_hz
        for j, place in enumerate(G.inputs):
            i = G.outputs.index(place) if place in G.outputs else int(np.argmax(np.abs(G.G[:, :, j]).mean(axis=0)))
            found.setdefault(place.removeprefix("motor "), []).append(s ** _ORDER(G) / np.abs(G.G[:, i, j]))
    return {joint: float(np.median(np.concatenate(each))) for joint, each in found.items()}


def _ORDER(G: Response) -> int:
    from elastid.record import MOTION_ORDER

    return MOTION_ORDER[G.quantity]


def rate_band(responses: Sequence[Response]) -> tuple[float, float]:
    """Lowest and highest angular frequency of the lines, rad/s."""
    lines = np.concatenate([response.freq_hz for response in responses])
    return 2 * np.pi * float(lines[lines > 0].min()), 2 * np.pi * float(lines.max())


def relaxation(joint: str) -> str:
    """Name of the relaxation time 1 / a of a motor's friction, s."""
    return f"relaxation_{joint}"


def with_presliding(assembly: Assembly, springs: Springs) -> Assembly:
    """Assembly with springs at motors that start at s, N m/rad, and a, 1/s."""
    low, high = rate_band(assembly.responses)
    shortest, longest = 1 / (RATE_BOUNDS[1] * high), 1 / (RATE_BOUNDS[0] * low)
    middle = Prior(1 / math.sqrt(low * high), TIME_STD)
    numbers: list[Parameter] = []
    times: list[Parameter] = []
    for spring, (s, a) in springs.items():
        (stiffness, damping), time = spring.names, relaxation(spring.joint)
        prior, ends = Prior(s, STIFFNESS_STD), (1e-4 * s, 1e4 * s)
        numbers.append(Parameter(stiffness, s, "N*m/rad", *ends, log=True, prior=prior, is_nuisance=True))
        numbers.append(Parameter(damping, s / a, "N*m*s/rad", log=True, tie=Tie(stiffness, 1.0, time)))
        times.append(Parameter(time, 1 / a, "s", shortest, longest, log=True, prior=middle, ratio=True, is_nuisance=True))
    every = assembly.parameters.parameters
    at = [p.name for p in every].index(DELAY)
    linearisation = replace(assembly.linearisation, presliding=tuple(springs))
    parameters = Parameters((*every[:at], *numbers, *every[at:], *times))
    return replace(assembly, parameters=parameters, linearisation=linearisation)


def start_of(parameters: Parameters, known: Parameters, x: FloatArray) -> FloatArray:
    """x (n_x,) of parameters: as in x of `known`, else their start."""
    values = dict(zip(known.free_names, x.tolist(), strict=True))
    return np.array([values.get(p.name, p.to_x(p.value)) for p in parameters.free])


def without_presliding(result: Result, springs: Sequence[RelaxingSpring], responses: Sequence[Response]) -> Result:
    """Result with the numbers of springs in `presliding` and as notes, and no longer among its parameters.

    The covariance of the others includes theirs.
    """
    if not springs:
        return result
    names = {*element_names(springs), *(relaxation(spring.joint) for spring in springs)}
    kept = np.array([name not in names for name in result.parameters.free_names])
    found = tuple(_presliding(result, spring, responses) for spring in springs)

    def rows(values: FloatArray) -> FloatArray:
        return values[kept] if len(values) == len(kept) else values

    return replace(
        result,
        parameters=Parameters(tuple(p for p in result.parameters if p.name not in names)),
        x=result.x[kept],
        covariance=result.covariance[np.ix_(kept, kept)],
        at_bound=result.at_bound[kept],
        profile95=rows(result.profile95),
        bootstrap95=rows(result.bootstrap95),
        information_fraction=result.information_fraction[:, kept],
        information_band_hz=rows(result.information_band_hz),
        averaging_fraction=rows(result.averaging_fraction),
        persistent_fraction=rows(result.persistent_fraction),
        starts=tuple(replace(s, x=rows(s.x), x_start=rows(s.x_start)) for s in result.starts),
        indices=tuple(replace(index, effects=rows(index.effects)) for index in result.indices),
        linear=tuple(without_springs(linear, springs) for linear in result.linear),
        presliding=found,
        notes=(*result.notes, *(_note(each) for each in found)),
    )


def _presliding(result: Result, spring: RelaxingSpring, responses: Sequence[Response]) -> Presliding:
    values, free = result.values, result.parameters.free_names
    std = np.sqrt(np.diag(result.covariance))
    stiffness, time = spring.names[0], relaxation(spring.joint)
    s, a = values[stiffness], 1 / values[time]
    place = f"motor {spring.joint}"
    rests = [rest for response in responses for rest in _between_reversals(response, place)]
    return Presliding(
        place, spring.sign * s, float(std[free.index(stiffness)]) * s, a, float(std[free.index(time)]) * a,
        a * float(np.median(rests)) if rests else math.nan,
    )  # fmt: skip


def _between_reversals(response: Response, place: str) -> Iterator[float]:
    """Mean time between two reversals of a motor in Gaussian motion, s: pi sigma_v / sigma_a (Rice, 1945)."""
    motion = response.motion
    if motion is not None and place in motion.motors:
        j, omega = motion.motors.index(place), 2 * np.pi * motion.freq_hz
        power = motion.power[:, j, j].real
        yield float(np.pi * np.sqrt((omega**2 @ power) / max(float(omega**4 @ power), 1e-300)))


def _note(found: Presliding) -> Note:
    s, unit = abs(found.stiffness), "N*m/rad"
    text = (
        f"{found.place}: presliding friction {'' if found.stiffness > 0 else 'compensated too much, by '}"
        f"of {s:.3g} +- {found.stiffness_std:.2g} {unit} that relaxes at {found.rate:.3g} +- {found.rate_std:.2g} 1/s, "
        "estimated with the other parameters"
    )
    if AMPLITUDE[0] < found.amplitude < AMPLITUDE[1]:
        text += (
            f". The motion between two reversals is about {found.amplitude:.2g} of the presliding distance: increase "
            "the amplitude to 4 of it or more, which narrows the intervals, and do not use this Coulomb torque"
        )
    return Note("fit/presliding", text, found.place)
