r"""Records from which effects of gears cannot be found, effects that are hidden, and bounds of the others.

How large each effect that was not found could be without having been seen:

.. math:: f < \max(\hat f, 0) + 1.645\, \sigma_f \quad (95\,\%)

f and its standard deviation by one Gauss-Newton step of parameters, found levels and the effect in question together,
along the motion under the effects that were found. Of a sine with its cosine the amplitude.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import Note
from elastid.base.statistics import ONE_SIDED_95
from elastid.fit.result import Result
from elastid.linear.modes import modes
from elastid.nonlinear.drives import DriveLines
from elastid.nonlinear.effects import GearEffect
from elastid.nonlinear.gear_choice import SPRINGS, Group, candidate_groups
from elastid.nonlinear.gear_levels import GearData, Levels
from elastid.nonlinear.gear_motion import Estimate, residuals
from elastid.nonlinear.gear_result import BENT_STILL
from elastid.nonlinear.levels import inverse
from elastid.nonlinear.spectra import PeriodLines
from elastid.response import BENT, NOT_STRAIGHT, UNEXPLAINED

_SOLVED = ("converged", "noise_unknown", "at_bound", "misfit")
# Of the rms deflection of a gear at the excited lines, above which noise of its motor's angle hides the effects, or a
# count of its encoder moves the numbers: k of a motor and link was 2.1 and 4.2 std off with counts of 1/16 of the
# deflection, 0.5 and 2.4 with 1/32, 1.1 and 1.3 with 1/65.
COARSE, COUNT = 0.1, 0.025
# Of the motion, by which periods differ above which nothing is looked for. Below, it counts as noise: of motor and
# link, unsettled by 1.7 to 7.5 %, k was at most 0.05 % and 1.7 std off, levels 1.2 std; of 23 clean sets, which wander
# by up to 6.6 % (scripts/studies/results.csv), none had a wrong effect.
UNSETTLED = 0.1
# Names of modification indices that make a channel late.
_LATE = ("delay", "low_pass", "hold", "difference", "torque_lag", "sensor_lag")
LOST = "stiffness, damping and friction stay those of the linear fit"
HYSTERESIS = ("stop", "bristle")


def refusal(data: GearData, drives: Sequence[DriveLines], result: Result) -> str:
    """Why no effects of gears can be found, and what is lost; empty where they can."""
    if result.status not in _SOLVED:
        ended = result.status.replace("_", " ")
        return f"the fit ended as {ended}, and effects of gears are found beside a model that fits"
    if len(np.unique(np.concatenate([lines.realisation for lines in data.lines]))) < 2:
        return (
            "the records are of one realisation, and an effect is taken where it predicts those that it was not fitted "
            f"to; measure two or more realisations; {LOST}"
        )
    late = next((index for index in result.indices if index.name.startswith(_LATE) and index.share > 0.5), None)
    # A late torque distorts nothing.
    is_distorted = any(note.code == UNEXPLAINED for G in data.responses for note in G.notes)
    if late is not None and result.status == "misfit" and not is_distorted:
        return (
            f"the fit finds {late.name} ({100 * late.share:.0f} % of the excess of V): the logged torque is not the "
            "one that acts, and effects of gears would follow the difference; give the robot's chain its torque_lag, "
            f"or free the delay; {LOST}"
        )
    apart = {lines.configuration.name: difference(lines) for lines in data.lines}
    if moving := [name for name, share in apart.items() if share > UNSETTLED]:
        return (
            f"the records of {', '.join(moving)} are not settled, or disturbed: their periods differ by up to "
            f"{100 * max(apart.values()):.2g} % of the motion, and effects of gears are found between the excited "
            "lines, where a transient lies, too; measure more periods and leave the first out "
            f"(estimator.transient_periods); {LOST}"
        )
    first = min(float(modes(drive.model, drive.theta).freq_hz.min(initial=np.inf)) for drive in drives)
    highest = max(float(lines.freq_hz[lines.excited].max()) for lines in data.lines)
    if first > highest:
        return (
            f"the first mode, {first:.3g} Hz, lies above the highest excited line, {highest:.3g} Hz: motors and links "
            "move as one, so that nothing behind a gear is distinguished from the same before it; excite higher lines; "
            f"{LOST}"
        )
    coarse = coarse_encoders(data.lines, drives)
    if coarse and len(coarse) == sum(bool(row.any()) for row in drives[0].places["gear"]):
        return f"{coarse[0]}; {LOST}"
    return ""


def difference(lines: PeriodLines) -> float:
    """RMS of the mean over the periods by their scatter, less the noise of the angles, over that of the motion."""
    motion = np.sum(np.mean(np.abs(lines.Y) ** 2, axis=2), axis=0)
    scatter = np.sum(lines.scatter - lines.noise, axis=0)
    return float(np.sqrt(np.max(np.maximum(scatter, 0.0) / motion)))


def coarse_encoders(data: Sequence[PeriodLines], drives: Sequence[DriveLines]) -> list[Note]:
    """Joints whose deflection is not large against the noise of their motor's angle, or a count of its encoder."""
    notes = []
    for j, joint in enumerate(drives[0].joints):
        if not drives[0].directions("gear", j).any():
            continue
        bent, noise, counts = [], [], []
        for lines, drive in zip(data, drives, strict=True):
            on, row = lines.excited, drive.motor_row(j)
            bent.append(np.sum(np.mean(np.abs(drive.moved("gear", j, lines.U)[on]) ** 2, axis=1)))
            noise.append(np.sum(lines.scatter[on] @ row**2))
            counts.append(np.abs(row) @ lines.count)
        size, error, count = np.sqrt(np.mean(bent) / 2), np.sqrt(np.mean(noise) / 2), max(counts)
        if error > COARSE * size or count > COUNT * size:
            text = (
                f"its angle has {error:.2g} rad of noise at the excited lines and counts of {count:.2g} rad, and its "
                f"gear bends by {size:.2g} rad: effects of this gear are hidden, and its numbers may be off by more "
                "than they state; take an encoder of more counts, more periods, or more torque"
            )
            notes.append(Note("gears/coarse-encoder", text, f"motor {joint}"))
    return notes


