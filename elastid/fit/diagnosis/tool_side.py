"""Responses at the tool against those of the motors: are both of one robot?

Where they are not (`second_source`), the cause is another reading of force and motion (sign, axis, quantity, motors
that were not as stated), or a further unknown: a common factor, a delay, one spring.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note
from elastid.covariance import scaled
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.second_source import SecondSource, Unknown, agreement, likeliest
from elastid.fit.problem.elastic import ElasticFit
from elastid.fit.problem.least_squares import RESIDUALS, as_real
from elastid.fit.problem.part import Part, mixed
from elastid.fit.result import Result
from elastid.fit.static_agreement import ToolAgreement, ToolComparison
from elastid.record import MOTION_ORDER
from elastid.response import Response

LARGEST = 0.9  # of a further unknown: ln of a stiffness, a factor less 1
# dG (F, n_y, n_u) of a further unknown, of the model's G, its slopes to x, and s = j omega.
Column: TypeAlias = Callable[[ComplexArray, ComplexArray, ComplexArray], ComplexArray]


def _residuals(
    fit: ElasticFit, column: Column | None, x: FloatArray, root: FloatArray, size: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Whitened residuals (N,) of each response and their slopes (N, n)."""
    for part in fit.parts:
        theta, s = fit.theta(part, x), (2j * np.pi * part.kernel.freq_hz[:, None, None]).astype(complex)
        G, dG = part.kernel.evaluate(theta)
        chain = fit.parameters.jacobian(x, part.configuration)[part.kernel.places]
        slopes = np.tensordot((chain @ root).T, dG, axes=1)
        if column is not None:
            further = column(G, np.tensordot(chain.T, dG, axes=1), s)
            G, slopes = G + size * further, np.concatenate([slopes, further[None]])
        e, slope = RESIDUALS[part.criterion](part.measured, G)
        used, mixing = part.gain > 0, part.mixing
        r, J = np.where(used, part.gain * e, 0.0), np.where(used, -part.gain * slope, 0.0) * slopes
        if mixing is not None:
            r, J = mixed(mixing, r), mixed(mixing, J)
        yield as_real(r).ravel(), as_real(J).reshape(len(J), -1).T


def tool_agreement(assembly: Assembly, alone: Result) -> ToolAgreement:
    """Responses at the tool, those of `assembly`, next to `alone`, the fit to the motors' responses."""
    fit, now = _beside(assembly.with_floor(alone.floor), alone)
    found = agreement(now, alone, Unknown(partial(_residuals, fit, _factor), _words_of_factor))
    causes, is_misread = list[str](), False
    if found.is_beyond:
        others = [(_beside(replace(assembly, responses=other).with_floor(alone.floor), alone)[1], words)
                  for other, words in _readings(assembly.responses)]  # fmt: skip
        readings = [(other.least()[0], words) for other, words in others]
        causes = list(likeliest(now, found.T, _unknowns(fit, alone), readings)) or [
            "no single cause explains it: check place, direction, sign and unit of force and motion, the angles, and "
            "whether the motors were as stated"
        ]
        is_misread = causes[0] in [words for _, words in readings]
    compared = tuple(_compared(G, part, fit, alone.x) for G, part in zip(assembly.responses, fit.parts, strict=True))
    ratio = 1 + found.factor, found.std
    return ToolAgreement(compared, *ratio, found.T, fit.n_residuals, " or ".join(causes), is_misread)


def _beside(assembly: Assembly, alone: Result) -> tuple[ElasticFit, SecondSource]:
    fit = replace(assembly, parameters=alone.parameters).at(alone.x, assembly.spec.criterion)
    return fit, SecondSource.of(alone, partial(_residuals, fit, None), fit.n_residuals)


def _compared(response: Response, part: Part, fit: ElasticFit, x: FloatArray) -> ToolComparison:
    G, used = part.kernel.response(fit.theta(part, x)), part.gain > 0
    ratio = np.abs(response.G[used]) / np.maximum(np.abs(G[used]), 1e-300)
    rms = float(np.sqrt(np.mean((20 * np.log10(np.maximum(ratio, 1e-300))) ** 2))) if used.any() else np.nan
    return ToolComparison(response.configuration.name, response.motors, response.inputs, response.outputs, rms)


def _factor(G: ComplexArray, slopes: ComplexArray, s: ComplexArray) -> ComplexArray:
    return G


def _delay(G: ComplexArray, slopes: ComplexArray, s: ComplexArray) -> ComplexArray:
    return np.asarray(-s * G)


def _of_spring(i: int) -> Column:
    return lambda G, slopes, s: np.asarray(slopes[i])


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


def _unknowns(fit: ElasticFit, alone: Result) -> Iterator[Unknown]:
    yield Unknown(partial(_residuals, fit, _factor), _words_of_factor, LARGEST)
    yield Unknown(partial(_residuals, fit, _delay), _words_of_delay, LARGEST)
    for i, parameter in enumerate(alone.parameters.free):
        if parameter.stands_for.startswith("k_") and parameter.log:
            words = partial(_words_of_spring, parameter.name)
            yield Unknown(partial(_residuals, fit, _of_spring(i)), words, LARGEST)


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
