"""Notes about a simulated run: torques clipped, limits exceeded, loops opened, friction extrapolated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.base.units import of_translation
from elastid.experiment.plan.plan import Experiment
from elastid.experiment.simulated.plant import Plant
from elastid.model.elastic import ElasticModel
from elastid.robot import Robot
from elastid.simulation.baumgarte import violation
from elastid.simulation.closed_loop import Trajectory
from elastid.simulation.dynamics import Contacts

# Limits of the notes about a simulated run. False-alarm rates: not measured, the signals have no noise.
MAX_VIOLATION_M = 1e-6  # between the ends of a loop
MAX_CLIPPED_SHARE = 0.5  # of the measured samples, beyond which a motor cannot control the robot


def clipped(u: FloatArray, plant: Plant, experiment: Experiment) -> tuple[Note, ...]:
    """A note for every motor whose measured torque u (n, n_u) was clipped; DataError where most of it was."""
    part = np.mean(np.abs(u) >= plant.loop.drives.torque, axis=0)
    notes = []
    for name, share, limit in zip(plant.model.inputs, part.tolist(), plant.loop.drives.torque.tolist(), strict=True):
        unit = "N" if plant.model.robot.slides(name) else "N*m"
        if share > MAX_CLIPPED_SHARE:
            raise DataError(
                f"configuration {experiment.configuration.name}, realisation {experiment.realisation}, experiment "
                f"{experiment.experiment}: {name} is at its torque limit of {limit:.4g} {unit} in {share:.0%} of the "
                "measured samples and cannot control the robot; lower excitation.torque_rms, choose a configuration "
                "with less gravity torque, or correct limits.torque"
            )
        if share > 0:
            text = (
                f"clipped at its torque limit of {limit:.4g} {unit} in {max(share, 1e-4):.2%} of the measured samples: "
                "the response is no longer linear; lower excitation.torque_rms"
            )
            notes.append(Note("clipped-torque", text, f"{experiment.name}, {name}"))
    return tuple(notes)


def torque_notes(u: FloatArray, plant: Plant, index: int, motion: str) -> tuple[Note, ...]:
    """A note where the torque u (n,) of the motor that a friction study moves was clipped, or beyond its limit."""
    joint, drive = plant.model.robot.driven[index], float(plant.loop.drives.torque[index])
    unit, peak, limit = "N" if joint.slides else "N*m", float(np.abs(u).max()), joint.limits.torque
    if peak >= drive:
        share = float(np.mean(np.abs(u) >= drive))
        text = (
            f"clipped at its torque limit of {drive:.4g} {unit} in {max(share, 1e-4):.2%} of the samples: its level is "
            "not that of friction; lower the highest speed, or choose a posture with less gravity torque"
        )
        return (Note("clipped-torque", text, f"{motion}, motor {joint.name}"),)
    if peak > limit:
        text = f"went to {peak:.4g} {unit}, beyond its limit of {limit:.4g} {unit}; lower the highest speed"
        return (Note("beyond-limit", text, f"{motion}, motor {joint.name}"),)
    return ()


def opened(model: ElasticModel, trajectory: Trajectory) -> tuple[Note, ...]:
    """A note where the loops did not stay closed."""
    left = violation(model, trajectory.q)
    if left <= MAX_VIOLATION_M:
        return ()
    text = f"the loops of robot {model.robot.name} opened by up to {left:.2g} m in the simulation; raise "
    return (Note("loops-opened", text + "experiment.simulated.substeps"),)


def extrapolated(
    contacts: Contacts, q: FloatArray, rate_hz: float, loads: Sequence[float], temperatures: Sequence[float]
) -> tuple[Note, ...]:
    """A note for every friction law that a run q (n, n_q) takes beyond the range in which its numbers were measured.

    loads: of each law in Nm, link side.  temperatures: degC that the run has, none where it has no temperature.
    """
    fastest = np.abs(np.diff(q @ contacts.P, axis=0)).max(axis=0, initial=0.0) * rate_hz
    notes = []
    for law, speed, load in zip(contacts.laws, fastest.tolist(), loads, strict=True):
        measured = law.spec.measured
        if measured is None:
            continue
        torque, velocity = ("N", "m/s") if law.slides else ("N*m", "rad/s")
        # A reversing motion passes every lower speed.
        slowest = max(0.0, measured.speed[0]) if measured.speed is not None else 0.0
        ranges = [
            ("speed", slowest, max(slowest, speed * law.scale), velocity),
            ("load", abs(load) / law.scale, abs(load) / law.scale, torque),
        ]
        if temperatures:
            ranges.append(("temperature", min(temperatures), max(temperatures), "degC"))
        for name, lowest, highest, unit in ranges:
            if measured.beyond(name, lowest, highest):
                ends = getattr(measured, name)
                reached = lowest if lowest < ends[0] else highest
                text = (
                    f"its friction was measured at a {name} of {ends[0]:.4g} to {ends[1]:.4g} {unit}, and the run goes "
                    f"to {reached:.4g} {unit}: the law is extrapolated; stay inside, or measure there"
                )
                notes.append(Note("friction-extrapolated", text, law.place))
    return tuple(notes)


def exceeded(robot: Robot, trajectory: Trajectory, B: FloatArray, rate_hz: float) -> tuple[Note, ...]:
    """A note for every motor that went beyond its limits; the simulation does not clip."""
    velocity = np.diff(trajectory.q @ B, axis=0) * rate_hz
    torque, speed = np.abs(trajectory.u).max(axis=0), np.abs(velocity).max(axis=0)
    acceleration = np.abs(np.diff(velocity, axis=0)).max(axis=0) * rate_hz
    notes = []
    for joint, *peaks in zip(robot.driven, torque, speed, acceleration, strict=True):
        limits = joint.limits.torque, joint.limits.velocity, joint.limits.acceleration
        for peak, limit, turning in zip(peaks, limits, ("N*m", "rad/s", "rad/s^2"), strict=True):
            unit = of_translation(turning) if joint.slides else turning
            if peak > limit:
                text = f"went to {peak:.4g} {unit}, beyond its limit of {limit:.4g} {unit}; lower excitation.torque_rms"
                notes.append(Note("beyond-limit", text, f"motor {joint.name}"))
    return tuple(notes)
