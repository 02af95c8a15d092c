r"""Functional mock-up units of a robot for co-simulation, FMI 2.0 and 3.0, with its equations in C.

A unit contains the nonlinear robot with friction and a Runge-Kutta solver. Its inputs are motor torques and forces at
the frames. A sampled controller is included; its gains are 0 until they are set:

.. math:: u_k = u_{in} + k_p (q_{ref} - q_k) + k_d (\dot q_{ref} - (q_k - q_{k-1}) / T_s) + k_i T_s \sum e

Stiffnesses, masses and friction parameters are tunable by name; torques and angles are on the link side. Encoders and
drives are ideal, without the delay of the measurement. The unit contains its sources, so that it can be built for any
system, and a library for this system if there is a C compiler.
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
from functools import partial
from importlib.resources import files
from pathlib import Path

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import capitalise
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
from elastid.simulation.contacts import Contacts, contacts
from elastid.simulation.controller import tune
from elastid.simulation.drives import gear_forces
from elastid.simulation.dynamics import free_acceleration, poles, projection
from elastid.simulation.runge_kutta import MAX_STEP_RATE
from elastid.targets.code import c_sources, dense
from elastid.targets.fmu_description import (
    IDENTIFIER,
    Causality,
    Layout,
    Variability,
    Variable,
    build_description,
    description,
)
from elastid.targets.move import move_sources
from elastid.targets.numbers import FIXED, c_row, exported_numbers
from elastid.targets.target import Target
from elastid.use.tune import DAMPING_RATIO, TunedMove


@dataclass(frozen=True, eq=False)
class Subject:
    """Robot of a unit: equations, start postures, and intervals of its parameters as text.

    move: reference trajectory and torques of the controller, with gains kp and kd (n_u,).
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
        """Return a fitted robot in its measured configurations."""
        postures = tuple(linear.configuration for linear in model.linear)
        intervals = {number.name: number.interval_text for number in exported_numbers(model)}
        return cls(model.name or model.robot.name, model.model, postures, intervals)

    @classmethod
    def moving(cls, robot: Robot, tuned: TunedMove) -> "Subject":
        """Return a robot at the start of a move, with the position loops of the simulation of the move."""
        model, start = formulate(robot), Configuration("start of the move", tuned.position[0])
        gains = tune(model, equilibrium(model, model.theta, start).q, tuned.bandwidth_hz, DAMPING_RATIO)
        return cls(tuned.name, model, (start,), {}, tuned, gains.kp, gains.kd)


def layout(
    subject: Subject, contacts: Contacts, points: tuple[OperatingPoint, ...], rate_hz: float, step_s: float
) -> Layout:
    """Return the variables of a robot that starts at rest in its first posture."""
    equations, moves = subject.model, subject.move is not None
    motors, joints = equations.inputs, [joint.name for joint in equations.robot.joints]
    position, torque = equations.B.T @ points[0].q * (not moves), points[0].u * (not moves)
    at_motors = partial(_variables_at, motors)
    with_move = " beside the move" * moves
    groups = {
        "TIME": [Variable("time", "independent", "continuous", "Time, s", 0.0)],
        "TORQUE": at_motors("torque", "input", f"link-side torque added to the feedback{with_move}", torque),
        "POSITION": at_motors("reference", "input", f"angle that the controller aims at{with_move}", position),
        "VELOCITY": at_motors("reference_speed", "input", f"speed that the controller aims at{with_move}"),
        "FORCE": _frame_variables(equations.robot, "force", "input", "force on it in N, along {axis} of the base"),
        "ANGLE": at_motors("angle", "output", "angle over its gear ratio"),
        "SPEED": at_motors("speed", "output", "speed over its gear ratio"),
        "APPLIED": at_motors("applied", "output", "torque with feedback, link side"),
        "HOLDING": at_motors("holding", "output", "torque that holds the posture of the start"),
        "JOINT": _variables_at([f"joint {name}" for name in joints], "angle", "output", "angle"),
        "PLACE": _frame_variables(equations.robot, "position", "output", "{axis} of its origin in m, axes of the base"),
        "THETA": _parameter_variables(subject),
        "FRICTION": _friction_variables(contacts),
        "KP": at_motors("kp", "parameter", "feedback of its angle, N*m/rad of the link side", subject.kp),
        "KD": at_motors("kd", "parameter", "feedback of its speed, N*m*s/rad of the link side", subject.kd),
        "KI": at_motors("ki", "parameter", "integral of the feedback, 1/s"),
        "RATE": [Variable("controller_rate", "parameter", "fixed", "Rate of the controller, Hz", rate_hz)],
        "STEP": [Variable("largest_step", "parameter", "fixed", "Longest step of integration, s", step_s)],
    }
    starts, first = {}, 0
    for name, members in groups.items():
        starts[name] = first
        first += len(members)
    return Layout(tuple(variable for members in groups.values() for variable in members), starts)


def _variables_at(
    places: Sequence[str], name: str, causality: Causality, text: str, start: FloatArray | None = None
) -> list[Variable]:
    """Return a variable for each motor or joint; start: 0 by default."""
    values = np.zeros(len(places)) if start is None else start
    variability: Variability = "tunable" if causality == "parameter" else "continuous"
    return [
        Variable(f"{name} of {place}", causality, variability, f"{capitalise(place)}: {text}", float(value))
        for place, value in zip(places, values, strict=True)
    ]


