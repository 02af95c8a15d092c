"""Presliding friction found in responses: a spring that relaxes at each motor, freed where V falls by more than chance.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.assembly import Assembly
from elastid.linear.linear_model import DELAY
from elastid.linear.presliding import RelaxingSpring
from elastid.parameters import Parameter, Parameters, Prior, Tie

# Std of the logarithms of a stiffness and of a rate about their starts.
STIFFNESS_STD, RATE_STD = 3.0, 1.0


def relaxation(joint: str) -> str:
    """Name of the relaxation time 1 / a of a motor's friction, s."""
    return f"relaxation_{joint}"


def with_presliding(
    assembly: Assembly, springs: Mapping[RelaxingSpring, tuple[float, float]], band: tuple[float, float]
) -> Assembly:
    """Assembly with springs at motors that start at s, N m/rad, and a, 1/s; band: of a."""
    numbers: list[Parameter] = []
    times: list[Parameter] = []
    low, high = 1 / band[1], 1 / band[0]
    for spring, (s, a) in springs.items():
        (stiffness, damping), time = spring.names, relaxation(spring.joint)
        wide = Prior(s, STIFFNESS_STD)
        numbers += [
            Parameter(stiffness, s, "N*m/rad", 1e-4 * s, 1e4 * s, log=True, prior=wide, is_nuisance=True),
            Parameter(damping, s / a, "N*m*s/rad", log=True, tie=Tie(stiffness, 1.0, time)),
        ]
        middle = Prior(math.sqrt(low * high), RATE_STD)
        times.append(Parameter(time, 1 / a, "s", low, high, log=True, prior=middle, ratio=True, is_nuisance=True))
    every = assembly.parameters.parameters
    at = [p.name for p in every].index(DELAY)
    linearisation = replace(assembly.linearisation, presliding=tuple(springs))
    parameters = Parameters((*every[:at], *numbers, *every[at:], *times))
    return replace(assembly, parameters=parameters, linearisation=linearisation)


def start_of(parameters: Parameters, known: Parameters, x: FloatArray) -> FloatArray:
    """x (n_x,) of parameters, those of `known` as in x."""
    values = dict(zip(known.free_names, x.tolist(), strict=True))
    return np.array([values.get(p.name, p.to_x(p.value)) for p in parameters.free])
