"""A map of the workspace: stiffness, frequencies, chatter and deflection at many postures, with their intervals."""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray, IntArray, frozen_value, labelled
from elastid.base.errors import StudyError
from elastid.base.statistics import QUANTILE_95
from elastid.fit.posture import Asked, Family
from elastid.fit.result import Result
from elastid.use.compliance import QUANTITIES, Cut, answers, linearised

LINES, CURVE_LINES = 300, 120


@frozen_value
class Quantity:
    """One number of every posture, SI, with its standard deviation and 95 % interval.

    A positive quantity has an interval that is symmetric in its logarithm.
    """

    name: str
    text: str
    unit: str
    value: FloatArray = labelled("value", "{unit}", "posture")
    std: FloatArray = labelled("standard deviation", "{unit}", "posture")

    @property
    def relative_std(self) -> FloatArray:
        """std over value (Q,)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.std / self.value)

    @property
    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Ends (Q,) of the 95 % intervals."""
        with np.errstate(over="ignore", invalid="ignore"):
            reach = np.exp(QUANTILE_95 * self.relative_std)
            return np.asarray(self.value / reach), np.asarray(self.value * reach)


@frozen_value
class WorkspaceMap:
    """Quantities of Q postures with an equilibrium, the motors held, in the axes of the base.

    angles (Q, n_u): of the driven joints `joints`.  asked (Q,): number of each among the postures asked for; those
    without an equilibrium are `refused`.  sliding: of each joint, True where it slides.  position (Q, 3): of the frame.
    axes (Q, 3, 3): directions of the principal static compliances, columns, the softest first.  springs, share (Q,
    n_s): part of each spring in the compliance of the softest direction.
    curve_hz (L,): of `magnitude`.
    """

    name: str
    frame: str
    joints: tuple[str, ...]
    angles: FloatArray = labelled("angle of the driven joints", "rad, m", "posture joints")
    asked: IntArray = labelled("number of the posture among those asked for", "", "posture")
    refused: tuple[int, ...] = labelled("postures without an equilibrium")
    position: FloatArray = labelled("origin of the frame", "m", "posture axis")
    axes: FloatArray = labelled("directions of principal compliances, the softest first", "", "posture axis rank")
    springs: tuple[str, ...]
    share: FloatArray = labelled("part of each spring in the softest compliance", "", "posture springs")
    chatter_hz: FloatArray = labelled("line of the most negative real part", "", "posture")
    curve_hz: FloatArray = labelled("lines of the curves")
    magnitude: FloatArray = labelled("dynamic compliance along the softest direction", "m/N", "posture curve_hz")
    magnitude_std: FloatArray = labelled("its standard deviation", "m/N", "posture curve_hz")
    quantities: tuple[Quantity, ...] = labelled(entry="name")
    load: tuple[float, float, float] = (0.0, 0.0, 0.0)
    cutting_coefficient: float = 0.0
    is_path: bool = False
    sliding: tuple[bool, ...] = ()

    def __getitem__(self, name: str) -> Quantity:
        """A quantity by its name."""
        return {each.name: each for each in self.quantities}[name]

    def __len__(self) -> int:
        return len(self.angles)

    @property
    def softest(self) -> IntArray:
        """Numbers (Q,) of the postures, the softest first."""
        return np.argsort(-self["softest_compliance"].value, kind="stable")

    @property
    def limiting_springs(self) -> tuple[str, ...]:
        """The spring with the largest part in the softest direction of each posture."""
        return tuple(self.springs[i] for i in np.argmax(self.share, axis=1)) if self.springs else ("",) * len(self)


def map_workspace(
    fitted: Result | Family,
    angles: FloatArray,
    cut: Cut | None = None,
    *,
    frame: str | None = None,
    lines_hz: FloatArray | None = None,
    name: str = "",
    is_path: bool = False,
) -> WorkspaceMap:
    """The map of postures (Q, n_u) of a fitted robot; StudyError where none of them has an equilibrium.

    fitted: or its family in the axes of the base, built before.  frame: by default `tool`, else the last one.
    lines_hz (F,): by default LINES of them over the modes.
    """
    cut = cut or Cut()
    family = fitted if isinstance(fitted, Family) else fitted.family(Asked(frame=frame, axes="world"))
    lines = default_lines(family, angles) if lines_hz is None else np.asarray(lines_hz, float)
    curve = np.geomspace(lines[0], lines[-1], CURVE_LINES)
    pieces, of_pieces = [], []
    for robots in linearised(family, angles):
        of_pieces.append(robots.found)
        if robots.found.any():
            pieces.append(answers(robots, lines, curve, cut) | {"position": robots.position})
    found = np.concatenate(of_pieces)
    if not found.any():
        raise StudyError(
            "robot/no-rest",
            f"robot {family.robot.name} finds no rest in any of the {len(angles)} postures; they may be outside the "
            "reach of its loops, or its springs too soft for its weight",
        )
    each = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    quantities = tuple(Quantity(key, text, unit, *each.pop(key).T) for key, (unit, text) in QUANTITIES.items())
    driven = family.robot.driven
    return WorkspaceMap(
        name=name or family.robot.name, frame=family.frame, joints=tuple(joint.name for joint in driven),
        angles=angles[found], asked=np.flatnonzero(found), refused=tuple(np.flatnonzero(~found).tolist()),
        springs=family.model.springs, curve_hz=curve, quantities=quantities, load=cut.load,
        cutting_coefficient=cut.cutting_coefficient, is_path=is_path, sliding=tuple(joint.slides for joint in driven),
        **each,
    )  # fmt: skip


def default_lines(family: Family, angles: FloatArray) -> FloatArray:
    """LINES lines (F,) from half the first natural frequency of some postures to twice their sixth, or last."""
    some = next(linearised(family, angles[:: max(1, len(angles) // 20)][:20]))
    if not len(some.M):
        return np.geomspace(1.0, 100.0, LINES)
    squares = np.linalg.eigvals(np.linalg.solve(some.M, some.K)).real
    freq_hz = np.sort(np.sqrt(np.maximum(squares, 1e-6)), axis=1) / (2 * np.pi)
    return np.geomspace(freq_hz[:, 0].min() / 2, 2 * freq_hz[:, : min(6, freq_hz.shape[1])].max(), LINES)
