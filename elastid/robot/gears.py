r"""Gears that couple axes: the matrix of gear ratios, and where the springs sit between its stages.

.. math:: q_m^m = \eta\, q_m^a, \qquad \tau_a = \eta^T \tau_m, \qquad \eta = \eta_1 \eta_2

Niglis & Oberg (2015), eqs. 2.24 to 2.28; superscripts: side on which an angle is measured. eta_2 holds the couplings
between the joints' springs and the links.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from elastid.arrays import BoolArray, FloatArray
from elastid.robot.joint import Joint
from elastid.section import section

# Reciprocal condition number of eta, its rows scaled to the motors' own ratios, that rounding cannot explain.
SINGULAR = 1e-10


@section
class GearCoupling:
    """A gear through which the motor of another joint turns along: eta[motor, joint] = ratio.

    motor, joint: two driven joints.  ratio: turns of the motor of `motor` per turn of `joint`, while joint `motor`
    stands still in its own bearing.  springs: `after` it, towards the links (the stiffness matrix stays diagonal), or
    `before` it, between motors and coupling: the springs of the joints; springs of motor shafts are before all gears.
    """

    motor: str
    joint: str
    ratio: float
    springs: Literal["before", "after"] = "after"

    def __post_init__(self) -> None:
        """A motor's own ratio stands with the motor."""
        if self.motor == self.joint:
            raise ValueError(
                f"the ratio of motor {self.motor} to its own joint stands in motor.ratio; gears hold couplings"
            )
        if not math.isfinite(self.ratio):
            raise ValueError(f"the ratio is {self.ratio:g}; it must be finite")


def mixing(driven: Sequence[Joint], gears: Sequence[GearCoupling], only: str = "") -> FloatArray:
    """E (n_u, n_u) = diag(ratio)^-1 eta: the identity but for couplings; `only` those with springs before or after."""
    names = [joint.name for joint in driven]
    ratio = {joint.name: joint.motor.ratio for joint in driven if joint.motor is not None}
    E = np.eye(len(names))
    for gear in gears:
        if only in ("", gear.springs):
            E[names.index(gear.motor), names.index(gear.joint)] = gear.ratio / ratio[gear.motor]
    return E


def spring_directions(driven: Sequence[Joint], gears: Sequence[GearCoupling]) -> dict[str, FloatArray]:
    """How far the joints (n_u,) turn where one spring gives by 1 rad and nothing else does, by parameter name.

    `k_<joint>` on the link side, unit of its joint; `km_<joint>` on the motor side.
    """
    directions: dict[str, FloatArray] = {}
    after, whole = _inverse(mixing(driven, gears, only="before")), _inverse(mixing(driven, gears))
    for i, joint in enumerate(driven):
        if joint.spring is not None:
            directions[f"k_{joint.name}"] = after[:, i]
        if joint.motor is not None and joint.motor.spring is not None:
            directions[f"km_{joint.name}"] = whole[:, i] / joint.motor.ratio
    return directions


@dataclass(frozen=True)
class Gearbox:
    """Elastic gears that give way together: gears (n_g,), places among the driven joints; springs (n_s,), names k_...

    X (n_g, n_s): how far each gear gives per rad of a spring.
    """

    gears: tuple[int, ...]
    springs: tuple[str, ...]
    X: FloatArray

    @property
    def is_in_series(self) -> bool:
        """More springs than gears: what each gives follows from the torque, not from the deflection of the gears."""
        return len(self.springs) > len(self.gears)


def gearboxes(driven: Sequence[Joint], gears: Sequence[GearCoupling]) -> tuple[Gearbox, ...]:
    """The elastic gears, those that a spring turns together in one gearbox."""
    directions = spring_directions(driven, gears)
    X = np.array([*directions.values()]).reshape(-1, len(driven)).T
    together = np.linalg.matrix_power((X @ X.T != 0).astype(float), len(driven)) > 0
    boxes = []
    for first in np.flatnonzero(X.any(axis=1)):
        members = np.flatnonzero(together[first])
        if members[0] == first:
            within: BoolArray = np.any(X[members], axis=0)
            springs = tuple(name for name, inside in zip(directions, within, strict=True) if inside)
            boxes.append(Gearbox(tuple(members.tolist()), springs, X[np.ix_(members, within)]))
    return tuple(boxes)


def _check_series(driven: Sequence[Joint], gears: Sequence[GearCoupling]) -> None:
    """Compliances add for springs of one stiffness only."""
    bent = {f"k_{joint.name}" for joint in driven if joint.spring is not None and not joint.spring.is_linear}
    for box in gearboxes(driven, gears):
        if box.is_in_series and bent & set(box.springs):
            name = min(bent & set(box.springs))[2:]
            raise ValueError(
                f"joint {name}: its spring is not linear and in series with that of a motor's shaft "
                f"({', '.join(s for s in box.springs if s.startswith('km_'))}); give one of the two, or a linear spring"
            )


def _inverse(E: FloatArray) -> FloatArray:
    """E^-1 with the rounding residue of zeros set to zero: an axis that is not coupled is not."""
    inverse: FloatArray = np.linalg.inv(E).astype(np.float64)
    return np.where(np.abs(inverse) < 1e-12 * np.abs(inverse).max(), 0.0, inverse)


def check_gears(driven: Sequence[Joint], gears: Sequence[GearCoupling]) -> None:
    """ValueError for couplings of joints that are not there, a singular eta, springs that would turn a rigid gear."""
    names = [joint.name for joint in driven]
    pairs = [(gear.motor, gear.joint) for gear in gears]
    for pair in pairs:
        for name in pair:
            if name not in names:
                raise ValueError(f"gears: joint {name} has no motor; driven joints: {', '.join(names)}")
        if pairs.count(pair) > 1:
            raise ValueError(f"gears: the coupling of motor {pair[0]} with joint {pair[1]} is given twice")
    stages = [mixing(driven, gears, only) for only in ("", "before")]
    if min(1 / np.linalg.cond(E) for E in stages) < SINGULAR:
        raise ValueError(
            f"gears: the matrix of gear ratios is singular (determinant {np.linalg.det(stages[0]):.3g} times the "
            "product of the motors' own ratios): some motion of the joints turns no motor; check the ratios, "
            "eta[motor, joint] = turns of the motor per turn of the joint"
        )
    _check_springs(driven, gears)
    _check_series(driven, gears)


def _check_springs(driven: Sequence[Joint], gears: Sequence[GearCoupling]) -> None:
    flexible = np.array([joint.is_flexible for joint in driven])
    directions = spring_directions(driven, gears)
    for name, direction in directions.items():
        stiff = [j.name for j, turn, soft in zip(driven, direction, flexible, strict=True) if turn and not soft]
        if stiff:
            raise ValueError(
                f"gears: where the spring {name} gives, joint {stiff[0]} turns too by the coupling, but its gear is "
                f"rigid; give joint {stiff[0]} a spring, or let the coupling come before the springs (springs: after)"
            )
    if directions and np.linalg.matrix_rank(np.array(list(directions.values()))[:, flexible]) < flexible.sum():
        raise ValueError("gears: the springs do not let every elastic joint give way on its own; give one to each")
