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
from elastid.robot import Robot


@dataclass(frozen=True)
class PlanLimits:
    """Limits of what contradicts a plan."""

    same_excitation: float = 0.98  # correlation of the injected torque with the plan
    late_s: float = 0.02  # by which a log may begin before or after the plan
    excitation_gain: float = 1.02  # ratio of the injected torque to the planned one, to either side
    posture: float = 0.01  # rad or m, of the mean position
    mirrored: float = -0.5  # correlation of a signal with the rehearsal, at least
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

    def lines(self, signal: FloatArray) -> ComplexArray:
        """Amplitudes (F, n_u) at the excited lines of the mean measured period of a whole run (n, n_u)."""
        periods = signal[self.plan.measured].reshape(self.plan.periods, self.plan.period_samples, -1)
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
    torque, position, none = run.rehearsal.torque, run.rehearsal.position, np.full(r.shape[1], np.inf)
    return (
        _unlike(run, "injected torque (r)", injected, planned, LIMITS.same_excitation, LIMITS.excitation_gain, none)
        or late
        or _unlike(run, "position (y)", y, position, LIMITS.mirrored, LIMITS.unit, np.full(len(none), LIMITS.posture))
        or _unlike(run, "acting torque (u)", u, torque, LIMITS.mirrored, LIMITS.unit, _holding_errors(run))
    )


def _in_step(plan: Plan, r: FloatArray, planned: FloatArray) -> tuple[str, FloatArray]:
    """Why the injected torque begins at another time than planned, empty where it does not; and it, in step."""
    spectrum = np.fft.rfft(r, 2 * len(r), axis=0) * np.fft.rfft(planned, 2 * len(r), axis=0).conj()
    lag = int(np.argmax(np.fft.irfft(spectrum.sum(axis=1))))
    lag -= 2 * len(r) if lag > len(r) else 0
    late, when = abs(lag) / plan.rate_hz, "before" if lag > 0 else "after"
    text = f"it begins {late:.3g} s {when} the planned run: log from its first sample" if late > LIMITS.late_s else ""
    return text, np.roll(r, -lag, axis=0)


def _unlike(
    run: PlannedRun, what: str, signal: FloatArray, expected: FloatArray, same: float, size: float, offset: FloatArray
) -> str:
    """The first motor whose signal does not follow the expected one, has another size, or a mean off by more."""
    X, planned = run.lines(signal), run.lines(expected)
    norms, sizes = np.linalg.norm(X, axis=0), np.linalg.norm(planned, axis=0)
    rho, gain = np.real(np.sum(X.conj() * planned, axis=0)) / np.maximum(norms * sizes, 1e-300), norms / sizes
    means, wanted = (x[run.plan.measured].mean(axis=0) for x in (signal, expected))
    wrong = (rho < same) | (gain > size) | (gain < 1 / size) | (np.abs(means - wanted) > offset)
    for i in np.flatnonzero(wrong)[:1]:
        return (
            f"the {what} of {run.plan.inputs[i]} is not the planned one: correlation {rho[i]:.2f}, "
            f"{number(float(gain[i]), 3)} times its size, mean {means[i]:.4g} and not {wanted[i]:.4g} (configuration "
            f"{run.experiment.configuration.name}): check that it is this run, channels, signs, units, posture, payload"
        )
    return ""


def _holding_errors(run: PlannedRun) -> FloatArray:
    """Errors (n_u,) of the mean torques that hold up the planned mass."""
    planned = run.rehearsal.torque[run.plan.measured].mean(axis=0)
    # Under a carrier friction changes sign and cancels; at rest it holds a part of the weight.
    friction = coulomb_levels(run.robot) * (0.2 if run.has_carrier else 1.2)
    injected = np.sqrt(np.mean(run.reference.injected(run.plan.torque(run.experiment))[run.plan.measured] ** 2, axis=0))
    weight = np.maximum(np.abs(planned), 0.25 * np.abs(planned).max())
    return np.asarray(LIMITS.holding * weight + friction + 0.1 * injected)
