"""Which parameters are identified: the robot's numbers under the `fit.parameters` of a study.

Stiffness, damping, friction, inertia and mass are logarithmic; centres of mass, products of inertia and the delay are
linear. What a study does not name keeps the robot's number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

from elastid.errors import StudyError
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.linear_model import DELAY
from elastid.names import did_you_mean
from elastid.parameters import Parameter, ParameterSet, Prior
from elastid.robot import Robot

# Default bounds: a logarithmic parameter within this factor of its start, the delay in s. Friction may end higher:
# Coulomb friction looks viscous to a multisine, the more the slower it slides, by far more than a data sheet's number.
REACH = 100.0
REACH_OF_FRICTION = 1e4
DELAY_BOUNDS = (0.0, 0.01)


def choose(spec: FitSpec, robot: Robot, configurations: Sequence[str] = ()) -> ParameterSet:
    """All numbers of the robot and the torque delay, those that the study names free, tied or fixed elsewhere.

    A key of spec.parameters is a name or a pattern (`k_*`); a name wins over patterns, a later pattern over an earlier.
    Without keys: every stiffness, and every damping and motor friction that is not zero.
    Raises StudyError for unknown names, a zero start of a logarithmic parameter, bounds that exclude the start, and
    where nothing is free.
    """
    table = robot.parameters() | {DELAY: (0.0, "s")}
    wanted = _match(spec.parameters, table) if spec.parameters else _default(robot)
    linear = _linear_names(robot)
    chosen = tuple(
        _parameter(name, value, unit, wanted[name], name not in linear)
        if name in wanted
        else Parameter(name, value, unit, log=name not in linear, free=False)
        for name, (value, unit) in table.items()
    )
    try:
        parameters = ParameterSet(chosen)
    except ValueError as error:
        raise StudyError(f"fit.parameters: {error}") from None
    if not parameters.free:
        raise StudyError("fit.parameters: nothing is left to identify, every parameter is fixed or tied")
    return parameters


def _match(given: Mapping[str, ParameterSpec], table: Mapping[str, object]) -> dict[str, ParameterSpec]:
    """What the study says about each name that it names."""
    matched: dict[str, ParameterSpec] = {}
    for key, wish in given.items():
        names = [name for name in table if fnmatchcase(name, key)]
        if not names:
            raise StudyError(f"fit.parameters: the robot has no parameter {key}; {did_you_mean(key, list(table))}")
        matched |= dict.fromkeys(names, wish)
    return matched | {key: wish for key, wish in given.items() if key in table}


def _default(robot: Robot) -> dict[str, ParameterSpec]:
    """Every stiffness, and every damping of a spring and friction of a motor that is not zero."""
    names = []
    for joint in robot.joints:
        if joint.spring is not None:
            names.append(f"k_{joint.name}")
        if joint.spring is not None and joint.spring.damping > 0:
            names.append(f"d_{joint.name}")
        if joint.motor is not None and joint.motor.viscous > 0:
            names.append(f"fm_{joint.name}")
    return {name: ParameterSpec() for name in names}


def _linear_names(robot: Robot) -> set[str]:
    """Those that may be zero or negative."""
    names = {DELAY}
    for body in robot.bodies:
        names |= {f"c_{body.name}_{axis}" for axis in "xyz"}
        names |= {f"I_{body.name}{entry}" for entry in body.inertia_entries if entry in ("_xy", "_xz", "_yz")}
    return names


def _parameter(name: str, value: float, unit: str, wish: ParameterSpec, log: bool) -> Parameter:
    where = f"fit.parameters.{name}"
    if wish.tie is not None:
        return Parameter(name, value, unit, log=log, tie=wish.tie.tie)
    start = value if wish.start is None else float(wish.start)
    if wish.fixed:
        return Parameter(name, start, unit, log=log, free=False)
    if log and not start > 0:
        raise StudyError(
            f"{where}: it is found as a factor of its start, and the start is {start:g} {unit}; "
            f"give a positive one, for example {{start: 1 {unit}}}"
        )
    prior = None if wish.prior is None else Prior(float(wish.prior.mean), wish.prior.std)
    if prior is not None and log and not prior.mean > 0:
        raise StudyError(f"{where}.prior: the mean {prior.mean:g} {unit} must be positive")
    lower, upper = _bounds(name, start, wish, log)
    try:
        return Parameter(name, start, unit, lower, upper, log, prior=prior)
    except ValueError as error:
        raise StudyError(f"fit.parameters: {error}") from None


def _bounds(name: str, start: float, wish: ParameterSpec, log: bool) -> tuple[float, float]:
    if wish.bounds is not None:
        return float(wish.bounds[0]), float(wish.bounds[1])
    if log:
        return start / REACH, start * (REACH_OF_FRICTION if name.startswith(("f_", "fm_")) else REACH)
    return DELAY_BOUNDS if name == DELAY else (-math.inf, math.inf)
