r"""Amplitudes within the robot's limits, scaled by linear prediction and checked by simulation of the nonlinear model.

.. math:: |x_{movement}| + |x_{multisine}| \le (1 - margin)\, limit, \qquad
          x = torque, position, velocity, acceleration

A simulation without multisine gives the peaks of the movement (holding torque, friction, carrier, ramps). The linear
response of the closed loop gives the peaks of the multisine. Runs near a limit, at least the nearest run, are then
simulated completely with the nominal robot, friction and noise. The configuration is scaled again until all peaks are
within the limits.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable
from elastid.base.errors import DataError, Note, StudyError
from elastid.base.execution import Execution
from elastid.design.limit_use import QUANTITIES, LimitUse, unit_of
from elastid.excitation.phases import peaks as signal_peaks
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import Experiment, Plan, torque_rms
from elastid.experiment.plan.reference_trajectory import Rehearsal, reference, references
from elastid.experiment.simulated.plant import closed_loop_of, feed_forward_of, model_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.record import Configuration


def limits_of(rig: SimulatedRig, configuration: Configuration) -> FloatArray:
    """Return the limits (8, n_u) of QUANTITIES in a configuration."""
    limits, carrier = [joint.limits for joint in rig.robot.driven], rig.simulated.carrier
    distance = [min(x.angle[1] - q, q - x.angle[0]) for x, q in zip(limits, configuration.angles, strict=True)]
    v = np.full(len(limits), np.inf)
    if carrier is not None and carrier.kind == "offset":
        v = np.abs(carrier.velocities(len(limits)))
    motion = [distance, [x.velocity for x in limits], [x.acceleration for x in limits]]
    of_reference = np.full((3, len(limits)), np.inf) if rig.plan.inject == "torque" else motion
    return np.array([[x.torque for x in limits], *motion, v, *of_reference])


def expected_peaks(rig: SimulatedRig, factor: FloatArray, base: FloatArray, q: int) -> dict[str, FloatArray]:
    """Predict the peaks (8, n_u) of every run of the q-th configuration by linear superposition on `base` (8, n_u).

    factor (Q, n_u): on the amplitudes of the plan.
    """
    plan, response, peaks = rig.plan, _response(rig, q), {}
    for run in plan.experiments:
        if run.configuration.name == plan.configurations[q].name:
            S = np.einsum("fckoi,fi->ckof", response, plan.R[q, run.realisation, run.experiment] * factor[q])
            peaks[run.name] = base + _by_quantity(signal_peaks(plan.lines, S, 4), base)
    return peaks


def _by_quantity(largest: FloatArray, like: FloatArray) -> FloatArray:
    """Return the values (8, n_u) of QUANTITIES from signals (C, K, n_u) of `_response`; turning back is velocity."""
    peak: FloatArray = largest.max(axis=0)
    return np.concatenate([peak[:4], peak[2:3], peak[4:], np.zeros((7 - len(peak), like.shape[1]))])


def largest_peaks(plan: Plan, runs: Mapping[str, FloatArray]) -> FloatArray:
    """Return the largest peaks (Q, 8, n_u) of all runs in each configuration."""
    return np.array([
        np.max([runs[e.name] for e in plan.experiments if e.configuration.name == c.name], axis=0)
        for c in plan.configurations
    ])  # fmt: skip


def peaks_of_movement(rig: SimulatedRig, experiment: Experiment) -> FloatArray:
    """Return the peaks (8, n_u) without multisine, by the rigid robot without friction if there is no limit.

    StudyError if a motor leaves its configuration.
    """
    if not np.isfinite(limits_of(rig, experiment.configuration)).any():
        return _rigid_peaks(rig, experiment)
    try:
        return peaks_of_run(rig, rig.rehearse(experiment, 0.0))
    except DataError as error:
        raise StudyError("design/limits", f"the robot leaves its configuration without excitation: {error}") from None


def _rigid_peaks(rig: SimulatedRig, experiment: Experiment) -> FloatArray:
    """Return the peaks (8, n_u) of the movement of the rigid robot without friction."""
    torque, configuration = feed_forward_of(model_of(rig.robot)), experiment.configuration
    path = reference(rig.plan, rig.simulated.carrier, torque, configuration)
    motion = path.position - configuration.angles, path.velocity, path.acceleration
    peaks = _reference_peaks(rig, configuration, references(rig.plan, rig.simulated.carrier, experiment, 0.0))
    return np.array([*np.abs([path.feed_forward, *motion, 0 * path.position]).max(axis=1), *peaks])


def _reference_peaks(rig: SimulatedRig, configuration: Configuration, rows: FloatArray) -> FloatArray:
    """Return the peaks (3, n_u) of position, velocity and acceleration of references (m, n_u); 0 without any."""
    rate_hz, x = rig.plan.rate_hz / rig.plan.cycle_samples, rows - configuration.angles
    if rig.plan.inject == "velocity":
        x = np.cumsum(rows, axis=0) / rate_hz
    v = np.diff(x, axis=0) * rate_hz
    return np.array([np.abs(signal).max(axis=0, initial=0.0) for signal in (x, v, np.diff(v, axis=0) * rate_hz)])


def expected_use(rig: SimulatedRig, margin: float) -> LimitUse:
    """Predict the use of the limits by superposition on the movement of the rigid robot without friction."""
    plan, (limit, experiments) = rig.plan, _limits_and_experiments(rig)
    names, factor = tuple(c.name for c in plan.configurations), np.ones((len(plan.configurations), len(plan.inputs)))
    runs: dict[str, FloatArray] = {}
    for q, experiment in enumerate(experiments):
        runs |= expected_peaks(rig, factor, _rigid_peaks(rig, experiment), q)
    return LimitUse(names, plan.inputs, largest_peaks(plan, runs), limit, factor, margin, (), plan.sliding)


def _limits_and_experiments(rig: SimulatedRig) -> tuple[FloatArray, list[Experiment]]:
    """Return limits (Q, 8, n_u), and the first experiment of each configuration."""
    first = {e.configuration.name: e for e in reversed(rig.plan.experiments)}
    limit = np.array([limits_of(rig, c) for c in rig.plan.configurations])
    return limit, [first[c.name] for c in rig.plan.configurations]


def peaks_of_run(rig: SimulatedRig, rehearsal: Rehearsal) -> FloatArray:
    """Return the peaks (8, n_u) of a simulated run."""
    signals, carrier = rehearsal.signals, rig.simulated.carrier
    turning_back = np.zeros(len(rig.plan.inputs))
    if carrier is not None and carrier.kind == "offset":
        v = carrier.velocities(len(turning_back))
        turning_back = np.maximum(0.0, np.abs(v) - (np.sign(v) * signals[2, rig.plan.measured]).min(axis=0))
    peaks = _reference_peaks(rig, rehearsal.experiment.configuration, rehearsal.references)
    return np.array([*np.abs(signals).max(axis=1), turning_back, *peaks])


def _peaks_of(rig: SimulatedRig, experiment: Experiment) -> FloatArray:
    """Return the peaks (8, n_u) of a run, for references also with the largest gains; 2 limits if it diverges."""
    rigs = [rig] if rig.plan.inject == "torque" else [rig, rig.with_gains(1 + GAIN_ERROR, 1 + GAIN_ERROR)]
    try:
        return np.asarray(np.max([peaks_of_run(variant, variant.rehearse(experiment)) for variant in rigs], axis=0))
    except DataError:
        limit = limits_of(rig, experiment.configuration)
        return np.where(np.isfinite(limit), 2 * limit, 0.0)


# Relative error of K_p and K_v of the drives with which references must be within the limits.
GAIN_ERROR = 0.3
GAINS = [*product((1.0, 1 + GAIN_ERROR, 1 - GAIN_ERROR), repeat=2)]
MAX_RANGE_FRACTION = 0.98  # of the margin that a rescaled configuration uses
# Predicted fraction of a limit above which a run is simulated. Peaks of random robots exceeded it by at most 15 %.
MIN_SIMULATED_FRACTION = 0.8


def within_limits(
    rig: SimulatedRig, excitation: MultisineSpec, execution: Execution | None = None
) -> tuple[Plan, LimitUse]:
    """Scale the plan of a nominal rig until the simulated peaks are within the limits; return it and all peaks.

    `torque_rms: limits` scales every motor up or down; numbers are only scaled down, by one factor in a configuration.
    Raises StudyError if a limit allows no excitation.
    """
    plan, (limit, base) = rig.plan, _limits_and_base(rig, excitation.margin)
    max_peaks = (1 - excitation.margin) * limit
    is_free = excitation.torque_rms == "limits"
    factor = np.ones((len(plan.configurations), len(plan.inputs)))
    if is_free:
        for q in range(len(factor)):
            factor[q] = _filling(rig, q, max_peaks[q] - base[q], excitation.flat == "information")
    factor, runs = _scale_to_limits(rig, factor, base, max_peaks, is_free, execution or Execution())
    notes = () if is_free else _notes(plan, factor, excitation.margin)
    names = tuple(c.name for c in plan.configurations)
    peak = largest_peaks(plan, runs)
    use = LimitUse(names, plan.inputs, peak, limit, factor, excitation.margin, notes, plan.sliding)
    return plan.scaled(factor), use


def power_costs(rig: SimulatedRig, excitation: MultisineSpec) -> FloatArray:
    r"""Return the cost of powers by the limits of each configuration: c (Q, n_o, F, n_u) with sum_kl c_okl P_kl <= 1.

    .. math:: c_{okl} = \frac{|T_{okl}|^2}{2 E}\, \frac{\kappa^2}{room_o^2}, \qquad \kappa^2 = 2 \ln (2 F E M)

    T: from injected torques to torque, position, velocity and acceleration of the motors.  room_o: limit minus peak of
    the movement.  kappa: expected crest factor of M E experiments of F lines with random phases.  A number of
    torque_rms adds c = 1 / (2 E rms_l^2).  P: |R|^2 summed over the E experiments of a realisation.
    Raises StudyError if a limit allows no excitation, or a motor has no limit.
    """
    plan, (limit, base) = rig.plan, _limits_and_base(rig, excitation.margin)
    margin = (1 - excitation.margin) * limit - base
    _, M, E, F, n_u = plan.R.shape
    crest = 2 * np.log(2 * F * E * M)
    torque_cost = np.zeros((0, F, n_u))
    if excitation.torque_rms != "limits":
        torque_cost = np.repeat(np.diag(1 / (2 * E * torque_rms(excitation, rig.robot) ** 2))[:, None, :], F, axis=1)
    costs = []
    for q, (torque, position, velocity, acceleration, turning_back, *of_reference) in enumerate(margin):
        if excitation.torque_rms == "limits":
            _check_ends(plan, margin[q])
        power = (np.abs(_response(rig, q)) ** 2).max(axis=1)
        smallest = np.array([torque, position, np.minimum(velocity, turning_back), acceleration, *of_reference])
        smallest, power = smallest[: power.shape[1]].ravel(), power.reshape(F, -1, n_u)
        motion = np.swapaxes(power, 0, 1) * (crest / (2 * E * smallest**2))[:, None, None]
        costs.append(np.concatenate([torque_cost, motion]))
    return np.array(costs)


def _response(rig: SimulatedRig, q: int) -> ComplexArray:
    """Return T (F, C, K, n_u, n_u) of the q-th configuration from planned torques to K signals with C pairs of gains.

    Signals: torque, position, velocity and acceleration of the motors, and motion of the references.
    """
    plan, s, blocks = rig.plan, laplace_variable(rig.plan.freq_hz[:, None, None]), list[list[ComplexArray]]()
    is_torque = plan.inject == "torque"
    x = np.asarray(s if is_torque else plan.S_inverse[q] / (s if plan.inject == "velocity" else 1.0), np.complex128)
    for gain in ((1.0, 1.0),) if is_torque else GAINS:
        predict = closed_loop_of(rig.robot, rig.simulated.controller.scaled(*gain), plan.rate_hz, plan.inject)
        loop = predict(plan.configurations[q], plan.freq_hz)
        blocks.append([loop.torque, loop.position, loop.velocity, loop.acceleration])
        if not is_torque:  # references are computed with the gains of the study
            controlled = np.linalg.solve(loop.reference, plan.S_inverse[q])
            blocks[-1] = [*(signal @ controlled for signal in blocks[-1]), x, s * x, s**2 * x]
    return np.moveaxis(np.array(blocks), 2, 0)


def _limits_and_base(rig: SimulatedRig, margin: float) -> tuple[FloatArray, FloatArray]:
    """Return limits and peaks without multisine (Q, 8, n_u); StudyError if a peak alone exceeds its margin."""
    plan, (limit, experiments) = rig.plan, _limits_and_experiments(rig)
    base = np.array([peaks_of_movement(rig, experiment) for experiment in experiments])
    fraction = base / limit
    q, kind, i = np.unravel_index(np.argmax(fraction), fraction.shape)
    if fraction[q, kind, i] < 1 - margin:
        return limit, base
    unit = unit_of(int(kind), rig.robot.driven[i].slides)
    raise StudyError(
        "design/limits",
        f"no excitation is possible within the limits of joint {rig.robot.driven[i].name}: without it, the "
        f"{QUANTITIES[kind]} is {base[q, kind, i]:.4g} of {limit[q, kind, i]:.4g} {unit}, and excitation.margin is "
        f"{margin:.0%}. Change the configuration, or velocity, amplitude or ramp of the slow motion",
        f"configuration {plan.configurations[q].name}",
    )


def _filling(rig: SimulatedRig, q: int, margin: FloatArray, is_shared: bool) -> FloatArray:
    """Return the factors (n_u,) with which motors use their margin (8, n_u), by prediction; StudyError without limits.

    is_shared: power is divided optimally between the motors, whose peaks keep the ratios of their rms.
    """
    plan = rig.plan
    _check_ends(plan, margin)
    response = _response(rig, q)

    def fraction(largest: FloatArray) -> FloatArray:
        return np.asarray((_by_quantity(largest, margin) / margin).max(axis=0))

    def peak_fraction(a: FloatArray, realisations: ComplexArray) -> FloatArray:
        S = np.einsum("fckoi,mefi->meckof", response, realisations * a)
        return fraction(np.max([signal_peaks(plan.lines, spectra, 16).max(axis=0) for spectra in S], axis=0))

    a = target = np.ones(len(plan.inputs))
    if is_shared:
        S = np.einsum("fckoi,efi->eckof", response, plan.R[q, 0])
        target = fraction(np.sqrt(np.sum(np.abs(S) ** 2, axis=-1).mean(axis=0)))
    for _ in range(15):
        a = a * (target / peak_fraction(a, plan.R[q, :1])) ** 0.8
    return np.asarray(a / max(peak_fraction(a, plan.R[q, m : m + 1]).max() for m in range(plan.R.shape[1])))


def _check_ends(plan: Plan, margin: FloatArray) -> None:
    endless = [name for name, column in zip(plan.inputs, margin.T, strict=True) if not np.isfinite(column).any()]
    if endless:
        raise StudyError(
            "design/limits",
            f"torque_rms: limits needs limits of every motor; missing for {', '.join(endless)}. Add "
            "`limits: {torque: ..., velocity: ...}` to the robot model, or give numbers",
            "excitation.torque_rms",
        )


def _scale_to_limits(
    rig: SimulatedRig, factor: FloatArray, base: FloatArray, limit: FloatArray, is_free: bool, execution: Execution
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return factors (Q, n_u) with which every run is within `limit` (Q, 8, n_u), and the peaks (8, n_u) of each run.

    base (Q, 8, n_u): peaks without multisine.  Runs far from all limits are predicted, the others simulated.
    """
    plan = rig.plan
    runs: dict[str, FloatArray] = {}
    is_open = np.ones(len(factor), dtype=np.bool_)
    for iteration in range(8):
        names = set[str]()
        for q in np.flatnonzero(is_open).tolist():
            expected = expected_peaks(rig, factor, base[q], q)
            fractions = {run: (peak / limit[q]).max() for run, peak in expected.items()}
            min_fraction = min(MIN_SIMULATED_FRACTION, max(fractions.values()))
            names |= {run for run, fraction in fractions.items() if fraction >= min_fraction > 0}
            runs |= expected
        scaled_plan = plan.scaled(factor)
        simulated = [run for run in scaled_plan.experiments if run.name in names]
        peaks = execution.ordered(partial(_peaks_of, replace(rig, plan=scaled_plan)), simulated)
        runs |= dict(zip((run.name for run in simulated), peaks, strict=True))
        peak = largest_peaks(plan, runs)
        with np.errstate(divide="ignore", invalid="ignore"):
            growth = np.where(peak > base, (limit - base) / (peak - base), np.inf).min(axis=(1, 2))
        # Amplitudes are increased once, and by at least 5 %.
        may_grow = is_free and iteration == 0
        is_open = (peak > limit).any(axis=(1, 2)) | (may_grow & (MAX_RANGE_FRACTION * growth > 1.05))
        if not is_open.any():
            return factor, runs
        factor = np.where(is_open[:, None], factor * (MAX_RANGE_FRACTION * np.minimum(growth, 10.0))[:, None], factor)
    raise StudyError(
        "design/limits",
        "the simulated peaks exceed the limits after 8 reductions of the amplitude. Remove this configuration, or "
        "move it away from the joint limits",
        f"configuration {', '.join(plan.configurations[q].name for q in np.flatnonzero(is_open))}",
    )


def _notes(plan: Plan, factor: FloatArray, margin: float) -> tuple[Note, ...]:
    text = "excitation.torque_rms was lowered to {:.1%}, so that {:.0%} of every limit stays free in the simulation"
    return tuple(
        Note("design/limits", text.format(f[0], margin), f"configuration {c.name}")
        for c, f in zip(plan.configurations, factor, strict=True)
        if f[0] < 1
    )
