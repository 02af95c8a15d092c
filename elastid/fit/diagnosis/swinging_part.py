r"""A part of the last body that swings on a spring: a tool on a soft plate, a gripper on its hose.

Its carrier moves by J dq / dt (6,) at its centre of mass.  The part, whose inertia is within the body's, moves in one
way s besides, of unit modal mass and resonance f_0, and pulls with h (6,), forces in sqrt(kg), moments in m sqrt(kg):

.. math:: M \to \begin{bmatrix} M & J^T h \\ h^T J & 1 \end{bmatrix}, \quad
          K \to \begin{bmatrix} K & 0 \\ 0 & \omega_0^2 \end{bmatrix}, \quad
          D \to \begin{bmatrix} D & 0 \\ 0 & \eta\, \omega_0^2 \end{bmatrix}

.. math:: \Delta Z = -\omega^2 \varphi\, J^T h h^T J, \qquad
          \varphi = \frac{\omega^2}{\omega_0^2 (1 + j \omega \eta) - \omega^2}

To first order the response is linear in h h^T: at each of some f_0 one least squares shows its largest direction.  The
solver follows the best of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.display import percent
from elastid.base.errors import ElastidError
from elastid.base.note import Note
from elastid.base.statistics import QUANTILE_95
from elastid.fit.diagnosis.hypothesis import Evidence
from elastid.fit.diagnosis.prediction import AS_READ, evaluate, settle, thinned
from elastid.fit.diagnosis.sensitivities import Evaluated
from elastid.fit.problem.elastic import ElasticFit, kernel_of
from elastid.fit.problem.inertia_barrier import moved_inertias
from elastid.fit.solve.solvers import ROUGH, solve
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import LinearModel, Slope
from elastid.linear.response.transfer import factor
from elastid.model.formulation import formulate
from elastid.parameters import Parameter, ParameterSet, Prior, Tie
from elastid.robot import FRAME_AXES, Body, Frame, Placement, Robot

SPRING, DAMPING, MARK = "k_swing", "d_swing", "swinging_part"
PATTERN = tuple(f"h_swing_{axis}" for axis in FRAME_AXES)
PAIRS = tuple(combinations_with_replacement(range(6), 2))


@dataclass(frozen=True)
class Limits:
    """Thresholds of the search for a part that swings, which begins only where V exceeds the noise."""

    frequency_step: float = 2.0**0.25  # ratio of neighbouring resonances
    loss_ratio: float = 0.05  # 2 zeta of the start: omega_0 d / k
    scan_loss: float = 0.2  # the same while f_0 is sought, between whose steps the resonance may be
    pattern_std: float = 0.5  # of h, relative to the roots of mass and inertia of what the last joint carries
    pattern_sizes: tuple[float, ...] = (1.0, 0.5, 0.25, 0.1)  # of the linear step, which goes too far by itself
    spring_std: float = 2.0  # of ln omega_0^2
    followed: int = 8  # resonances that the solver follows
    iterations: int = 25  # for each
    enough: float = 0.1  # of V without the part, below which no further resonance is followed
    hidden_share: float = 1 / 8  # of the last body's mass, of a tool as is usual
    hidden_ratio: float = 2.0  # of its resonance to the end of the band
    hidden_parts: int = 32  # configurations by which it is judged, at most


LIMITS = Limits()


@dataclass(frozen=True, eq=False)
class SwingingPart:
    """body: that carries it.  freq_hz: its resonance.  mass: of what swings at least, kg.  cost: V on thinned lines.

    x (n_x,): estimate of the fit's parameters with it.  occam: of `ranking`, of what was found besides.
    """

    body: str
    freq_hz: float
    mass: float
    cost: float
    x: FloatArray
    occam: float


def find_swinging_part(evidence: Evidence) -> SwingingPart | None:
    """The part of the last body with which V is lowest, of a resonance within the band; None where there is none."""
    fit, x = thinned(evidence.optimum.fit), evidence.optimum.end.x
    robot, evaluated = evidence.assembly.linearisation.model.robot, evaluate(fit, x)
    body = next(body for body in reversed(robot.bodies) if body.joints)
    scale = _scale(robot, body)
    try:
        motions = [scale[:, None] * J for J in _motions(evidence, fit, body)]
    except ElastidError:  # no robot stands there
        return None
    best, before = None, fit.evaluate(x).cost
    start_hz = min(float(e.part.kernel.freq_hz.min()) for e in evaluated)
    edge_hz = max(float(e.part.kernel.freq_hz.max()) for e in evaluated)
    for f_0, h in _starts(evaluated, motions, fit, x):
        try:
            sized = (_with_part(evidence, fit, x, motions, f_0, size * h) for size in LIMITS.pattern_sizes)
            swinging = min(sized, key=lambda each: each.evaluate(each.parameters.x).cost)
            start = swinging.parameters.x
            _, start = settle(AS_READ, swinging, start, np.ones(len(start), dtype=bool))
            end = solve(swinging.problem, start, ROUGH, LIMITS.iterations)
        except (ElastidError, np.linalg.LinAlgError):  # no robot stands there
            continue
        part = _part(body, scale, swinging, end.x, end.cost, evidence)
        # One beyond the band is a spring like any other, and explains what many of them do; one below it stands still.
        if start_hz < part.freq_hz < edge_hz and (best is None or part.cost < best.cost):
            best = part
        if best is not None and best.cost < LIMITS.enough * before:
            break
    return best


def find_hidden_tool(evidence: Evidence) -> tuple[Note, ...]:
    """A sentence on a tool that swings beyond the band, where it would move a stiffness out of its interval.

    Parameters and tolerances follow it, so that residuals show nothing:  Delta x = A^-1 J^T Delta G.  It swings along
    an axis of the last body, at the end of the link.
    """
    fit, x, result = thinned(evidence.optimum.fit), evidence.optimum.end.x, evidence.result
    every = math.ceil(len(fit.parts) / LIMITS.hidden_parts)
    robot, evaluated = evidence.assembly.linearisation.model.robot, evaluate(replace(fit, parts=fit.parts[::every]), x)
    fit = replace(fit, parts=tuple(e.part for e in evaluated))  # without those that nothing is known of
    body = next(body for body in reversed(robot.bodies) if body.joints)
    try:
        motions = _motions(evidence, fit, body)
    except ElastidError:  # no robot stands there
        return ()
    end_hz, lever = max(float(e.part.kernel.freq_hz.max()) for e in evaluated), np.array(body.center_of_mass)
    h = math.sqrt(LIMITS.hidden_share * body.mass) * np.array([[*e, *np.cross(lever, e)] for e in np.eye(3)])
    A, b = np.diag(fit.prior_slopes**2), np.zeros((len(x), 3))
    for e, J in zip(evaluated, motions, strict=True):
        s = 2j * np.pi * e.part.kernel.freq_hz
        phi = -(s**2) / ((2 * np.pi * LIMITS.hidden_ratio * end_hz) ** 2 + s**2)
        across = _across(e, J, fit.theta(e.part, x))
        columns = np.stack([sum(p[i] * p[j] * c for (i, j), c in zip(PAIRS, across, strict=True)) for p in h])
        A, b = A + every * e.information, b - every * e.rows @ e.whitened(-(s**2 * phi)[:, None, None] * columns).T
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    moved = np.linalg.lstsq(A / np.outer(size, size), b / size[:, None], rcond=1e-13)[0] / size[:, None]
    names = [p.name for p in result.parameters.asked]
    stiff = [i for i, name in enumerate(names) if name.startswith("k_") and result.parameters.asked[i].log]
    if not stiff:
        return ()
    limits = QUANTILE_95 * np.sqrt(np.diag(result.covariance)[stiff])
    over = np.abs(moved[stiff]) / np.maximum(limits, 1e-300)[:, None]
    place, axis = np.unravel_index(int(np.argmax(over)), over.shape)
    if not over[place, axis] > 1:
        return ()
    largest = sorted(stiff, key=lambda i: -abs(float(moved[i, axis])))[:2]
    changes = (f"{percent(abs(math.expm1(moved[i, axis])))} in {names[i]}" for i in largest)
    text = (
        f"no response shows a tool that swings beyond the band: an eighth of {body.name}, at "
        f"{LIMITS.hidden_ratio * end_hz:.3g} Hz along {'xyz'[axis]}, makes errors of {' and '.join(changes)}, within "
        f"the intervals from {LIMITS.hidden_ratio * end_hz * math.sqrt(over[place, axis]):.2g} Hz on; excite up to its "
        "resonance, or give it a body with a spring in the robot's file"
    )
    return (Note("fit/undetectable", text, severity="information"),)


def _scale(robot: Robot, body: Body) -> FloatArray:
    """sqrt of mass and inertia (6,) of a body and what is fixed to it, which h is relative to."""
    carried, names = [body], {body.name}
    for other in robot.all_bodies:
        if other.parent in names and not other.joints:
            carried.append(other)
            names.add(other.name)
    mass = sum(each.mass for each in carried)
    levers = (np.linalg.norm(np.array(each.placement.xyz) + each.center_of_mass) for each in carried[1:])
    inertia = np.trace(body.inertia_matrix) / 3 + sum(
        each.mass * lever**2 for each, lever in zip(carried[1:], levers, strict=True)
    )
    return np.asarray(np.sqrt(np.array([mass] * 3 + [max(float(inertia), 1e-3 * mass)] * 3)))


def _motions(evidence: Evidence, fit: ElasticFit, body: Body) -> list[FloatArray]:
    """J (6, n) of each configuration, of the body's centre of mass in its own axes."""
    robot = evidence.assembly.linearisation.model.robot
    marked = replace(robot, frames=(*robot.frames, Frame(MARK, body.name, Placement(body.center_of_mass))))
    model = formulate(marked, evidence.assembly.model)
    places, found = tuple(f"frame {MARK} {axis}" for axis in FRAME_AXES), []
    for linear in (part.kernel.model for part in fit.parts):
        point = equilibrium(model, model.theta, linear.configuration)
        C, _ = model.readout(point.q, model.theta, places)
        found.append(np.asarray(C.full() @ (np.eye(linear.n) if linear.Z is None else linear.Z)))
    return found


