r"""Export of the nonlinear equations of motion: CasADi functions, and C code without dependencies.

.. math:: M(q)\, \ddot q + f(q, \dot q) + \Phi^T \lambda = B u, \qquad \varphi(q) = 0

with the fitted parameters, and the equilibria in the postures of the study. Signs and sides: `elastid.model.elastic`.
"""

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from elastid.base.escape import c_comment, one_line
from elastid.base.files import replacing
from elastid.fit.fitted_robot import FittedRobot
from elastid.linear.equilibrium import equilibrium
from elastid.store.files import write_text
from elastid.targets.numbers import interval_lines
from elastid.targets.target import Target


def model_functions(model: FittedRobot) -> tuple[ca.Function, ...]:
    """Return mass(q) -> M, force(q, v) -> f, damping(q) -> D, stiffness(q) -> K, input_matrix() -> B, as fitted.

    damping and stiffness are the Hessians of dissipation and potential: the linear model at an equilibrium q. With
    loop constraints, also constraint(q) -> phi and constraint_jacobian(q) -> Phi, and stiffness(q, lambda_) is the
    Hessian of V + lambda^T phi.  equilibria() -> q, lambda_ and motor torques u, a column for each posture of the
    study; StudyError if a posture has no equilibrium.
    """
    m, theta = model.model, model.theta[:-1]
    q, v, multipliers = m.symbols("q", "v", "lambda")
    symbols = {"q": q, "v": v, "lambda_": multipliers}

    def function(name: str, inputs: tuple[str, ...], output: str, value: ca.SX) -> ca.Function:
        return ca.Function(name, [symbols[symbol] for symbol in inputs], [value], list(inputs), [output], {"cse": True})

    constraints = (
        function("constraint", ("q",), "phi", m.constraint(q, theta)),
        function("constraint_jacobian", ("q",), "Phi", m.constraint_jacobian(q, theta)),
    )
    return (
        function("mass", ("q",), "M", m.mass(q, theta)), function("force", ("q", "v"), "f", m.force(q, v, theta)),
        function("damping", ("q",), "D", m.damping(q, theta)),
        function("stiffness", ("q", "lambda_") if m.n_c else ("q",), "K", m.stiffness(q, multipliers, theta)),
        function("input_matrix", (), "B", ca.SX(ca.DM(m.B))), _equilibria(model), *(constraints if m.n_c else ()),
    )  # fmt: skip


def _equilibria(model: FittedRobot) -> ca.Function:
    points = [
        equilibrium(model.model, model.theta_of(G.configuration.name)[:-1], G.configuration) for G in model.linear
    ]
    names = ["q", "lambda_", "u"] if model.model.n_c else ["q", "u"]
    columns = [np.stack([getattr(point, name) for point in points], axis=1) for name in names]
    return ca.Function("equilibria", [], [ca.SX(ca.DM(column)) for column in columns], [], names)


def write_casadi(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """Write a file <name>.casadi for each of `model_functions`, for casadi.Function.load, and coordinates.txt."""
    files = {folder / f"{function.name()}.casadi": function for function in model_functions(model)}
    for path, function in files.items():
        with replacing(path) as temporary:
            function.save(str(temporary))
    return (*files, _write_coordinates(folder, model))


def write_c(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """Write robot.c and robot.h: `model_functions` as `int robot_mass(const double** arg, double** res, ...)`.

    Matrices are dense, column by column. Compile with `cc -O2 -shared -fPIC robot.c -lm`. The comment of robot.h lists
    arguments, results, coordinates and units.
    """
    c_functions = []
    for function in model_functions(model):
        results = [ca.densify(output) for output in function.call(function.sx_in())]
        signature = function.sx_in(), results, function.name_in(), function.name_out()
        c_functions.append(ca.Function(f"robot_{function.name()}", *signature, {"cse": True}))
    sources = c_sources("robot", c_functions)
    source, header = folder / "robot.c", folder / "robot.h"
    write_text(source, sources["robot.c"])
    write_text(header, _header_comment(model, c_functions) + sources["robot.h"])
    return source, header, _write_coordinates(folder, model)


def c_sources(name: str, functions: Iterable[ca.Function]) -> dict[str, str]:
    """Return the texts of <name>.c and <name>.h with these functions."""
    generator = ca.CodeGenerator(f"{name}.c", {"with_header": True})
    for function in functions:
        generator.add(function)
    with tempfile.TemporaryDirectory() as temporary:
        generator.generate(f"{temporary}/")
        return {path.name: path.read_text("utf-8") for path in sorted(Path(temporary).iterdir())}


def dense(name: str, expression: list[ca.SX], results: Iterable[ca.SX]) -> ca.Function:
    """Return a function whose results have no structural zeros."""
    return ca.Function(name, expression, [ca.densify(result) for result in results], {"cse": True})


def _header_comment(model: FittedRobot, c_functions: Sequence[ca.Function]) -> str:
    units = {joint.name: ("m, m/s, N" if joint.slides else "rad, rad/s, N*m") for joint in model.robot.joints}
    lines = [f"{_equation(model)}, on the link side.", ""]
    for function in c_functions:
        arguments = ", ".join(f"arg[{i}] {_name_and_size(function, i, is_in=True)}" for i in range(function.n_in()))
        results = ", ".join(f"res[{i}] {_name_and_size(function, i, is_in=False)}" for i in range(function.n_out()))
        lines.append(f"{function.name()}: {arguments or 'no arguments'} -> {results}")
    legend = "Matrices are dense, column by column. Each function returns 0. Entries:"
    lines += ["", *interval_lines(model), "", *_posture_lines(model), "", legend]
    for letter, names in (("q", model.model.coordinates), ("u", model.model.inputs)):
        lines += [f"  {letter}[{i}]  {name} ({units.get(name.split(' ', 1)[1], 'SI')})" for i, name in enumerate(names)]
    return c_comment(lines)


def _posture_lines(model: FittedRobot) -> list[str]:
    return [f"column {i} of equilibria: {linear.configuration.name}" for i, linear in enumerate(model.linear)]


def _name_and_size(function: ca.Function, i: int, *, is_in: bool) -> str:
    name, size = (function.name_in(i), function.size_in(i)) if is_in else (function.name_out(i), function.size_out(i))
    return f"{name} ({size[0]}{f' x {size[1]}' if size[1] > 1 else ''})"


def _equation(model: FittedRobot) -> str:
    right_side = " + Phi(q)^T lambda = B u, phi(q) = 0" if model.model.n_c else " = B u"
    return f"{model.name}: M(q) q'' + f(q, q'){right_side}"


def _write_coordinates(folder: Path, model: FittedRobot) -> Path:
    """Write coordinates.txt: the names of the entries of q and u, and the intervals of the parameters."""
    path, lines = folder / "coordinates.txt", [f"{_equation(model)}, link side, SI"]
    for letter, names in (("q", model.model.coordinates), ("u", model.model.inputs)):
        lines += [f"{letter}[{i}]  {name}" for i, name in enumerate(names)]
    write_text(
        path, "".join(f"{one_line(line)}\n" for line in (*lines, *_posture_lines(model), *interval_lines(model)))
    )
    return path


TARGETS = (
    Target("casadi", ("model",), "nonlinear equations as CasADi functions, with intervals", write_casadi),
    Target("c", ("model",), "nonlinear equations in C, with intervals", write_c),
)
