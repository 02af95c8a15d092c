"""Workspace map: quantities of many postures of a fitted robot, with their intervals (`posture_values`)."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.errors import StudyError
from elastid.base.execution import SERIAL, Execution
from elastid.base.large_arrays import empty_in_file, release
from elastid.base.statistics import QUANTILE_95
from elastid.fit.posture import Family, PredictionPorts
from elastid.fit.result import Result
from elastid.linear.modes import oscillations
from elastid.use.locked_postures import LockedEquations
from elastid.use.posture_values import QUANTITIES, Cut, map_columns

LINES, CURVE_LINES = 300, 120
SAMPLE, N_SOFTEST = 2000, 10  # postures on a page: evenly spread over the map, and the softest


@frozen_value
class Quantity:
    """One quantity of Q postures, SI, with its standard deviation and 95 % interval, symmetric in its logarithm."""

    name: str
    text: str
    unit: str
    value: FloatArray = labelled("value", "{unit}", "posture")
    std: FloatArray = labelled("standard deviation", "{unit}", "posture")

    @property
    def relative_std(self) -> FloatArray:
        """Relative standard deviation (Q,); 0 for a value of 0, such as on the axis of the only joint."""
        return np.divide(self.std, self.value, out=np.zeros_like(self.std), where=self.value != 0)

    @property
    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Ends (Q,) of the 95 % intervals."""
        with np.errstate(over="ignore", invalid="ignore"):
            factor = np.exp(QUANTILE_95 * self.relative_std)
            return self.value / factor, self.value * factor