def _starts(
    evaluated: Sequence[Evaluated], motions: Sequence[FloatArray], fit: ElasticFit, x: FloatArray
) -> list[tuple[float, FloatArray]]:
    """f_0 and h (6,) in parts of the body, where V after a step is lowest, best first."""
    freq_hz = np.concatenate([e.part.kernel.freq_hz for e in evaluated])
    low, high = float(freq_hz[freq_hz > 0].min()), float(freq_hz.max())
    count = 1 + math.ceil(math.log(high / low) / math.log(LIMITS.frequency_step))
    across = [_across(e, J, fit.theta(e.part, x)) for e, J in zip(evaluated, motions, strict=True)]
    n_x, trials = len(fit.prior_slopes), []
    for f_0 in high / LIMITS.frequency_step ** np.arange(count):
        b = np.zeros(n_x + len(PAIRS))
        A = np.diag(np.concatenate([fit.prior_slopes**2, np.full(len(PAIRS), LIMITS.pattern_std**-2)]))
        for e, columns in zip(evaluated, across, strict=True):
            s = 2j * np.pi * e.part.kernel.freq_hz
            phi = -(s**2) / ((2 * np.pi * f_0) ** 2 * (1 + s * LIMITS.scan_loss / (2 * np.pi * f_0)) + s**2)
            J = np.concatenate([e.rows, -e.whitened(-(s**2 * phi)[:, None, None] * columns)])
            A += J @ J.T
            b += J @ e.residual
        size = np.sqrt(np.maximum(np.diag(A), 1e-300))
        step = -np.linalg.solve(A / np.outer(size, size) + 1e-12 * np.eye(len(b)), b / size) / size
        H = np.zeros((6, 6))
        for (i, j), value in zip(PAIRS, step[n_x:], strict=True):
            H[i, j] = H[j, i] = value
        power, directions = np.linalg.eigh(H)
        if power[-1] > 0:
            trials.append(
                (float(step @ b), float(f_0), math.sqrt(min(power[-1], LIMITS.pattern_std)) * directions[:, -1])
            )
    trials.sort(key=lambda trial: trial[0])
    return [(f_0, h) for _, f_0, h in trials[: LIMITS.followed]]


