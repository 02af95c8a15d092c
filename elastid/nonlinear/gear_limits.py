r"""Records from which effects of gears cannot be found: the reason, and what is lost.

Bounds of effects that were not found: how large each could be without having been seen.

.. math:: f < \max(\hat f, 0) + 1.645\, \sigma_f \quad (95\,\%)

f and its standard deviation by one Gauss-Newton step of parameters, found levels and the effect in question together,
along the motion under the effects that were found. Of a sine with its cosine the amplitude.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import DataError, Note
from elastid.base.statistics import ONE_SIDED_95
from elastid.fit.result import Result
from elastid.linear.linearise import Linearisation
from elastid.linear.modes import modes
from elastid.nonlinear.gear.choice import candidate_groups
from elastid.nonlinear.gear.effects import GearEffect
from elastid.nonlinear.gear.levels import Levels, inverse, joints_of, normal_equations, priors
from elastid.nonlinear.gear.motion import estimate_motion
from elastid.nonlinear.gear.period_lines import DriveLines, PeriodLines, drive_lines, elastic_joints
from elastid.response import UNEXPLAINED, Response

_SOLVED = ("converged", "noise_unknown", "at_bound", "misfit")
# Of the rms deflection of a gear at the excited lines, above which noise of its motor's angle hides the effects, or a
# count of its encoder moves the numbers: k of a motor and link was 2.1 and 4.2 std off with counts of 1/16 of the
# deflection, 0.5 and 2.4 with 1/32, 1.1 and 1.3 with 1/65.
COARSE, COUNT = 0.1, 0.025
# Of the motion, from which on a difference of the periods is told, and above which nothing is looked for. It counts as
# noise: of motor and link, unsettled by 1.7 to 7.5 %, k was at most 0.05 % and 1.7 std off, levels 1.2 std; of 23 clean
# sets, which wander by up to 6.6 % (scripts/studies/results.csv), none had a wrong effect.
DIFFERS, UNSETTLED = 1e-2, 0.1
# Names of modification indices that make a channel late.
_LATE = ("delay", "low_pass", "hold", "torque_lag", "sensor_lag")
_SETTLE = "measure more periods and leave the first out (estimator.transient_periods)"
LOST = "stiffness, damping and friction stay those of the linear fit"


def drives_of(
    data: Sequence[PeriodLines],
    responses: Sequence[Response],
    linearisation: Linearisation,
    result: Result,
) -> list[DriveLines]:
    """The linear model of each configuration at a fit; DataError where no gear has a spring."""
    if not elastic_joints(linearisation):
        raise DataError(
            "robot/no-spring",
            f"no driven joint of robot {linearisation.model.robot.name} has a spring in its gear, by which its effects "
            "would be found; give joints a spring",
        )
    pairs = zip(data, responses, strict=True)
    return [drive_lines(lines, linearisation, G, result.parameters, result.x) for lines, G in pairs]


def refusal(
    data: Sequence[PeriodLines],
    drives: Sequence[DriveLines],
    responses: Sequence[Response],
    result: Result,
    joints: Sequence[str],
) -> str:
    """Why no effects of gears can be found, and what is lost; empty where they can."""
    if result.status not in _SOLVED:
        ended = result.status.replace("_", " ")
        return f"the fit ended as {ended}, and effects of gears are found beside a model that fits"
    if len(np.unique(np.concatenate([lines.realisation for lines in data]))) < 2:
        return (
            "the records are of one realisation, and an effect is taken where it predicts those that it was not fitted "
            f"to; measure two or more realisations; {LOST}"
        )
    late = next((index for index in result.indices if index.name.startswith(_LATE) and index.share > 0.5), None)
    # A late torque distorts nothing.
    is_distorted = any(note.code == UNEXPLAINED for G in responses for note in G.notes)
    if late is not None and result.status == "misfit" and not is_distorted:
        return (
            f"the fit finds {late.name} ({100 * late.share:.0f} % of the excess of V): the logged torque is not the "
            "one that acts, and effects of gears would follow the difference; give the robot's chain its torque_lag, "
            f"or free the delay; {LOST}"
        )
    apart = {lines.configuration.name: difference(lines) for lines in data}
    if moving := [name for name, share in apart.items() if share > UNSETTLED]:
        return (
            f"the records of {', '.join(moving)} are not settled, or disturbed: their periods differ by up to "
            f"{100 * max(apart[name] for name in moving):.2g} % of the motion, and effects of gears are found between "
            f"the excited lines, where a transient lies, too; {_SETTLE}; {LOST}"
        )
    first = min(float(modes(drive.model, drive.theta).freq_hz.min(initial=np.inf)) for drive in drives)
    highest = max(float(lines.freq_hz[lines.excited].max()) for lines in data)
    if first > highest:
        return (
            f"the first mode, {first:.3g} Hz, lies above the highest excited line, {highest:.3g} Hz: motors and links "
            "move as one, so that nothing behind a gear is distinguished from the same before it; excite higher lines; "
            f"{LOST}"
        )
    coarse = coarse_encoders(data, drives, joints)
    if coarse and len(coarse) == sum(bool(drives[0].directions("gear", j).any()) for j in range(len(joints))):
        return f"{coarse[0]}; {LOST}"
    return ""


def unsettled_notes(data: Sequence[PeriodLines]) -> list[Note]:
    """Configurations whose periods differ, which makes intervals wide."""
    shares = {lines.configuration.name: difference(lines) for lines in data}
    text = (
        "its periods differ by {:.2g} % of the motion, a transient or a disturbance, which counts as noise: intervals "
        "of the gears' numbers are the wider for it; " + _SETTLE
    )
    return [
        Note("gears/unsettled", text.format(100 * share), f"configuration {name}", "information")
        for name, share in shares.items()
        if share > DIFFERS
    ]


def difference(lines: PeriodLines) -> float:
    """RMS of the mean over the periods by their scatter, less the noise of the angles, over that of the motion."""
    motion = np.sum(np.mean(np.abs(lines.Y) ** 2, axis=2), axis=0)
    scatter = np.sum(lines.scatter - lines.noise, axis=0)
    return float(np.sqrt(np.max(np.maximum(scatter, 0.0) / motion)))


def coarse_encoders(data: Sequence[PeriodLines], drives: Sequence[DriveLines], joints: Sequence[str]) -> list[Note]:
    """Joints whose deflection is not large against the noise of their motor's angle, or a count of its encoder."""
    notes = []
    for j, joint in enumerate(joints):
        if not drives[0].directions("gear", j).any():
            continue
        bent, noise, counts = [], [], []
        for lines, drive in zip(data, drives, strict=True):
            bent.append(np.sum(np.mean(np.abs(deflections(lines, drive, j)[lines.excited]) ** 2, axis=1)))
            row = drive.directions("motor", j) @ np.linalg.pinv(drive.C)
            noise.append(np.sum(lines.scatter[lines.excited] @ row**2))
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


