r"""Responses at the tool against those of the motors: are both of one robot?

The fit to the motors' responses alone, x_m with covariance C, and the residuals r of the responses at the tool,

.. math:: T = \min_x \; |r(x)|^2 + (x - x_m)^T C^{-1} (x - x_m) \sim \chi^2

by a few damped steps of Gauss and Newton. Where T is beyond chance, or the factor rho by which all responses at the
tool are larger, the cause is that, of those below, with which T is smallest: another reading of force and motion (sign,
axis, quantity, motors that were not as stated), or a further unknown (a common factor, a delay, one spring).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import permutations
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note
from elastid.base.statistics import chi_square_limit
from elastid.covariance import scaled
from elastid.fit.assembly import Assembly
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.least_squares import RESIDUALS, as_real
from elastid.fit.problem.part import Part, mixed
from elastid.fit.result import Result, largest_by_chance
from elastid.fit.static_agreement import ToolAgreement, ToolComparison
from elastid.record import MOTION_ORDER
from elastid.response import Response


@dataclass(frozen=True)
class ToolLimits:
    """Thresholds of a disagreement: each test errs once in 700 fits (scripts/studies/results.csv)."""

    tail: float = 1 / 700  # probability of T, and of the factor, by chance
    unreached: float = 30.0  # std of x in a direction that the motors' responses do not reach
    steps: int = 12
    progress: float = 0.1  # of T, below which a step is the last
    share: float = 0.5  # of T beyond its degrees of freedom, that a cause must explain
    alternative: float = 12.0  # of T beyond 1.05 of the least, within which a further cause is named
    largest: float = 0.9  # of a further unknown: ln of a stiffness, a factor less 1


LIMITS = ToolLimits()
# dG (F, n_y, n_u) of a further unknown, of the model's G, its slopes to x, and s = j omega.
Column: TypeAlias = Callable[[ComplexArray, ComplexArray, ComplexArray], ComplexArray]


@dataclass(frozen=True, eq=False)
class _Joint:
    """Responses at the tool with what the motors say: x_m (n_x,) and a root L of C = L L^T, x = x_m + L z."""

    fit: ElasticFit
    x: FloatArray
    root: FloatArray

    def least(self, column: Column | None = None) -> tuple[float, float, float]:
        """T and the further unknown with its std, NaN without a column."""
        z = np.zeros(self.root.shape[1] + (column is not None))
        best, gradient, H = self._at(z, column)
        damping = 0.0
        for _ in range(LIMITS.steps):
            tried = z - np.linalg.lstsq(H + damping * np.diag(np.diag(H)), gradient)[0]
            cost, *slopes = self._at(tried, column)
            if not cost < best:
                damping = max(10 * damping, 1e-2)
                continue
            is_last = best - cost < LIMITS.progress
            z, best, (gradient, H), damping = tried, cost, slopes, damping / 10
            if is_last:
                break
        if column is None:
            return best, np.nan, np.nan
        std = np.sqrt(max(np.linalg.pinv(H)[-1, -1], 0.0)) if H[-1, -1] > 0 else np.inf
        return best, float(z[-1]), float(std)

    def _at(self, z: FloatArray, column: Column | None) -> tuple[float, FloatArray, FloatArray]:
        """T, half its gradient and J^T J at z (n,)."""
        n = self.root.shape[1]
        x, own = self.x + self.root @ z[:n], np.append(z[:n], 0.0) if column is not None else z
        cost, gradient, H = float(own @ own), own.copy(), np.eye(len(z))
        if column is not None:
            H[-1, -1] = 0.0
        with np.errstate(all="ignore"):
            try:
                for part in self.fit.parts:
                    r, J = self._part(part, x, column, float(z[-1]))
                    cost, gradient, H = cost + float(r @ r), gradient + J.T @ r, H + J.T @ J
            except np.linalg.LinAlgError:
                return np.inf, gradient, H
        # Far away slopes overflow before the cost does.
        return cost if np.isfinite(cost) and np.isfinite(H).all() else np.inf, gradient, H

    def _part(self, part: Part, x: FloatArray, column: Column | None, size: float) -> tuple[FloatArray, FloatArray]:
        """Whitened residuals (N,) and their slopes (N, n)."""
        theta, s = self.fit.theta(part, x), (2j * np.pi * part.kernel.freq_hz[:, None, None]).astype(complex)
        G, dG = part.kernel.evaluate(theta)
        chain = self.fit.parameters.jacobian(x, part.configuration)[part.kernel.places]
        slopes = np.tensordot((chain @ self.root).T, dG, axes=1)
        if column is not None:
            further = column(G, np.tensordot(chain.T, dG, axes=1), s)
            G, slopes = G + size * further, np.concatenate([slopes, further[None]])
        e, slope = RESIDUALS[part.criterion](part.measured, G)
        used, mixing = part.gain > 0, part.mixing
        r, J = np.where(used, part.gain * e, 0.0), np.where(used, -part.gain * slope, 0.0) * slopes
        if mixing is not None:
            r, J = mixed(mixing, r), mixed(mixing, J)
        return as_real(r).ravel(), as_real(J).reshape(len(J), -1).T


def tool_agreement(assembly: Assembly, alone: Result) -> ToolAgreement:
    """Responses at the tool, those of `assembly`, next to `alone`, the fit to the motors' responses."""
    now = _joint(assembly.with_floor(alone.floor), alone)
    dof = now.fit.n_residuals
    scale = alone.model_error**2 if alone.exceeds_noise else 1.0
    T = now.least()[0]
    _, factor, std = now.least(_factor)
    is_other_size = factor**2 > scale * chi_square_limit(1, LIMITS.tail) * std**2
    is_beyond = scale * dof * largest_by_chance(dof) < T or is_other_size
    cause, is_misread = _cause(assembly, alone, now, T) if is_beyond else ("", False)
    compared = tuple(_compared(G, part, now) for G, part in zip(assembly.responses, now.fit.parts, strict=True))
    return ToolAgreement(compared, 1 + factor, std, T, dof, cause, is_misread)


