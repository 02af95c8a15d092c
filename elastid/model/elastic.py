r"""ElasticModel: the equations of motion of an elastic robot, the contract of every formulation.

.. math:: M(q, \theta)\, \ddot q + f(q, \dot q, \theta) + \Phi(q)^T \lambda = B u, \qquad \varphi(q, \theta) = 0,
          \qquad \Phi = \partial \varphi / \partial q

    f = Coriolis and centrifugal terms + dV/dq + dR/dq'
    V = gravity + springs + compensators,     R = dissipation / 2

Conventions, for all of `model`, `linear` and `simulation`:

- Everything is on the link side: a motor coordinate q_m is the motor's angle divided by its gear ratio, a motor torque
  is multiplied by it, inertia and viscous friction by its square. Where gears couple axes, q_m = eta^-1 q_m^m and
  u = eta^T tau_m: `motor 5` is then the angle of joint 5 that all motors make without deflection, not one shaft.
  `drivetrain` alone applies ratios.
- u is the torque that the motor's magnetic field exerts; a positive torque drives a positive angle.
- The gear spring drives the arm and holds the motor back by the same torque,
  tau_a = K (q_m - q_a) + D (q_m' - q_a'): Niglis & Oberg (2015), eq. (2.8a); the order is reversed in eq. (2.12).
- An elastic joint that is not driven rests at angle 0: tau_na = -K q_na - D q_na'.
- A nonlinear spring's deflection is q_m - q_a in a gear and q_na in an elastic joint; its law takes the place of K.
- Friction stands on the left, in f: it brakes a positive velocity, eq. (2.9). Coulomb friction is not in f.
- lambda enters as +Phi^T lambda on the left, as in the Lagrangian T - V - lambda^T phi.
- Reduced motor model (Spong): the rotor of a motor without a carrier turns about its own axis only; its inertial
  coupling S with the motion of the link that carries it, of relative size 1 / ratio, is left out. The carrier's mass
  and inertia include the motor. A motor that rides `on` a body has both, from its kinetic energy: `drivetrain.rotors`.
"""

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, IntArray, frozen_value, values_by_name
from elastid.base.errors import StudyError
from elastid.robot import FRAME_AXES, Robot
from elastid.robot.robot import split_location