def left(data: Sequence[PeriodLines], drives: Sequence[DriveLines], forces: Sequence[ComplexArray]) -> float:
    """Share of the motors' motion at the excited lines that a model leaves, rms over these lines.

    forces (F, n, M): sum f Phi of each configuration, on the model's coordinates.
    """
    shares = []
    for lines, drive, force in zip(data, drives, forces, strict=True):
        explained = drive.sensor[:, :, None] * (drive.C @ drive.H @ force)
        r = (lines.Y - drive.G @ lines.U + explained)[lines.excited]
        motion = np.sum(np.abs(lines.Y[lines.excited]) ** 2, axis=(1, 2))
        shares.append(np.mean(np.sum(np.abs(r) ** 2, axis=(1, 2)) / motion))
    return float(np.sqrt(np.mean(shares)))


def deflections(lines: PeriodLines, drive: DriveLines, j: int) -> ComplexArray:
    """Deflection (F, M) of a gear by the linear model."""
    q = drive.H @ (drive.B @ (drive.command[:, :, None] * lines.U))
    return np.asarray(np.tensordot(drive.directions("gear", j), q, axes=(0, 1)))


def gear_torque(lines: PeriodLines, drive: DriveLines, j: int) -> FloatArray:
    """Torque (M, n) of a gear on the fine grid by the linear model, with that at rest."""
    of_motion = (drive.k[j] + lines.s * drive.d[j]) * deflections(lines, drive, j).T
    return np.asarray(lines.fine(of_motion) + drive.torque[j])


