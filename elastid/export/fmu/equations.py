"""The equations of a robot with friction as C functions, its tunable numbers among their arguments."""

from __future__ import annotations

from pathlib import Path

import casadi as ca

from elastid.model.elastic import ElasticModel
from elastid.simulation.baumgarte import projection
from elastid.simulation.dynamics import free_acceleration
from elastid.simulation.friction_states import Contacts


def equations(model: ElasticModel, contacts: Contacts) -> tuple[ca.Function, ...]:
    """acceleration, bristles, readings and, with loops, closing; dense.

    acceleration(q, v, z, u, theta, friction) -> q''.  bristles(z, v, friction, step) -> z after a step at constant v.
    readings(q, v) -> angles and speeds of the motors, angles of the joints.  closing(q, v, theta) -> q, v on the loops.
    """
    q, v = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q)
    z, u = ca.SX.sym("z", contacts.n_states), ca.SX.sym("u", model.n_u)
    theta, friction = ca.SX.sym("theta", len(model.theta)), ca.SX.sym("friction", len(contacts.curves))
    step = ca.SX.sym("step")
    B, n_l = ca.DM(model.B), len(model.robot.joints)
    torque = B @ u - contacts.torque(v, z, friction)
    accelerate = free_acceleration(model, theta=theta)
    readings = [B.T @ q, B.T @ v, q[:n_l]]
    built = [
        _dense("acceleration", [q, v, z, u, theta, friction], [accelerate(q, v, torque, theta)]),
        _dense("bristles", [z, v, friction, step], [contacts.advanced(v, z, friction, step)]),
        _dense("readings", [q, v], readings),
    ]
    if model.n_c:
        built.append(_dense("closing", [q, v, theta], list(projection(model, theta)(q, v, theta))))
    return tuple(built)


def write_equations(folder: Path, functions: tuple[ca.Function, ...]) -> None:
    """equations.c and equations.h."""
    generator = ca.CodeGenerator("equations.c", {"with_header": True})
    for function in functions:
        generator.add(function)
    generator.generate(f"{folder}/")


def _dense(name: str, given: list[ca.SX], results: list[ca.SX]) -> ca.Function:
    """A function whose results have no structural zeros."""
    return ca.Function(name, given, [ca.densify(result) for result in results], {"cse": True})
