r"""A fitted robot as functional mock-up units for co-simulation, FMI 2.0 and 3.0, with its equations in C.

The whole nonlinear robot with its friction, integrated by Runge-Kutta steps of its own, torques of motors and forces at
its frames as inputs and beside them a sampled controller whose gains are 0 until they are set:

.. math:: u_k = u_{in} + k_p (q_{ref} - q_k) + k_d (\dot q_{ref} - (q_k - q_{k-1}) / T_s) + k_i T_s \sum e

The stiffnesses, masses and friction numbers are tunable by their names; all torques and angles are on the link side.
Encoders and drives are ideal, and the delay of the measurement is left out. The sources are inside, so that a unit can
be built for any system; a library for this one is inside where a C compiler was found.
"""

import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Literal, TypeAlias
from xml.etree import ElementTree as ET

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.files import replacing
from elastid.fit.fitted_robot import FittedRobot
from elastid.friction.robot_friction import frictions
from elastid.friction.static import CURVE
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.model.frame_tree import position, tree, turns
from elastid.record import Configuration
from elastid.robot import TOOL, Robot
from elastid.robot.robot import with_frames
from elastid.simulation.controller import tune
from elastid.simulation.drives import gear_forces
from elastid.simulation.dynamics import MAX_STEP_RATE, Contacts, contacts, free_acceleration, poles, projection
from elastid.targets.code import c_sources, dense
from elastid.targets.move import move_sources
from elastid.targets.numbers import FIXED, c_row, known_numbers
from elastid.targets.target import Target
from elastid.use.tune import DAMPING_RATIO, TunedMove

Causality: TypeAlias = Literal["independent", "input", "output", "parameter"]
Variability: TypeAlias = Literal["continuous", "discrete", "tunable", "fixed"]


@dataclass(frozen=True)
class Variable:
    """A real variable: its value reference is its place in a list of all."""

    name: str
    causality: Causality
    variability: Variability
    text: str
    start: float


@dataclass(frozen=True)
class Layout:
    """All real variables, and by name the place where each group begins."""

    variables: tuple[Variable, ...]
    places: dict[str, int]

    @property
    def outputs(self) -> list[int]:
        """References of the outputs."""
        return [i for i, variable in enumerate(self.variables) if variable.causality == "output"]


@dataclass(frozen=True, eq=False)
class Subject:
    """Robot as a functional mock-up unit: equations, start postures, and a description of the uncertainty.

    move: references and torques that its controller has inside, and the gains (n_u,) of angles and speeds with them.
    """

    name: str
    model: ElasticModel
    postures: tuple[Configuration, ...]
    intervals: Mapping[str, str]
    move: TunedMove | None = None
    kp: FloatArray | None = None
    kd: FloatArray | None = None

    @classmethod
    def fitted(cls, model: FittedRobot) -> "Subject":
        """Return a fitted robot, in the configurations that were measured."""
        postures = tuple(linear.configuration for linear in model.linear)
        intervals = {number.name: number.interval_text for number in known_numbers(model)}
        return cls(model.name or model.robot.name, model.model, postures, intervals)

    @classmethod
    def moving(cls, robot: Robot, tuned: TunedMove) -> "Subject":
        """Return a robot at the start of a move, in the loops that the move was judged in."""
        model, start = formulate(robot), Configuration("start of the move", tuned.position[0])
        gains = tune(model, equilibrium(model, model.theta, start).q, tuned.bandwidth_hz, DAMPING_RATIO)
        return cls(tuned.name, model, (start,), {}, tuned, gains.kp, gains.kd)


