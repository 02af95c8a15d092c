"""A rig of another thermal structure than the model's: gear and housing, two nodes, with the thermometer outside.

Heat of friction enters the gear, flows to the housing through a conductance, and from there to the room; friction
follows the gear. Integrated by explicit Euler steps of a second, with the mean power of the motion.
"""

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from plants.friction_logs import GRAVITY, INERTIA, RATIO, RIPPLE, trapezoids

ROOM = 22.0  # degC
# Coulomb and viscous friction at the room's temperature in Nm and Nms/rad, their decay over K.
COULOMB, VISCOUS, DECAY = 30.0, 90.0, 40.0
# Heat capacities of gear and housing in J/K, conductances between them and to the room in W/K.
GEAR, HOUSING, INNER, OUTER = 2500.0, 9000.0, 12.0, 6.0


@dataclass(frozen=True)
class WarmLog:
    """Signals (n,) on the link side: angle, torque, thermometer outside; gear: degC, which friction follows."""

    rate_hz: float
    position: FloatArray
    torque: FloatArray
    thermometer: FloatArray
    gear: FloatArray


def friction(speed: FloatArray | float, degc: FloatArray | float) -> FloatArray:
    """Nm at |speed| in rad/s and a temperature."""
    fade = np.exp(-(np.asarray(degc) - ROOM) / DECAY)
    return COULOMB * (0.7 + 0.3 * fade) + VISCOUS * (0.3 + 0.7 * fade) * np.abs(speed)


def warm_log(hours: float, thermometer_std: float = 0.3, count: float = 0.0) -> WarmLog:
    """Half an hour of work at two speeds, a pause of ten minutes, and again; torque noise of 1 Nm."""
    rng, rate_hz = np.random.default_rng(0), 25.0
    n = round(hours * 3600 * rate_hz)
    time_s = np.arange(n) / rate_hz
    # To and fro at 1.2 and 0.4 rad/s.
    cycles = np.resize(np.diff(trapezoids((1.2, 1.2, 1.2, 0.4), 1.2, rate_hz)) * rate_hz, n)
    velocity = np.where(time_s % 2400 < 1800, cycles, 0.0)
    position = np.cumsum((velocity + np.append(0.0, velocity[:-1])) / 2) / rate_hz
    position = position - position.mean()
    gear, housing = _temperatures(velocity, rate_hz)
    sliding = np.sign(velocity) * friction(velocity, gear)
    torque = sliding + INERTIA * np.gradient(velocity, 1 / rate_hz) - GRAVITY * np.cos(position)
    torque = torque + RIPPLE * np.sin(RATIO * position) + rng.standard_normal(n)
    readings = housing + thermometer_std * rng.standard_normal(n)
    return WarmLog(rate_hz, position, torque, np.round(readings / count) * count if count else readings, gear)


def _temperatures(velocity: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    per_s = round(rate_hz)
    seconds = np.abs(velocity)[: len(velocity) // per_s * per_s].reshape(-1, per_s)
    T, S, path = ROOM, ROOM, [(ROOM, ROOM)]
    for speeds in seconds:
        power = float(np.mean(speeds * friction(speeds, T)))
        flow = INNER * (T - S)
        T, S = T + (power - flow) / GEAR, S + (flow - OUTER * (S - ROOM)) / HOUSING
        path.append((T, S))
    gear, housing = (
        np.interp(np.arange(len(velocity)) / rate_hz, np.arange(len(path)), each) for each in np.array(path).T
    )
    return gear, housing
