r"""Joint parameters as snippets for simulators: MJCF, Isaac Lab, URDF, SDF (Gazebo), Drake and ROS 2.

All numbers are on the link side:

.. math:: J_a = n^2 J_m, \qquad f = n^2 f_m + f_j, \qquad F_c = |n| F_{c,m} + F_{c,j}, \qquad F_s \ge F_c

n: ratio, m: motor, j: joint. Each simulator supports some of these numbers; README.md lists the mapping of each and the
omitted parts of the identified model.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeAlias
from xml.etree import ElementTree as ET

from elastid.base.escape import comment_lines, docstring, one_line, xml_comment, xml_text
from elastid.base.files import from_template
from elastid.fit.fitted_robot import FittedRobot
from elastid.friction_study.commanded import DELAY
from elastid.friction_study.result import RIGID_TERMS, FrictionResult
from elastid.nonlinear.compensated_friction import CompensatedFriction, friction_rows
from elastid.robot import Friction, Joint, Robot
from elastid.robot.friction_numbers import TERMS, law_of
from elastid.store.files import write_text
from elastid.targets.numbers import exported_numbers
from elastid.targets.target import Target

Intervals: TypeAlias = Mapping[tuple[str, str], tuple[float, float]]  # 95 %, by joint and quantity
# Units of each quantity for a rotating and for a sliding joint.
UNITS: Final = {
    "armature": ("kg*m^2", "kg"), "viscous": ("N*m*s/rad", "N*s/m"), "coulomb": ("N*m", "N"), "stiction": ("N*m", "N"),
    "stribeck_velocity": ("rad/s", "m/s"), "stiffness": ("N*m/rad", "N/m"), "damping": ("N*m*s/rad", "N*s/m"),
    "kp": ("N*m/rad", "N/m"), "kd": ("N*m*s/rad", "N*s/m"), "delay": ("s", "s"),
}  # fmt: skip


@dataclass(frozen=True)
class Actuator:
    """Parameters of a driven joint, link side, SI; stiffness and damping of its gear, None if it is rigid.

    rotor_inertia: motor side.  kp, kd, delay: of the joint controller, None if unknown.  lost: parts of the model that
    no snippet contains.
    """

    joint: str
    slides: bool
    ratio: float
    rotor_inertia: float
    armature: float
    viscous: float
    coulomb: float
    stiction: float
    stribeck_velocity: float | None
    stiffness: float | None
    damping: float | None
    effort: float
    velocity: float
    kp: float | None
    kd: float | None
    delay: float | None
    lost: tuple[str, ...] = ()


@dataclass(frozen=True)
class Actuators:
    """Parameters of all driven joints with intervals, for one robot or group of configurations."""

    name: str
    rows: tuple[Actuator, ...]
    intervals: Intervals

    def interval_text(self, row: Actuator, *quantities: str) -> str:
        """Return the intervals of quantities of a joint in one line; empty without intervals."""
        phrases = [
            f"{quantity} {ends[0]:.6g} to {ends[1]:.6g} {UNITS[quantity][row.slides]}"
            for quantity in quantities
            if (ends := self.intervals.get((row.joint, quantity)))
        ]
        return f"95 %: {', '.join(phrases)}" if phrases else ""


Gains: TypeAlias = Sequence[tuple[float, float]]


def actuators_of(
    name: str, robot: Robot, intervals: Intervals, gains: Gains = (), delay_s: float | None = None
) -> Actuators:
    """Collect the parameters of the driven joints of a robot.  gains: kp and kd of each joint, empty if unknown."""
    pairs: Sequence[tuple[float | None, float | None]] = gains or [(None, None)] * robot.n_u
    rows = (_actuator(robot, joint, *pair, delay_s) for joint, pair in zip(robot.driven, pairs, strict=True))
    return Actuators(name, tuple(rows), intervals)


def _actuator(robot: Robot, joint: Joint, kp: float | None, kd: float | None, delay_s: float | None) -> Actuator:
    ratio, motor, law, spring = robot.ratio(joint.name), joint.motor, law_of(robot, joint.name), joint.spring
    assert motor is not None  # the joint is driven
    laws = [friction for friction in (law, joint.friction) if friction is not None]
    coulomb, stiction = (sum(getattr(friction, key) for friction in laws) for key in ("coulomb", "break_away"))
    return Actuator(
        joint.name, joint.slides, ratio, float(motor.inertia), float(ratio**2 * motor.inertia),
        float(joint.all_viscous), float(coulomb), float(stiction),
        None if law is None or law.stribeck_velocity is None else float(law.stribeck_velocity),
        None if spring is None else float(spring.stiffness), None if spring is None else float(spring.damping),
        joint.limits.torque, joint.limits.velocity, kp, kd, delay_s, tuple(_parts_without_snippet(joint, law)),
    )  # fmt: skip


def _parts_without_snippet(joint: Joint, law: Friction | None) -> Iterator[str]:
    """Yield the model terms of a joint that no snippet contains."""
    name_of = {
        "quadratic friction": "quadratic", "friction by direction": "directions", "load-dependent friction": "load",
        "temperature dependence of the friction": "temperature", "presliding (LuGre)": "lugre",
        "presliding (Maxwell slip)": "maxwell_slip",
    }  # fmt: skip
    yield from (part_name for part_name, key in name_of.items() if law is not None and getattr(law, key, None))
    if joint.spring is not None and joint.spring.backlash is not None:
        yield "backlash of the gear (export to mujoco has it)"
    if joint.spring is not None and any((joint.spring.quadratic, joint.spring.symmetric_quadratic, joint.spring.cubic)):
        yield "hardening of the gear"
    effects = ("load", "transmission_error", "ripple", "hysteresis")
    yield from (f"{key.replace('_', ' ')} of the gear" for key in effects if getattr(joint.gear, key, None))
    if joint.motor is not None and joint.motor.spring is not None:
        yield "spring of the motor shaft"


def fit_intervals(model: FittedRobot, friction: CompensatedFriction | None) -> Intervals:
    """Return the intervals of the parameters of a fit and of its Coulomb friction, link side.

    The interval of a sum of parameters p with factors c is the root of the sum of the squares of c (p - end).
    """
    numbers = {number.name: number for number in exported_numbers(model) if math.isfinite(number.std)}
    interval_of = {row.place: row.interval for row in (friction_rows(friction) if friction else ()) if row.interval}
    intervals = {}
    for joint in model.robot.driven:
        name, square = joint.name, model.robot.ratio(joint.name) ** 2
        for quantity, scale_of in (
            ("armature", {f"Jm_{name}": square}), ("viscous", {f"fm_{name}": square, f"f_{name}": 1.0}),
            ("stiffness", {f"k_{name}": 1.0}), ("damping", {f"d_{name}": 1.0}),
        ):  # fmt: skip
            if free := [(numbers[part], scale) for part, scale in scale_of.items() if part in numbers]:
                value = float(joint.all_viscous) if quantity == "viscous" else free[0][0].value * free[0][1]
                down, up = (
                    math.hypot(*(k * (n.value - getattr(n, end)) for n, k in free)) for end in ("lower_95", "upper_95")
                )
                intervals[name, quantity] = value - down, value + up
        if ends := interval_of.get(f"motor {name}"):
            intervals[name, "coulomb"] = ends
    return intervals


def with_total_inertias(actuators: Actuators, result: FrictionResult) -> Actuators:
    """Add the identified total inertia (with links), gravity and offset of each joint to the omitted parts."""

    def with_omissions(row: Actuator) -> Actuator:
        values = {n.name: n.value for joint in result.joints if joint.joint == row.joint for n in joint.numbers}
        total = values.get(RIGID_TERMS["inertia"].name(row.joint))
        if total is None:
            return row
        unit = UNITS["armature"][row.slides]
        text = (
            f"total inertia {total:.6g} {unit} with the links (the armature is from the robot model and not identified)"
        )
        return replace(row, lost=(*row.lost, text, "identified gravity and offset of the torque"))

    return replace(actuators, rows=tuple(map(with_omissions, actuators.rows)))


def friction_intervals(result: FrictionResult) -> Intervals:
    """Return the intervals of friction parameters that are equal in both directions, and of the common delay."""
    all_terms = {**TERMS, "armature": RIGID_TERMS["armature"], "delay": RIGID_TERMS[DELAY]}
    terms = {quantity: all_terms[quantity] for quantity in UNITS if quantity in all_terms}
    intervals = {
        (joint.joint, quantity): (number.low, number.high)
        for joint in result.joints
        for quantity, term in terms.items()
        for number in joint.numbers
        if number.name == term.name(joint.joint)
    }
    delays = [ends for (_, quantity), ends in intervals.items() if quantity == "delay"]
    return intervals | {(joint.joint, "delay"): delays[0] for joint in result.joints if delays}


def write_actuators(folder: Path, actuators: Actuators) -> tuple[Path, ...]:
    """Write one snippet for each simulator, and README.md with the mapping and the omitted parts."""
    writers = {
        "mjcf.xml": _mjcf, "isaac_lab.py": _isaac_lab, "urdf.xml": _urdf, "sdf.xml": _sdf, "drake.xml": _drake,
        "ros2_control.yaml": _ros2, "README.md": _readme,
    }  # fmt: skip
    for name, text_of in writers.items():
        write_text(folder / name, text_of(actuators))
    return tuple(folder / name for name in writers)


def _document(root: ET.Element, actuators: Actuators, *lines: str) -> str:
    comment = xml_comment("\n".join([f"{actuators.name}: link side, SI.", *lines]))
    return f"<!-- {comment} -->\n{xml_text(root)}\n"


def _numbers(**values: float | None) -> dict[str, str]:
    return {key: repr(float(value)) for key, value in values.items() if value is not None and math.isfinite(value)}


def _add_comment(parent: ET.Element, *texts: str) -> None:
    for text in filter(None, texts):
        parent.append(ET.Comment(f" {xml_comment(text)} "))


def _mjcf(actuators: Actuators) -> str:
    """Return default classes, one per joint and one per elastic gear, for <include>."""
    root = ET.Element("mujoco", model=actuators.name)
    defaults = ET.SubElement(root, "default")
    for row in actuators.rows:
        _add_comment(defaults, actuators.interval_text(row, "armature", "viscous", "coulomb", "kp", "kd", "delay"))
        if row.delay is not None:
            _add_comment(defaults, f"delay {row.delay:g} s: attribute of actuators in new MuJoCo, else delay ctrl")
        joint_class = ET.SubElement(defaults, "default", {"class": row.joint})
        ET.SubElement(
            joint_class, "joint", _numbers(armature=row.armature, damping=row.viscous, frictionloss=row.coulomb)
        )
        if row.kp is not None:
            ET.SubElement(joint_class, "position", _numbers(kp=row.kp, kv=row.kd))
        if row.stiffness is not None:
            _add_comment(defaults, actuators.interval_text(row, "stiffness", "damping"))
            gear_class = ET.SubElement(defaults, "default", {"class": f"{row.joint} gear"})
            ET.SubElement(gear_class, "joint", _numbers(stiffness=row.stiffness, damping=row.damping))
    return _document(
        root, actuators, '<include file="mjcf.xml"/>, then class="JOINT" for a joint and its <position> actuator.',
        'An elastic gear is a second joint on the same body and axis, of class="JOINT gear"; target mujoco has both.',
    )  # fmt: skip


def _isaac_lab(actuators: Actuators) -> str:
    """Return a module with one actuator configuration per joint."""
    lines = []
    for row in actuators.rows:
        interval = actuators.interval_text(row, "armature", "coulomb", "stiction", "viscous", "kp", "kd", "delay")
        lines += [f"    # {one_line(interval)}"] * bool(interval)
        expression = re.escape(row.joint).replace("\\ ", " ")  # matches this name only
        delay = row.delay or 0.0
        fields = {
            "joint_names_expr": f"[{expression!r}]", "stiffness": row.kp, "damping": row.kd, "armature": row.armature,
            "friction": row.stiction, "dynamic_friction": row.coulomb, "viscous_friction": row.viscous,
            "effort_limit": row.effort, "velocity_limit": row.velocity,
            "min_delay": f"floor({delay!r} / PHYSICS_STEP)", "max_delay": f"ceil({delay!r} / PHYSICS_STEP)",
        }  # fmt: skip
        lines += [f"    {row.joint!r}: DelayedPDActuatorCfg("]
        lines += [f"        {key}={_python(value)}," for key, value in fields.items()] + ["    ),"]
    return from_template(
        "targets/templates/isaac_lab.py.txt", name=docstring(one_line(actuators.name)), rows="\n".join(lines)
    )


def _python(value: float | str | None) -> str:
    if isinstance(value, str) or value is None:
        return str(value)
    return repr(float(value)) if math.isfinite(value) else "None"


def _urdf(actuators: Actuators) -> str:
    root = ET.Element("robot", name=actuators.name)
    for row in actuators.rows:
        _add_comment(root, actuators.interval_text(row, "viscous", "coulomb"))
        joint = ET.SubElement(root, "joint", name=row.joint)
        ET.SubElement(joint, "dynamics", _numbers(damping=row.viscous, friction=row.coulomb))
        if limits := _numbers(effort=row.effort, velocity=row.velocity):
            ET.SubElement(joint, "limit", limits)
    return _document(root, actuators, "Copy <dynamics> into the joints of the robot; Gazebo reads both numbers.")


def _sdf(actuators: Actuators) -> str:
    root = ET.Element("model", name=actuators.name)
    for row in actuators.rows:
        _add_comment(root, actuators.interval_text(row, "viscous", "coulomb"))
        dynamics = ET.SubElement(ET.SubElement(ET.SubElement(root, "joint", name=row.joint), "axis"), "dynamics")
        for key, text in _numbers(damping=row.viscous, friction=row.coulomb).items():
            ET.SubElement(dynamics, key).text = text
    return _document(root, actuators, "Copy <dynamics> into the axes of the model. Gazebo's joints have no armature.")


def _drake(actuators: Actuators) -> str:
    """Return joints and transmissions of a URDF with Drake's tags."""
    root = ET.Element("robot", {"name": actuators.name, "xmlns:drake": "http://drake.mit.edu"})
    for row in actuators.rows:
        _add_comment(root, actuators.interval_text(row, "armature", "viscous", "kp", "kd"))
        ET.SubElement(ET.SubElement(root, "joint", name=row.joint), "dynamics", _numbers(damping=row.viscous))
        transmission = ET.SubElement(root, "transmission", name=f"{row.joint} transmission")
        ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        ET.SubElement(transmission, "joint", name=row.joint)
        actuator = ET.SubElement(transmission, "actuator", name=f"{row.joint} actuator")
        ET.SubElement(actuator, "drake:gear_ratio", _numbers(value=row.ratio))
        ET.SubElement(actuator, "drake:rotor_inertia", _numbers(value=row.rotor_inertia))
        if row.kp is not None:
            ET.SubElement(actuator, "drake:controller_gains", _numbers(p=row.kp, d=row.kd))
    return _document(root, actuators, "Copy into a URDF for Drake. The rotor inertia is on the motor side.")


