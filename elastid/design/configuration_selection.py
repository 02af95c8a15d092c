"""Selection of configurations: admissible candidates and D-optimal numbers of experiments (`optimal`) of each."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import DataError, StudyError
from elastid.base.execution import Execution
from elastid.design.optimal import DesignCriterion, best_experiments
from elastid.design.predicted_response import Prospect
from elastid.design.spec import CandidateSpec
from elastid.experiment.plan.plan import DesignedConfiguration
from elastid.model.kinematics import Skeleton, skeleton
from elastid.parameters import Parameters
from elastid.record import Configuration
from elastid.robot import Robot


@dataclass(frozen=True)
class Candidates:
    """Admissible configurations, and the number of refused candidates by reason."""

    configurations: tuple[Configuration, ...]
    refused: Mapping[str, int]

    @property
    def reasons(self) -> str:
        """Reasons with their counts, for a message."""
        return ", ".join(f"{count} {reason}" for reason, count in self.refused.items())


def draw_candidates(spec: CandidateSpec, robot: Robot, seed: int, swing: float | FloatArray = 0.0) -> Candidates:
    """Return the admissible candidates of a study.

    swing: excursion of each joint to either side, rad (m), one number or (n_u,).  StudyError for a wrong number of
    angles, a sliding joint without limits, and without an admissible candidate.
    """
    low, high = _range(robot, swing)
    names, angles = _proposed_angles(spec, robot, *_range(robot, swing + spec.margin), seed)
    reasons = [("are outside the joints' limits", ((angles < low - 1e-9) | (angles > high + 1e-9)).any(axis=1))]
    reasons += list(collisions(spec, robot, angles))
    is_admissible = np.ones(len(angles), dtype=np.bool_)
    counts = {}
    for reason, is_bad in reasons:
        if (is_admissible & is_bad).any():
            counts[reason] = int((is_admissible & is_bad).sum())
        is_admissible &= ~is_bad
    if not is_admissible.any():
        raise StudyError(
            "design/candidates",
            f"none of {len(angles)} candidates is admissible: {Candidates((), counts).reasons}. Give others, or "
            "relax the constraints that reject them",
            "design.candidates",
        )
    return Candidates(tuple(Configuration(names[i], angles[i]) for i in np.flatnonzero(is_admissible).tolist()), counts)


def _range(robot: Robot, swing: float | FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest angles (n_u,) with an excursion to either side; StudyError for an empty range."""
    limits = np.array([joint.limits.angle for joint in robot.driven])
    endless = [j.name for j in robot.driven if j.slides and not np.isfinite(j.limits.angle).all()]
    if endless:
        raise StudyError(
            "design/candidates",
            f"sliding joint {endless[0]} has no limits.angle for random candidates. Give both ends of its travel in "
            "the robot model",
            "design.candidates",
        )
    low = np.where(np.isfinite(limits[:, 0]), limits[:, 0] + swing, -math.pi)
    high = np.where(np.isfinite(limits[:, 1]), limits[:, 1] - swing, math.pi)
    for joint, by, a, b in zip(robot.driven, np.broadcast_to(swing, len(low)).tolist(), low, high, strict=True):
        if a > b:
            raise StudyError(
                "design/candidates",
                f"carrier and margin of {by:g} {joint.unit} to either side exceed the range of joint {joint.name}, "
                f"[{joint.limits.angle[0]:g}, {joint.limits.angle[1]:g}] {joint.unit}. Lower the carrier's amplitude "
                "or design.candidates.margin",
                "design.candidates",
            )
    return low, high


def _proposed_angles(
    spec: CandidateSpec, robot: Robot, low: FloatArray, high: FloatArray, seed: int
) -> tuple[Sequence[str], FloatArray]:
    """Return names (Q,) and angles (Q, n_u) of the listed, grid or random candidates between low and high (n_u,)."""
    n = robot.n_u
    if spec.given:
        for name, position in spec.given.items():
            if refusal := robot.count_refusal(len(position)):
                raise StudyError("design/candidates", refusal, f"design.candidates.given.{name}")
        return list(spec.given), np.array(list(spec.given.values()))
    if spec.grid is not None:
        counts = spec.grid if isinstance(spec.grid, tuple) else (spec.grid,) * n
        if refusal := robot.count_refusal(len(counts), "numbers"):
            raise StudyError("design/candidates", refusal, "design.candidates.grid")
        if math.prod(counts) > 200_000:  # a typing error
            text = "more than 200000 candidates. Reduce the points per joint"
            raise StudyError("design/candidates", text, "design.candidates.grid")
        axes = [np.linspace(a, b, m) if m > 1 else [(a + b) / 2] for a, b, m in zip(low, high, counts, strict=True)]
        angles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, n)
    else:
        draw = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0xCA,)))
        angles = low + (high - low) * draw.random((spec.random or 200, n))
    return [f"candidate{i + 1}" for i in range(len(angles))], angles


def collisions(spec: CandidateSpec, robot: Robot, angles: FloatArray) -> Iterator[tuple[str, BoolArray]]:
    """Yield reason and flags (Q,) of candidates with moving points or links in the floor or a box; angles (Q, n_u)."""
    if spec.floor is None and not spec.boxes:
        return
    points = _link_points(skeleton(robot, angles))
    if spec.floor is not None:
        yield "reach the floor", (points @ upwards(robot)).min(axis=1) < spec.floor + spec.clearance
    for box in spec.boxes:
        low, high = np.array(box.lower) - spec.clearance, np.array(box.upper) + spec.clearance
        yield f"reach into box {box.name}", np.any(np.all((points > low) & (points < high), axis=2), axis=1)