def _across(evaluated: Evaluated, J: FloatArray, theta: FloatArray) -> ComplexArray:
    """c (C Z^-1 J_i^T) (J_j Z^-1 B), both ways (21, F, n_y, n_u), of all pairs i <= j; theta (n_theta,): SI."""
    model, s = evaluated.part.kernel.model, np.asarray(2j * np.pi * evaluated.part.kernel.freq_hz, np.complex128)
    (M, D, K), (C, T) = model.matrices(theta), model.readout(theta)
    Z = K + s[:, None, None] * D + s[:, None, None] ** 2 * M
    reached = np.linalg.solve(Z, np.broadcast_to(J.T, (len(s), *J.T.shape)))  # Z^-1 J^T (F, n, 6)
    P = C @ reached + T @ reached / s[:, None, None] ** 2
    Q = reached.transpose(0, 2, 1) @ model.B
    gain = np.multiply.outer(factor(model, theta, s), np.outer(*model.channel_gains(theta)))
    pairs = [P[:, :, [i]] * Q[:, [j]] + (P[:, :, [j]] * Q[:, [i]] if i != j else 0.0) for i, j in PAIRS]
    return np.asarray(gain * np.array(pairs))


def _with_part(
    evidence: Evidence, fit: ElasticFit, x: FloatArray, motions: Sequence[FloatArray], f_0: float, h: FloatArray
) -> ElasticFit:
    """The fit from x (n_x,) with a part that swings, whose resonance and pattern are free."""
    own, stiffness = evidence.assembly.parameters, (2 * np.pi * f_0) ** 2
    further = (
        Parameter(SPRING, stiffness, "1/s^2", log=True, prior=Prior(stiffness, LIMITS.spring_std)),
        Parameter(DAMPING, 0.0, tie=Tie(SPRING, LIMITS.loss_ratio / (2 * np.pi * f_0))),
        *(Parameter(name, float(v), prior=Prior(0.0, LIMITS.pattern_std)) for name, v in zip(PATTERN, h, strict=True)),
    )
    now = own.with_means(x)
    of_model = (*(p for p in now if p.is_of_model), *further)
    parameters = ParameterSet((*of_model, *(p for p in now if not p.is_of_model)))
    parts = []
    for part, J in zip(fit.parts, motions, strict=True):
        model = with_part(part.kernel.model, J, own.expand(x, part.configuration))
        parts.append(replace(part, kernel=kernel_of(model, parameters, part.kernel.freq_hz), compressed=None))
    return ElasticFit(parameters, tuple(parts), moved_inertias(parameters, evidence.assembly.linearisation.model.robot))


