"""Stiffness and damping of the bristles from responses at rest, one for each amplitude of the torque."""

from __future__ import annotations

from dataclasses import dataclass

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.note import Note


@frozen_value
class RestPoint:
    """Spring and damper to ground at one amplitude: torque (peak, Nm), stiffness, damping with their std, SI."""

    torque: float
    stiffness: float
    stiffness_std: float
    damping: float
    damping_std: float


@dataclass(frozen=True)
class AtRest:
    """sigma_0 and sigma_1, extrapolated to no amplitude, with covariance (2, 2); points: of each amplitude.

    falls: whether the stiffness falls with the logarithm of the amplitude, as that of Maxwell slip does.
    """

    sigma_0: float
    sigma_1: float
    covariance: FloatArray
    points: tuple[RestPoint, ...]
    falls: bool = False
    notes: tuple[Note, ...] = ()