def largest_torques(data: Sequence[PeriodLines], drives: Sequence[DriveLines]) -> list[float]:
    """Of each joint's gear in the records."""
    pairs, count = list(zip(data, drives, strict=True)), len(drives[0].k)
    return [max(float(np.abs(gear_torque(*pair, j)).max()) for pair in pairs) for j in range(count)]


# Of kinds that are one effect in several shapes.
_FAMILIES = {"progressive": "cubic", "range": "cubic", "bristle": "stop"}


@dataclass(frozen=True)
class Bound:
    """How large an effect that was not found could be.  rival: place of the found one it is least told apart from.

    correlation: of their levels.  factor: level of the rival that one of the effect makes up for; 0 without a rival.
    """

    size: float
    rival: int = -1
    correlation: float = 0.0
    factor: float = 0.0


def family_of(effect: GearEffect) -> tuple[str, str, float]:
    """Kind in general, joint, and order of what is periodic: shapes of one effect have the same."""
    word = effect.kind.split()[0]
    order = effect.scale if word in ("error", "ripple") else 0.0
    return _FAMILIES.get(word, word), effect.joint, order


def level_bounds(
    data: Sequence[PeriodLines],
    responses: Sequence[Response],
    linearisation: Linearisation,
    found: Levels,
    orders: Iterable[float],
) -> dict[tuple[GearEffect, ...], Bound]:
    """The bound of each candidate group, none of whose family is among the effects that were found.

    data: as the effects were found in.
    """
    families = {family_of(effect) for effect in found.effects}
    joints, ratios = joints_of(linearisation)
    every = candidate_groups(data, found, linearisation, bent=joints, orders=tuple(orders))
    groups = [group for group in every if family_of(group[0]) not in families]
    effects = [*found.effects, *(effect for group in groups for effect in group)]
    levels, before = found.levels_of(effects), found.estimates_of(effects)
    drives = [drive_lines(c, linearisation, G, found.parameters, found.x) for c, G in zip(data, responses, strict=True)]
    estimates = [
        estimate_motion(lines, drive, joints, ratios, effects, levels, each)
        for lines, drive, each in zip(data, drives, before, strict=True)
    ]
    n_x = len(found.x)
    sums, (A, b) = (
        normal_equations(data, drives, estimates, n_x, levels),
        priors(found.parameters, found.x, n_x + len(levels)),
    )
    A, b = A + sums.A.sum(axis=0), b + sums.b.sum(axis=0)
    bounds, first = dict[tuple[GearEffect, ...], Bound](), n_x + len(found.levels)
    known = list(range(first))
    for group in groups:
        chosen = [*known, *range(first, first + len(group))]
        covariance = inverse(A[np.ix_(chosen, chosen)])
        step = (covariance @ b[chosen])[len(known) :]
        std = np.sqrt(np.diag(covariance)[len(known) :])
        size = float(np.hypot.reduce(step)) if len(group) > 1 else float(max(step[0], 0.0))
        if not group[0].brakes and len(group) == 1:
            size = float(abs(step[0]))
        bound = Bound(size + ONE_SIDED_95 * float(std.max()))
        bounds[group] = bound if len(group) > 1 else _with_rival(bound, group[0], found, covariance)
        first += len(group)
    return bounds


def _with_rival(bound: Bound, effect: GearEffect, found: Levels, covariance: FloatArray) -> Bound:
    """covariance: of parameters and found levels, and of the effect as the last."""
    own = [i for i, other in enumerate(found.effects) if other.joint == effect.joint]
    if not own:
        return bound
    rows, power = len(found.x) + np.array(own), np.maximum(np.diag(covariance), 1e-300)
    r = covariance[rows, -1] / np.sqrt(power[rows] * power[-1])
    i = int(np.argmax(np.abs(r)))
    return Bound(bound.size, own[i], float(r[i]), float(-covariance[rows[i], -1] / power[-1]))