@frozen_value
class WorkspaceMap:
    """Quantities of Q postures with an equilibrium and locked motors, in the axes of the base.

    angles (Q, n_u).  asked (Q,): index of each posture among the requested ones.  refused: indices of the requested
    postures without an equilibrium.  axes (Q, 3, 3): directions of the principal static compliances as columns.
    compliance_fraction (Q, n_s): of each spring.  magnitude (Q, L).  sliding: True for each joint that slides.
    """

    name: str
    frame: str
    joints: tuple[str, ...]
    angles: FloatArray = labelled("angle of the driven joints", "rad, m", "posture joints")
    asked: IntArray = labelled("number of the posture among those asked for", "", "posture")
    refused: IntArray = labelled("postures without an equilibrium")
    position: FloatArray = labelled("origin of the frame", "m", "posture axis")
    axes: FloatArray = labelled("directions of principal compliances, the softest first", "", "posture axis rank")
    springs: tuple[str, ...]
    compliance_fraction: FloatArray = labelled("part of each spring in the softest compliance", "", "posture springs")
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
        """Return a quantity by its name."""
        return {quantity.name: quantity for quantity in self.quantities}[name]

    def __len__(self) -> int:
        return len(self.angles)

    def subset(self, rows: IntArray) -> "WorkspaceMap":
        """Return the map of a subset of its postures; rows (n,): their indices, ascending."""

        def select(values: Any) -> Any:
            pieces = []
            for piece in np.array_split(rows, 1 + len(rows) // 200):  # a read maps 64 KB of the file into memory
                pieces.append(values[piece])
                release(values)
            return np.concatenate(pieces)

        names = "angles asked position axes compliance_fraction chatter_hz magnitude magnitude_std"
        columns = {name: select(getattr(self, name)) for name in names.split()}
        quantities = tuple(replace(q, value=select(q.value), std=select(q.std)) for q in self.quantities)
        return replace(self, quantities=quantities, **columns)

    @cached_property
    def sample(self) -> "WorkspaceMap":
        """Map of SAMPLE evenly spread postures, the N_SOFTEST softest and the stiffest, for pages and figures."""
        if len(self) <= SAMPLE:
            return self
        compliance, extremes = self["softest_compliance"].value, np.zeros(0, int)
        for first in range(0, len(self), SAMPLE):
            rows = np.append(extremes, np.arange(first, min(first + SAMPLE, len(self))))
            rows = rows[np.argsort(-compliance[rows], kind="stable")]
            extremes = np.append(rows[:N_SOFTEST], rows[-1])
            release(compliance)
        return self.subset(np.union1d(np.linspace(0, len(self) - 1, SAMPLE).round().astype(int), extremes))

    @property
    def softest(self) -> IntArray:
        """Indices (Q,) of the postures, the softest first."""
        return np.argsort(-self["softest_compliance"].value, kind="stable")

    @property
    def limiting_springs(self) -> tuple[str, ...]:
        """Name (Q,) of the spring with the largest contribution to the softest direction."""
        if not self.springs:
            return ("",) * len(self)
        return tuple(self.springs[i] for i in np.argmax(self.compliance_fraction, axis=1))


def map_workspace(
    fitted: Result | Family, angles: FloatArray, cut: Cut | None = None, *, frame: str | None = None,
    lines_hz: FloatArray | None = None, name: str = "", is_path: bool = False, execution: Execution = SERIAL,
) -> WorkspaceMap:  # fmt: skip
    """Map postures (N, n_u), rad or m, of a fitted robot; StudyError if none of them has an equilibrium.

    fitted: a result, or its family in the axes of the base.  frame: default `tool`, else the last frame.
    lines_hz (F,): default LINES lines over the modes.  Columns of many postures are in temporary files.
    """
    cut = cut or Cut()
    family = fitted if isinstance(fitted, Family) else fitted.family(PredictionPorts(frame=frame, axes="world"))
    equations, N, columns = LockedEquations(family), len(angles), dict[str, Any]()
    lines = default_lines(equations, angles) if lines_hz is None else np.asarray(lines_hz, float)
    curve = np.geomspace(lines[0], lines[-1], CURVE_LINES)
    work = partial(_in_batches, partial(map_columns, equations, lines, curve, cut))
    has_rest = np.zeros(N, bool)
    pieces = [angles[first : first + SAMPLE] for first in range(0, N, SAMPLE)]
    for i, (batch_has_rest, batch) in execution.unordered(work, pieces):
        rows = SAMPLE * i + np.flatnonzero(batch_has_rest)
        has_rest[rows] = True
        for key, values in (batch | {"asked": rows}).items():
            if key not in columns:
                columns[key] = (empty_in_file if N > 5 * SAMPLE else np.empty)((N, *values.shape[1:]), values.dtype)
            columns[key][rows] = values
            release(columns[key])
        release(angles)
    if not has_rest.any():
        raise StudyError(
            "robot/no-equilibrium",
            f"robot {family.robot.name} has no equilibrium in any of the {N} postures. Check that the loops can "
            "reach the postures, and the units of springs and masses",
        )
    columns = {key: _keep_rows(column, has_rest) for key, column in columns.items()}
    quantities = tuple(Quantity(key, text, unit, *columns.pop(key).T) for key, (unit, text) in QUANTITIES.items())
    driven = family.robot.driven
    return WorkspaceMap(
        name=name or family.robot.name, frame=family.frame, joints=tuple(joint.name for joint in driven),
        refused=np.flatnonzero(~has_rest), springs=family.model.springs, curve_hz=curve, quantities=quantities,
        load=cut.load, cutting_coefficient=cut.cutting_coefficient, is_path=is_path,
        sliding=tuple(joint.slides for joint in driven), **columns,
    )  # fmt: skip


def _keep_rows(column: Any, has_rest: BoolArray) -> Any:
    """Move the rows with an equilibrium to the front of a column, in place, and return them read-only."""
    n = 0
    for first in range(0, len(column), SAMPLE):
        values = column[first : first + SAMPLE][has_rest[first : first + SAMPLE]]
        column[n : (n := n + len(values))] = values
        release(column)
    column.flags.writeable = False
    return column[:n]


def _in_batches(function: Callable[[FloatArray], Any], angles: FloatArray) -> tuple[BoolArray, dict[str, FloatArray]]:
    """Apply `map_columns` to 50 postures at a time, which fit into a cache; return the joined columns."""
    has_rest, columns = zip(*(function(angles[first : first + 50]) for first in range(0, len(angles), 50)), strict=True)
    names = max(columns, key=len)
    return np.concatenate(has_rest), {key: np.concatenate([batch[key] for batch in columns if batch]) for key in names}


def default_lines(equations: LockedEquations, angles: FloatArray) -> FloatArray:
    """Return LINES lines (F,) from half the first natural frequency of 20 postures to twice their sixth, or last."""
    some_angles = angles[:: max(1, len(angles) // 20)][:20]
    q, has_rest = equations.rest(some_angles)
    freq_hz = np.array([2.0, 50.0])
    if has_rest.any():
        models = equations.at(some_angles[has_rest], q[has_rest])
        freq_hz = np.abs(oscillations(models.M, models.D, models.K)[0][:, :6]) / (2 * np.pi)
    return np.geomspace(np.nanmin(freq_hz) / 2, 2 * np.nanmax(freq_hz), LINES)