def layout(
    subject: Subject, contacts: Contacts, points: tuple[OperatingPoint, ...], rate_hz: float, step_s: float
) -> Layout:
    """Return the variables of a robot that starts at rest in the first of its configurations."""
    equations, moves = subject.model, subject.move is not None
    motors, joints = equations.inputs, [joint.name for joint in equations.robot.joints]
    position = equations.B.T @ points[0].q * (not moves)
    beside = " beside the move" * moves
    groups = {
        "TIME": [Variable("time", "independent", "continuous", "Time, s", 0.0)],
        "TORQUE": _of(
            motors, "torque", "input", f"link-side torque added to the feedback{beside}", points[0].u * (not moves)
        ),
        "POSITION": _of(motors, "reference", "input", f"angle that the controller aims at{beside}", position),
        "VELOCITY": _of(motors, "reference_speed", "input", f"speed that the controller aims at{beside}"),
        "FORCE": _at_frames(equations.robot, "force", "input", "force on it in N, along {axis} of the base"),
        "ANGLE": _of(motors, "angle", "output", "angle over its gear ratio"),
        "SPEED": _of(motors, "speed", "output", "speed over its gear ratio"),
        "APPLIED": _of(motors, "applied", "output", "torque with feedback, link side"),
        "HOLDING": _of(motors, "holding", "output", "torque that holds the posture of the start"),
        "JOINT": _of([f"joint {name}" for name in joints], "angle", "output", "angle"),
        "PLACE": _at_frames(equations.robot, "position", "output", "{axis} of its origin in m, axes of the base"),
        "THETA": _stiffnesses(subject),
        "FRICTION": _friction(contacts),
        "KP": _of(motors, "kp", "parameter", "feedback of its angle, N*m/rad of the link side", subject.kp),
        "KD": _of(motors, "kd", "parameter", "feedback of its speed, N*m*s/rad of the link side", subject.kd),
        "KI": _of(motors, "ki", "parameter", "integral of the feedback, 1/s"),
        "RATE": [Variable("controller_rate", "parameter", "fixed", "Rate of the controller, Hz", rate_hz)],
        "STEP": [Variable("largest_step", "parameter", "fixed", "Longest step of integration, s", step_s)],
    }
    starts, first = {}, 0
    for name, members in groups.items():
        starts[name] = first
        first += len(members)
    return Layout(tuple(variable for members in groups.values() for variable in members), starts)


def _of(
    motors: Sequence[str], name: str, causality: Causality, text: str, start: FloatArray | None = None
) -> list[Variable]:
    values = np.zeros(len(motors)) if start is None else start
    variability: Variability = "tunable" if causality == "parameter" else "continuous"
    return [
        Variable(f"{name} of {motor}", causality, variability, f"{motor[0].upper()}{motor[1:]}: {text}", float(value))
        for motor, value in zip(motors, values, strict=True)
    ]


def with_tool_frame(robot: Robot) -> Robot:
    """Return the robot, with a frame `tool` if it has no frames."""
    return robot if robot.frames else with_frames(robot, (TOOL,))


def _at_frames(robot: Robot, name: str, causality: Causality, text: str) -> list[Variable]:
    return [
        Variable(
            f"{name} {axis} of frame {frame.name}", causality, "continuous",
            f"Frame {frame.name}: {text.format(axis=axis)}", 0.0,
        )
        for frame in with_tool_frame(robot).frames
        for axis in "xyz"
    ]  # fmt: skip


def _stiffnesses(subject: Subject) -> list[Variable]:
    rows = subject.model.robot.parameters().items()
    texts = {name: f"{name} of the robot, {unit}; {subject.intervals.get(name, FIXED)}" for name, (_, unit) in rows}
    return [
        Variable(name, "parameter", "tunable", texts.get(name, name), float(value))
        for name, value in zip(subject.model.parameters, subject.model.theta, strict=True)
    ]


def _friction(contacts: Contacts) -> list[Variable]:
    names = [f"{number} of friction at {law.place}" for law in contacts.laws for number in CURVE]
    return [
        Variable(name, "parameter", "tunable", f"{name}, link side, SI", float(value))
        for name, value in zip(names, contacts.curves, strict=True)
    ]


IDENTIFIER = "robot"
OWN = ("robot.h", "robot.c", "fmi.h", "fmi2.c", "fmi3.c")


def _compiled_sources(version: int, moves: bool) -> tuple[str, ...]:
    return (f"fmi{version}.c", "robot.c", "equations.c", *["move.c"] * moves)


