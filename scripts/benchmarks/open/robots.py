"""Twelve elastic robots, drawn by a seed: their true numbers and the data sheet that an entrant is given.

Angles, inertias, stiffnesses and torques of joints are link-side. A joint with a motor has two coordinates in series,
the motor's angle and the twist of its gear; a bearing has a twist alone; a passive joint has its angle alone.
"""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import mujoco
import numpy as np

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
# One standard deviation of a data sheet: relative, and in m.
TOLERANCES = {"mass": 0.03, "inertia": 0.10, "motor_inertia": 0.05, "center_of_mass": 0.010}


@dataclass(frozen=True)
class Motor:
    """Rotor and friction: J in kg*m^2, f in N*m*s/rad, F in N*m."""

    ratio: float
    J: float
    f: float
    F: float
    z: float = 0.0  # presliding distance in rad
    damping: float = 0.0  # of presliding, in N*m*s/rad


@dataclass(frozen=True)
class Joint:
    """Twist of a gear or bearing: k in N*m/rad, d in N*m*s/rad; friction in the gear (N*m, rad), transmission error."""

    name: str
    axis: str
    k: float = 0.0
    d: float = 0.0
    motor: Motor | None = None
    hysteresis: float = 0.0
    knee: float = 1e-4
    error: float = 0.0  # amplitude in rad
    order: int = 1  # periods in a turn of the motor
    phase: float = 0.0


@dataclass(frozen=True)
class Body:
    """Link behind its joints: kg, m, kg*m^2 about the centre of mass."""

    name: str
    parent: str
    xyz: tuple[float, ...]
    joints: tuple[Joint, ...]
    mass: float
    com: tuple[float, ...]
    inertia: tuple[float, ...]


@dataclass(frozen=True)
class Rod:
    """Elastic rod between points of two bodies: m, kg, N/m, N*s/m. Its mass acts in halves at both ends."""

    bodies: tuple[str, str]
    points: tuple[tuple[float, ...], tuple[float, ...]]
    length: float
    mass: float
    k: float
    d: float


@dataclass(frozen=True)
class Robot:
    """Bodies from the base on, and perhaps a rod that closes a loop."""

    name: str
    bodies: tuple[Body, ...]
    rod: Rod | None = None

    @property
    def joints(self) -> list[Joint]:
        """All joints, from the base on."""
        return [joint for body in self.bodies for joint in body.joints]

    @property
    def motors(self) -> list[Motor]:
        """All motors, from the base on."""
        return [joint.motor for joint in self.joints if joint.motor]

    def with_joints(self, change: Callable[[Joint], Joint]) -> "Robot":
        """Return the robot with changed joints."""
        return replace(self, bodies=tuple(replace(b, joints=tuple(map(change, b.joints))) for b in self.bodies))

    def truth(self) -> dict[str, float]:
        """Return the true values of the scored parameters."""
        springs = {f"{letter}_{j.name}": getattr(j, letter) for letter in "kd" for j in self.joints if j.k}
        return springs | ({"k_rod": self.rod.k} if self.rod else {})


@dataclass(frozen=True)
class Row:
    """One robot of the benchmark: axes, locked-motor frequencies in Hz, size, Coulomb torque over the rms torque."""

    name: str
    axes: str
    hz: list[float]
    size: float = 1.0
    friction: float = 0.1
    sheet: str = "exact"  # exact, sheet, or wrong: with the mass of the last body 25 % too high
    route: str = "torque"  # torque, position or command
    postures: int = 2
    carrier: float = 0.0  # amplitude in rad of a slow motion of all axes
    effect: str = ""


TABLES = tomllib.loads(Path(__file__).with_name("robots.toml").read_text(encoding="utf-8"))
ROWS = tuple(Row(**row) for row in TABLES["robots"])
ACCELERATION = 2.5  # rad/s^2, rms of the torque over the inertia


def postures(row: Row) -> dict[str, list[float]]:
    """Return motor angles in rad by the name of the posture."""
    kind, first = ("linkage", 0) if row.effect == "linkage" else ("serial", int(row.axes[0] == "y"))
    angles = TABLES["postures"][kind][: row.postures]
    return {f"p{i + 1}": q[first : first + len(row.axes)] for i, q in enumerate(angles)}


def draw(row: Row, seed: int) -> tuple[Robot, Robot, Array]:
    """Draw the true robot, its data sheet and the rms torques of the excitation (n,)."""
    rng = np.random.default_rng([seed, ROWS.index(row)])
    shape = _linkage(row, rng) if row.effect == "linkage" else _serial(row, rng)
    true, torque = _elastic(row, shape, rng)
    return true, _sheet(row, true, rng), torque


