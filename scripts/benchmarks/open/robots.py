"""Twelve elastic robots, drawn by a seed: their true numbers and the data sheet that an entrant is given.

Angles, inertias, stiffnesses and torques of joints are link-side. A joint with a motor has two coordinates in series,
the motor's angle and the twist of its gear; a bearing has a twist alone; a passive joint has its angle alone.
"""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import mujoco
import numpy as np
from pydantic.dataclasses import dataclass  # converts the nested objects of a JSON file

Array: TypeAlias = np.ndarray[Any, np.dtype[np.float64]]
Numbers: TypeAlias = tuple[float, ...]
# One standard deviation of a data sheet: relative, and in m.
TOLERANCES = {"mass": 0.03, "inertia": 0.10, "motor_inertia": 0.05, "center_of_mass": 0.010}
ACCELERATION = 2.5  # rad/s^2, rms of the torque over the inertia
STEPS_HZ = 4000  # of the engine, and of the drives that follow position references


@dataclass(frozen=True)
class Motor:
    """Rotor and friction: J in kg*m^2, f in N*m*s/rad, F in N*m."""

    ratio: float
    J: float = 1.0
    f: float = 0.0
    F: float = 0.0
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
    xyz: Numbers
    joints: tuple[Joint, ...]
    mass: float
    com: Numbers
    inertia: Numbers


@dataclass(frozen=True)
class Rod:
    """Elastic rod between points of two bodies: m, kg, N/m, N*s/m. Its mass acts in halves at both ends."""

    bodies: tuple[str, str]
    points: tuple[Numbers, Numbers]
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
    def gears(self) -> list[Joint]:
        """Joints with motors, from the base on."""
        return [joint for joint in self.joints if joint.motor]

    @property
    def bristles(self) -> list[tuple[str, float, float, float]]:
        """Presliding of motors and hysteresis of gears: coordinate, F in N*m, z_s in rad, damping in N*m*s/rad."""
        presliding = [(f"m{j.name}", j.motor.F, j.motor.z, j.motor.damping) for j in self.gears if j.motor.z]
        return presliding + [(f"s{j.name}", j.hysteresis, j.knee, 0.0) for j in self.gears if j.hysteresis]

    @property
    def parameters(self) -> dict[str, float]:
        """The scored parameters: k and d of each gear and bearing, and k of the rod."""
        springs = {f"{letter}_{j.name}": getattr(j, letter) for letter in "kd" for j in self.joints if j.k}
        return springs | ({"k_rod": self.rod.k} if self.rod else {})

    def with_parameters(self, values: Mapping[str, float]) -> "Robot":
        """Return the robot with other values of scored parameters and of `f_<motor>`, viscous frictions."""

        def joint(j: Joint) -> Joint:
            k, d = (values.get(f"{letter}_{j.name}", getattr(j, letter)) for letter in "kd")
            return replace(j, k=k, d=d, motor=j.motor and replace(j.motor, f=values.get(f"f_{j.name}", j.motor.f)))

        rod = self.rod and replace(self.rod, k=values.get("k_rod", self.rod.k))
        return replace(self.with_joints(joint), rod=rod)

    def with_joints(self, change: Callable[[Joint], Joint]) -> "Robot":
        """Return the robot with changed joints."""
        return replace(self, bodies=[replace(b, joints=[*map(change, b.joints)]) for b in self.bodies])


@dataclass(frozen=True)
class Row:
    """One robot of the benchmark: axes, locked-motor frequencies in Hz, size, Coulomb torque over the rms torque."""

    name: str
    axes: str
    hz: Numbers
    size: float = 1.0
    friction: float = 0.1
    sheet: str = "exact"  # exact, sheet, or wrong: with the mass of the last body 25 % too high
    route: str = "torque"  # torque, position or command
    postures: int = 2
    carrier: float = 0.0  # amplitude in rad of a slow motion of all axes
    effect: str = ""


TABLES = tomllib.loads(Path(__file__).with_name("robots.toml").read_text(encoding="utf-8"))
ROWS = tuple(Row(**row) for row in TABLES["robots"])


def postures(row: Row) -> dict[str, list[float]]:
    """Return motor angles in rad by the name of the posture."""
    kind, first = ("linkage", 0) if row.effect == "linkage" else ("serial", int(row.axes[0] == "y"))
    angles = TABLES["postures"][kind][: row.postures]
    return {f"p{i + 1}": q[first : first + len(row.axes)] for i, q in enumerate(angles)}


