r"""A fitted robot as functional mock-up units for co-simulation, FMI 2.0 and 3.0, with its equations in C.

The whole nonlinear robot with its friction, integrated by Runge-Kutta steps of its own, torque as input and beside it
a sampled controller whose gains are 0 until they are set:

.. math:: u_k = u_{in} + k_p (q_{ref} - q_k) + k_d (\dot q_{ref} - (q_k - q_{k-1}) / T_s) + k_i T_s \sum e

The stiffnesses, masses and friction numbers are tunable by their names; all torques and angles are on the link side.
Encoders and drives are ideal, and the delay of the measurement is left out. The sources are inside, so that a unit can
be built for any system; a library for this one is inside where a C compiler was found.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.export.fmu.description import (
    IDENTIFIER,
    SOURCES,
    Layout,
    build_description,
    description_2,
    description_3,
    layout,
)
from elastid.fit.fitted_robot import FittedRobot
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.model.elastic import ElasticModel
from elastid.simulation.baumgarte import projection
from elastid.simulation.dynamics import MAX_STEP_RATE, Contacts, contacts, fastest_rate, free_acceleration
from elastid.store.files import replacing


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


COMPILERS = ("cc", "gcc", "clang")
# Names of this system in both versions, and how its libraries end.
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("win", ".dll")}


def write_fmu(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """robot_fmi2.fmu and robot_fmi3.fmu; StudyError where a configuration has no rest."""
    sources, described = unit_sources(model)
    compiler = next((tool for name in COMPILERS if (tool := shutil.which(name))), None)
    paths = []
    for version in (2, 3):
        content = {f"sources/{name}": text for name, text in sources.items() if name not in _other(version)}
        content["modelDescription.xml"] = described[version]
        if version == 3:
            content["sources/buildDescription.xml"] = build_description()
        path = folder / f"robot_fmi{version}.fmu"
        library = None if compiler is None else compiled(compiler, sources, version)
        _pack(path, content, {} if library is None else {_library_path(version): library})
        paths.append(path)
    return tuple(paths)


def unit_sources(model: FittedRobot) -> tuple[dict[str, str], dict[int, str]]:
    """The text of all sources by name, and the descriptions of both versions."""
    equations_of = model.model
    sliding = contacts(equations_of, frictions(model.robot))
    points = tuple(equilibrium(equations_of, model.theta[:-1], linear.configuration) for linear in model.linear)
    rate_hz = 1000.0  # of the controller, until it is set
    fastest = max(fastest_rate(equations_of, sliding, point.q) for point in points)
    step_s = 1 / (rate_hz * max(2, int(np.ceil(fastest / rate_hz / MAX_STEP_RATE))))
    variables = layout(model, sliding, points, rate_hz, step_s)
    functions = equations(equations_of, sliding)
    sources = {name: files(__package__).joinpath(name).read_text("utf-8") for name in _OWN}
    with tempfile.TemporaryDirectory() as temporary:
        write_equations(Path(temporary), functions)
        sources |= {path.name: path.read_text("utf-8") for path in sorted(Path(temporary).iterdir())}
    sources["start.h"] = _start(variables, points)
    sizes = _sizes(model, sliding.n_states, functions, variables, len(points))
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_OID, ''.join([*sources.values(), sizes]))}}}"
    sources["sizes.h"] = sizes + f'#define GUID "{token}"\n'
    names = tuple(point.configuration.name for point in points)
    described = (model.name or model.robot.name, token, variables, names, 1 / rate_hz)
    return sources, {2: description_2(*described), 3: description_3(*described)}


def compiled(compiler: str, sources: Mapping[str, str], version: int) -> bytes:
    """The library for this system; StudyError with the compiler's words where it fails."""
    with tempfile.TemporaryDirectory() as temporary:
        for name, text in sources.items():
            (Path(temporary) / name).write_text(text, encoding="utf-8", newline="\n")
        library = Path(temporary) / f"{IDENTIFIER}.library"
        command = [compiler, "-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden", "-o", str(library)]
        done = subprocess.run(
            [*command, *SOURCES[version], "-lm"],
            cwd=temporary,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
        )
        if done.returncode:
            raise StudyError(f"export to fmu: {compiler} cannot compile the unit: {done.stderr.strip()[:400]}")
        return library.read_bytes()


_OWN = ("robot.h", "robot.c", "fmi2.c", "fmi3.c")


def _other(version: int) -> tuple[str, ...]:
    """The sources that are of another version."""
    return tuple(f"fmi{each}.c" for each in SOURCES if each != version)


def _library_path(version: int) -> str:
    """Where a unit of a version has the library of this system."""
    system, suffix = _SYSTEMS[sys.platform]
    if version == 2:
        return f"binaries/{system}64/{IDENTIFIER}{suffix}"
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    return f"binaries/{machine}-{'windows' if system == 'win' else system}/{IDENTIFIER}{suffix}"


def _sizes(model: FittedRobot, n_z: int, functions: tuple[ca.Function, ...], variables: Layout, postures: int) -> str:
    """sizes.h without its last line."""
    equations_of = model.model
    numbers = {
        "N_Q": equations_of.n_q,
        "N_U": equations_of.n_u,
        "N_L": len(equations_of.robot.joints),
        "N_Z": n_z,
        "N_POSTURES": postures,
        "N_VALUES": len(variables.variables),
        "HAS_LOOPS": int(equations_of.n_c > 0),
        "N_ARG": max(function.sz_arg() for function in functions),
        "N_RES": max(function.sz_res() for function in functions),
        "N_IW": max(function.sz_iw() for function in functions),
        "N_W": max(function.sz_w() for function in functions),
        "OF_OUTPUTS": variables.places["ANGLE"],
        **{f"OF_{name}": place for name, place in variables.places.items()},
    }
    lines = [f"#define {name} {number}" for name, number in numbers.items()]
    lines.append('#define START_REFUSED "no such configuration, or a rate or step that is not positive"')
    lines.append('#define LOST "the motion has left all bounds: take a smaller largest_step, or gentler inputs"')
    return "\n".join(lines) + "\n"


def _start(variables: Layout, points: tuple[OperatingPoint, ...]) -> str:
    """start.h: the values of all variables, and rest in every configuration."""
    values = _row(variable.start for variable in variables.variables)
    return (
        f"static const double START_VALUES[N_VALUES] = {values};\n"
        f"static const double START_POSTURES[N_POSTURES][N_Q] = {_table([point.q for point in points])};\n"
        f"static const double START_TORQUES[N_POSTURES][N_U] = {_table([point.u for point in points])};\n"
    )


def _table(rows: Iterable[FloatArray]) -> str:
    return "{" + ", ".join(_row(row.tolist()) for row in rows) + "}"


def _row(values: Iterable[float]) -> str:
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def _pack(path: Path, texts: Mapping[str, str], libraries: Mapping[str, bytes]) -> None:
    """A zip file whose bytes depend on its content alone."""
    entries = {name: text.encode("utf-8") for name, text in texts.items()} | dict(libraries)
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(entries):
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), entries[name], zipfile.ZIP_DEFLATED)