def with_tool_frame(robot: Robot) -> Robot:
    """Return the robot; with a frame `tool` if it has no frames."""
    return robot if robot.frames else with_frames(robot, (TOOL,))


def _frame_variables(robot: Robot, name: str, causality: Causality, text: str) -> list[Variable]:
    return [
        Variable(
            f"{name} {axis} of frame {frame.name}", causality, "continuous",
            f"Frame {frame.name}: {text.format(axis=axis)}", 0.0,
        )
        for frame in with_tool_frame(robot).frames
        for axis in "xyz"
    ]  # fmt: skip


def _parameter_variables(subject: Subject) -> list[Variable]:
    rows = subject.model.robot.parameters().items()
    texts = {name: f"{name} of the robot, {unit}; {subject.intervals.get(name, FIXED)}" for name, (_, unit) in rows}
    return [
        Variable(name, "parameter", "tunable", texts.get(name, name), float(value))
        for name, value in zip(subject.model.parameters, subject.model.theta, strict=True)
    ]


def _friction_variables(contacts: Contacts) -> list[Variable]:
    names = [f"{number} of friction at {law.place}" for law in contacts.laws for number in CURVE]
    return [
        Variable(name, "parameter", "tunable", f"{name}, link side, SI", float(value))
        for name, value in zip(names, contacts.curves, strict=True)
    ]


SOURCES = ("robot.h", "robot.c", "fmi.h", "fmi2.c", "fmi3.c")


def _compiled_sources(version: int, moves: bool) -> tuple[str, ...]:
    return (f"fmi{version}.c", "robot.c", "equations.c", *["move.c"] * moves)


def equations(model: ElasticModel, contacts: Contacts) -> tuple[ca.Function, ...]:
    """Return the functions acceleration, bristles, readings and, with loops, closing; all results are dense.

    acceleration(q, v, z, u, force, theta, friction) -> q''.  bristles(z, v, friction, step) -> z after a step at
    constant v.  readings(q, v) -> angles and speeds of the motors, angles of the joints, origins of the frames.
    closing(q, v, theta) -> q, v projected onto the loops.  force: at all frames, in the axes of the base.
    """
    q, v, theta = model.symbols("q", "v", "theta")
    z, u = ca.SX.sym("z", contacts.n_states), ca.SX.sym("u", model.n_u)
    friction, step = ca.SX.sym("friction", len(contacts.curves)), ca.SX.sym("step")
    B, n_l = ca.DM(model.B), model.robot.n_l
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
    joint_turns = turns(layout, q[: model.robot.n_l])
    return ca.vertcat(*(position(layout, joint_turns, seat) for seat in layout.named))


# Name of each system in both versions of FMI, and the extension of its libraries.
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("win", ".dll")}


def write_fmu(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """Write robot_fmi2.fmu and robot_fmi3.fmu; StudyError if a configuration has no equilibrium."""
    return write_units(folder, Subject.fitted(model), IDENTIFIER)


def write_move_fmu(folder: Path, robot: Robot, tuned: TunedMove) -> tuple[Path, ...]:
    """Write robot_with_move_fmi2.fmu and ..._fmi3.fmu: a robot whose controller executes a tuned move from time 0."""
    return write_units(folder, Subject.moving(robot, tuned), "robot_with_move")


def write_units(folder: Path, subject: Subject, stem: str) -> tuple[Path, ...]:
    """Write <stem>_fmi2.fmu and <stem>_fmi3.fmu of a robot; StudyError if a start posture has no equilibrium."""
    sources, xml_of_version = unit_sources(subject)
    compiler = next((tool for name in ("cc", "gcc", "clang") if (tool := shutil.which(name))), None)
    paths = tuple(folder / f"{stem}_fmi{version}.fmu" for version in (2, 3))
    for version, path in zip((2, 3), paths, strict=True):
        unused = "fmi3.c" if version == 2 else "fmi2.c"
        names = _compiled_sources(version, subject.move is not None)
        content: dict[str, str | bytes] = {f"sources/{name}": text for name, text in sources.items() if name != unused}
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
    model, move = subject.model, subject.move
    sliding = contacts(model, frictions(model.robot))
    points = tuple(equilibrium(model, model.theta, posture) for posture in subject.postures)
    rate_hz = 1000.0 if move is None else move.rate_hz  # default rate of the controller
    fastest = max(np.abs(poles(model, sliding, point.q)[0]).max() for point in points)
    step_s = 1 / (rate_hz * max(2, int(np.ceil(fastest / rate_hz / MAX_STEP_RATE))))
    variables = layout(subject, sliding, points, rate_hz, step_s)
    functions = equations(model, sliding)
    sources = {
        **{name: (files(__package__) / "fmu_sources" / name).read_text("utf-8") for name in SOURCES},
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
    """Return the library for this system; StudyError with the compiler's message if it fails."""
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
    model = subject.model
    numbers = {
        "N_Q": model.n_q, "N_U": model.n_u, "N_L": model.robot.n_l, "N_Z": n_z,
        "N_P": 3 * len(with_tool_frame(model.robot).frames),
        "N_POSTURES": len(subject.postures), "N_VALUES": len(variables.variables),
        "HAS_LOOPS": int(model.n_c > 0), "HAS_MOVE": int(subject.move is not None),
        **{f"N_{s.upper()}": max(getattr(f, f"sz_{s}")() for f in functions) for s in ("arg", "res", "iw", "w")},
        **{f"OF_{name}": index for name, index in {"OUTPUTS": variables.starts["ANGLE"], **variables.starts}.items()},
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
