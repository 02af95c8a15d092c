r"""One sample of the closed loop as a function: encoders, controller and drives, then the steps of the plant.

.. math:: (q, v, z, w, I, y)_{k+1}, u_k = F\bigl((q, v, z, w, I, y)_k, \text{references}_k, \text{noise}_k\bigr)

q, v: coordinates and velocities, z: states of friction, w: of the drives, I: of the integral, y: last reading. Each
stage of a Runge-Kutta step calls the same functions, so that the code of a robot's equations is there once.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from elastid.model.elastic import ElasticModel
from elastid.simulation.baumgarte import projection
from elastid.simulation.controller import feedback
from elastid.simulation.drives import Drives
from elastid.simulation.dynamics import free_acceleration, runge_kutta_step
from elastid.simulation.friction_states import Contacts

# Results of a sample that the next one starts from: q, v, states of friction and drives, integral, last reading.
N_STATES = 6


def sampled_step(
    model: ElasticModel,
    contacts: Contacts,
    rate_hz: float,
    substeps: int,
    drives: Drives,
) -> ca.Function:
    """The states, references, noise, gains and the friction's numbers -> the states one sample later, and u.

    substeps: Runge-Kutta steps in a sample.  The loops of a linkage are closed by projection after each sample.
    """
    sizes = {"q": model.n_q, "v": model.n_q, "z": contacts.n_states, "w": drives.n_states}
    sizes |= dict.fromkeys(("integral", "last", "position", "velocity", "torque", "disturbance", "noise"), model.n_u)
    sizes |= dict.fromkeys(("kp", "kd", "ki"), model.n_u) | {"curves": len(contacts.curves)}
    given = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    control, drive = _control(model, drives, rate_hz), _drive(drives, 1 / (rate_hz * substeps))
    accelerate, advance = _acceleration(model, contacts, drives), _advance(model, contacts)

    def acceleration(q: ca.MX, v: ca.MX, z: ca.MX, torque: ca.MX) -> ca.MX:
        return accelerate(q, v, z, torque, given["disturbance"], given["curves"])

    def advanced(z: ca.MX, v: ca.MX, step: float) -> ca.MX:
        return advance(z, v, given["curves"], step)

    reading, u, integral = control(*(given[name] for name in control.name_in()))
    q, v, z, w = (given[name] for name in ("q", "v", "z", "w"))
    for _ in range(substeps):
        *torques, w = drive(w, u)
        q, v, z = runge_kutta_step(acceleration, advanced, q, v, z, torques, 1 / (rate_hz * substeps))
    if model.n_c:
        q, v = projection(model)(q, v)
    return ca.Function("sample", [*given.values()], [q, v, z, w, integral, reading, u])


def shafts(model: ElasticModel) -> tuple[ca.DM, ca.DM]:
    """E and its inverse: from the link side to the shafts, where encoders count and drives clip (robot.mixing)."""
    E = model.robot.mixing
    return ca.sparsify(ca.DM(E)), ca.sparsify(ca.DM(np.linalg.inv(E)))


def _control(model: ElasticModel, drives: Drives, rate_hz: float) -> ca.Function:
    """Encoders and controller: the reading, the command u as the drives clip it, and the integral after the sample."""
    names = ("q", "integral", "last", "position", "velocity", "torque", "noise", "kp", "kd", "ki")
    given = {name: ca.SX.sym(name, model.n_q if name == "q" else model.n_u) for name in names}
    E, E_inverse = shafts(model)
    reading = E_inverse @ drives.reading(E @ ca.DM(model.B).T @ given["q"], given["noise"])
    last, position, velocity = given["last"], given["position"], given["velocity"]
    error = feedback(reading, last, position, velocity, given["kp"], given["kd"], rate_hz)
    command = given["torque"] + error + given["ki"] * given["integral"]
    asked = E_inverse.T @ command
    taken = drives.clipped(asked)
    u = command + E.T @ (taken - asked)
    # A drive at its limit would wind the integral up.
    integral = given["integral"] + ca.if_else(taken == asked, error / rate_hz, 0)
    results = [ca.densify(each) for each in (reading, u, integral)]
    return ca.Function("control", [*given.values()], results, [*names], ["reading", "u", "integral_after"])


def _drive(drives: Drives, step: float) -> ca.Function:
    """(w, u) -> torque at the beginning, the middle and the end of a step, and w after it."""
    w, u = ca.SX.sym("w", drives.n_states), ca.SX.sym("u", len(drives.torque))
    found = [drives.lagged(w, u, part * step) for part in (0.0, 0.5, 1.0)]
    return ca.Function("drive", [w, u], [*(torque for torque, _ in found), found[-1][1]])


def _acceleration(model: ElasticModel, contacts: Contacts, drives: Drives) -> ca.Function:
    """(q, v, z, torque, disturbance, curves) -> q'', the torque that of the drives (n_u,), link side."""
    q, v, z = (ca.SX.sym(name, n) for name, n in (("q", model.n_q), ("v", model.n_q), ("z", contacts.n_states)))
    torque, disturbance = ca.SX.sym("torque", model.n_u), ca.SX.sym("disturbance", model.n_u)
    curves = ca.SX.sym("curves", len(contacts.curves))
    B, (E, E_inverse) = ca.DM(model.B), shafts(model)
    driving = E.T @ drives.on_motors(E_inverse.T @ torque, E @ B.T @ q) + disturbance
    a = free_acceleration(model)(q, v, B @ driving - contacts.torque(v, z, curves))
    return ca.Function("acceleration", [q, v, z, torque, disturbance, curves], [ca.densify(a)], {"cse": True})


def _advance(model: ElasticModel, contacts: Contacts) -> ca.Function:
    """(z, v, curves, step) -> the states of friction after `step` s at constant v."""
    z, v = ca.SX.sym("z", contacts.n_states), ca.SX.sym("v", model.n_q)
    curves, step = ca.SX.sym("curves", len(contacts.curves)), ca.SX.sym("step")
    return ca.Function("advance", [z, v, curves, step], [ca.densify(contacts.advanced(v, z, curves, step))])
