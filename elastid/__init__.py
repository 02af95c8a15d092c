"""elastid: the elasticity of industrial robots, identified from frequency responses with honest intervals.

Five nouns carry it; plain functions lead from one to the next, and a script from logs to stiffness needs no other name:

- Robot       bodies, joints, springs, motors, loops                     read_robot("robot.yml")
- Record      sampled signals of one experiment                          read_records(robot, ...)
- Response    G (F, n_y, n_u) of one configuration, with covariance      estimate(records, robot)
- Parameters  numbers of a robot: units, bounds, priors, which are free  choose(robot, "k_*")
- Result      estimates with intervals, covariance, status               identify(responses, robot, parameters)

`run`, `export` and `compare` do what the commands of these names do; `load` and `save` read and write a run's files.

Two wings end in the same value, Response, and meet in the fit:

     measured wing:  excitation -> experiment -> record -> frf -----.
                                       ^                            v
     one bridge:            experiment/simulated                   fit -> validation -> report, export
                                       ^                            ^
     model wing:     robot -> model -> simulation                   |
                                `----> linear ----------------------'----> use

Floors, from the top; a room imports from the floors below it only:

- app           command line, table of stages, runs: file -> value -> file
- api           functions from noun to noun
- targets study models for other tools; YAML -> values, with file, line and column of every error
- report store  page and figures; HDF5
- design nonlinear logs use validation  plans within limits; friction compensation; logs -> records; workspace maps and
  posterior samples; comparison with measurements
- friction_study               levels, laws, presliding and warm-up of friction; an extended Kalman filter follows it
- experiment fit modal         plan and simulated rig; weights, least squares, solvers, diagnosis; modes of a structure
- frf linear simulation        estimators; linearised robot and its responses; closed loop in time
- friction model response      laws; equations of motion in CasADi; Response
- excitation parameters robot   multisines; names and vectors; bodies, joints, springs, motors
- record        sampled signals
- base          arrays, units, errors, notes, execution

The names below are loaded when they are first used; all others live in their rooms.
"""

# Nothing is imported here: the program's first lines (`elastid.__main__`) come after this file.
__version__ = "0.3.0"

_NAMES = {
    "elastid.robot": "Robot Body Joint Spring Motor",
    "elastid.record": "Record Configuration",
    "elastid.response": "Response",
    "elastid.parameters": "Parameters",
    "elastid.fit.result": "Result",
    "elastid.api": "read_robot read_records simulate choose estimate identify load save",
    "elastid.app.finished_run": "run export compare",
    "elastid.plot": "plot",
}
# The module of each public name.
_HOMES = {name: module for module, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> object:
    """Load a public name from its module when it is first used; CasADi and SciPy wait until then."""
    from importlib import import_module

    if name == "__all__":
        return [*_HOMES]
    if name not in _HOMES:
        raise AttributeError(f"module 'elastid' has no attribute '{name}'")
    module = import_module(_HOMES[name])
    return module if name == "plot" else getattr(module, name)


def __dir__() -> list[str]:
    """The public names, whether they have been used or not."""
    return sorted({*_HOMES, "__all__", "__version__"})
