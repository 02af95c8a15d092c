"""The friction of a simulated robot, at the conditions at which the identified numbers stand."""

from __future__ import annotations

import math

import numpy as np

from elastid.friction_fit.static_law import StaticLaw
from elastid.robot import Friction, Robot
from elastid.robot.friction_numbers import TERMS, friction_numbers, law_of


def true_numbers(robot: Robot, joint: str, static: StaticLaw | None = None) -> dict[str, float]:
    """Numbers of a joint by name, link side, SI; empty for one without friction.

    static: the law that they are compared with. Its numbers stand at the mean temperature of its levels, and where it
    has no part for the load, under the mean load of these.
    """
    law, known = law_of(robot, joint), friction_numbers(robot)
    if law is None:
        return {}
    paths = {path: known[term.name(joint)][0] for path, term in TERMS.items() if term.name(joint) in known}
    if static is not None:
        paths |= _at_temperature(law, paths, static)
        paths |= _under_load(law, paths, static)
    return {TERMS[path].name(joint): value for path, value in paths.items()}


def _at_temperature(law: Friction, paths: dict[str, float], static: StaticLaw) -> dict[str, float]:
    """Numbers that change with temperature, at that of the levels: F_s + a dT, nu_s + b dT, f + f_T (e^-dT/T_V - 1)."""
    warm, known = law.temperature, np.isfinite(static.levels.temperature)
    if warm is None or not known.any():
        return {}
    rise = float(np.mean(static.levels.temperature[known])) - warm.reference
    fading = math.exp(-rise / warm.decay)
    found = {
        "viscous": paths["viscous"] + warm.viscous * (fading - 1),
        "temperature.viscous": warm.viscous * fading,
    }
    for name, slope in (("stiction", warm.stiction), ("stribeck_velocity", warm.stribeck_velocity)):
        if name in paths:
            found[name] = paths[name] + slope * rise
    return found


def _under_load(law: Friction, paths: dict[str, float], static: StaticLaw) -> dict[str, float]:
    """Coulomb friction and stiction with what the mean load adds, where the law has no part for the load."""
    if law.load is None or "load.coulomb" in static.names:
        return {}
    load = float(np.mean(static.levels.load))
    by_load = {"coulomb": law.load.coulomb, "stiction": law.load.of_stiction}
    return {name: paths[name] + slope * load for name, slope in by_load.items() if name in paths}
