r"""Sensors of the simulated rig: encoders, angles, and the acceleration of points.

.. math:: y = e^T R(q)^T (\ddot p - g) + e^T R(q_0)^T g \quad (accelerometer), \qquad
          y = e^T R(q)^T \ddot p \quad (frame)

with the frame's origin p and axes R, e one of its axes. An accelerometer measures gravity: its constant part is
removed, its change as the frame tilts remains. The second derivative is taken of the sampled motion by central
differences over nine samples, as a sensor with an anti-aliasing filter: to 1e-5 up to a tenth of the
rate, 2e-3 up to a fifth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.model.elastic import ElasticModel
from elastid.model.kinematics import frame_poses
from elastid.record import Motion
from elastid.simulation.controller import rigid_path

_SECOND_DERIVATIVE = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
_REACH = len(_SECOND_DERIVATIVE) // 2


def logged_quantity(place: str) -> Motion:
    """The quantity that is logged at a place: the acceleration of points, the position of joints, motors and bodies."""
    return "acceleration" if _is_point(place) else "position"


def output_stds(noise: NoiseSpec, outputs: Sequence[str]) -> FloatArray:
    """Standard deviation (n_y,) of the noise on each output, in its unit."""
    return np.array([noise.acceleration_std if _is_point(place) else noise.angle_std for place in outputs])


def sense(
    q: FloatArray,
    reading: FloatArray,
    model: ElasticModel,
    q0: FloatArray,
    outputs: Sequence[str],
    rate_hz: float,
    period_samples: int,
) -> FloatArray:
    """Logged outputs (n, n_y) of a motion q (n, n_q), without noise; reading (n, n_u): of the encoders.

    Joint angles in full, of bodies and frames the small angle C (q - q0) from the equilibrium q0.
    """
    C = model.output_jacobian(q0, outputs)
    y = q @ C.T
    for column, place in enumerate(outputs):
        if place in model.inputs:
            y[:, column] = reading[:, model.inputs.index(place)]
        elif _is_point(place):
            y[:, column] = point_acceleration(q, model, q0, place, rate_hz, period_samples)
        elif not place.startswith("joint "):
            y[:, column] -= C[column] @ q0
    return y


def sense_movement(
    moved: FloatArray, model: ElasticModel, q0: FloatArray, outputs: Sequence[str], rate_hz: float, period_samples: int
) -> FloatArray:
    """Contribution (n, n_y) of the planned movement, moved (n, n_u) from the configuration, to the logged outputs."""
    start = model.B.T @ q0
    path = rigid_path(model, q0, start, start + moved)
    y = (path - q0) @ model.output_jacobian(q0, outputs).T
    for column, place in enumerate(outputs):
        if _is_point(place):
            y[:, column] = point_acceleration(path, model, q0, place, rate_hz, period_samples)
    return y


def point_acceleration(
    q: FloatArray, model: ElasticModel, q0: FloatArray, place: str, rate_hz: float, period_samples: int
) -> FloatArray:
    """m/s^2 (n,) at `frame <name> <axis>` or `accelerometer <name> <axis>` along a motion q (n, n_q).

    Before its first sample the motion is extrapolated linearly, after its last one from a period earlier.
    """
    kind, name, axis = place.split(" ", 1)[0], *place.split(" ", 1)[1].rsplit(" ", 1)
    links = [model.index(f"joint {joint.name}") for joint in model.robot.joints]
    poses = frame_poses(model.robot, q[:, links], name)
    acceleration = _second_derivative(poses.position, rate_hz, period_samples)
    along = poses.rotation[:, :, "xyz".index(axis)]
    if kind == "frame":
        return np.asarray(np.einsum("nx,nx->n", along, acceleration))
    gravity = np.array(model.robot.gravity)
    at_rest = frame_poses(model.robot, q0[None, links], name).rotation[0, :, "xyz".index(axis)]
    return np.asarray(np.einsum("nx,nx->n", along, acceleration - gravity) + at_rest @ gravity)


def _second_derivative(p: FloatArray, rate_hz: float, period_samples: int) -> FloatArray:
    n, N = len(p), min(period_samples, len(p) - 1)
    before = p[0] - np.arange(_REACH, 0, -1)[:, None] * (p[1] - p[0])
    after = p[n - N : n - N + _REACH] + (p[n - 1] - p[n - 1 - N])
    padded = np.concatenate([before, p, after])
    weighted = sum(weight * padded[i : i + n] for i, weight in enumerate(_SECOND_DERIVATIVE))
    return np.asarray(weighted * rate_hz**2)


def _is_point(place: str) -> bool:
    kind, _, rest = place.partition(" ")
    return kind == "accelerometer" or (kind == "frame" and rest.rpartition(" ")[2] in ("x", "y", "z"))
