r"""Presliding friction of motors: a spring that relaxes (Maxwell element) at each motor's shaft.

.. math:: \tau = s z, \quad \dot z = \dot q_m - a z \qquad\Rightarrow\qquad
          \frac{\tau}{q_m} = s\, \frac{j \omega}{j \omega + a}

This is the stochastic linearisation of bristles (LuGre, Dahl, Maxwell slip) for a Gaussian motion; a is about E|v|, v
the velocity, over the presliding distance. A massless coordinate p between the spring s at the shaft and a damper c = s
/ a to the ground has the same torque, so that M, D and K are affine in s and c:

.. math:: K \mathrel{+}= s \begin{bmatrix} b b^T & -b \\ -b^T & 1 \end{bmatrix}, \qquad
          D \mathrel{+}= c \begin{bmatrix} 0 & 0 \\ 0 & 1 \end{bmatrix}, \qquad q_m = b^T q

For a -> 0 it is a spring s to the ground, for a -> infinity a damper s / a.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.linear.linear_model import LinearModel, Slope
from elastid.parameters import DELAY

# Ratio of motion between reversals to presliding distance, between which a linear model needs relaxing springs.
AMPLITUDES = (0.2, 4.0)


@dataclass(frozen=True)
class RelaxingSpring:
    """Presliding friction of the motor of a joint; sign: -1 for overcompensated friction."""

    joint: str
    sign: int = 1

    @property
    def names(self) -> tuple[str, str]:
        """Names of s, N m/rad, and c = s / a, N m s/rad, both positive, on the link side."""
        return f"presliding_{self.joint}", f"sliding_{self.joint}"


def element_names(springs: Sequence[RelaxingSpring]) -> tuple[str, ...]:
    """Return the names of the numbers of all springs, in their order in theta."""
    return tuple(name for spring in springs for name in spring.names)


def with_relaxing_springs(
    model: LinearModel, springs: Sequence[RelaxingSpring], shafts: FloatArray, theta: FloatArray
) -> LinearModel:
    """Add springs at the motors.  shafts (n_s, n): b of each spring.  theta (2 n_s,): s and c of each spring."""
    n, n_s = model.n, len(springs)
    size = n + n_s
    slopes = {name: _pad_slope(slope, n_s) for name, slope in model.slopes.items()}
    M, D, K = (_pad(matrix, n_s, n_s) for matrix in (model.M, model.D, model.K))
    for i, (spring, b) in enumerate(zip(springs, shafts, strict=True)):
        v, e = np.zeros(size), np.zeros(size)
        v[:n], v[n + i], e[n + i] = b, -1.0, 1.0
        of_K, of_D = spring.sign * np.outer(v, v), spring.sign * np.outer(e, e)
        K, D = K + theta[2 * i] * of_K, D + theta[2 * i + 1] * of_D
        slopes |= dict(zip(spring.names, (Slope(K=of_K), Slope(D=of_D)), strict=True))
    at = model.parameters.index(DELAY)
    names = (*model.parameters[:at], *element_names(springs), *model.parameters[at:])
    return replace(
        model, parameters=names, theta_ref=np.insert(model.theta_ref, at, theta), M=M, D=D, K=K, slopes=slopes,
        B=_pad(model.B, n_s, 0), C=_pad(model.C, 0, n_s), T=_pad(model.T, 0, n_s), Z=_pad(model.Z, 0, n_s),
    )  # fmt: skip


def _pad_slope(slope: Slope, n_s: int) -> Slope:
    shapes = {"M": (n_s, n_s), "D": (n_s, n_s), "K": (n_s, n_s), "C": (0, n_s), "T": (0, n_s), "B": (n_s, 0)}
    blocks = {letter: (getattr(slope, letter), shape) for letter, shape in shapes.items()}
    return Slope(**{letter: None if A is None else _pad(A, *shape) for letter, (A, shape) in blocks.items()})


def _pad(matrix: FloatArray, rows: int, columns: int) -> FloatArray:
    larger = np.zeros((matrix.shape[0] + rows, matrix.shape[1] + columns))
    larger[: matrix.shape[0], : matrix.shape[1]] = matrix
    return larger
