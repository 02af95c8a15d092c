"""A rig of another thermal structure than the model's: gear and housing, two nodes, with the thermometer outside.

Heat of friction enters the gear, flows to the housing through a conductance, and from there to the room; friction
follows the gear. Integrated by explicit Euler steps of a second, with the mean power of the motion.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray

ROOM = 22.0  # degC
# Coulomb and viscous friction at the room's temperature in Nm and Nms/rad, their decay over K; rigid body.
COULOMB, VISCOUS, DECAY, INERTIA, GRAVITY, RIPPLE = 30.0, 90.0, 40.0, 15.0, 60.0, 0.5


@dataclass(frozen=True)
class Nodes:
    """Heat capacities of gear and housing in J/K, conductances between them and to the room in W/K."""

    gear: float = 2500.0
    housing: float = 9000.0
    inner: float = 12.0
    outer: float = 6.0


NODES = Nodes()


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
    return np.asarray(COULOMB * (0.7 + 0.3 * fade) + VISCOUS * (0.3 + 0.7 * fade) * np.abs(speed))


def warm_log(
    hours: float = 2.0, rate_hz: float = 100.0, seed: int = 0, thermometer_std: float = 0.3, count: float = 0.0,
    start_degc: float = ROOM, nodes: Nodes = NODES,
) -> WarmLog:  # fmt: skip
    """Half an hour of work at two speeds, a pause of ten minutes, and again; torque noise of 1 Nm."""
    rng = np.random.default_rng(seed)
    n = round(hours * 3600 * rate_hz)
    time_s = np.arange(n) / rate_hz
    velocity = np.where(time_s % 2400 < 1800, _cycles(n, rate_hz), 0.0)
    position = np.cumsum((velocity + np.append(0.0, velocity[:-1])) / 2) / rate_hz
    position = position - position.mean()
    gear, housing = _temperatures(velocity, rate_hz, start_degc, nodes)
    sliding = np.sign(velocity) * friction(velocity, gear)
    torque = sliding + INERTIA * np.gradient(velocity, 1 / rate_hz) - GRAVITY * np.sin(position)
    torque = torque + RIPPLE * np.sin(100 * position) + rng.standard_normal(n)
    readings = housing + thermometer_std * rng.standard_normal(n)
    return WarmLog(rate_hz, position, torque, np.round(readings / count) * count if count else readings, gear)


def _cycles(n: int, rate_hz: float) -> FloatArray:
    """Velocity (n,) to and fro at 1.2 and 0.4 rad/s with ramps of 0.3 s, over 1.2 rad."""
    ramp = np.sin(np.linspace(0, np.pi / 2, round(0.3 * rate_hz))) ** 2
    ways = []
    for speed in (1.2, 1.2, 1.2, 0.4):
        flat = np.ones(round((1.2 / speed - 0.3) * rate_hz))
        way = speed * np.concatenate([ramp, flat, ramp[::-1], np.zeros(round(0.1 * rate_hz))])
        ways += [way, -way]
    return np.resize(np.concatenate(ways), n)


def _temperatures(
    velocity: FloatArray, rate_hz: float, start_degc: float, nodes: Nodes
) -> tuple[FloatArray, FloatArray]:
    """Gear and housing (n,) in degC."""
    per_s = round(rate_hz)
    seconds = np.abs(velocity)[: len(velocity) // per_s * per_s].reshape(-1, per_s)
    T, S, path = start_degc, start_degc, [(start_degc, start_degc)]
    for speeds in seconds:
        power = float(np.mean(speeds * friction(speeds, T)))
        flow = nodes.inner * (T - S)
        T, S = T + (power - flow) / nodes.gear, S + (flow - nodes.outer * (S - ROOM)) / nodes.housing
        path.append((T, S))
    gear, housing = (
        np.interp(np.arange(len(velocity)) / rate_hz, np.arange(len(path)), each) for each in np.array(path).T
    )
    return gear, housing


def write_warm_log(path: Path, log: WarmLog, thermometer: bool = True, part: slice = slice(None)) -> None:
    """A CSV of torque, angle and thermometer on the link side."""
    columns = {"torque": log.torque, "angle": np.round(log.position / 1e-6) * 1e-6}
    columns |= {"temperature": log.thermometer} if thermometer else {}
    table = np.column_stack([column[part] for column in columns.values()])
    np.savetxt(path, table, "%.8g", ",", header=",".join(columns), comments="")
