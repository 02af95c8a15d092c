"""Candidates of the score test: each number alone, common factors of several, and numbers that one cause changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elastid.fit.diagnosis.hypothesis import Hypothesis
from elastid.fit.diagnosis.response_columns import inertial
from elastid.fit.diagnosis.score_test import Candidate, HeldNumber
from elastid.robot import Robot

# Families of numbers that depend on the posture alone.
OF_POSTURES = ("friction by posture", "transmission", "reading by posture", "spring by posture")


def candidates(numbers: Sequence[HeldNumber], robot: Robot, hypotheses: Sequence[Hypothesis]) -> list[Candidate]:
    """Each number alone, then common factors of several, then what one cause changes together.

    A torque constant that is wrong in every drive is one error and not six: gain_u_* is a factor of all of them.  A
    payload changes mass, centre and inertia of a body; friction or the ratio of an axis may differ in every posture.
    """
    place = {number.name: i for i, number in enumerate(numbers)}
    doubled = {f"angle_{name.removeprefix('zero_')}" for name in place if name.startswith("zero_")}
    parts = doubled | {
        name for name in place for prefix in ("m_", "c_", "I_") if name.startswith(prefix) and "@" in name
    }
    every = [
        Candidate(n.name, n.family, np.array([i]), np.eye(1)) for i, n in enumerate(numbers) if n.name not in parts
    ]

    def add_common(name: str, members: list[int]) -> None:
        if len(members) > 1 and len({numbers[i].log for i in members}) == 1:
            every.append(Candidate(name, numbers[members[0]].family, np.array(members), np.ones((len(members), 1))))

    def add_together(name: str, family: str, members: list[int]) -> None:
        if len(members) > 1:
            every.append(Candidate(name, family, np.array(members), np.eye(len(members))))

    for prefix in (prefix for h in hypotheses if h.is_common for prefix in h.numbers):
        add_common(f"{prefix}_*", [i for name, i in place.items() if name.startswith(f"{prefix}_")])
    for body in robot.bodies:
        moments = [f"I_{body.name}_{axis}" for axis in ("xx", "yy", "zz")]
        if f"I_{body.name}" not in place:
            add_common(f"I_{body.name}_*", [place[name] for name in moments if name in place])
    for name, family, members in _of_one_cause(robot, place):
        add_together(name, family, [place[member] for member in members if member in place])
    loops, gains = ([i for name, i in place.items() if name.startswith(word)] for word in ("loop_", "gain_u_"))
    if loops and gains:  # one constant of all motors
        directions = np.zeros((len(loops) + len(gains), len(loops) + 1))
        directions[: len(loops), :-1], directions[len(loops) :, -1] = np.eye(len(loops)), 1.0
        every.append(Candidate("reference", "reference", np.array(loops + gains), directions))
    return every


def _of_one_cause(robot: Robot, place: dict[str, int]) -> Iterator[tuple[str, str, list[str]]]:
    """Name, family and members: of payloads, of axes that differ between postures, of a reference logged as torque."""
    postures = sorted({name.partition("@")[2] for name in place if "@" in name})
    for body in robot.bodies:
        yield f"payload_{body.name}", "payload", inertial(body)
        for posture in postures:
            own = [f"{name}@{posture}" for name in inertial(body)]  # none but of the last body
            yield f"payload_{body.name}@{posture}", "payload of one posture", own
    for family in OF_POSTURES:
        word = family.partition(" ")[0]
        for joint in robot.driven:
            yield f"{word}_{joint.name}", family, [f"{word}_{joint.name}@{posture}" for posture in postures]
    yield "torques", "torques by posture", [f"torques@{posture}" for posture in postures]
    for joint in robot.driven:
        yield f"angles_{joint.name}", "angles by posture", [f"angle_{joint.name}@{posture}" for posture in postures]
