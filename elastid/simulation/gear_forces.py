r"""Forces of gears besides their springs and dry friction: transmission error, ripple, friction by load.

.. math:: x = z^T q + e(\theta), \qquad \tau = n(x) + d\, \dot x, \qquad
          F = z\, [\tau - n(z^T q) - d\, z^T \dot q]
              + m\, [\tau\, e' + F_{load} |\tau|\, \mathrm{sgn}(m^T \dot q) + ripple(\theta)]

z: deflection of a gear's spring, m: angle of its motor on the link side, as rows in the coordinates; theta the motor's
own angle, n the spring. F brakes, as friction does: it stands on the left of the equations of motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from elastid.friction.static import SLIDING_VELOCITY
from elastid.model.drivetrain import spring_deflections, spring_torque
from elastid.model.elastic import ElasticModel
from elastid.robot import GearRipple, TransmissionError


def gear_forces(model: ElasticModel, q: ca.SX, v: ca.SX, numbers: ca.SX | None = None) -> ca.SX:
    """F (n_q,) at q, v (n_q,).  numbers (n_theta,): symbols of the parameters; the model's own by default."""
    robot, force = model.robot, ca.SX(model.n_q, 1)
    values = model.theta.tolist() if numbers is None else ca.vertsplit(numbers)
    theta = dict(zip(model.parameters, values, strict=True))
    shafts = dict(zip((joint.name for joint in robot.driven), robot.mixing @ model.B.T, strict=True))
    springs = spring_deflections(robot)
    for joint in robot.driven:
        if joint.gear is None or joint.spring is None:
            continue
        z, m = ca.sparsify(ca.DM(springs[f"k_{joint.name}"])), ca.sparsify(ca.DM(shafts[joint.name]))
        ratio, d = robot.ratio(joint.name), theta[f"d_{joint.name}"]
        e, slope = _harmonics(joint.gear.error, ratio * (m.T @ q))
        ripple, _ = _harmonics(joint.gear.ripple, ratio * (m.T @ q))
        slope = ratio * slope
        linear = spring_torque(joint.name, z.T @ q, theta) + d * (z.T @ v)
        tau = spring_torque(joint.name, z.T @ q + e, theta) + d * (z.T @ v + slope * (m.T @ v))
        braking = joint.gear.load * ca.fabs(tau) * ca.tanh(m.T @ v / SLIDING_VELOCITY)
        force += z * (tau - linear) + m * (tau * slope + braking + ripple)
    return force


def _harmonics(terms: Sequence[TransmissionError | GearRipple], angle: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The sum of A sin(order angle + phase), and its derivative."""
    value, slope = ca.SX(0), ca.SX(0)
    for term in terms:
        value += term.amplitude * ca.sin(term.order * angle + term.phase)
        slope += term.amplitude * term.order * ca.cos(term.order * angle + term.phase)
    return value, slope
