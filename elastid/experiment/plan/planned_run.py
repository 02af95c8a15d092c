"""A record against the plan that it was measured by: excitation, posture, signals, payload.

The plan was rehearsed on the robot as it is known so far, which may be off by a third in its stiffnesses: signals are
compared by the correlation of their mean periods over the excited lines, means by what hold the robot up.
"""

import numpy as np

from elastid.base.arrays import FloatArray, fold_periods
from elastid.base.display import number
from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.reference_trajectory import Rehearsal
from elastid.record import Record

# Limits for contradictions between a record and its plan.
SAME_EXCITATION = 0.98  # correlation of the injected torque with the plan
LATE_S = 0.02  # by which a log may begin before or after the plan
EXCITATION_GAIN = 1.02  # ratio of the injected torque to the planned one, to either side
POSTURE_ERROR = 0.01  # rad or m, of the mean position
MAX_MIRROR_CORRELATION = -0.5  # correlation of a signal with the rehearsal, at least
UNIT_RATIO = 3.0  # ratio of a signal's size to the expected one, to either side
HOLDING_ERROR = 0.12  # relative error of a holding torque; masses of files are off by 3 to 5 %


def contradiction(record: Record, plan: Plan, rehearsal: Rehearsal, coulomb: FloatArray, has_carrier: bool) -> str:
    """Return contradiction between a record and its plan as a sentence; an empty text without one.

    coulomb (n_u,): friction of the motors, as known.  The record has the positions of all motors.
    """
    assert record.r is not None
    r_plan, columns = plan.torque(rehearsal.experiment), [record.outputs.index(at) for at in record.inputs]
    N = plan.period_samples
    r, u, y = (mean_period(x, N) for x in (record.r, record.u, record.y[:, columns]))
    position, torque = (mean_period(x[plan.measured], N) for x in (rehearsal.position, rehearsal.torque))
    spectrum = np.sum(np.fft.rfft(r, axis=0) * np.fft.rfft(r_plan, axis=0).conj(), axis=1)
    lag = int(np.argmax(np.fft.irfft(spectrum, len(r))))  # a start that all signals share is no contradiction
    late_s, none = min(lag, len(r) - lag) / plan.rate_hz, np.full(r.shape[1], np.inf)
    same, size = SAME_EXCITATION, EXCITATION_GAIN
    text = _first_inconsistent_motor(plan, "injected torque (r)", np.roll(r, -lag, axis=0), r_plan, same, size, none)
    if not text and late_s > LATE_S:
        return f"its excitation is shifted by {late_s:.3g} s relative to the plan. Log from the first sample of the run"
    same, size, posture = MAX_MIRROR_CORRELATION, UNIT_RATIO, np.full(len(none), POSTURE_ERROR)
    # Under a carrier friction changes sign and cancels; at rest it holds a part of the weight.
    friction, mean_torque = coulomb * (0.2 if has_carrier else 1.2), np.abs(torque.mean(axis=0))
    planned_rms = np.sqrt(np.mean(r_plan**2, axis=0))
    holding = HOLDING_ERROR * np.maximum(mean_torque, 0.25 * mean_torque.max()) + friction + 0.1 * planned_rms
    return (
        text
        or _first_inconsistent_motor(plan, "position (y)", y, position, same, size, posture)
        or _first_inconsistent_motor(plan, "acting torque (u)", u, torque, same, size, holding)
    )


def _first_inconsistent_motor(
    plan: Plan, noun: str, signal: FloatArray, planned_signal: FloatArray, min_rho: float, max_gain: float,
    max_error: FloatArray,
) -> str:  # fmt: skip
    """Find the first motor whose mean period does not follow the expected one, or has another size or mean."""
    X, X_expected = (np.fft.rfft(x, axis=0)[plan.lines] for x in (signal, planned_signal))
    norms, sizes = np.linalg.norm(X, axis=0), np.linalg.norm(X_expected, axis=0)
    rho, gain = np.real(np.sum(X.conj() * X_expected, axis=0)) / np.maximum(norms * sizes, 1e-300), norms / sizes
    means, expected_means = signal.mean(axis=0), planned_signal.mean(axis=0)
    wrong = (rho < min_rho) | (gain > max_gain) | (gain < 1 / max_gain) | (np.abs(means - expected_means) > max_error)
    for i in np.flatnonzero(wrong)[:1]:
        return (
            f"the {noun} of {plan.inputs[i]} differs from the plan: correlation {rho[i]:.2f}, gain "
            f"{number(float(gain[i]), 3)}, mean {means[i]:.4g} instead of {expected_means[i]:.4g}. Check run, "
            "channels, signs, units, posture and payload"
        )
    return ""


def mean_period(signals: FloatArray, N: int) -> FloatArray:
    """Return the mean (N, c) of the whole periods of signals (n, c)."""
    return np.asarray(fold_periods(signals, N).mean(axis=0))