@frozen_value(eq=False)
class ElasticModel:
    """The equations as named CasADi functions of q (n_q,), v = q' (n_q,), theta (n_theta,), lambda_ (n_c,).

    coordinates: `joint <name>` of every joint in the robot's order, `motor <name>` of every flexible joint, and
    `rod <name>`, its elongation, of every elastic rod that is not cut.
    inputs: `motor <name>` of every motor.  parameters: all names of robot.parameters(), and coordinates of its geometry
    as far as they are to be symbols; theta their nominal values.

        mass(q, theta) -> M (n_q, n_q)                      force(q, v, theta) -> f (n_q,)
        constraint(q, theta) -> phi (n_c,)                  potential_gradient(q, theta) -> dV/dq (n_q,)
        damping(q, theta) -> D (n_q, n_q), Hessian of R     stiffness(q, lambda_, theta) -> Hessian of V + lambda^T phi
        angular_velocity(q, theta) -> J (3 n_bodies, n_q): J v is the angular velocity of each body in its own axes
        frame_velocity(q, theta) -> J (6 n_f, n_q): velocity and angular velocity of each named frame, in its own axes
        frame_gravity(q, theta) -> g (3 n_f,): gravity in the axes of each named frame
        constraint_jacobian(q, theta) -> Phi (n_c, n_q)     potential(q, theta) -> V
        strain(q, theta) -> tangent stiffness c (n_s,) and rows b (n_s, n_q) of deflections b dq

    springs: the names k_... of the parameters of these n_s springs (`strain`).
    independent: None where the constraints are kept with their multipliers, else (minimal formulation) the coordinates
    to be kept, () for a choice by rank.

    B (n_q, n_u) is constant. Call a function with numbers, or with SX to build on it: given numeric theta it folds the
    constants, and the option cse of the new function shares what M and f have in common. Functions pickle.
    """

    robot: Robot
    coordinates: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    theta: FloatArray
    B: FloatArray
    mass: ca.Function
    force: ca.Function
    constraint: ca.Function
    damping: ca.Function
    stiffness: ca.Function
    potential_gradient: ca.Function
    angular_velocity: ca.Function
    frame_velocity: ca.Function
    frame_gravity: ca.Function
    potential: ca.Function
    constraint_jacobian: ca.Function
    springs: tuple[str, ...]
    strain: ca.Function
    independent: tuple[str, ...] | None = None

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def n_u(self) -> int:
        """Number of motors."""
        return len(self.inputs)

    def symbols(self, *names: str) -> list[ca.SX]:
        """Create symbols, one for each coordinate; `lambda` has one per constraint row, `theta` one per parameter."""
        sizes = {"lambda": self.n_c, "theta": len(self.parameters)}
        return [ca.SX.sym(name, sizes.get(name, self.n_q)) for name in names]

    @property
    def n_c(self) -> int:
        """Number of constraint rows; 0 for a tree."""
        return int(self.constraint.size1_out(0))

    @cached_property
    def geometry(self) -> tuple[str, ...]:
        """The coordinates and lengths among the parameters."""
        return tuple(name for name in self.parameters if name in self.robot.geometry)

    @cached_property
    def of_payload(self) -> tuple[str, ...]:
        """Parameters that affect the payload only."""
        return tuple(name for name in self.parameters if self.robot.payload and name in self.robot.payload.numbers)

    def with_payload(self, theta: FloatArray, has_payload: bool) -> FloatArray:
        """Return theta (n_theta,); mass and inertia of the payload are 0 if has_payload is False."""
        absent = () if has_payload else [self.parameters.index(name) for name in self.of_payload]
        return np.where(np.isin(np.arange(len(theta)), absent), 0.0, theta)

    def robot_at(self, theta: FloatArray) -> Robot:
        """Return the robot with the geometry of theta (n_theta,); StudyError if no robot has it."""
        return _robot_at(self, np.asarray(theta, dtype=float).tobytes()) if self.geometry else self.robot

    @property
    def passive(self) -> IntArray:
        """The coordinates of joints that neither a motor nor a spring holds."""
        names = [f"joint {joint.name}" for joint in self.robot.joints if joint.is_passive]
        return np.array([self.coordinates.index(name) for name in names], np.int64)

    @property
    def rates(self) -> tuple[tuple[str, str, str], ...]:
        """Kind, name and axis of each row of angular_velocity, then of frame_velocity."""
        bodies = (("body", body.name, axis) for body in self.robot.all_bodies for axis in "xyz")
        return (*bodies, *(("frame", frame.name, axis) for frame in self.robot.frames for axis in FRAME_AXES))

    def index(self, location: str) -> int:
        """Return the coordinate of `motor <name>` or `joint <name>`; the motor of a rigid gear turns with its joint."""
        if location not in self.coordinates and location in self.inputs:
            return self.coordinates.index(location.replace("motor ", "joint ", 1))
        return self.coordinates.index(location)

    def output_jacobian(self, q: FloatArray, locations: Sequence[str]) -> FloatArray:
        """Return C (n_y, n_q) of `readout` at q (n_q,), with the robot's own numbers."""
        return np.ascontiguousarray(self.readout(q, self.theta, locations)[0].full())

    def readout(self, q: Any, theta: Any, locations: Sequence[str]) -> tuple[Any, Any]:
        r"""Return C and T (n_y, n_q) of locations with the rates C v, at q (n_q,): DM, or SX for symbols.

        `motor <name>`, `joint <name>`.  `body <name> <axis>`: absolute angular velocity about an axis fixed in it.
        `frame <name> x`, `accelerometer <name> x`: velocity of the frame's origin along its axis; `frame <name> rx`:
        its angular velocity.  StudyError for an unknown place.

        T: gravity that tilting adds to accelerometers, y = C q'' + T q; 0 for all other places. An accelerometer reads
        the acceleration of its origin (Niglis & Oberg 2015, eq. (2.5), at rest) less gravity, both in its own axes. A
        small rotation phi of these axes turns gravity in them by g x phi, so that the reading changes by -g x phi =
        -[g x] J_omega q.
        """
        rates, names = {}, [frame.name for frame in self.robot.frames]
        if not all(location.startswith(("motor ", "joint ")) for location in locations):
            rows = ca.vertsplit(ca.vertcat(self.angular_velocity(q, theta), self.frame_velocity(q, theta)))
            rates = dict(zip(self.rates, rows, strict=True))
        C, T, coordinates = [], [ca.DM(1, self.n_q)] * len(locations), ca.DM.eye(self.n_q)
        for i, location in enumerate(locations):
            self.robot.check_location(location)
            kind, name, axis = split_location(location)
            if kind in ("motor", "joint"):
                C.append(coordinates[self.index(location), :])
                continue
            C.append(rates["frame" if kind == "accelerometer" else kind, name, axis])
            if kind == "accelerometer":
                turning = ca.vertcat(*(rates["frame", name, f"r{letter}"] for letter in "xyz"))
                g = self.frame_gravity(q, theta)[3 * names.index(name) : 3 * names.index(name) + 3]
                T[i] = -(ca.skew(g) @ turning)["xyz".index(axis), :]
        return ca.vertcat(*C), ca.vertcat(*T)


@lru_cache(maxsize=8)
def _robot_at(model: ElasticModel, theta: bytes) -> Robot:
    values = values_by_name(model.parameters, np.frombuffer(theta))
    try:
        return model.robot.with_parameters({name: values[name] for name in model.geometry})
    except ValueError as error:
        raise StudyError("robot/loops", str(error)) from None
