"""elastid: the elasticity of industrial robots, identified from frequency responses with honest intervals.

Five nouns carry it, and a script from logs to stiffness needs no other name (`elastid.nouns`):

- Robot       bodies, joints, springs, motors, loops                     Robot.read("robot.yml")
- Record      sampled signals of one experiment                          Record.read(robot, ...)
- Response    G (F, n_y, n_u) of one configuration, with covariance      Response.estimate(records)
- Parameters  numbers of a robot: units, bounds, priors, which are free  Parameters.choose(robot, "k_*")
- Result      estimates with intervals, covariance, status               Result.fit(responses, robot, parameters)

Two wings end in the same value, FrequencyResponse, and meet in the fit:

     measured wing:  excitation -> experiment -> record -> frf -----.
                                       ^                            v
     one bridge:            experiment/simulated                   fit -> validation -> report, export
                                       ^                            ^
     model wing:     robot -> model -> simulation                   |
                                `----> linear ----------------------'----> use

Floors, from the top; a room imports from the floors below it only:

- app           command line, table of stages, runs: file -> value -> file
- nouns         the five nouns with their constructors
- export study  models for other tools; YAML -> values, with file, line and column of every error
- report store  page and figures; HDF5
- design nonlinear recorded use validation  plans within limits; friction out of records; logs -> records; maps of the
  workspace and draws of robots; agreement
- friction_study               levels, laws, presliding and warm-up of friction; an extended Kalman filter follows it
- experiment fit modal         plan and simulated rig; weights, least squares, solvers, diagnosis; modes of a structure
- frf linear simulation        estimators; linearised robot and its responses; closed loop in time
- friction model response      laws; equations of motion in CasADi; FrequencyResponse
- excitation parameters robot   multisines; names and vectors; bodies, joints, springs, motors
- record        sampled signals
- base          arrays, units, errors, notes, execution

The names below are those that a notebook needs, in the order of the work; they are loaded when they are first used.
"""

from __future__ import annotations

# Nothing is imported here: the program's first lines (`elastid.__main__`) come after this file.
__version__ = "0.2.0"

_HOMES: dict[str, str] = {}  # the module of each public name, once one is used


def _homes() -> dict[str, str]:
    """The module of each public name, as `__init__.pyi` has them for editors and type checkers."""
    if not _HOMES:
        import ast
        from importlib.resources import files

        for node in ast.parse((files("elastid") / "__init__.pyi").read_text("utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                _HOMES.update((alias.name, f"{node.module}") for alias in node.names)
    return _HOMES


def __getattr__(name: str) -> object:
    """Load a public name from its module when it is first used; CasADi and SciPy wait until then."""
    from importlib import import_module

    if name == "__all__":
        return [*_homes()]
    if name == "plot":
        return import_module("elastid.plot")
    if name not in _homes():
        raise AttributeError(f"module 'elastid' has no attribute '{name}'")
    return getattr(import_module(_homes()[name]), name)


def __dir__() -> list[str]:
    """The public names, whether they have been used or not."""
    return sorted({*_homes(), "__all__", "__version__"})