def gear_torque(lines: PeriodLines, drive: DriveLines, j: int) -> FloatArray:
    """Torque (M, n) of a gear on the fine grid by the linear model, with that at rest."""
    of_motion = (drive.k[j] + lines.s * drive.d[j]) * drive.moved("gear", j, lines.U).T
    return np.asarray(lines.fine(of_motion) + drive.torque[j])


def rigid_gears(joints: Sequence[str]) -> list[Note]:
    """Gears of which the model has no deflection, and so the friction of their motors alone."""
    text = (
        "its gear has no spring of its own in the model (rigid, or in series with that of a shaft), so that friction "
        "at its motor alone was looked for; what the gear does otherwise is left out, and has no bound"
    )
    return [Note("gears/left-out", text, f"joint {joint}", "information") for joint in joints]


def bent_notes(data: GearData, found: Levels) -> list[Note]:
    """Gears that are no straight springs, of which neither law, hysteresis nor transmission error was found."""
    kinds = (*SPRINGS, *HYSTERESIS, "error sine", "error cosine")
    laws = {effect.joint for effect in found.effects if effect.kind in kinds}
    every = (note.text for G in data.responses for note in G.notes if note.code == NOT_STRAIGHT)
    bent = dict.fromkeys(text.removeprefix(BENT).partition(" is ")[0].strip() for text in every)
    text = "its gear is no straight spring, and nothing of it was found: its stiffness is that of this amplitude"
    return [Note(BENT_STILL, text, f"joint {joint}") for joint in bent if joint not in laws]


def left(data: GearData, drives: Sequence[DriveLines], estimates: Sequence[Estimate], levels: FloatArray) -> float:
    """Share of the motors' motion at the excited lines that a model with effects of these levels leaves, rms."""
    shares = []
    for lines, drive, estimate in zip(data.lines, drives, estimates, strict=True):
        signals = residuals(lines, drive, estimate, levels), lines.Y
        r, motion = (np.sum(np.abs(x[lines.excited]) ** 2, axis=(1, 2)) for x in signals)
        shares.append(np.mean(r / motion))
    return float(np.sqrt(np.mean(shares)))


# Of kinds that are one effect in several shapes.
_FAMILIES = {"progressive": "cubic", "range": "cubic", "bristle": "stop"}


def family_of(effect: GearEffect) -> tuple[str, str, float]:
    """Kind in general, joint, and order of what is periodic: shapes of one effect have the same."""
    word = effect.kind.split()[0]
    order = effect.scale if word in ("error", "ripple") else 0.0
    return _FAMILIES.get(word, word), effect.joint, order


def level_bounds(data: GearData, found: Levels, orders: Iterable[float]) -> dict[Group, float]:
    """How large each candidate group could be, none of whose family is among the effects that were found.

    data: as the effects were found in.
    """
    families = {family_of(effect) for effect in found.effects}
    every = candidate_groups(data, found, bent=data.joints, orders=tuple(orders))
    groups = [group for group in every if family_of(group[0]) not in families]
    sums, (A, b) = data.sums_with(found, [effect for group in groups for effect in group])
    A, b = A + sums.A.sum(axis=0), b + sums.b.sum(axis=0)
    bounds, n = dict[Group, float](), len(found.x) + len(found.levels)
    first = n
    for group in groups:
        chosen = [*range(n), *range(first, first + len(group))]
        covariance = inverse(A[np.ix_(chosen, chosen)])
        step = (covariance @ b[chosen])[n:]
        size = float(max(step[0], 0.0) if group[0].brakes else np.hypot.reduce(step))
        bounds[group] = size + ONE_SIDED_95 * float(np.sqrt(np.diag(covariance)[n:].max()))
        first += len(group)
    return bounds
