"""Two links in a vertical plane with both joints elastic, a lone motor, and their simulation."""

import math

import numpy as np

from elastid.friction.robot_friction import PlacedLaw
from elastid.friction.static import Tustin
from elastid.model.elastic import ElasticModel
from elastid.robot import Body, Friction, Joint, Motor, Robot
from elastid.simulation.closed_loop import ClosedLoop, Commands, closed_loop
from elastid.simulation.controller import feed_forward
from elastid.simulation.drives import Drives
from elastid.simulation.dynamics import Contacts, contacts
from plants.arm import LENGTH, MASS, OFFSET, STIFFNESS, robot
from plants.integration import acceleration, runge_kutta

FREE = np.array([[-np.inf, np.inf]] * 2)
NO_FRICTION = np.zeros(2)


def arm(damping: float = 0.0, gravity: float = -9.81) -> Robot:
    """Two links in a vertical plane, both joints elastic."""
    return robot(damping=(damping, damping), gravity=-gravity)


def motor(inertia: float = 2e-3) -> Robot:
    """A single motor on a weightless gear, 20 kg m^2 on the link side, and nothing else."""
    return Robot("motor", (Body("rotor", joints=(Joint("1", "z", motor=Motor(inertia, 100.0)),), mass=1.0),))


def energy(model: ElasticModel, q: np.ndarray, v: np.ndarray) -> float:
    """Kinetic, gravitational and elastic energy of the arm, heights and deflections written out."""
    a1, a2 = q[0], q[0] + q[1]
    heights = -OFFSET[0] * math.sin(a1), -LENGTH * math.sin(a1) - OFFSET[1] * math.sin(a2)
    gravitational = 9.81 * sum(m * h for m, h in zip(MASS, heights, strict=True))
    elastic = sum(k * (q[2 + i] - q[i]) ** 2 / 2 for i, k in enumerate(STIFFNESS))
    return float(v @ model.mass(q, model.theta).full() @ v / 2 + gravitational + elastic)


def path(model: ElasticModel, step: float, duration: float, state: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """States (n, 2 n_q) at the ends of n equal parts of `duration` s, with torque (n, n_u) held in each."""
    advance = runge_kutta(acceleration(model, NO_FRICTION), step, round(duration / len(torque) / step))
    states = []
    for u in torque:
        state = np.concatenate([part.full()[:, 0] for part in advance(*np.split(state, 2), u)])
        states.append(state)
    return np.array(states)


def quiet(model: ElasticModel, q0: np.ndarray, n: int, torque: np.ndarray | None = None) -> Commands:
    """Stay where you are: reference and holding torque of q0, n samples, `torque` added."""
    z = np.zeros((n, model.n_u))
    held = feed_forward(model, q0, z[:1], z[:1], z[:1])
    return Commands(z + model.B.T @ q0, z, z + held + (0 if torque is None else torque), z, z)


def rough(model: ElasticModel, level: float) -> Contacts:
    """Coulomb friction of so many Nm, link side, at every motor."""
    return contacts(model, [PlacedLaw(place, Tustin(), Friction(level), 1.0) for place in model.inputs if level])


def loop(model: ElasticModel, coulomb: float = 0.0, count: float = 0.0) -> ClosedLoop:
    """Closed at 1 kHz with two steps a sample, motors free to go anywhere."""
    n_u = model.n_u
    drives = Drives(np.full(n_u, count), np.full(n_u, np.inf))
    return closed_loop(model, rough(model, coulomb), FREE[:n_u], 1000.0, 2, drives)