def _joint(assembly: Assembly, alone: Result) -> _Joint:
    C = alone.covariance.copy()
    unknown = ~np.isfinite(np.diag(C))
    C[unknown] = C[:, unknown] = 0.0
    C[unknown, unknown] = LIMITS.unreached**2
    size = np.sqrt(np.maximum(np.diag(C), 1e-300))
    values, V = np.linalg.eigh(C / np.outer(size, size))
    root = size[:, None] * V * np.sqrt(np.maximum(values, 0.0))
    return _Joint(replace(assembly, parameters=alone.parameters).at(alone.x, assembly.spec.criterion), alone.x, root)


def _compared(response: Response, part: Part, now: _Joint) -> ToolComparison:
    G, used = part.kernel.response(now.fit.theta(part, now.x)), part.gain > 0
    ratio = np.abs(response.G[used]) / np.maximum(np.abs(G[used]), 1e-300)
    rms = float(np.sqrt(np.mean((20 * np.log10(np.maximum(ratio, 1e-300))) ** 2))) if used.any() else np.nan
    return ToolComparison(response.configuration.name, response.motors, response.inputs, response.outputs, rms)


def _factor(G: ComplexArray, slopes: ComplexArray, s: ComplexArray) -> ComplexArray:
    return G


def _delay(G: ComplexArray, slopes: ComplexArray, s: ComplexArray) -> ComplexArray:
    return np.asarray(-s * G)


def _of_spring(i: int) -> Column:
    return lambda G, slopes, s: np.asarray(slopes[i])


def _cause(assembly: Assembly, alone: Result, now: _Joint, T: float) -> tuple[str, bool]:
    """The likeliest cause, and others that explain as much; whether it is another reading."""
    tried: list[tuple[float, str]] = []
    for responses, words in _readings(assembly.responses):
        other = replace(assembly, responses=responses).with_floor(alone.floor)
        tried.append((_joint(other, alone).least()[0], words))
    readings = [words for _, words in tried]
    for column, describe in _columns(alone):
        least, size, _ = now.least(column)
        if abs(size) < LIMITS.largest:  # beyond it another reading explains what this column imitates
            tried.append((least, describe(size)))
    tried.sort(key=lambda each: each[0])
    best, excess = tried[0][0], T - now.fit.n_residuals
    if not T - best > LIMITS.share * excess:
        return (
            "no single cause explains it: check place, direction, sign and unit of force and motion, the angles, and "
            "whether the motors were as stated"
        ), False
    near = [words for least, words in tried if least < 1.05 * best + LIMITS.alternative]
    return " or ".join(near[:3]), near[0] in readings