def _serial(row: Row, rng: np.random.Generator) -> Robot:
    bodies, parent, s = [], "base", row.size
    for index, (name, axis) in enumerate(zip(TABLES["chains"][row.axes], row.axes, strict=True)):
        xyz, mass, com, inertia = TABLES["bodies"][name]
        m, length, i = np.exp(0.1 * rng.standard_normal(3)) * [s**3, s, s**5]
        joints = [Joint(str(index + 1), axis, motor=Motor(float(rng.choice([80, 100, 121, 160])), 1, 0, 0))]
        if row.effect == "bearing" and index == 1:
            joints.append(Joint("2x", "x"))
        place = tuple(np.round(np.multiply(xyz, length), 4).tolist()) if bodies else (0.0, 0.0, s * 0.3)
        own = tuple(np.multiply(com, length).tolist()), tuple(np.multiply(inertia, i).tolist())
        bodies.append(Body(name, parent, place, tuple(joints), float(mass * m), *own))
        parent = name
    return Robot(row.name, tuple(bodies))


def _linkage(row: Row, rng: np.random.Generator) -> Robot:
    """Draw a lower arm, a crank with the same axis, and a fore arm that a rod connects to the crank."""
    (a, b, c), (n_1, n_2) = np.exp(0.1 * rng.standard_normal(3)), rng.choice([80.0, 100.0, 121.0], 2)
    joints = Joint("1", "y", motor=Motor(n_1, 1, 0, 0)), Joint("2", "y", motor=Motor(n_2, 1, 0, 0)), Joint("elbow", "y")
    lower = Body("lower", "base", (0.0, 0.0, 0.0), joints[:1], 30.0 * a, (0.05, 0.05, 0.35), (1.6, 1.6, 0.2))
    crank = Body("crank", "base", (0.0, 0.0, 0.0), joints[1:2], 18.0 * b, (-0.3, -0.05, 0.02), (0.2, 0.6, 0.6))
    fore = Body("fore", "lower", (0.0, 0.0, 0.8), joints[2:], 40.0 * c, (0.33, 0.1, 0.1), (0.8, 4.0, 4.0))
    ends = (-0.3, 0.0, 0.0), (-0.3, 0.0, 0.0)
    rod = Rod(("crank", "fore"), ends, 0.8, 6.0, float(8e6 * np.exp(0.2 * rng.standard_normal())), 3000.0)
    return Robot(row.name, (lower, crank, fore), rod)


def _elastic(row: Row, robot: Robot, rng: np.random.Generator) -> tuple[Robot, Array]:
    """Give each joint the stiffness of its frequency with locked motors, and motors that fit their links."""
    inertia, hz, torque = composite_inertia(robot, postures(row)["p1"]), iter(row.hz), []

    def elastic(joint: Joint) -> Joint:
        if joint.name == "elbow":
            return joint
        load = inertia[joint.name]
        omega = 2 * np.pi * (next(hz) if joint.motor else 24.0) * rng.uniform(0.85, 1.15)
        k, zeta = load * omega**2, rng.uniform(0.02, 0.05)
        joint = replace(joint, k=k, d=2 * zeta * k / omega)
        if not joint.motor:
            return joint
        J = load * rng.uniform(0.3, 1.0)
        rms = ACCELERATION * (load + J)
        torque.append(rms)
        motor = replace(joint.motor, J=J, f=J * rng.uniform(1.0, 3.0), F=row.friction * rms * rng.uniform(0.7, 1.3))
        return _with_effect(row, replace(joint, motor=motor), rms, rng)

    return robot.with_joints(elastic), np.array(torque)


def _with_effect(row: Row, joint: Joint, rms: float, rng: np.random.Generator) -> Joint:
    motor = joint.motor
    if row.effect == "hysteresis":
        return replace(joint, hysteresis=0.05 * rms * rng.uniform(0.7, 1.3), knee=rms / joint.k * rng.uniform(0.1, 0.3))
    if row.effect == "error":
        return replace(joint, error=rng.uniform(2e-5, 5e-5), order=int(rng.integers(1, 3)), phase=rng.uniform(0, 6.28))
    if row.effect == "presliding" and motor:
        z = 1e-3 * rng.uniform(0.4, 2.0)
        damping = rng.uniform(0.1, 0.6) * 2 * np.sqrt(motor.F / z * motor.J)  # of critical
        return replace(joint, motor=replace(motor, z=z, damping=damping))
    return joint