def _ros2(actuators: Actuators) -> str:
    """Return gains of a trajectory controller with effort commands, and limits of joints."""
    gains, limits = list[str](), list[str]()
    for row in actuators.rows:
        name, interval = one_line(row.joint).replace("'", "''"), actuators.interval_text(row, "kp", "kd")
        if row.kp is not None:
            gains += [f"      # {interval}"] * bool(interval)
            gains.append(f"      '{name}': {{p: {row.kp!r}, i: 0.0, d: {(row.kd or 0.0)!r}}}")
        finite = {key: value for key, value in (("effort", row.effort), ("velocity", row.velocity)) if value < math.inf}
        pairs = (f"has_{key}_limits: true, max_{key}: {float(value)!r}" for key, value in finite.items())
        limits += [f"  '{name}': {{{', '.join(pairs)}}}"] * bool(finite)
    head = f"{actuators.name}: link side, SI. ROS 2 has no keys for armature, friction, elasticity and delay."
    text = [comment_lines(head) + "joint_trajectory_controller:", "  ros__parameters:"]
    text += ["    gains:", *gains] if gains else ["    gains: {} # unknown: give the controller in the study"]
    return "\n".join([*text, "joint_limits:", *limits] if limits else [*text, "joint_limits: {}"]) + "\n"