def _readings(responses: Sequence[Response]) -> Iterator[tuple[tuple[Response, ...], str]]:
    """All responses at the tool as they would be read otherwise, with words."""

    def turned(sign: float, power: int) -> tuple[Response, ...]:
        every = []
        for G in responses:
            s = 2j * np.pi * G.freq_hz[:, None, None]
            noise, total = (scaled(own, np.abs(s) ** (2 * power)) for own in (G.noise, G.total))
            every.append(replace(G, G=sign * G.G * s**power, noise=noise, total=total))
        return tuple(every)

    yield turned(-1.0, 0), "force and motion have opposite signs: reverse the sign of one of them"
    orders = {order: name for name, order in MOTION_ORDER.items()}
    for power in (-2, -1, 1, 2):
        stated = {MOTION_ORDER[G.quantity] for G in responses}
        if len(stated) == 1 and (held := orders.get(min(stated) - power)):
            yield turned(1.0, power), f"the file holds the {held}, not the {orders[min(stated)]}"
    for motors in ("held", "free"):
        if any(G.motors != motors for G in responses) and _lets(responses, motors):
            yield tuple(replace(G, motors=motors, loop=None) for G in responses), f"the motors were {motors}"
    for axes in permutations("xyz"):
        if "".join(axes) != "xyz" and (other := _along(responses, dict(zip("xyz", axes, strict=True)))) is not None:
            yield other, f"the axes x, y and z of the force are {', '.join(axes)} of the robot's frame"


def _lets(responses: Sequence[Response], motors: str) -> bool:
    """False where motors that are held would be outputs."""
    return motors != "held" or not any(place.startswith("motor ") for G in responses for place in G.outputs)


def _along(responses: Sequence[Response], axes: dict[str, str]) -> tuple[Response, ...] | None:
    """The same with forces along other axes of their frames; None where a force is none along an axis."""
    names = [place.rpartition(" ") for G in responses for place in G.inputs]
    if any(axis not in axes for _, _, axis in names):
        return None
    renamed = []
    for G in responses:
        parts = [place.rpartition(" ") for place in G.inputs]
        renamed.append(replace(G, inputs=tuple(f"{head} {axes[axis]}" for head, _, axis in parts)))
    return (
        tuple(renamed) if any(new.inputs != old.inputs for new, old in zip(renamed, responses, strict=True)) else None
    )


def _columns(alone: Result) -> Iterator[tuple[Column, Callable[[float], str]]]:
    yield _factor, _words_of_factor
    yield _delay, _words_of_delay
    for i, parameter in enumerate(alone.parameters.free):
        if parameter.stands_for.startswith("k_") and parameter.log:
            yield _of_spring(i), partial(_words_of_spring, parameter.name)


def _words_of_factor(by: float) -> str:
    return (
        f"all responses at the tool are {1 + by:.4g} times as large: check unit and calibration of hammer and sensor, "
        "and whether the current of the motors is their torque"
    )


def _words_of_delay(by: float) -> str:
    return f"motion behind force by {1e3 * by:.3g} ms: a filter, or channels that were not simultaneous"


def _words_of_spring(name: str, by: float) -> str:
    return (
        f"as if {name} were {np.exp(by):.3g} times as large at the small motions of the tool as at those of the "
        "motors, as friction or backlash of that gear makes it"
    )


def tool_contradiction(tool: ToolAgreement) -> str:
    """The disagreement with its cause."""
    return f"responses at the tool contradict those of the motors: {tool.words}; {tool.cause}"


def tool_notes(result: Result) -> tuple[Note, ...]:
    """A warning where responses at the tool contradict those of the motors."""
    if result.tool is None or not result.tool.disagrees:
        return ()
    both = "" if result.tool.is_misread else ", and their intervals contain those of both together"
    alone = f"the numbers are those of the motors' responses alone{both}"
    return (Note("fit/tool", f"{tool_contradiction(result.tool)}; {alone}"),)