def _sheet(row: Row, robot: Robot, rng: np.random.Generator) -> Robot:
    """Draw the data-sheet model for entrants: springs with random factors, viscous friction only, no gear effects."""
    size = 0.0 if row.sheet == "exact" else 1.0

    def off(name: str) -> float:
        return float(1 + size * TOLERANCES[name] * rng.standard_normal())

    def joint(j: Joint) -> Joint:
        guess = np.exp(rng.uniform(0.25, 0.6, 2) * rng.choice([-1, 1], 2))
        motor = j.motor and Motor(j.motor.ratio, j.motor.J * off("motor_inertia"), j.motor.f * guess[1], 0.0)
        return Joint(j.name, j.axis, j.k * guess[0], j.d * guess[1], motor)

    def body(b: Body) -> Body:
        com = tuple(float(x + size * TOLERANCES["center_of_mass"] * row.size * rng.standard_normal()) for x in b.com)
        factor = off("inertia")
        inertia = tuple(factor * x for x in b.inertia)
        return replace(b, joints=tuple(map(joint, b.joints)), mass=b.mass * off("mass"), com=com, inertia=inertia)

    bodies = [body(b) for b in robot.bodies]
    if row.sheet == "wrong":
        bodies[-1] = replace(bodies[-1], mass=1.25 * bodies[-1].mass)
    rod = robot.rod and replace(robot.rod, k=robot.rod.k * 1.3)
    return Robot(robot.name, tuple(bodies), rod)


def tag(kind: str, *inside: str, **attributes: Any) -> str:
    """Write an element of a MuJoCo file."""
    words = []
    for name, value in attributes.items():
        text = value if isinstance(value, str) else " ".join(f"{x:.17g}" for x in np.atleast_1d(value))
        words.append(f"{name}={text!r}")
    return f"<{kind} {' '.join(words)}>{''.join(inside)}</{kind}>\n"


def mjcf(robot: Robot, step: float = 1 / 4000) -> str:
    """Write the robot for MuJoCo: joints `m...` are motors, `s...` twists; the rod is a tendon."""
    ends = dict(zip(robot.rod.bodies, robot.rod.points, strict=True)) if robot.rod else {}
    axes = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}

    def joint(j: Joint) -> str:
        axis, m = axes[j.axis], j.motor
        motor = tag("joint", name=f"m{j.name}", axis=axis, armature=m.J, damping=m.f) if m else ""
        return motor + tag("joint", name=f"s{j.name}", axis=axis, stiffness=j.k, damping=j.d)

    def body(b: Body) -> str:
        inside = [joint(j) for j in b.joints] + [tag("inertial", pos=b.com, mass=b.mass, diaginertia=b.inertia)]
        if robot.rod and b.name in ends:
            point = tag("inertial", pos=(0, 0, 0), mass=robot.rod.mass / 2, diaginertia=(1e-9, 1e-9, 1e-9))
            inside += [tag("site", name=b.name, pos=ends[b.name]), tag("body", point, pos=ends[b.name])]
        inside += [body(child) for child in robot.bodies if child.parent == b.name]
        if b is robot.bodies[-1]:
            inside.append(tag("site", name="tool", pos=2 * np.array(b.com)))
        return tag("body", *inside, name=b.name, pos=b.xyz)

    rod, tendon, state = robot.rod, "", {"dyntype": "user", "actdim": 1, "gainprm": 0, "biastype": "none"}
    if rod:
        sites = [tag("site", site=name) for name in rod.bodies]
        tendon = tag("tendon", tag("spatial", *sites, stiffness=rod.k, damping=rod.d, springlength=rod.length))
    rubbing = [f"m{j.name}" for j in robot.joints if j.motor and j.motor.z]
    rubbing += [f"s{j.name}" for j in robot.joints if j.hysteresis]  # bristles of motors, then gears, as in the engine
    return tag(
        "mujoco",
        tag("compiler", angle="radian", inertiafromgeom="false", balanceinertia="true"),
        tag("option", tag("flag", contact="disable"), gravity=(0, 0, -9.81), timestep=step, integrator="RK4"),
        tag("worldbody", *(body(b) for b in robot.bodies if b.parent == "base")),
        tendon,
        tag("actuator", *(tag("general", joint=name, **state) for name in rubbing)),
        model=robot.name,
    )


def composite_inertia(robot: Robot, posture: list[float]) -> dict[str, float]:
    """Compute the inertia of all that is behind each joint, motors excluded, in a posture."""
    model = mujoco.MjModel.from_xml_string(mjcf(robot))
    data = mujoco.MjData(model)
    for joint, angle in zip([j for j in robot.joints if j.motor], posture, strict=True):
        data.joint(f"m{joint.name}").qpos = angle
    if robot.rod:
        data.joint("selbow").qpos = posture[1] - posture[0]
    mujoco.mj_forward(model, data)
    M = mass_matrix(model, data)
    loads = {j.name: float(M[(i := model.joint(f"s{j.name}").dofadr[0]), i]) for j in robot.joints}
    return {**loads, "2": loads["2"] + loads["elbow"]} if robot.rod else loads


def mass_matrix(model: Any, data: Any) -> Array:
    """Return M (n, n) in the current state; the arguments of `mj_fullM` change with MuJoCo 4."""
    M = np.empty((model.nv, model.nv))
    for column, unit in zip(M, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    return M.T
