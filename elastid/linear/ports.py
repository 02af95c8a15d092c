r"""Ports of a linear model: forces and torques at frames as inputs, with motors locked, free or controlled.

.. math:: B = J^T, \qquad \text{locked: } q = N y, \; B_m^T N = 0, \qquad
          \text{controlled: } K + B_m (k_p + k_i k_d) B_m^T, \; D + B_m k_d B_m^T, \; \Delta = B_m k_i k_p B_m^T

J: velocity of the origin of a frame, or its angular velocity.  B_m: columns of the motors.
"""

from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.linear.linear_model import LinearModel, Slope, is_load, project
from elastid.model.loop_closure import null_space
from elastid.record import JointLoop, Motors
from elastid.robot.robot import split_location


def port_motion(location: str) -> str:
    """Return the location of the motion on which a force or torque does work."""
    kind, name, axis = split_location(location)
    return {"force": f"frame {name} {axis}", "torque": f"frame {name} r{axis}"}.get(kind, location)


def locked_motor_motions(B: FloatArray) -> FloatArray:
    """Return N (n, m), the motions with locked motors B^T q = 0; columns of the unit matrix if possible."""
    still = ~np.any(B, axis=1)
    if np.linalg.matrix_rank(B) == np.count_nonzero(~still):
        return np.eye(len(B))[:, still]
    return null_space(B.T)


@dataclass(frozen=True, eq=False)
class Ports:
    """Inputs and outputs as linear combinations of the n_p outputs and n_m motors of a linear model.

    act (n_u, n_p + n_m): inputs by forces at the outputs, then by torques of the motors.  read (n_y, n_p): outputs.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    act: FloatArray
    read: FloatArray

    @classmethod
    def at_frames(cls, model: LinearModel, inputs: tuple[str, ...]) -> "Ports":
        """Return ports for forces that do work on outputs of a model; all outputs are read."""
        n, rows = len(model.outputs), [model.outputs.index(port_motion(load)) for load in inputs if is_load(load)]
        return cls(inputs, model.outputs, np.eye(n, n + len(model.inputs))[rows], np.eye(n))


def between_ports(model: LinearModel, ports: Ports, motors: Motors, loop: JointLoop | None) -> LinearModel:
    """Return the model between ports, without the measurement chain of the drives."""
    K, D, integral = model.K, model.D, None
    if motors == "controlled" and loop is not None:
        gains = loop.kp + loop.ki * loop.kd, loop.kd, loop.ki * loop.kp
        stiffness, damping, drift = ((model.B * gain) @ model.B.T for gain in gains)
        K, D, integral = K + stiffness, D + damping, drift if np.any(drift) else None
    N = locked_motor_motions(model.B) if motors == "locked" else np.eye(model.n)
    slopes = {name: _slope_between_ports(slope, N, ports) for name, slope in model.slopes.items()}
    M, D, K = (project(N, A) for A in (model.M, D, K))
    B, C, T = N.T @ np.hstack([model.C.T, model.B]) @ ports.act.T, ports.read @ model.C @ N, ports.read @ model.T @ N
    return replace(
        model, M=M, D=D, K=K, B=B, C=C, T=T, Z=model.Z @ N, slopes=slopes,
        inputs=ports.inputs, outputs=ports.outputs, chain=(), motors=motors, loop=loop, integral=integral,
    )  # fmt: skip


def _slope_between_ports(slope: Slope, N: FloatArray, ports: Ports) -> Slope:
    M, D, K = (None if A is None or not np.any(N.T @ A) else project(N, A) for A in (slope.M, slope.D, slope.K))
    C, T = (None if matrix is None else ports.read @ matrix @ N for matrix in (slope.C, slope.T))
    B = None if slope.C is None else N.T @ slope.C.T @ ports.act[:, : len(slope.C)].T
    return Slope(M, D, K, C, T, B if B is not None and np.any(B) else None)
