"""Response with bands, modes and static stiffness of a robot in a posture, each with standard deviations."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.display import Display, as_html, as_text, number
from elastid.base.propagation import By
from elastid.linear.modes import modes_display
from elastid.response import FrequencyResponse
from elastid.robot import FRAME_AXES

Axes: TypeAlias = Literal["own", "world"]


@frozen_value
class ResponseBand:
    """G (F, n_y, n_u) with bands: distances (F, n_y, n_u) from it within which the truth is with probability `level`.

    pointwise: at each line by itself.  simultaneous: at all lines of an element together.  std: E|dG|^2 ^ 1/2.
    by: linearisation where draws agree with it, else draws.
    """

    response: FrequencyResponse
    std: FloatArray
    pointwise: FloatArray
    simultaneous: FloatArray
    level: float
    by: By

    @property
    def freq_hz(self) -> FloatArray:
        """The lines (F,)."""
        return self.response.freq_hz

    @property
    def G(self) -> ComplexArray:
        """The response (F, n_y, n_u)."""
        return self.response.G


@frozen_value
class PostureModes:
    """Oscillating modes by rising frequency with standard deviations: freq_hz, zeta (n_m,), shapes (n_q, n_m).

    shapes: in `coordinates`, all of the robot's, largest entry 1.  shapes_std: of their distance from the estimate.
    """

    freq_hz: FloatArray
    freq_std: FloatArray
    zeta: FloatArray
    zeta_std: FloatArray
    shapes: ComplexArray
    shapes_std: FloatArray
    coordinates: tuple[str, ...]
    real_poles: FloatArray
    by: By

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Frequency and damping ratio of each mode with their standard deviations."""
        columns = self.freq_hz, self.freq_std, self.zeta, self.zeta_std
        return modes_display(f"{len(self.freq_hz)} modes", *columns)


@frozen_value
class FrameStiffness:
    """Compliance C = J K^-1 J^T (6, 6) of a frame with its standard deviation, and stiffness, its inverse.

    Rows: x, y, z, rx, ry, rz of the frame by forces and torques, m/N, rad/N, rad/(Nm).  matrix, std (6, 6): stiffness;
    infinite numbers of a robot without six independent springs have none, and both are NaN.
    """

    compliance: FloatArray
    compliance_std: FloatArray
    matrix: FloatArray
    std: FloatArray
    frame: str
    axes: Axes
    by: By

    __repr__, _repr_html_ = as_text, as_html

    @property
    def principal(self) -> tuple[FloatArray, FloatArray]:
        """Compliances (3,) to forces along their principal directions (3, 3), columns; the softest first."""
        values, vectors = np.linalg.eigh(self.compliance[:3, :3])
        return values[::-1], vectors[:, ::-1]

    @property
    def display(self) -> Display:
        """Compliance of each direction with its standard deviation, and the stiffness there."""
        rows = [
            (axis, number(c, 5), number(s, 2), number(1 / c, 5) if c > 0 else "rigid")
            for axis, c, s in zip(
                FRAME_AXES, np.diag(self.compliance).tolist(), np.diag(self.compliance_std).tolist(), strict=True
            )
        ]
        heads = ("direction", "compliance in m/N, rad/(N*m)", "std", "its inverse")
        return Display(f"Static compliance of {self.frame}, {self.axes} axes", heads, rows)