def description(
    version: int, sources: Sequence[str], name: str, token: str, layout: Layout, configurations: tuple[str, ...],
    step_s: float,
) -> str:  # fmt: skip
    """Return modelDescription.xml of FMI 2.0 or 3.0."""
    is_2, state = version == 2, "FMUstate" if version == 2 else "FMUState"
    head = {
        "fmiVersion": f"{version}.0", "modelName": name, "guid" if is_2 else "instantiationToken": token,
        "generationTool": "elastid", "variableNamingConvention": "flat",
    }  # fmt: skip
    root = ET.Element("fmiModelDescription", head | ({"numberOfEventIndicators": "0"} if is_2 else {}))
    can = ("canHandleVariableCommunicationStepSize", f"canGetAndSet{state}", f"canSerialize{state}")
    simulation = ET.SubElement(root, "CoSimulation", {"modelIdentifier": IDENTIFIER} | dict.fromkeys(can, "true"))
    if is_2:
        files = ET.SubElement(simulation, "SourceFiles")
        for source in sources:
            ET.SubElement(files, "File", name=source)
    ET.SubElement(ET.SubElement(root, "LogCategories"), "Category", name="logStatusError")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(step_s))
    variables = ET.SubElement(root, "ModelVariables")
    (_describe_2 if is_2 else _describe_3)(variables, ET.SubElement(root, "ModelStructure"), layout, configurations)
    return _text(root)


def _describe_2(variables: ET.Element, structure: ET.Element, layout: Layout, names: tuple[str, ...]) -> None:
    """Add variables with their types below them, and unknowns by their places from 1 on."""
    for reference, variable in enumerate(layout.variables):
        scalar = ET.SubElement(variables, "ScalarVariable", _attributes(variable, reference))
        ET.SubElement(scalar, "Real", _start_of(variable))
    posture = ET.SubElement(variables, "ScalarVariable", _configuration(len(layout.variables), names))
    ET.SubElement(posture, "Integer", start="1", min="1", max=str(len(names)))
    for part in ("Outputs", "InitialUnknowns"):
        section = ET.SubElement(structure, part)
        for reference in layout.outputs:
            ET.SubElement(section, "Unknown", index=str(reference + 1))


def _describe_3(variables: ET.Element, structure: ET.Element, layout: Layout, names: tuple[str, ...]) -> None:
    for reference, variable in enumerate(layout.variables):
        ET.SubElement(variables, "Float64", _attributes(variable, reference) | _start_of(variable))
    limits = {"start": "1", "min": "1", "max": str(len(names))}
    ET.SubElement(variables, "Int32", _configuration(len(layout.variables), names) | limits)
    for section in ("Output", "InitialUnknown"):
        for reference in layout.outputs:
            ET.SubElement(structure, section, valueReference=str(reference))


