"""CSV files of paths: tables of joint angles or poses of a frame, in SI units."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from elastid.base.arrays import BoolArray, FloatArray
from elastid.base.errors import DataError
from elastid.base.tables import name_and_unit, read_table
from elastid.base.units import si_factor
from elastid.robot import Robot
from elastid.use.postures import beyond_limits, follow_path

_POSITION, _ROTATION = dict.fromkeys(("x", "y", "z"), "m"), dict.fromkeys(("rx", "ry", "rz"), "rad")


@dataclass(frozen=True)
class Table:
    """Numbers (Q, n) of a CSV file with headings (n,).  lines (Q,): row numbers in the file, from 1."""

    path: Path
    heads: tuple[str, ...]
    values: FloatArray
    lines: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Headings without units."""
        return tuple(name_and_unit(head)[0] for head in self.heads)

    def angles(self, robot: Robot) -> FloatArray | None:
        """Return the angles (Q, n_u) of the driven joints in rad (m); None if the table lacks a joint."""
        if not set(robot.driven_names) <= set(self.names):
            return None
        return self.in_si({joint.name: "m" if joint.slides else "rad" for joint in robot.driven})

    def poses(self, robot: Robot) -> tuple[FloatArray, FloatArray | None]:
        """Return positions (Q, 3), m, and rotations (Q, 3, 3) or None; DataError for a table without poses."""
        rotation = _ROTATION.keys() & {*self.names}
        if not _POSITION.keys() <= {*self.names} or (rotation and rotation != _ROTATION.keys()):
            joints = robot.driven_names
            raise DataError(
                "use/path",
                f"its columns are {', '.join(self.heads)}. Give a column per driven joint "
                f"({', '.join(joints)}; rad, or `{joints[0]} (deg)`), or poses of the frame: x, y, z in m, and all or "
                "none of rx, ry, rz in rad",
                self.path,
            )
        return self.in_si(_POSITION), Rotation.from_rotvec(self.in_si(_ROTATION)).as_matrix() if rotation else None

    def in_si(self, dimensions: dict[str, str]) -> FloatArray:
        """Return the columns (Q, n) of the names in `dimensions`, in SI; DataError for a unit of another dimension."""
        columns = [self.names.index(name) for name in dimensions]
        units = [name_and_unit(self.heads[column])[1] for column in columns]
        try:
            scale = [si_factor(unit or si, si) for unit, si in zip(units, dimensions.values(), strict=True)]
        except ValueError as error:
            raise DataError("use/path", str(error), self.path) from None
        return self.values[:, columns] * scale


def read_path(path: Path, robot: Robot, frame: str) -> tuple[FloatArray, tuple[str, ...]]:
    """Read a CSV file with a column for each driven joint, in rad (or deg: `1 deg`), or with poses of the frame.

    Poses: columns x, y, z in m and, to follow the orientation, the rotation vector rx, ry, rz in rad.  Returns angles
    (Q, n_u), and sentences on omitted rows (out of reach) and on rows beyond the limits of the joints.  These are not
    omitted, because some robot models have stricter limits than the robots.
    DataError for other columns and for cells without a number.
    """
    table = read_numbers(path)
    angles = table.angles(robot)
    if angles is not None:
        is_beyond = np.asarray(beyond_limits(robot, angles).any(axis=1))
        return angles, _remark(is_beyond, "are beyond the limits of the joints, and kept")
    angles, is_reached = follow_path(robot, frame, *table.poses(robot))
    if not is_reached.any():
        raise DataError(
            "use/unreachable",
            f"no pose is within reach of frame {frame} and the limits of the joints. x, y, z are from the robot's "
            "base, in m unless the heading has another unit. Correct them or the limits",
            path,
        )
    text = "are out of reach of the frame within the limits of the joints, and left out"
    return angles[is_reached], _remark(~is_reached, text)


def _remark(mask: BoolArray, text: str) -> tuple[str, ...]:
    """Return a sentence on the rows of a mask (Q,), counted from 1; empty without rows."""
    rows = [str(row + 1) for row in np.flatnonzero(mask)]
    more = ", ..." * (len(rows) > 5)
    return (f"{len(rows)} of the path's postures (row {', '.join(rows[:5])}{more}) {text}",) if rows else ()


def read_numbers(path: Path) -> Table:
    """Read the numbers of a CSV file; raise DataError with the row of a cell without a number."""
    values, lines, heads = [], [], tuple[str, ...]()
    for line, cells in read_table(path):
        try:
            numbers = [float(cell.removesuffix(name_and_unit(head)[1])) for head, cell in cells.items()]
        except ValueError:
            numbers = [np.nan]
        if not np.isfinite(numbers).all():
            text = f"{', '.join(cells.values())}: each cell must be a finite number"
            raise DataError("use/path", text, f"{path}:{line}")
        values.append(numbers)
        lines.append(line)
        heads = tuple(cells)
    return Table(path, heads, np.array(values), tuple(lines))
