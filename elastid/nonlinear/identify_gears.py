"""Identification of gear effects and gearbox characteristics from records, and the reasons to refuse it."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elastid.base.arrays import FloatArray, IntArray
from elastid.base.errors import DataError, Note, StudyError, notes_of
from elastid.base.execution import Execution
from elastid.fit.result import Result
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.modes import modes
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.nonlinear.gear_characteristics import JointEffects, sheet_of
from elastid.nonlinear.gear_estimation import GearData
from elastid.nonlinear.gear_model_selection import choose_effects, magnitude_bounds
from elastid.nonlinear.gear_result import GearResult
from elastid.nonlinear.hidden_motion_smoother import SmoothedMotion, residuals
from elastid.nonlinear.period_lines import PeriodLines, gather_lines
from elastid.nonlinear.period_model import DriveLines, elastic_joints, without_arm
from elastid.nonlinear.spec import GearsSpec
from elastid.record import Record
from elastid.response import UNEXPLAINED, Response
from elastid.robot import Robot

_VALID_STATUSES = ("converged", "noise_unknown", "at_bound", "misfit")
# Largest non-periodic fraction of the motion, and largest noise of a motor angle over the rms deflection of its gear at
# the excited lines. With 1.7 to 7.5 % of transients k was at most 0.05 % and 1.7 std off; 23 settled sets with up to
# 6.6 % (scripts/studies/results.csv) had no false effect. Largest encoder resolution over the deflection: k was 2.1 and
# 4.2 std off with 1/16, 1.1 and 1.3 std with 1/65.
MAX_DISTURBANCE, MAX_RESOLUTION = 0.1, 0.025
# Prefixes of parameters that delay a channel.
_DELAYS = ("delay", "low_pass", "hold", "torque_lag", "sensor_lag")
FALLBACK = "stiffness, damping and friction stay those of the linear fit"


def identify_gears(
    measured: Sequence[Iterable[Record]], responses: Sequence[Response], result: Result, robot: Robot,
    spec: EstimatorSpec, gears: GearsSpec, execution: Execution | None = None, model: ModelSpec = EXACT,
    planned: IntArray | None = None
) -> GearResult:  # fmt: skip
    """Estimate the effects of all gears together with the parameters, and the characteristics of each gear.

    measured, responses: of each fitted configuration, in one order.  result: fit of these responses with linear
    springs (`with_straight_springs`), whose parameters are returned with the reason in `refused` if gear effects are
    not identifiable.
    """
    execution = execution or Execution()
    nothing = GearResult(result.x, result.covariance)
    linearisation = Linearisation.of_robot(robot, model, result.parameters.names)
    elastic = elastic_joints(linearisation)
    if not elastic:
        text = f"no driven joint of robot {robot.name} has a spring in its gear. Add springs to joints"
        return replace(nothing, refused=f"{text}; {FALLBACK}")
    try:
        lines = execution.quiet.ordered(partial(gather_lines, spec=spec, planned=planned), measured)
        linear = GearData(lines, responses, linearisation)
        drives = linear.drives(result.parameters, result.x)
        if reason := refusal(linear, drives, result):
            return replace(nothing, refused=reason)
        data = replace(linear, lines=[without_arm(*pair, robot) for pair in zip(lines, drives, strict=True)])
    except (DataError, StudyError) as error:
        return replace(nothing, refused=f"{error}; {FALLBACK}")
    execution.progress(0, 3)
    estimate = choose_effects(data, result.parameters, result.x, gears.orders)
    execution.progress(2, 3)  # the search takes about two thirds of the time
    bounds = magnitude_bounds(data, estimate, gears.orders)
    execution.progress(3, 3)
    pairs = [*zip(data.lines, estimate.drives, strict=True)]
    sheets = []
    for j, joint in enumerate(data.joints):
        if joint in elastic:
            peak = max(float(np.abs(gear_torque(*pair, j)).max()) for pair in pairs)
            sheets.append(sheet_of(JointEffects(estimate, robot, joint, peak), result, bounds))
    rigid = [joint for joint in data.joints if joint not in elastic]
    notes = (*coarse_encoders(data.lines, drives), *rigid_gears(rigid))
    no_effects = [SmoothedMotion.start(grid, drive, 0) for grid, drive in zip(lines, drives, strict=True)]
    fraction_before = unexplained_fraction(linear, drives, no_effects, np.zeros(0))
    fraction_after = unexplained_fraction(data, estimate.drives, estimate.estimates, estimate.magnitudes)
    numbers = estimate.x, estimate.covariance, estimate.effects, estimate.magnitudes, tuple(sheets)
    return GearResult(*numbers, before=fraction_before, after=fraction_after, notes=notes)


def refusal(data: GearData, drives: Sequence[DriveLines], result: Result) -> str:
    """Return the reason why no gear effects can be estimated, with its consequence; empty if they can."""
    if result.status not in _VALID_STATUSES:
        status = result.status.replace("_", " ")
        return f"the fit ended as {status}, and estimates of gear effects need a model that fits"
    if len(np.unique(np.concatenate([lines.realisation for lines in data.lines]))) < 2:
        return (
            "the records contain one realisation, and cross-validation of gear effects needs two or more. Measure "
            f"another realisation; {FALLBACK}"
        )
    delays = [index for index in result.indices if index.name.startswith(_DELAYS) and index.explained_fraction > 0.5]
    # A delay alone causes no distortion.
    is_distorted = any(note.code == UNEXPLAINED for note in notes_of(data.responses))
    if delays and result.status == "misfit" and not is_distorted:
        return (
            f"{delays[0].name} explains {100 * delays[0].explained_fraction:.0f} % of the excess of V: the logged "
            "torque differs from the acting torque, which would cause false gear effects. Add torque_lag to the "
            f"robot's chain, or free the delay; {FALLBACK}"
        )
    ratios = {lines.configuration.name: difference(lines) for lines in data.lines}
    if unsteady := [name for name, ratio in ratios.items() if ratio > MAX_DISTURBANCE]:
        return (
            f"the records of {', '.join(unsteady)} are not settled, or disturbed: their periods differ by up to "
            f"{100 * max(ratios.values()):.2g} % of the motion (limit {100 * MAX_DISTURBANCE:g} %). Measure more "
            f"periods and discard the first (estimator.transient_periods); {FALLBACK}"
        )
    first = min(float(modes(drive.model, drive.theta).freq_hz.min(initial=np.inf)) for drive in drives)
    highest = max(float(lines.freq_hz[lines.excited].max()) for lines in data.lines)
    if first > highest:
        return (
            f"the first mode, {first:.3g} Hz, is above the highest excited line, {highest:.3g} Hz: motors and links "
            "move together, so effects before and behind a gear are not distinguishable. Excite higher lines; "
            f"{FALLBACK}"
        )
    coarse = coarse_encoders(data.lines, drives)
    if coarse and len(coarse) == sum(bool(row.any()) for row in drives[0].places["gear"]):
        return f"{coarse[0]}; {FALLBACK}"
    return ""


def difference(lines: PeriodLines) -> float:
    """Return the ratio of the rms error of the mean over periods, without encoder noise, to the rms motion."""
    motion = np.sum(np.mean(np.abs(lines.Y) ** 2, axis=2), axis=0)
    return math.sqrt(np.max(np.maximum(np.sum(lines.scatter - lines.noise, axis=0), 0.0) / motion))


def coarse_encoders(data: Sequence[PeriodLines], drives: Sequence[DriveLines]) -> list[Note]:
    """Return a note for each joint with a small deflection relative to the noise or resolution of its encoder."""
    notes = []
    for j, joint in enumerate(drives[0].joints):
        if not drives[0].directions("gear", j).any():
            continue
        power, noise, counts = [], [], []
        for lines, drive in zip(data, drives, strict=True):
            excited, row = lines.excited, drive.motor_row(j)
            power.append(np.sum(np.mean(np.abs(drive.motion("gear", j, lines.U)[excited]) ** 2, axis=1)))
            noise.append(np.sum(lines.scatter[excited] @ row**2))
            counts.append(np.abs(row) @ lines.count)
        deflection, error, count = np.sqrt(np.mean(power) / 2), np.sqrt(np.mean(noise) / 2), max(counts)
        if error > MAX_DISTURBANCE * deflection or count > MAX_RESOLUTION * deflection:
            text = (
                f"the angle has {error:.2g} rad of noise at the excited lines and a resolution of {count:.2g} rad, and "
                f"the gear deflects by {deflection:.2g} rad: effects of this gear are not detectable, and intervals of "
                "its numbers may be too narrow. Use a finer encoder, more periods, or more torque"
            )
            notes.append(Note("gears/coarse-encoder", text, f"motor {joint}"))
    return notes


def gear_torque(lines: PeriodLines, drive: DriveLines, j: int) -> FloatArray:
    """Return the torque (M, n) of the gear j on the fine grid by the linear model, including its static torque."""
    of_motion = (drive.k[j] + lines.s * drive.d[j]) * drive.motion("gear", j, lines.U).T
    return np.asarray(lines.fine(of_motion) + drive.torque[j])


def rigid_gears(joints: Sequence[str]) -> list[Note]:
    """Return a note on each gear without a deflection in the model; only friction of its motor is estimated."""
    text = (
        "the gear has no spring of its own in the model (rigid, or in series with a shaft's spring). Only friction at "
        "its motor is estimated; its other effects are neglected and have no bound"
    )
    return [Note("gears/effect-discarded", text, f"joint {joint}", "information") for joint in joints]


def unexplained_fraction(
    data: GearData, drives: Sequence[DriveLines], estimates: Sequence[SmoothedMotion], magnitudes: FloatArray
) -> float:
    """Return the unexplained fraction, rms, of the motors' motion at the excited lines; magnitudes (n_f,)."""
    fractions = []
    for lines, drive, estimate in zip(data.lines, drives, estimates, strict=True):
        signals = residuals(lines, drive, estimate, magnitudes), lines.Y
        r, motion = (np.sum(np.abs(x[lines.excited]) ** 2, axis=(1, 2)) for x in signals)
        fractions.append(np.mean(r / motion))
    return math.sqrt(np.mean(fractions))
