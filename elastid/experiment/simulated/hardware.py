r"""Drives, sensors, noise and friction of the simulated rig, from its section of the study.

.. math:: y = e^T R(q)^T (\ddot p - g) + e^T R(q_0)^T g \quad (accelerometer), \qquad
          y = e^T R(q)^T \ddot p \quad (frame)

with the frame's origin p and axes R, e one of its axes. An accelerometer measures gravity: its constant part is
removed, its change as the frame tilts remains. The second derivative is taken of the sampled motion, with the images of
held torques that it contains, by central differences over 21 samples (Fornberg, Math. Comp. 51, 1988): to 1e-6 up to a
fifth of the rate, 4e-5 up to a quarter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, laplace_variable
from elastid.base.errors import StudyError
from elastid.experiment.specs.simulated import NoiseSpec, TorqueRippleSpec
from elastid.linear.equilibrium import OperatingPoint
from elastid.linear.linear_model import LagElement, sensor_elements, torque_elements
from elastid.linear.motion_bias import is_point
from elastid.model.elastic import ElasticModel
from elastid.model.kinematics import frame_poses
from elastid.record import Motion
from elastid.robot import Robot
from elastid.simulation.contacts import Contacts
from elastid.simulation.controller import rigid_path
from elastid.simulation.drives import Drives, Lag, Ripple

_REACH = 10
# Weights of p_k + p_-k - 2 p_0 of order 2 n, n = _REACH: 2 (-1)^(k + 1) n!^2 / (k^2 (n - k)! (n + k)!).
_WEIGHTS = [
    -2 * (-1) ** k * math.comb(2 * _REACH, _REACH - k) / math.comb(2 * _REACH, _REACH) / k**2
    for k in range(1, _REACH + 1)
]
_SECOND_DERIVATIVE = np.array([*_WEIGHTS[::-1], -2 * sum(_WEIGHTS), *_WEIGHTS])


def logged_quantity(location: str) -> Motion:
    """Return the quantity logged at a location: acceleration of points, position of joints, motors and bodies."""
    return "acceleration" if is_point(location) else "position"


def output_stds(noise: NoiseSpec, outputs: Sequence[str]) -> FloatArray:
    """Return standard deviation (n_y,) of the noise on each output, in its unit."""
    return np.array([noise.acceleration_std if is_point(location) else noise.angle_std for location in outputs])


def sense(
    q: FloatArray, reading: FloatArray, model: ElasticModel, q0: FloatArray, outputs: Sequence[str], rate_hz: float,
    period_samples: int
) -> FloatArray:  # fmt: skip
    """Return logged outputs (n, n_y) of a motion q (n, n_q), without noise; reading (n, n_u): encoder positions.

    Joint angles in full, of bodies and frames the small angle C (q - q0) from the equilibrium q0.
    """
    C = model.output_jacobian(q0, outputs)
    y = q @ C.T
    for column, location in enumerate(outputs):
        if location in model.inputs:
            y[:, column] = reading[:, model.inputs.index(location)]
        elif is_point(location):
            y[:, column] = point_acceleration(q, model, q0, location, rate_hz, period_samples)
        elif not location.startswith("joint "):
            y[:, column] -= C[column] @ q0
    return y


def sense_movement(
    offset: FloatArray, model: ElasticModel, q0: FloatArray, outputs: Sequence[str], rate_hz: float, period_samples: int
) -> FloatArray:
    """Compute the contribution (n, n_y) of a planned movement, offset (n, n_u), to the logged outputs."""
    start = model.B.T @ q0
    path = rigid_path(model, q0, start, start + offset)
    still, setup = np.broadcast_to(q0, path.shape), (model, q0, outputs, rate_hz, period_samples)
    return sense(path, start + offset, *setup) - sense(still, still @ model.B, *setup)


def point_acceleration(
    q: FloatArray, model: ElasticModel, q0: FloatArray, location: str, rate_hz: float, period_samples: int
) -> FloatArray:
    """Compute m/s^2 (n,) at `frame <name> <axis>` or `accelerometer <name> <axis>` along a motion q (n, n_q).

    Before its first sample the motion is extrapolated linearly, after its last one from a period earlier.
    """
    kind, name, axis = location.split(" ", 1)[0], *location.split(" ", 1)[1].rsplit(" ", 1)
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
    head = p[0] - np.arange(_REACH, 0, -1)[:, None] * (p[1] - p[0])
    extended = np.concatenate([head, p, p[n - N : n - N + _REACH] + (p[n - 1] - p[n - 1 - N])])
    return np.asarray(sum(weight * extended[i : i + n] for i, weight in enumerate(_SECOND_DERIVATIVE)) * rate_hz**2)


@dataclass(frozen=True)
class Noise:
    """All noise over a whole run: Nm (n, n_u), rad (n, n_u), Nm (n, n_u), of the outputs (n, n_y)."""

    torque: FloatArray
    reading: FloatArray
    disturbance: FloatArray
    outputs: FloatArray


def draw_noise(
    spec: NoiseSpec, n: int, rate_hz: float, n_u: int, outputs: Sequence[str], seed: tuple[int, ...]
) -> Noise:
    """Draw the noise of a run of n samples; white and colored parts come from the same seed, one after the other."""
    random = np.random.default_rng(seed)
    signals = {
        "torque": spec.torque_std * random.standard_normal((n, n_u)),
        "reading": spec.angle_std * random.standard_normal((n, n_u)),
        "disturbance": spec.disturbance_std * random.standard_normal((n, n_u)),
        "outputs": output_stds(spec, outputs) * random.standard_normal((n, len(outputs))),
    }
    frequencies = np.fft.rfftfreq(n, 1 / rate_hz).astype(np.float64)
    for color in spec.colored:
        shape = color.amplitude(frequencies)
        shape[0] = 0.0
        shape *= color.std / math.sqrt(np.mean(shape**2))
        for name in ("reading", "outputs") if color.signal == "angle" else (color.signal,):
            white = random.standard_normal(signals[name].shape)
            noise = np.fft.irfft(shape[:, None] * np.fft.rfft(white, axis=0), n, axis=0)
            if name == "outputs":  # accelerations have no noise of an angle
                noise = noise * [logged_quantity(location) == "position" for location in outputs]
            signals[name] = signals[name] + noise
    return Noise(**signals)


def drives(robot: Robot, encoder_counts: int, torque_ripple: Sequence[TorqueRippleSpec], saturation: bool) -> Drives:
    """Return the drives of a robot, link side; StudyError where torques are to be clipped and no joint has a limit."""
    ratio = np.array([robot.ratio(joint.name) for joint in robot.driven])
    limit = np.array([joint.limits.torque if saturation else math.inf for joint in robot.driven])
    if saturation and not np.isfinite(limit).any():
        raise StudyError(
            "experiment/simulated",
            "saturation needs limits.torque. Add `limits: {torque: ...}` to the robot model",
            "experiment.simulated.saturation",
        )
    resolution = 2 * np.pi / (encoder_counts * np.abs(ratio)) if encoder_counts else np.zeros(len(ratio))
    T = robot.chain.torque_lag
    lags = [Lag(element.coefficients, T) for element in torque_elements(robot.chain) if T is not None]
    ripples = tuple(
        Ripple(spec.amplitude * np.abs(ratio), spec.periods * ratio, np.full(len(ratio), spec.phase))
        for spec in torque_ripple
    )
    return Drives(resolution, limit, ripples, lags[0] if lags else None)


def friction_coefficients(contacts: Contacts, robot: Robot, point: OperatingPoint) -> FloatArray:
    """Compute friction coefficients (9 n_f,) in a configuration: the load on a joint is the torque that holds it there.

    StudyError where the load gives coefficients that no friction law has.
    """
    pairs = zip(contacts.laws, loads_of(contacts, robot, point), strict=True)
    try:
        return np.concatenate([np.zeros(0), *(law.curve(load) for law, load in pairs)])
    except ValueError as error:
        raise StudyError("experiment/simulated", str(error), f"configuration {point.configuration.name}") from None


def loads_of(contacts: Contacts, robot: Robot, point: OperatingPoint) -> list[float]:
    """Compute loads in Nm, link side, of contacts: the holding torque of a driven joint, the spring's of another."""
    driven, loads = robot.driven_names, list[float]()
    for law in contacts.laws:
        name = law.place.split(" ", 1)[1]
        index, joint = next((i, joint) for i, joint in enumerate(robot.joints) if joint.name == name)
        spring_torque = 0.0 if joint.spring is None else joint.spring.stiffness * point.q[index]
        loads.append(float(abs(point.u[driven.index(name)] if name in driven else spring_torque)))
    return loads


def filter_motions(robot: Robot, y: FloatArray, rate_hz: float) -> FloatArray:
    """Filter motions (n, n_y), at rest before they begin, by the low-pass filter of the robot's chain.

    The filter is the continuous one, by the spectrum of the motion continued smoothly to its mirror image.
    """
    for element in sensor_elements(robot.chain):
        T = robot.chain.sensor_lag
        if isinstance(element, LagElement) and T is not None:
            half = np.concatenate([y, 2 * y[-1] - y[::-1]])
            period = np.concatenate([half, half[::-1]]) - y[0]
            s = laplace_variable(np.fft.rfftfreq(len(period), 1 / rate_hz))
            spectrum = np.fft.rfft(period, axis=0) * element.response(s, T)[:, None]
            y = y[0] + np.fft.irfft(spectrum, len(period), axis=0)[: len(y)]
    return y
