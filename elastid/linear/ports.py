r"""Forces and torques at frames as inputs of a linear model, with its motors held, free or controlled.

.. math:: B = J^T, \qquad \text{held: } q = N y, \; B_m^T N = 0, \qquad
          \text{controlled: } K + B_m k_p B_m^T, \; D + B_m k_d B_m^T

J: velocity of a frame's origin, or its angular velocity, so that a force at a place works on its motion.  B_m: of the
motors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.linear.linear_model import LinearModel, Slope, is_load
from elastid.model.loop_closure import null_space
from elastid.record import JointLoop, Motors


def moved_by(place: str) -> str:
    """The motion on which a force or torque works."""
    kind, _, rest = place.partition(" ")
    name, _, axis = rest.rpartition(" ")
    return {"force": f"frame {name} {axis}", "torque": f"frame {name} r{axis}"}.get(kind, place)


def with_held_motors(B: FloatArray) -> FloatArray:
    """N (n, m): motions that leave the motors B^T q = 0 at rest; columns of the unit matrix where these are."""
    still = ~np.any(B, axis=1)
    if np.linalg.matrix_rank(B) == np.count_nonzero(~still):
        return np.eye(len(B))[:, still]
    return null_space(B.T)


def acted_on(model: LinearModel, inputs: tuple[str, ...], motors: Motors, loop: JointLoop | None) -> LinearModel:
    """The same by forces and torques at frames, whose motions are among its outputs; no chain of drives is in it."""
    K, D = model.K, model.D
    if motors == "controlled" and loop is not None:
        K, D = (A + (model.B * gain) @ model.B.T for A, gain in ((K, loop.kp), (D, loop.kd)))
    N = with_held_motors(model.B) if motors == "held" else np.eye(model.n)
    rows = [model.outputs.index(moved_by(place)) for place in inputs if is_load(place)]
    slopes = {name: _on(slope, N, rows) for name, slope in model.slopes.items()}
    M, D, K = (_square(N, A) for A in (model.M, D, K))
    return replace(
        model, M=M, D=D, K=K, B=(model.C[rows] @ N).T, C=model.C @ N, T=model.tilt @ N, Z=np.asarray(model.Z) @ N,
        slopes=slopes, inputs=inputs, chain=(), motors=motors, loop=loop,
    )  # fmt: skip


def _square(N: FloatArray, A: FloatArray) -> FloatArray:
    """N^T A N, symmetric to the last bit."""
    product = N.T @ A @ N
    return np.asarray((product + product.T) / 2)


def _on(slope: Slope, N: FloatArray, rows: list[int]) -> Slope:
    M, D, K = (None if A is None or not np.any(N.T @ A) else _square(N, A) for A in (slope.M, slope.D, slope.K))
    C, T = (None if part is None else part @ N for part in (slope.C, slope.T))
    B = None if C is None or not np.any(C[rows]) else C[rows].T
    return Slope(M, D, K, C, T, B)
