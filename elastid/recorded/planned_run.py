"""A log against the plan that it was measured by: length, excitation, posture, signals, payload.

The plan was rehearsed on the robot as it is known so far, which may be off by a third in its stiffnesses: signals are
compared by their correlation over the excited lines, means by what hold the robot up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.display import number
from elastid.experiment.plan.movement import Reference, Rehearsal
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.friction.robot_friction import coulomb_levels
from elastid.record import drive_unit
from elastid.robot import Robot


@dataclass(frozen=True)
class PlanLimits:
    """Limits of what contradicts a plan."""

    same_excitation: float = 0.98  # correlation of the injected torque with the plan
    late_s: float = 0.02  # by which a log may begin before or after the plan
    excitation_gain: float = 1.02  # ratio of the injected torque to the planned one, to either side
    posture: float = 0.01  # rad or m, of the mean position
    exchanged: float = 0.7  # correlation with another channel's plan, from which on it is that channel
    exchanged_lead: float = 0.2  # by which it exceeds that with the own plan
    mirrored: float = -0.5
    unit: float = 3.0  # ratio of a signal's size to the expected one, to either side
    holding: float = 0.12  # relative error of a holding torque; masses of files are off by 3 to 5 %


LIMITS = PlanLimits()


@frozen_value
class PlannedRun:
    """A run of a plan: its reference, its rehearsal on the robot as it is known, and that robot, which carries."""

    plan: Plan
    experiment: Experiment
    reference: Reference
    rehearsal: Rehearsal
    robot: Robot
    has_carrier: bool

    @property
    def measured(self) -> slice:
        """Samples of the whole run in the measured periods."""
        first = self.plan.first_sample + self.plan.transient_periods * self.plan.period_samples
        return slice(first, first + self.plan.periods * self.plan.period_samples)

    def lines(self, signal: FloatArray) -> ComplexArray:
        """Amplitudes (F, n_u) at the excited lines of the mean measured period of a whole run (n, n_u)."""
        periods = signal[self.measured].reshape(self.plan.periods, self.plan.period_samples, -1)
        return np.asarray(np.fft.rfft(periods.mean(axis=0), axis=0)[self.plan.lines])


def contradiction(run: PlannedRun, r: FloatArray, u: FloatArray, y: FloatArray) -> str:
    """The contradiction of a log to its plan, in words; an empty text where there is none.

    r, u, y (n, n_u): injected torque, acting torque and position of the motors over the whole run, link side, SI.
    """
    n, hz = run.plan.run_samples, run.plan.rate_hz
    if len(r) != n:
        return (
            f"it has {len(r)} samples, and the planned run has {n} ({n / hz:g} s at {hz:g} Hz, from standstill to "
            "standstill): log each sample of the whole run, and no more"
        )
    missing = [name for name, signal in (("r", r), ("u", u), ("y", y)) if not np.isfinite(signal).all()]
    if missing:
        return f"{missing[0]} has samples that are no finite numbers; measure it again"
    planned = run.reference.injected(run.plan.torque(run.experiment))
    late, injected = _in_step(run.plan, r, planned)
    return (
        _unlike(run, "injected torque (r)", injected, planned, LIMITS.same_excitation, LIMITS.excitation_gain)
        or late
        or _posture(run, y)
        or _unlike(run, "acting torque (u)", u, run.rehearsal.torque, LIMITS.mirrored, LIMITS.unit)
        or _unlike(run, "position (y)", y, run.rehearsal.position, LIMITS.mirrored, LIMITS.unit)
        or _holding_torque(run, u)
    )


def _in_step(plan: Plan, r: FloatArray, planned: FloatArray) -> tuple[str, FloatArray]:
    """Why the injected torque begins at another time than planned, empty where it does not; and it, in step."""
    spectrum = np.fft.rfft(r, 2 * len(r), axis=0) * np.fft.rfft(planned, 2 * len(r), axis=0).conj()
    lag = int(np.argmax(np.fft.irfft(spectrum.sum(axis=1))))
    lag -= 2 * len(r) if lag > len(r) else 0
    late, when = abs(lag) / plan.rate_hz, "before" if lag > 0 else "after"
    text = f"it begins {late:.3g} s {when} the planned run: log from its first sample" if late > LIMITS.late_s else ""
    return text, np.roll(r, -lag, axis=0)


def _unlike(run: PlannedRun, what: str, signal: FloatArray, expected: FloatArray, same: float, size: float) -> str:
    """A channel that fits the plan of another motor, does not follow its own, or has another size."""
    X, planned, names = run.lines(signal), run.lines(expected), run.plan.inputs
    norms, sizes = np.linalg.norm(X, axis=0), np.linalg.norm(planned, axis=0)
    C, gain = np.real(X.conj().T @ planned) / np.maximum(np.outer(norms, sizes), 1e-300), norms / sizes
    for i, place in enumerate(names):
        k = int(np.argmax(np.abs(C[i])))
        if k != i and abs(C[i, k]) > max(LIMITS.exchanged, abs(C[i, i]) + LIMITS.exchanged_lead):
            return f"the {what} of {place} is not the planned one but that of {names[k]}: channels are exchanged"
        if C[i, i] < same:
            return (
                f"the {what} of {place} is not the planned one (correlation {C[i, i]:.2f}): its sign is the other, or "
                "another reference was played"
            )
        if not 1 / size <= gain[i] <= size:
            return (
                f"the {what} of {place} is {number(float(gain[i]), 3)} times the planned one: its unit or its side of "
                "the gear is another"
            )
    return ""


def _posture(run: PlannedRun, y: FloatArray) -> str:
    """Another posture than the planned one."""
    mean, planned = y[run.measured].mean(axis=0), run.rehearsal.position[run.measured].mean(axis=0)
    i = int(np.argmax(np.abs(mean - planned)))
    if abs(mean[i] - planned[i]) <= LIMITS.posture:
        return ""
    joint = run.robot.driven[i]
    return (
        f"it was measured in another posture: joint {joint.name} was at {mean[i]:.4g} {joint.unit}, planned is "
        f"{planned[i]:.4g} {joint.unit} (configuration {run.experiment.configuration.name})"
    )


def _holding_torque(run: PlannedRun, u: FloatArray) -> str:
    """Torques that hold up another mass than the planned one."""
    mean, planned = u[run.measured].mean(axis=0), run.rehearsal.torque[run.measured].mean(axis=0)
    # Under a carrier friction changes sign and cancels; at rest it holds a part of the weight.
    friction = coulomb_levels(run.robot) * (0.2 if run.has_carrier else 1.2)
    injected = np.sqrt(np.mean(run.reference.injected(run.plan.torque(run.experiment))[run.measured] ** 2, axis=0))
    allowed = LIMITS.holding * np.maximum(np.abs(planned), 0.25 * np.abs(planned).max()) + friction + 0.1 * injected
    i = int(np.argmax(np.abs(mean - planned) / allowed))
    if abs(mean[i] - planned[i]) <= allowed[i]:
        return ""
    unit = drive_unit(run.robot.driven[i].slides)
    return (
        f"it carries another payload, or the scale of the torque is another: {run.plan.inputs[i]} holds {mean[i]:.4g} "
        f"{unit}, and {planned[i]:.4g} {unit} are planned"
    )
