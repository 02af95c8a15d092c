"""Two links in a vertical plane with both joints elastic, a lone motor, and their simulation."""

import numpy as np

from elastid.friction.robot_friction import PlacedLaw
from elastid.friction.static import Tustin
from elastid.model.elastic import ElasticModel
from elastid.robot import Body, Friction, Joint, Motor, Robot
from elastid.simulation.closed_loop import ClosedLoop, Commands, closed_loop
from elastid.simulation.contacts import Contacts, contacts
from elastid.simulation.controller import feed_forward
from elastid.simulation.drives import Drives
from plants.arm import robot

FREE = np.array([[-np.inf, np.inf]] * 2)


def arm(damping: float = 0.0) -> Robot:
    """Two links in a vertical plane, both joints elastic."""
    return robot(damping=(damping, damping))


def motor() -> Robot:
    """A single motor on a weightless gear, 20 kg m^2 on the link side, and nothing else."""
    return Robot("motor", (Body("rotor", joints=(Joint("1", "z", motor=Motor(2e-3, 100.0)),), mass=1.0),))


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