def upwards(robot: Robot) -> FloatArray:
    """Return the unit vector against gravity; z without gravity."""
    gravity = np.array(robot.gravity)
    g = float(np.linalg.norm(gravity))
    return -gravity / g if g > 0 else np.array([0.0, 0.0, 1.0])


def _link_points(skeleton: Skeleton) -> FloatArray:
    """Return the moving points and points on the links between them (Q, n, 3)."""
    points = [skeleton.points[:, skeleton.moves]]
    for a, b in skeleton.links:
        if skeleton.moves[a] and skeleton.moves[b]:
            fractions = np.linspace(0, 1, 7)[1:-1, None]
            points.append(skeleton.points[:, [a]] + fractions * (skeleton.points[:, [b]] - skeleton.points[:, [a]]))
    return np.concatenate(points, axis=1)


def choose_configurations(
    criterion: DesignCriterion, prospect: Prospect, count: int, prior: FloatArray,
    configurations: Sequence[Configuration], reserved: Sequence[str], execution: Execution,
) -> tuple[tuple[DesignedConfiguration, ...], str]:  # fmt: skip
    """Select the best `count` whole experiments among candidate configurations; return them and a sentence.

    prior (n_x, n_x): information of given configurations, earlier measurements and priors.  reserved: names of other
    configurations.  StudyError if no candidate informs a parameter of interest.
    """
    H, rows = informations(prospect, configurations, prospect.parameters.x, execution)
    of_identifiable, regularisation = identifiable(criterion, H, prior, prospect.parameters)
    numbers, efficiency = best_experiments(H[None], count, of_identifiable, (prior + regularisation)[None])
    selection = _name_choices([configurations[i] for i in rows], numbers, prospect.realisations, reserved)
    names = ", ".join(f"{c.configuration.name} ({c.realisations} realisations)" for c in selection)
    best = f"{100 * efficiency:.1f} % of the best possible allocation"
    return selection, f"chosen among {len(rows)} candidates: {names}; {best}"


def informations(
    prospect: Prospect, configurations: Sequence[Configuration], x: FloatArray, execution: Execution
) -> tuple[FloatArray, IntArray]:
    """Return H (Q, n_x, n_x) at x (n_x,) of the configurations with an equilibrium, and their indices (Q,).

    Raises the StudyError or DataError of the first configuration if none has an equilibrium.
    """
    if len(configurations) < 400:  # the start of other processes would take longer
        execution = replace(execution, jobs=1)
    blocks = execution.ordered(partial(_information, prospect, x), configurations)
    informative = {i: H for i, H in enumerate(blocks) if H is not None}
    if not informative:
        prospect.expected(configurations[0], x)  # raises with the reason
    return np.stack([*informative.values()]), np.array([*informative])


def _information(prospect: Prospect, x: FloatArray, configuration: Configuration) -> FloatArray | None:
    """Return the information H (n_x, n_x) of a configuration; None without an equilibrium."""
    try:
        return prospect.information(configuration, x)
    except (StudyError, DataError):
        return None


def identifiable(
    criterion: DesignCriterion, H: FloatArray, prior: FloatArray, parameters: Parameters
) -> tuple[DesignCriterion, FloatArray]:
    """Return the criterion for the identifiable parameters, and a regularising information (n_x, n_x) for the others.

    H (Q, n_x, n_x): of candidates.  StudyError if no parameter of interest is identifiable.
    """
    total = H.mean(axis=0) + prior
    length = np.sqrt(np.maximum(np.diag(total), 0.0))
    length[length == 0] = 1.0
    eigenvalues, V = np.linalg.eigh(total / np.outer(length, length))
    null_space = V[:, eigenvalues < 1e-12]  # relative to the best known direction
    is_identifiable = np.abs(null_space).max(axis=1, initial=0.0) < 1e-3
    columns = criterion.interest[:, [is_identifiable[int(np.argmax(column))] for column in criterion.interest.T]]
    if columns.shape[1] == 0:
        names = ", ".join(parameters.free_names[i] for i in np.flatnonzero(criterion.interest.sum(axis=1)))
        raise StudyError(
            "design/goal",
            f"no candidate identifies {names} above the noise. Raise excitation.torque_rms; if no measured output "
            "depends on it, fix it or add an output (experiment.simulated.outputs)",
            "design",
        )
    null_space = null_space * length[:, None]
    return replace(criterion, interest=columns), null_space @ null_space.T


def _name_choices(
    configurations: Sequence[Configuration], numbers: IntArray, realisations: int, reserved: Sequence[str]
) -> tuple[DesignedConfiguration, ...]:
    """Return the selected configurations in the order of the candidates; unnamed ones are called c1, c2 ..."""
    selection = []
    names = {*reserved, *(c.name for c in configurations if not c.name.startswith("candidate"))}
    free = (name for name in (f"c{i}" for i in range(1, len(names) + len(configurations) + 2)) if name not in names)
    for configuration, number in zip(configurations, numbers.tolist(), strict=True):
        if number:
            name = next(free) if configuration.name.startswith("candidate") else configuration.name
            selection.append(DesignedConfiguration(replace(configuration, name=name), number * realisations))
    return tuple(selection)
