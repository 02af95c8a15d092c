r"""formulate(robot, spec): a serial tree, constrained, minimal; or an approximation of a parallel linkage.

Serial, Niglis & Oberg (2015), eq. (2.10): the coordinates of a tree are independent; the extended flexible joint of eq.
(2.12) is a further joint with a spring. Constrained, eq. (2.33): all coordinates of the open chain, with multipliers.

.. math:: M(q)\, \ddot q + f(q, \dot q) + \Phi^T \lambda = B u, \qquad \varphi(q) = 0

The elongation of an elastic rod is a coordinate of its own; where the rod weighs nothing it has no inertia, and M is
singular: only on the null space of Phi is it regular. Minimal, eq. (2.34): independent coordinates y.

.. math:: q = \gamma(y): \quad \varphi(\gamma(y)) = 0, \qquad \dot q = Z \dot y, \quad
          Z = \begin{bmatrix} I \\ -\Phi_d^{-1} \Phi_i \end{bmatrix}, \qquad Z^T [M(q) \ddot q + f(q, \dot q) - B u] = 0

Elastic rods are cut: they are force elements, and a loop that they close needs no constraint. Other loops are
eliminated by the implicit function theorem, exactly, in the linear model and in the simulation; the dependent
coordinates stay in q and are solved for, not integrated.

Approximate models of parallel linkages, whose error a study can measure.

The elastic rod of a loop condensed into the gear spring of the lever that drives it, with the rate y of the rod's
elongation per lever angle:

.. math:: k_{rod} = k_r y^2, \quad y = \partial s / \partial q_{lever}, \qquad
          \frac{1}{k_{eff}} = \frac{1}{k} + \frac{1}{k_{rod}}, \qquad
          d_{eff} = k_{eff}^2 \left( \frac{d}{k^2} + \frac{d_r y^2}{k_{rod}^2} \right)

In a parallelogram y = l sin(angle between lever and rod): a spring that looks constant in one posture and is not. The
parts between the two springs, crank and part of the rod, lose their own motion.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.model.closed_posture import assemble, follow_angles
from elastid.model.drivetrain import Strain
from elastid.model.elastic import ElasticModel
from elastid.model.frame_tree import tree
from elastid.model.loop_closure import Closure, closures, cut_rods, elastic, stretching, with_rod_inertia
from elastid.model.open_chain import Equations, by_name, elastic_model, open_chain, with_energies, with_strains
from elastid.model.spec import ModelSpec, Variant
from elastid.robot import Loop, Robot


def serial(robot: Robot, geometry: Collection[str] = ()) -> ElasticModel:
    """Build the ElasticModel of a tree of bodies: coordinates of all joints, then of the motors of flexible joints.

    geometry: names of robot.geometry that are parameters, too.
    """
    return elastic_model(robot, open_chain(robot, geometry))


def with_constraints(robot: Robot, geometry: Collection[str] = ()) -> ElasticModel:
    """Build the ElasticModel with a constraint row per rod and the rows of each pin and point, also redundant ones."""
    tree = open_chain(robot, geometry)
    loops = closures(robot, tree.q[: robot.n_l], by_name(tree))
    equations, rows = stretching(with_rod_inertia(robot, tree, loops), loops)
    return elastic_model(robot, replace(equations, phi=ca.vertcat(equations.phi, *rows)))


def minimal(robot: Robot, spec: ModelSpec, geometry: Collection[str] = ()) -> ElasticModel:
    """Build the ElasticModel in independent coordinates of `spec`; StudyError for a variant that does not fit."""
    equations = open_chain(robot, geometry)
    moving = [name for name in robot.geometry if name in equations.parameters]
    if spec.variant == "constant_stiffness" and moving:
        raise StudyError(
            "model/variant",
            f"constant_stiffness holds the posture of the robot's own geometry, so that {moving[0]} "
            "cannot be identified with it; choose series_stiffness or exact",
            "model.variant",
        )
    q = equations.q[: robot.n_l]
    loops = closures(robot, unbent(robot, q) if spec.variant == "bending_outside" else q, by_name(equations))
    rods = elastic(loops)
    equations = with_rod_inertia(robot, equations, loops, rods=spec.variant == "lumped_rod")
    if spec.variant in STIFF:
        rows = [*(closure.rows for closure in loops), *(equations.q[i] for i in elastic_joints_within(robot))]
        if spec.variant != "rigid_loop":
            equations = series_stiffness(robot, equations, rods, constant=spec.variant == "constant_stiffness")
    else:
        equations = cut_rods(equations, rods)
        rows = [closure.rows for closure in loops if closure not in rods]
    return elastic_model(robot, replace(equations, phi=ca.vertcat(equations.phi, *rows)), spec.independent)


# The formulation that suits the robot, without approximation.
EXACT = ModelSpec()


def formulate(robot: Robot, spec: ModelSpec = EXACT, geometry: Collection[str] = ()) -> ElasticModel:
    """Build the ElasticModel of a robot in the formulation of `spec`; StudyError if they do not fit.

    geometry: names of robot.geometry that are parameters of the model besides robot.parameters(); others do not count.
    """
    formulation = spec.formulation or ("constrained" if robot.loops else "serial")
    for (key, *_), refusal in spec.refusals(robot):
        raise StudyError("model/variant", refusal, f"model.{key}")
    if formulation == "minimal":
        return minimal(robot, spec, geometry)
    return (serial if formulation == "serial" else with_constraints)(robot, geometry)


# Variants in which rods do not stretch and nothing bends inside a loop.
STIFF = ("rigid_loop", "constant_stiffness", "series_stiffness")


def elastic_joints_within(robot: Robot) -> tuple[int, ...]:
    """List the elastic joints without drive inside a loop."""
    joints = robot.joints
    return tuple(i for i in robot.joints_in_loops if joints[i].spring is not None and joints[i].motor is None)


def inert_parameters(robot: Robot, variant: Variant) -> tuple[str, ...]:
    """List the parameters of rods, and of elastic joints in stiff loops, without a separate effect in a variant.

    If gear and rod are condensed into one stiffness, this stiffness is the parameter of the gear.
    """
    if variant == "lumped_rod":
        return tuple(f"I_{loop.name}" for loop in robot.loops if loop.rod is not None)
    if variant not in STIFF:
        return ()
    joints = [robot.joints[i] for i in elastic_joints_within(robot)]
    bending = [name for joint in joints for name in joint.numbers]
    if variant == "series_stiffness":
        return tuple(bending)
    rods = [loop.name for loop in robot.loops if loop.rod is not None and loop.rod.is_elastic]
    return (*bending, *(f"{letter}_{name}" for name in rods for letter in "kd"))


def unbent(robot: Robot, q: ca.SX) -> ca.SX:
    """Return the joints (n_l,) for loops that ignore elastic joints.

    An elastic joint is straight; the bodies behind the loop's next passive joint keep their direction, as in a
    parallelogram: about parallel axes the passive joint has turned back by as much.
    """
    straight, elastic_joints, axes = ca.SX(q), set(elastic_joints_within(robot)), _axes(robot)
    for branches in robot.branches:
        for branch in branches:
            passive = [i for i in branch if robot.joints[i].is_passive]
            for i in set(branch) & elastic_joints:
                straight[i] = 0
                if passive:
                    j = min(passive, key=lambda j: abs(j - i))
                    straight[j] += float(axes[i] @ axes[j]) * q[i]
    return straight


def _axes(robot: Robot) -> list[FloatArray]:
    """Return the axes (3,) of all joints in the base frame, all at 0."""
    R: list[FloatArray] = []
    axes = []
    for frame in tree(robot).frames:
        R.append((R[frame.parent] if frame.parent >= 0 else np.eye(3)) @ frame.R)
        axes.append(R[-1][:, frame.axis])
    return axes


def series_stiffness(robot: Robot, equations: Equations, rods: Sequence[Closure], constant: bool) -> Equations:
    """Add gear springs of levers in series with the elastic rods of loops. constant: as in the start posture."""
    theta = by_name(equations)
    for closure in rods:
        lever = _lever(robot, closure.loop)
        joint, name = robot.joints[lever].name, closure.loop.name
        y = ca.gradient(ca.norm_2(closure.gap), equations.q)[lever]
        if constant:
            q_l = equations.q[: robot.n_l]
            y = ca.substitute(y, q_l, ca.DM(assemble(robot, np.array([driven.start for driven in robot.driven]))))
        k, d, k_rod = theta[f"k_{joint}"], theta[f"d_{joint}"], theta[f"k_{name}"] * y**2
        k_eff = k * k_rod / (k + k_rod)
        d_eff = (k_rod / (k + k_rod)) ** 2 * d + (k / (k + k_rod)) ** 2 * theta[f"d_{name}"] * y**2
        across = ca.DM(len(equations.coordinates), 1)
        across[equations.coordinates.index(f"motor {joint}")], across[lever] = 1, -1
        deflection = ca.dot(across, equations.q)
        equations = with_energies(
            equations, (k_eff - k) * deflection**2 / 2, (d_eff - d) * ca.sparsify(across @ across.T)
        )
        # Both bear the torque k_eff times the deflection.
        springs = {f"k_{joint}": k, f"k_{name}": k_rod}
        equations = with_strains(
            equations, *(Strain(spring, k_eff**2 / k_part, deflection) for spring, k_part in springs.items())
        )
    return equations


def _lever(robot: Robot, loop: Loop) -> int:
    """Return the elastically driven joint that turns an end of a loop, its first end if both are turned so."""
    for branch in robot.branches[robot.loops.index(loop)]:
        for i in branch:
            if robot.joints[i].is_flexible:
                return i
            if robot.joints[i].is_passive:
                break
    raise StudyError(
        "model/variant",
        f"the stiffness of rod {loop.name} cannot be combined with a gear, because passive joints separate both ends "
        "from the next motor. Choose the variant exact",
        "model.variant",
    )


@dataclass(frozen=True)
class ElasticJoint:
    """Joint alone: inertias of motor and link, stiffness and damping of the spring between them, on one side, SI."""

    motor_inertia: float
    link_inertia: float
    stiffness: float
    damping: float

    @property
    def inertia(self) -> float:
        """Of motor and link together."""
        return self.motor_inertia + self.link_inertia


def locked_joint(robot: Robot, joint: str, angles: FloatArray) -> ElasticJoint | None:
    """Return inertias of motor and link, link side, and the gear spring; None if the model has no such form.

    angles (n_u,): posture in which the other joints are locked, with stiff springs, as in undriven joints.
    Without the form: a stiff joint, one in a loop, of coupled gears, or with a spring that is not linear.
    """
    index = [side.name for side in robot.joints].index(joint)
    spec = robot.joints[index]
    if spec.motor is None or not spec.is_flexible or index in robot.joints_in_loops:
        return None
    driven_index = robot.driven_indices.index(index)
    coupling = np.abs(robot.mixing[driven_index]) + np.abs(robot.mixing[:, driven_index])
    if np.count_nonzero(coupling) > 1 or not (spec.spring is None or spec.spring.is_linear):
        return None
    springs = [(spec.spring, 1.0), (spec.motor.spring, robot.ratio(joint) ** 2)]
    compliance = sum(1 / (scale * spring.stiffness) for spring, scale in springs if spring is not None)
    # Of two springs in series the softer one damps.
    damping = min(scale * spring.damping for spring, scale in springs if spring is not None)
    model = formulate(robot)
    q = np.zeros(model.n_q)
    q[: robot.n_l] = follow_angles(robot, angles[None])
    q[[model.index(motor) for motor in model.inputs]] = angles
    inertia = np.diag(np.asarray(model.mass(q, model.theta)))
    motor, link = (float(inertia[model.index(f"{side} {joint}")]) for side in ("motor", "joint"))
    return ElasticJoint(motor, link, 1 / compliance, damping)
