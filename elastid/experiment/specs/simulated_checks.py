"""Rules between the `simulated` section, the robot and the excitation, each as the sentence of a refusal."""

from __future__ import annotations

import math

import numpy as np

from elastid.base.arrays import IntArray
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.robot import Robot


def saturation_refusal(robot: Robot) -> str:
    """Why torques of this robot cannot be clipped; empty where they can."""
    if any(math.isfinite(joint.limits.torque) for joint in robot.driven):
        return ""
    return "no joint has limits.torque, so that nothing can be clipped; give limits: {torque: ...} in the robot's file"


def chain_refusal(robot: Robot) -> str:
    """Why a rig that logs positions cannot have the robot's measurement chain; empty where it can."""
    if robot.chain.differentiator is None:
        return ""
    return (
        f"robot {robot.name}: chain.differentiator: the simulated rig logs positions and differentiates nothing; leave "
        "it out of the robot's chain"
    )


def carrier_refusal(carrier: CarrierSpec, lines: IntArray, spacing_hz: float, n_u: int) -> str:
    """A sentence where a periodic carrier is not below all analysed lines, or moves other than n_u motors.

    An empty text where nothing is wrong.  lines: excited and left free for detection.  spacing_hz: 1 / period.
    """
    lowest = int(lines.min())
    if carrier.kind != "offset" and carrier.cycles >= lowest:
        return (
            f"{carrier.cycles} cycles a period are {carrier.cycles * spacing_hz:g} Hz, not below the lowest excited "
            f"frequency of {lowest * spacing_hz:g} Hz; "
            + (f"take at most {lowest - 1} cycles, or raise" if lowest > 1 else "raise")
            + " excitation.band_hz"
        )
    for what, values in (("velocities", carrier.velocity), ("amplitudes", carrier.amplitude)):
        given = np.size(0.0 if values is None else values)
        if given not in (1, n_u):
            return f"{given} {what} for {n_u} motors; give one for all or one for each"
    return ""