def with_part(model: LinearModel, J: FloatArray, theta: FloatArray) -> LinearModel:
    """The model at theta (n_theta,) with a further coordinate s and its parameters, all 0.

    k_swing: omega_0^2, d_swing: eta omega_0^2, h_swing_x ...: pattern of the rows of J (6, n).
    """
    (M, D, K), (C, T) = model.matrices(theta), model.readout(theta)
    n, one = model.n, np.zeros((model.n + 1, model.n + 1))
    one[n, n] = 1.0

    def square(matrix: FloatArray | None) -> FloatArray | None:
        return None if matrix is None else np.pad(matrix, (0, 1))

    def wide(matrix: FloatArray | None) -> FloatArray | None:
        return None if matrix is None else np.pad(matrix, ((0, 0), (0, 1)))

    def tall(matrix: FloatArray | None) -> FloatArray | None:
        return None if matrix is None else np.pad(matrix, ((0, 1), (0, 0)))

    slopes = {
        name: Slope(square(s.M), square(s.D), square(s.K), wide(s.C), wide(s.T), tall(s.B))
        for name, s in model.slopes.items()
    }
    slopes |= {SPRING: Slope(K=one), DAMPING: Slope(D=one)}
    for name, row in zip(PATTERN, J, strict=True):
        pull = np.pad(np.zeros((n, n)), (0, 1))
        pull[n, :n] = pull[:n, n] = row
        slopes[name] = Slope(M=pull)
    Z = np.eye(n) if model.Z is None else model.Z
    return replace(
        model, parameters=(*model.parameters, SPRING, DAMPING, *PATTERN), theta_ref=np.append(theta, np.zeros(8)),
        M=np.pad(M, (0, 1)) + one,
        D=np.pad(D, (0, 1)), K=np.pad(K, (0, 1)), slopes=slopes, B=np.pad(model.acting(theta), ((0, 1), (0, 0))),
        C=np.pad(C, ((0, 0), (0, 1))), T=np.pad(T, ((0, 0), (0, 1))), Z=np.pad(Z, ((0, 0), (0, 1))),
    )  # fmt: skip


def _part(
    body: Body, scale: FloatArray, fit: ElasticFit, x: FloatArray, cost: float, evidence: Evidence
) -> SwingingPart:
    names, values = fit.parameters.free_names, dict(zip(fit.parameters.free_names, x.tolist(), strict=True))
    places = [names.index(name) for name in (SPRING, *PATTERN)]
    widths = np.array([LIMITS.spring_std] + [LIMITS.pattern_std] * len(PATTERN))
    # Of the new parameters, beyond what their priors are alone.
    C = np.linalg.pinv(fit.evaluate(x).hessian / 2, hermitian=True)[np.ix_(places, places)]
    _, narrowed = np.linalg.slogdet(C / np.outer(widths, widths))
    own = np.array([values[name] for name in evidence.result.parameters.free_names])
    h = scale * np.array([values[name] for name in PATTERN])
    freq_hz = math.sqrt(math.exp(values[SPRING])) / (2 * math.pi)
    return SwingingPart(body.name, freq_hz, float(h[:3] @ h[:3]), cost, own, -float(narrowed))