def build_description(sources: Sequence[str]) -> str:
    """Return sources/buildDescription.xml of FMI 3.0."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=IDENTIFIER)
    files = ET.SubElement(build, "SourceFileSet", language="C99")
    for source in sources:
        ET.SubElement(files, "SourceFile", name=source)
    return _text(root)


def _attributes(variable: Variable, reference: int) -> dict[str, str]:
    attributes = {"name": variable.name, "valueReference": str(reference), "description": variable.text}
    return attributes | {"causality": variable.causality, "variability": variable.variability}


def _configuration(reference: int, names: tuple[str, ...]) -> dict[str, str]:
    choices = ", ".join(f"{number} {name}" for number, name in enumerate(names, start=1))
    text = f"posture of the start, from 1: {choices}"
    return _attributes(Variable("configuration", "parameter", "fixed", text, 1.0), reference)


def _start_of(variable: Variable) -> dict[str, str]:
    """Return the start of an input or parameter; empty for outputs, which are computed."""
    return {"start": repr(variable.start)} if variable.causality in ("input", "parameter") else {}


def _text(root: ET.Element) -> str:
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def equations(model: ElasticModel, contacts: Contacts) -> tuple[ca.Function, ...]:
    """Return acceleration, bristles, readings and, with loops, closing; dense.

    acceleration(q, v, z, u, force, theta, friction) -> q''.  bristles(z, v, friction, step) -> z after a step at
    constant v.  readings(q, v) -> angles and speeds of the motors, angles of the joints, origins of the frames.
    closing(q, v, theta) -> q, v on the loops.  force: at all frames, in the axes of the base.
    """
    q, v, theta = model.symbols("q", "v", "theta")
    z, u = ca.SX.sym("z", contacts.n_states), ca.SX.sym("u", model.n_u)
    friction, step = ca.SX.sym("friction", len(contacts.curves)), ca.SX.sym("step")
    B, n_l = ca.DM(model.B), len(model.robot.joints)
    origin_of = origins(model, q)
    force = ca.SX.sym("force", origin_of.numel())
    torque = B @ u - contacts.torque(v, z, friction) - gear_forces(model, q, v, theta)
    torque += ca.jacobian(origin_of, q).T @ force
    accelerate = free_acceleration(model, theta=theta)
    functions = [
        dense("acceleration", [q, v, z, u, force, theta, friction], [accelerate(q, v, torque, theta)]),
        dense("bristles", [z, v, friction, step], [contacts.advanced(v, z, friction, step)]),
        dense("readings", [q, v], [B.T @ q, B.T @ v, q[:n_l], origin_of]),
    ]
    if model.n_c:
        functions.append(dense("closing", [q, v, theta], list(projection(model, theta)(q, v, theta))))
    return tuple(functions)


def origins(model: ElasticModel, q: ca.SX) -> ca.SX:
    """Return origins (3 n_f,) of all frames at q (n_q,), in the axes of the base, m."""
    layout = tree(with_tool_frame(model.robot))
    joint_turns = turns(layout, q[: len(model.robot.joints)])
    return ca.vertcat(*(position(layout, joint_turns, seat) for seat in layout.named))


COMPILERS = ("cc", "gcc", "clang")
# Names of this system in both versions, and how its libraries end.
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("win", ".dll")}


def write_fmu(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """Write robot_fmi2.fmu and robot_fmi3.fmu; StudyError where a configuration has no rest."""
    return write_units(folder, Subject.fitted(model), IDENTIFIER)


def write_move_fmu(folder: Path, robot: Robot, tuned: TunedMove) -> tuple[Path, ...]:
    """Write robot_with_move_fmi2.fmu and ..._fmi3.fmu: a robot with a tuned move in its controller, from time 0 on."""
    return write_units(folder, Subject.moving(robot, tuned), "robot_with_move")


def write_units(folder: Path, subject: Subject, stem: str) -> tuple[Path, ...]:
    """Write <stem>_fmi2.fmu and <stem>_fmi3.fmu of a robot; StudyError where a posture of its start has no rest."""
    sources, xml_of_version = unit_sources(subject)
    compiler = next((tool for name in COMPILERS if (tool := shutil.which(name))), None)
    paths = tuple(folder / f"{stem}_fmi{version}.fmu" for version in (2, 3))
    for version, path in zip((2, 3), paths, strict=True):
        surplus = "fmi3.c" if version == 2 else "fmi2.c"
        names = _compiled_sources(version, subject.move is not None)
        content: dict[str, str | bytes] = {f"sources/{name}": text for name, text in sources.items() if name != surplus}
        content["modelDescription.xml"] = xml_of_version[version]
        if version == 3:
            content["sources/buildDescription.xml"] = build_description(names)
        if compiler is not None:
            content[_library_path(version)] = compile_library(compiler, sources, names)
        with replacing(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(content):
                archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content[name], zipfile.ZIP_DEFLATED)
    return paths


def unit_sources(subject: Subject) -> tuple[dict[str, str], dict[int, str]]:
    """Return the text of all sources by name, and the descriptions of both versions."""
    equations_of, move = subject.model, subject.move
    sliding = contacts(equations_of, frictions(equations_of.robot))
    points = tuple(equilibrium(equations_of, equations_of.theta, posture) for posture in subject.postures)
    rate_hz = 1000.0 if move is None else move.rate_hz  # of the controller, until it is set
    fastest = max(np.abs(poles(equations_of, sliding, point.q)[0]).max() for point in points)
    step_s = 1 / (rate_hz * max(2, int(np.ceil(fastest / rate_hz / MAX_STEP_RATE))))
    variables = layout(subject, sliding, points, rate_hz, step_s)
    functions = equations(equations_of, sliding)
    sources = {
        **{name: (files(__package__) / "fmu_sources" / name).read_text("utf-8") for name in OWN},
        **c_sources("equations", functions), "start.h": _start(variables, points),
        **({} if move is None else move_sources(move)),
    }  # fmt: skip
    sizes = _sizes(subject, sliding.n_states, functions, variables)
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_OID, ''.join([*sources.values(), sizes]))}}}"
    sources["sizes.h"] = sizes + f'#define GUID "{token}"\n'
    fields = (subject.name, token, variables, tuple(point.configuration.name for point in points), 1 / rate_hz)
    compiled_sources = {version: _compiled_sources(version, move is not None) for version in (2, 3)}
    return sources, {version: description(version, compiled_sources[version], *fields) for version in (2, 3)}


def compile_library(compiler: str, sources: Mapping[str, str], names: Sequence[str]) -> bytes:
    """Return the library for this system; StudyError with the compiler's words where it fails."""
    with tempfile.TemporaryDirectory() as temporary:
        for name, text in sources.items():
            (Path(temporary) / name).write_text(text, encoding="utf-8", newline="\n")
        library = Path(temporary) / f"{IDENTIFIER}.library"
        command = [compiler, "-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-o", str(library)]
        command += [*names, "-lm"]
        process = subprocess.run(command, cwd=temporary, capture_output=True, encoding="utf-8", errors="replace")
        if process.returncode:
            raise StudyError(
                "install/missing-package",
                f"{compiler} cannot compile the unit: {process.stderr.strip()[:400]}",
                "export to fmu",
            )
        return library.read_bytes()


