r"""Export of the nonlinear equations: CasADi functions in one file each, and C code without dependencies.

.. math:: M(q)\, \ddot q + f(q, \dot q) + \Phi^T \lambda = B u, \qquad \varphi(q) = 0

with the fitted numbers inserted. Conventions of sign and side: `elastid.model.elastic`.
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca

from elastid.fit.fitted_model import FittedModel
from elastid.store import replacing, text_file


def functions(model: FittedModel) -> tuple[ca.Function, ...]:
    """mass(q) -> M, force(q, v) -> f, damping(q) -> D, stiffness(q) -> K, input_matrix() -> B, at the fitted numbers.

    damping and stiffness are the Hessians of dissipation and potential: the linear model at an equilibrium q. Where
    loops are closed by constraints, also constraint(q) -> phi and constraint_jacobian(q) -> Phi, and stiffness(q,
    lambda_) is the Hessian of V + lambda^T phi.
    """
    m, theta = model.model, model.theta[:-1]
    q, v, multipliers = ca.SX.sym("q", m.n_q), ca.SX.sym("v", m.n_q), ca.SX.sym("lambda_", m.n_c)
    given = {"q": q, "v": v, "lambda_": multipliers}

    def function(name: str, inputs: tuple[str, ...], output: str, value: ca.SX) -> ca.Function:
        return ca.Function(name, [given[each] for each in inputs], [value], list(inputs), [output], {"cse": True})

    closing = (
        function("constraint", ("q",), "phi", m.constraint(q, theta)),
        function("constraint_jacobian", ("q",), "Phi", m.constraint_jacobian(q, theta)),
    )
    return (
        function("mass", ("q",), "M", m.mass(q, theta)),
        function("force", ("q", "v"), "f", m.force(q, v, theta)),
        function("damping", ("q",), "D", m.damping(q, theta)),
        function("stiffness", ("q", "lambda_") if m.n_c else ("q",), "K", m.stiffness(q, multipliers, theta)),
        function("input_matrix", (), "B", ca.SX(ca.DM(m.B))),
        *(closing if m.n_c else ()),
    )


def write_casadi(folder: Path, model: FittedModel) -> tuple[Path, ...]:
    """mass.casadi, force.casadi, damping.casadi, stiffness.casadi, input_matrix.casadi for casadi.Function.load."""
    paths = []
    for function in functions(model):
        path = folder / f"{function.name()}.casadi"
        with replacing(path) as temporary:
            function.save(str(temporary))
        paths.append(path)
    return (*paths, _coordinates(folder, model))


def write_c(folder: Path, model: FittedModel) -> tuple[Path, ...]:
    """robot.c and robot.h: the same functions, each `int mass(const double** arg, double** res, ...)`.

    Matrices are dense, column by column. Compile with `cc -O2 -shared -fPIC robot.c -lm`.
    """
    generator = ca.CodeGenerator("robot.c", {"with_header": True})
    for function in functions(model):
        dense = [ca.densify(part) for part in function.call(function.sx_in())]
        generator.add(
            ca.Function(
                function.name(), function.sx_in(), dense, function.name_in(), function.name_out(), {"cse": True}
            )
        )
    folder.mkdir(parents=True, exist_ok=True)
    generator.generate(f"{folder}/")
    return folder / "robot.c", folder / "robot.h", _coordinates(folder, model)


def _coordinates(folder: Path, model: FittedModel) -> Path:
    """coordinates.txt: the names of the entries of q and u."""
    path = folder / "coordinates.txt"
    equation = "M(q) q'' + f(q, q')" + (" + Phi(q)^T lambda = B u, phi(q) = 0" if model.model.n_c else " = B u")
    with text_file(path) as file:
        file.write(f"{model.name}: {equation}, link side, SI\n")
        for letter, names in (("q", model.model.coordinates), ("u", model.model.inputs)):
            file.writelines(f"{letter}[{i}]  {name}\n" for i, name in enumerate(names))
    return path