def draw(row: Row, seed: int) -> tuple[Robot, Robot, Array]:
    """Draw the true robot, its data sheet and the rms torques of the excitation (n,)."""
    rng = np.random.default_rng([seed, ROWS.index(row)])
    true, torque = _elastic(row, _linkage(row, rng) if row.effect == "linkage" else _serial(row, rng), rng)
    return true, _sheet(row, true, rng), torque


def _serial(row: Row, rng: np.random.Generator) -> Robot:
    bodies, parent, s = [], "base", row.size
    for index, (name, axis) in enumerate(zip(TABLES["chains"][row.axes], row.axes, strict=True)):
        xyz, mass, com, inertia = TABLES["bodies"][name]
        m, length, i = np.exp(0.1 * rng.standard_normal(3)) * [s**3, s, s**5]
        joints = [Joint(str(index + 1), axis, motor=Motor(rng.choice([80, 100, 121, 160])))]
        joints += [Joint("2x", "x")] * (row.effect == "bearing" and index == 1)
        place = np.round(np.multiply(xyz, length), 4).tolist() if bodies else (0.0, 0.0, s * 0.3)
        com, inertia = (np.multiply(*each).tolist() for each in ((com, length), (inertia, i)))
        bodies.append(Body(name, parent, place, joints, mass * m, com, inertia))
        parent = name
    return Robot(row.name, bodies)


def _linkage(row: Row, rng: np.random.Generator) -> Robot:
    masses, ratios = np.exp(0.1 * rng.standard_normal(3)), rng.choice([80.0, 100.0, 121.0], 2)
    joints = [*(Joint(str(i), "y", motor=Motor(ratio)) for i, ratio in enumerate(ratios, 1)), Joint("elbow", "y")]
    rows = zip(TABLES["linkage"], joints, masses, strict=True)
    bodies = [Body(**body | {"joints": [joint], "mass": body["mass"] * factor}) for body, joint, factor in rows]
    rod = Rod(**TABLES["rod"])
    return Robot(row.name, bodies, replace(rod, k=rod.k * np.exp(0.2 * rng.standard_normal())))


def _elastic(row: Row, robot: Robot, rng: np.random.Generator) -> tuple[Robot, Array]:
    """Give each joint the stiffness of its frequency with locked motors, and motors that fit their links."""
    inertia, hz, torque = composite_inertia(robot, postures(row)["p1"]), iter(row.hz), []

    def elastic(joint: Joint) -> Joint:
        if joint.name == "elbow":
            return joint
        load = inertia[joint.name]
        omega = 2 * np.pi * (next(hz) if joint.motor else 24.0) * rng.uniform(0.85, 1.15)
        k, zeta = load * omega**2, rng.uniform(0.02, 0.05)
        gear, motor = {"k": k, "d": 2 * zeta * k / omega}, joint.motor
        if not motor:
            return replace(joint, **gear)
        J = load * rng.uniform(0.3, 1.0)
        rms = ACCELERATION * (load + J)
        torque.append(rms)
        motor = replace(motor, J=J, f=J * rng.uniform(1.0, 3.0), F=row.friction * rms * rng.uniform(0.7, 1.3))
        if row.effect == "hysteresis":
            gear |= {"hysteresis": 0.05 * rms * rng.uniform(0.7, 1.3), "knee": rms / k * rng.uniform(0.1, 0.3)}
        elif row.effect == "error":
            gear |= {"error": rng.uniform(2e-5, 5e-5), "order": rng.integers(1, 3), "phase": rng.uniform(0, 6.28)}
        elif row.effect == "presliding":
            z = 1e-3 * rng.uniform(0.4, 2.0)
            motor = replace(motor, z=z, damping=rng.uniform(0.1, 0.6) * 2 * np.sqrt(motor.F / z * J))  # of critical
        return replace(joint, motor=motor, **gear)

    return robot.with_joints(elastic), np.array(torque)


