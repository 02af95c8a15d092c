"""Checks of measured responses before a fit: of this robot, none twice, one kind of frequency."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from elastid.base.errors import DataError, StudyError, check_kind
from elastid.base.note import Note
from elastid.parameters import ParameterSet
from elastid.response import FrequencyResponse
from elastid.robot import Robot


def check_responses(responses: Sequence[FrequencyResponse], robot: Robot) -> None:
    """Refuse responses that cannot be of this robot, or not in one fit.

    Raises DataError for none at all, a configuration given twice or under two names, angles for another number of
    joints, places that the robot does not have, and quantities or sampling rates that differ.  TypeError for a single
    response, or for a robot that is none.
    """
    check_kind(responses, Sequence, "responses", "give a sequence of FrequencyResponse, such as [response]")
    for response in responses:
        check_kind(response, FrequencyResponse, "one of the responses", "read_responses and estimate make them")
    check_kind(robot, Robot, "robot", "load_robot(path) reads one, and a study has one as study.robot")
    if not responses:
        raise DataError("there is no response to fit; measure at least one configuration")
    names = [response.configuration.name for response in responses]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DataError(
            f"configuration {', '.join(twice)} is given by two responses; its lines would count twice: leave one out, "
            "or give each its own name where they are separate measurements"
        )
    for response in responses:
        _check_robot(response, robot)
    for first, second in _same_postures(responses):
        if np.array_equal(first.freq_hz, second.freq_hz) and np.array_equal(first.G, second.G):
            raise DataError(
                f"the responses of {first.configuration.name} and {second.configuration.name} are the same numbers at "
                "the same angles: one measurement under two names, whose lines would count twice; leave one out"
            )
    if len({response.rate_is_known for response in responses}) > 1:
        unknown = ", ".join(r.configuration.name for r in responses if not r.rate_is_known)
        raise DataError(f"the lines of {unknown} are in units of an unknown sampling rate, the others in Hz")


def find_same_postures(
    responses: Sequence[FrequencyResponse], parameters: ParameterSet, robots: Mapping[str, Sequence[str]]
) -> tuple[Note, ...]:
    """A note on configurations that are one posture of one robot, with the same parameters, under two names."""

    def group(name: str) -> tuple[object, ...]:
        own = tuple(p.name for p in parameters if name in p.only)
        return own, tuple(robot for robot, members in robots.items() if name in members)

    pairs = ((first.configuration.name, second.configuration.name) for first, second in _same_postures(responses))
    duplicates = [f"{first} and {second}" for first, second in pairs if group(first) == group(second)]
    if not duplicates:
        return ()
    return (
        Note(
            "same-posture",
            f"the same posture under two names: {', '.join(duplicates)}; both count, as is right where it was measured "
            "twice; leave one out where it was not, and name them in fit.robots where they are of two robots",
        ),
    )


def find_contradictions(
    responses: Sequence[FrequencyResponse], robots: Mapping[str, Sequence[str]]
) -> tuple[Note, ...]:
    """A warning where responses of one robot at the same declared angles differ far beyond their noise.

    No parameters explain both; those that are found are of neither.  Responses are not of one posture where the median
    over lines of |G1 - G2| / |G| exceeds 0.3, by less than which friction changes from one measurement to the next, and
    that over its standard deviation 5.
    """
    unlike = [
        (f"{first.configuration.name} and {second.configuration.name}", *difference)
        for first, second in _same_postures(responses)
        if _are_of_one_robot(first.configuration.name, second.configuration.name, robots)
        and (difference := _difference(first, second))[0] > 0.3
        and difference[1] > 5.0
    ]
    if not unlike:
        return ()
    _, share, over_std = max(unlike, key=lambda pair: pair[1])
    return (
        Note(
            "unlike-at-one-posture",
            f"declared at the same angles, and their responses differ: {', '.join(pair[0] for pair in unlike)}, by up "
            f"to {100 * share:.0f} % (median of the lines), {over_std:.0f} times their noise; no parameters explain "
            "both, and those that are found may be off by many times their std: correct the angles under "
            "experiment.configurations, or name the robots in fit.robots where they are of two",
        ),
    )


def _are_of_one_robot(first: str, second: str, robots: Mapping[str, Sequence[str]]) -> bool:
    return not any((first in members) != (second in members) for members in robots.values())


def _difference(first: FrequencyResponse, second: FrequencyResponse) -> tuple[float, float]:
    """Medians over common lines of the elements' difference: relative to the larger one, and over its std.

    Without common lines both are 0; where the noise is not known, it is taken for none.
    """
    _, lines, other_lines = np.intersect1d(first.freq_hz, second.freq_hz, assume_unique=True, return_indices=True)
    if not lines.size:
        return 0.0, 0.0
    G, H = first.G[lines], second.G[other_lines]
    difference = np.abs(G - H)
    variance = sum(
        0.0 if covariance is None else covariance.variance[rows]
        for covariance, rows in ((first.noise, lines), (second.noise, other_lines))
    )
    relative = difference / np.maximum(np.maximum(np.abs(G), np.abs(H)), 1e-300)
    return float(np.median(relative)), float(np.median(difference / np.sqrt(np.maximum(variance, 1e-300))))


def _same_postures(responses: Sequence[FrequencyResponse]) -> Iterator[tuple[FrequencyResponse, FrequencyResponse]]:
    """Pairs at the same angles and through the same channels."""
    angles = np.array([response.configuration.angles for response in responses])
    same = np.all(np.abs(angles[:, None] - angles) < 2e-5, axis=2)  # rad or m
    for i, j in np.argwhere(np.triu(same, 1)):
        first, second = responses[i], responses[j]
        if (first.inputs, first.outputs) == (second.inputs, second.outputs):
            yield first, second


def find_copies(responses: Sequence[FrequencyResponse]) -> tuple[Note, ...]:
    """A note on every two configurations that hold the same numbers, which two measurements never do."""
    words = []
    for first, second in combinations(responses, 2):
        if (first.inputs, first.outputs) != (second.inputs, second.outputs):
            continue
        _, lines, other_lines = np.intersect1d(first.freq_hz, second.freq_hz, assume_unique=True, return_indices=True)
        same = int(np.all((first.G[lines] == second.G[other_lines]) & (first.G[lines] != 0), axis=(1, 2)).sum())
        if same > 0.5 * min(first.n_lines, second.n_lines):
            words.append(
                Note(
                    "alike-responses",
                    f"configurations {first.configuration.name} and {second.configuration.name} hold the same "
                    f"numbers at {same} of {min(first.n_lines, second.n_lines)} lines: one measurement counts twice, "
                    "which makes the intervals too narrow, or a file is given for the wrong configuration; leave one "
                    "of them out",
                )
            )
    return tuple(words)


def _check_robot(response: FrequencyResponse, robot: Robot) -> None:
    where, angles = f"configuration {response.configuration.name}", response.configuration.angles
    if refused := robot.count_refusal(angles.size):
        raise DataError(f"{where}: {refused}" + ("; is this response from another robot?" if angles.size else ""))
    if not np.all(np.isfinite(angles)):
        raise DataError(f"{where}: an angle is not a finite number")
    motors = robot.motor_locations
    missing = [name for name in response.inputs if name not in motors]
    if missing:
        raise DataError(
            f"{where}: the response has the input {', '.join(missing)}, which robot {robot.name} has not; there are "
            f"{', '.join(motors)}; is this response from another robot?"
        )
    for place in response.outputs:
        try:
            robot.check_location(place)
        except StudyError as error:
            raise DataError(f"{where}: an output, {error}; is this response from another robot?") from None