def _library_path(version: int) -> str:
    system, suffix = _SYSTEMS[sys.platform]
    if version == 2:
        return f"binaries/{system}64/{IDENTIFIER}{suffix}"
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    return f"binaries/{machine}-{'windows' if system == 'win' else system}/{IDENTIFIER}{suffix}"


def _sizes(subject: Subject, n_z: int, functions: tuple[ca.Function, ...], variables: Layout) -> str:
    equations_of = subject.model
    numbers = {
        "N_Q": equations_of.n_q, "N_U": equations_of.n_u, "N_L": len(equations_of.robot.joints), "N_Z": n_z,
        "N_P": 3 * len(with_tool_frame(equations_of.robot).frames),
        "N_POSTURES": len(subject.postures), "N_VALUES": len(variables.variables),
        "HAS_LOOPS": int(equations_of.n_c > 0), "HAS_MOVE": int(subject.move is not None),
        **{f"N_{of.upper()}": max(getattr(f, f"sz_{of}")() for f in functions) for of in ("arg", "res", "iw", "w")},
        **{f"OF_{name}": index for name, index in {"OUTPUTS": variables.places["ANGLE"], **variables.places}.items()},
        "START_REFUSED": '"no such configuration, or a rate or step that is not positive"',
        "LOST": '"the motion has left all bounds: take a smaller largest_step, or gentler inputs"',
    }  # fmt: skip
    return "".join(f"#define {name} {number}\n" for name, number in numbers.items())


def _start(variables: Layout, points: tuple[OperatingPoint, ...]) -> str:
    values = c_row(variable.start for variable in variables.variables)
    return (
        f"static const double START_VALUES[N_VALUES] = {values};\n"
        f"static const double START_POSTURES[N_POSTURES][N_Q] = {_table([point.q for point in points])};\n"
        f"static const double START_TORQUES[N_POSTURES][N_U] = {_table([point.u for point in points])};\n"
    )


def _table(rows: Iterable[FloatArray]) -> str:
    return "{" + ", ".join(map(c_row, rows)) + "}"


TARGETS = (
    Target("fmu", ("model",), "nonlinear robot with friction and feedback as FMI 2 and 3 units", write_fmu, True),
)