def _sheet(row: Row, robot: Robot, rng: np.random.Generator) -> Robot:
    """Draw the data-sheet model for entrants: springs with random factors, viscous friction only, no gear effects."""
    std = {name: value * (row.sheet != "exact") for name, value in TOLERANCES.items()}

    def joint(j: Joint) -> Joint:
        k, d = np.exp(rng.uniform(0.25, 0.6, 2) * rng.choice([-1, 1], 2))
        motor = j.motor and Motor(j.motor.ratio, j.motor.J * rng.normal(1, std["motor_inertia"]), j.motor.f * d)
        return Joint(j.name, j.axis, j.k * k, j.d * d, motor)

    def body(b: Body) -> Body:
        com = rng.normal(b.com, std["center_of_mass"] * row.size).tolist()
        inertia = (rng.normal(1, std["inertia"]) * np.array(b.inertia)).tolist()
        joints, mass = [*map(joint, b.joints)], b.mass * rng.normal(1, std["mass"])
        mass *= 1.25 if row.sheet == "wrong" and b is robot.bodies[-1] else 1.0
        return replace(b, joints=joints, mass=mass, com=com, inertia=inertia)

    rod = robot.rod and replace(robot.rod, k=robot.rod.k * 1.3)
    return Robot(robot.name, [*map(body, robot.bodies)], rod)


def tag(kind: str, *inside: str, **attributes: Any) -> str:
    """Write an element of a MuJoCo file."""
    values = [[x] if isinstance(x, str) else [f"{e:.17g}" for e in np.atleast_1d(x)] for x in attributes.values()]
    words = [f"{name}={' '.join(texts)!r}" for name, texts in zip(attributes, values, strict=True)]
    return f"<{kind} {' '.join(words)}>{''.join(inside)}</{kind}>\n"


def mjcf(robot: Robot) -> str:
    """Write the robot for MuJoCo: joints `m...` are motors, `s...` twists; the rod is a tendon."""
    rod, axes = robot.rod, dict(zip("xyz", np.eye(3), strict=True))
    ends = dict(zip(rod.bodies, rod.points, strict=True)) if rod else {}

    def body(b: Body) -> str:
        inside = []
        for j in b.joints:
            if m := j.motor:
                inside.append(tag("joint", name=f"m{j.name}", axis=axes[j.axis], armature=m.J, damping=m.f))
            inside.append(tag("joint", name=f"s{j.name}", axis=axes[j.axis], stiffness=j.k, damping=j.d))
        inside.append(tag("inertial", pos=b.com, mass=b.mass, diaginertia=b.inertia))
        if b.name in ends:
            point = tag("inertial", pos=(0, 0, 0), mass=rod.mass / 2, diaginertia=(1e-9, 1e-9, 1e-9))
            inside += [tag("site", name=b.name, pos=ends[b.name]), tag("body", point, pos=ends[b.name])]
        inside += [body(child) for child in robot.bodies if child.parent == b.name]
        if b is robot.bodies[-1]:
            inside.append(tag("site", name="tool", pos=2 * np.array(b.com)))
        return tag("body", *inside, name=b.name, pos=b.xyz)

    tendon, state = "", {"dyntype": "user", "actdim": 1, "gainprm": 0, "biastype": "none"}
    if rod:
        sites = [tag("site", site=name) for name in rod.bodies]
        tendon = tag("tendon", tag("spatial", *sites, stiffness=rod.k, damping=rod.d, springlength=rod.length))
    compiler = tag("compiler", angle="radian", inertiafromgeom="false", balanceinertia="true")
    world = tag("worldbody", *(body(b) for b in robot.bodies if b.parent == "base"))
    actuators = tag("actuator", *(tag("general", joint=name, **state) for name, *_ in robot.bristles))
    flag = tag("flag", contact="disable")
    option = tag("option", flag, gravity=(0, 0, -9.81), timestep=1 / STEPS_HZ, integrator="RK4")
    return tag("mujoco", compiler, option, world, tendon, actuators, model=robot.name)


def composite_inertia(robot: Robot, posture: list[float]) -> dict[str, float]:
    """Compute the inertia of all that is behind each joint, motors excluded, in a posture."""
    model = mujoco.MjModel.from_xml_string(mjcf(robot))
    data, M = mujoco.MjData(model), np.empty((model.nv, model.nv))
    elbow = [("selbow", posture[1] - posture[0])] if robot.rod else []
    for name, angle in [*zip((f"m{j.name}" for j in robot.gears), posture, strict=True), *elbow]:
        data.joint(name).qpos = angle
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    loads = {j.name: M[(i := model.joint(f"s{j.name}").dofadr[0]), i] for j in robot.joints}
    return {**loads, "2": loads["2"] + loads["elbow"]} if robot.rod else loads
