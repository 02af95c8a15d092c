r"""Gears that couple axes: the matrix of gear ratios, and springs before and after the couplings.

.. math:: q_m^m = \eta\, q_m^a, \qquad \tau_a = \eta^T \tau_m, \qquad \eta = \eta_1 \eta_2

Niglis & Oberg (2015), eqs. (2.23), (2.25a) to (2.25c); superscripts: side of an angle. eta_2: couplings between the
springs of the joints and the links. A gear without a spring is elastic if a spring before the coupling moves it.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elastid.base.arrays import FloatArray, frozen, frozen_value
from elastid.base.section import Key, section
from elastid.robot.joint import Joint

MIN_RECIPROCAL_CONDITION = 1e-10  # of eta with rows over the ratios of the motors, below which it is singular


@section
class GearCoupling:
    """Gear by which a joint also rotates the motor of another joint: eta[motor, joint] = ratio."""

    # fmt: off
    motor: Annotated[str, Key("Driven joint whose motor the coupling rotates.", "mostly a later axis of the wrist, "
        "whose motor also rotates with an earlier joint.")]
    joint: Annotated[str, Key("Driven joint whose rotation also rotates that motor.", "the earlier joint of the "
        "wrist.")]
    ratio: Annotated[float, Key("Revolutions of the motor of `motor` per revolution of `joint`, with the joint `motor` "
        "at rest.", "copy it from the controller's coupling parameters; try the other sign if free wrist motion shows "
        "cross torques.")]
    springs: Annotated[Literal["before", "after"], Key("Location of the joint springs: `after` the coupling, on the "
        "link side (diagonal stiffness matrix), or `before` it, on the motor side; springs of motor shafts are before "
        "all gears.", "`before` for soft belts or shafts ahead of the bevel stage; `elastid compare` tries "
        "both.")] = "after"
    # fmt: on

    def __post_init__(self) -> None:
        if self.motor == self.joint:
            raise ValueError(f"gears contains couplings only. Give the ratio of motor {self.motor} in motor.ratio")
        if self.ratio == 0:
            raise ValueError("ratio is 0, which couples nothing. Give turns of the motor per turn of the joint")


# fmt: off
GearCouplings: TypeAlias = Annotated[tuple[GearCoupling, ...], Key("Gear couplings, by which one axis also rotates the "
    "motor of another axis.", "for wrists with coupled motors. Without it, the torque of one motor appears at "
    "another joint.")]
# fmt: on


def mixing(driven: Sequence[Joint], gears: Sequence[GearCoupling], only: str = "") -> FloatArray:
    """Compute E (n_u, n_u) = diag(ratio)^-1 eta, identity without couplings. only: springs before or after."""
    ratio = {joint.name: joint.motor.ratio for joint in driven if joint.motor is not None}
    names, E = list(ratio), np.eye(len(ratio))
    for gear in gears:
        if only in ("", gear.springs):
            E[names.index(gear.motor), names.index(gear.joint)] = gear.ratio / ratio[gear.motor]
    return E


def spring_directions(driven: Sequence[Joint], gears: Sequence[GearCoupling]) -> dict[str, FloatArray]:
    """Return the joint rotations (n_u,) for a deflection of 1 rad of one spring alone, by parameter name.

    `k_<joint>` on the link side, unit of its joint; `km_<joint>` on the motor side.
    """
    directions = {}
    # Exactly zero for axes without coupling.
    to_joints, total = (_without_rounding(np.linalg.inv(mixing(driven, gears, only))) for only in ("before", ""))
    for i, joint in enumerate(driven):
        if joint.spring is not None:
            directions[f"k_{joint.name}"] = to_joints[:, i]
        if joint.motor is not None and joint.motor.spring is not None:
            directions[f"km_{joint.name}"] = total[:, i] / joint.motor.ratio
    return directions


@frozen_value(eq=False)
class Gearbox:
    """Elastic gears with common springs.  gears (n_g,): indices of driven joints.  springs (n_s,): names k_...

    X (n_g, n_s): deflection of each gear per rad of a spring.  range (n_g, r): orthonormal basis of the deflections
    that the springs allow.  rigid (n_g - r, n_g): rigid @ delta = 0.
    """

    gears: tuple[int, ...]
    springs: tuple[str, ...]
    X: FloatArray

    @cached_property
    def is_in_series(self) -> bool:
        """True with more springs than independent deflections; the deflections then depend on the torque only."""
        _, rank = self._directions
        return bool(len(self.springs) > rank)

    @cached_property
    def range(self) -> FloatArray:
        """Basis of the deflections that the springs allow; the unit matrix without rigid gears."""
        U, rank = self._directions
        return frozen(np.eye(len(U)) if rank == len(U) else _without_rounding(U[:, :rank]))

    @cached_property
    def rigid(self) -> FloatArray:
        """Combinations of gears that are rigid."""
        U, rank = self._directions
        return frozen(_without_rounding(U[:, rank:]).T)

    @cached_property
    def deflections(self) -> FloatArray:
        """X^-1 (n_s, n_g): deflection of each spring per deflection of the gears, without springs in series."""
        length = np.linalg.norm(self.X, axis=0)
        square = len(self.springs) == len(self.gears)
        return frozen(np.linalg.inv(self.X) if square else np.linalg.pinv(self.X / length) / length[:, None])

    @cached_property
    def _directions(self) -> tuple[FloatArray, int]:
        """Left singular vectors of X, columns scaled to unit length, and its rank."""
        U, size, _ = np.linalg.svd(self.X / np.linalg.norm(self.X, axis=0))
        return U, int(np.sum(size > MIN_RECIPROCAL_CONDITION * size[0]))


def gearboxes(driven: Sequence[Joint], gears: Sequence[GearCoupling]) -> tuple[Gearbox, ...]:
    """Return the elastic gears; gears with a common spring are in one gearbox."""
    directions = spring_directions(driven, gears)
    X = np.array([*directions.values()]).reshape(-1, len(driven)).T
    share_springs = np.linalg.matrix_power((X @ X.T != 0).astype(float), len(driven)) > 0
    boxes = []
    for first in np.flatnonzero(X.any(axis=1)):
        members = np.flatnonzero(share_springs[first])
        if members[0] == first:
            within = np.any(X[members], axis=0)
            springs = tuple(name for name, inside in zip(directions, within.tolist(), strict=True) if inside)
            boxes.append(Gearbox(tuple(members.tolist()), springs, X[np.ix_(members, within)]))
    return tuple(boxes)


def check_series(driven: Sequence[Joint], boxes: Sequence[Gearbox]) -> None:
    """Raise ValueError for nonlinear springs in series: compliances add for springs of one stiffness only."""
    nonlinear = {f"k_{joint.name}" for joint in driven if joint.spring is not None and not joint.spring.is_linear}
    for box in boxes:
        if box.is_in_series and nonlinear & set(box.springs):
            name = min(nonlinear & set(box.springs))[2:]
            raise ValueError(
                f"joint {name}: a nonlinear spring in series with a motor-shaft spring "
                f"({', '.join(s for s in box.springs if s.startswith('km_'))}) is not supported. Remove one of them"
            )


def _without_rounding(matrix: NDArray[Any]) -> FloatArray:
    return np.where(np.abs(matrix) < 1e-12 * np.abs(matrix).max(initial=0.0), 0.0, matrix)


def check_gears(driven: Sequence[Joint], gears: Sequence[GearCoupling]) -> None:
    """Raise ValueError for couplings of joints without a motor and a singular eta."""
    names = [joint.name for joint in driven]
    pairs = [(gear.motor, gear.joint) for gear in gears]
    for pair in pairs:
        for name in pair:
            if name not in names:
                raise ValueError(f"gears: no joint {name} has a motor. Use one of {', '.join(names)}")
        if pairs.count(pair) > 1:
            raise ValueError(f"gears: the coupling of motor {pair[0]} with joint {pair[1]} is given twice")
    stages = [mixing(driven, gears, only) for only in ("", "before")]
    if min(1 / np.linalg.cond(E) for E in stages) < MIN_RECIPROCAL_CONDITION:
        raise ValueError(
            f"gears: the matrix of gear ratios is singular (determinant {np.linalg.det(stages[0]):.3g} times the "
            "product of the motors' own ratios). Correct `ratio` in gears: turns of the motor per turn of the joint"
        )
