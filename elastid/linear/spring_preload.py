"""Nonlinear springs under gravity: their deflection and tangent stiffness where the robot rests."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.note import Note
from elastid.linear.equilibrium import OperatingPoint
from elastid.model.elastic import ElasticModel
from elastid.model.nonlinear_springs import deflections, tangents

# Beyond b + FLANK e the flank of a gap has 95 % of its stiffness.
FLANK = 2.0


@frozen_value
class Preload:
    """The springs at rest, in the order of `joints`: deflection (rad, m), tangent (Nm/rad, N/m), (n_s,) each."""

    joints: tuple[str, ...]
    deflection: FloatArray
    tangent: FloatArray


def preloads(model: ElasticModel, theta: FloatArray, points: Sequence[OperatingPoint]) -> tuple[Preload, ...]:
    """The springs of a robot at each operating point; theta (n_theta,): model.parameters, SI."""
    q, symbols = ca.SX.sym("q", model.n_q), ca.SX.sym("theta", len(model.parameters))
    named = dict(zip(model.parameters, ca.vertsplit(symbols), strict=True))
    deflection, tangent = deflections(model.robot, q), tangents(model.robot, q, named)
    function = ca.Function("preload", [q, symbols], [ca.vertcat(*deflection.values()), ca.vertcat(*tangent.values())])
    at_points = (function(point.q, theta) for point in points)
    return tuple(Preload(tuple(deflection), x.full().ravel(), k.full().ravel()) for x, k in at_points)


def spring_notes(model: ElasticModel, theta: FloatArray, points: Sequence[OperatingPoint]) -> tuple[Note, ...]:
    """A note for each joint that rests inside its backlash or whose spring is unstable, with the configurations."""
    if all(joint.spring is None or joint.spring.is_linear for joint in model.robot.joints):
        return ()
    values = dict(zip(model.parameters, np.asarray(theta, dtype=float).tolist(), strict=True))
    names = [point.configuration.name for point in points]
    loads = preloads(model, theta, points)
    notes: list[Note] = []
    for i, joint in enumerate(loads[0].joints if loads else ()):
        x, k = (np.array([getattr(load, what)[i] for load in loads]) for what in ("deflection", "tangent"))
        notes += [*_in_the_gap(model, joint, values, names, x, k), *_unstable(model, joint, names, x, k)]
    return tuple(notes)


def _in_the_gap(
    model: ElasticModel, joint: str, values: dict[str, float], names: list[str], x: FloatArray, k: FloatArray
) -> Iterator[Note]:
    b = values.get(f"b_{joint}", 0.0)
    e = values.get(f"e_{joint}", 0.0) * b
    inside = np.flatnonzero(np.abs(x) < b + FLANK * e)
    if inside.size:
        unit = model.robot.parameters()[f"b_{joint}"][1]
        found = ", ".join(f"{names[i]} (deflected by {x[i]:.2g} {unit})" for i in inside)
        share = k[inside] / values[f"k_{joint}"]
        yield (
            Note(
                "inside-backlash",
                f"joint {joint} rests inside its backlash of +-{b:.2g} {unit} in {found}: the response depends on the "
                f"amplitude there, and the stiffness of {share.min():.0%} to {share.max():.0%} of k_{joint} that the "
                "model has at rest describes none; take configurations in which gravity presses the joint onto one "
                "flank, or leave these out",
            )
        )


def _unstable(model: ElasticModel, joint: str, names: list[str], x: FloatArray, k: FloatArray) -> Iterator[Note]:
    unit = model.robot.parameters()[f"k_{joint}"][1]
    for i in np.flatnonzero(k < 0):
        yield (
            Note(
                "unstable-spring",
                f"the spring of joint {joint} is unstable in {names[i]}: deflected by {x[i]:.2g} it pulls further, "
                f"with {k[i]:.3g} {unit}; bound its quadratic terms so that quadratic^2 < 3 k cubic",
            )
        )