def _readme(actuators: Actuators) -> str:
    omissions = [f"- {one_line(row.joint)}: {', '.join(row.lost)}" for row in actuators.rows if row.lost]
    head = ["| joint | quantity | value | unit | 95 % interval |", "|---|---|---|---|---|"]
    return from_template(
        "targets/templates/actuators.md.txt", name=one_line(actuators.name),
        numbers="\n".join([*head, *_table(actuators)]),
        lost="\n".join(omissions) or "- Nothing: the models of all joints have only the numbers above.",
    )  # fmt: skip


def _table(actuators: Actuators) -> Iterator[str]:
    """Yield a table row for each parameter of each joint."""
    for row in actuators.rows:
        for quantity, units in UNITS.items():
            value, ends = getattr(row, quantity), actuators.intervals.get((row.joint, quantity))
            if value is not None:
                interval = "not identified" if ends is None else f"{ends[0]:.6g} to {ends[1]:.6g}"
                yield f"| {one_line(row.joint)} | {quantity} | {value:.6g} | {units[row.slides]} | {interval} |"


TARGETS = (
    Target(
        "actuators",
        ("actuators",),
        "joint parameters for MJCF, Isaac Lab, URDF, Gazebo, Drake and ROS 2, with their names there",
        write_actuators,
    ),
)
