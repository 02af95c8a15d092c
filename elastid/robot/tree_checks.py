"""Checks of a tree of bodies: names that differ and exist, loops between bodies, motors that gears can reach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from elastid.base.errors import did_you_mean
from elastid.base.names import check_different
from elastid.robot.body import BASE, TENSOR_LETTERS, Body, Frame
from elastid.robot.gravity_compensator import Compensator
from elastid.robot.joint import Joint
from elastid.robot.loop import Loop


def check_part_names(
    bodies: Sequence[Body],
    joints: Sequence[Joint],
    frames: Sequence[Frame],
    loops: Sequence[Loop],
    compensators: Sequence[Compensator],
) -> None:
    """ValueError for names of one kind that are the same, and for a body that has the name of the base."""
    for body in bodies:
        if body.name.casefold() == BASE:
            raise ValueError(
                f"body {body.name}: its name is that of the base, which carries the first body and is not listed; give "
                "it another"
            )
    for kind, parts in (
        ("body", bodies), ("joint", joints), ("frame", frames), ("loop", loops), ("compensator", compensators),
    ):  # fmt: skip
        check_different(kind, [part.name for part in parts])
    masses = [*(body.name for body in bodies), *(loop.name for loop in loops)]
    for name in masses:
        stem, _, letters = name.rpartition("_")
        if letters in TENSOR_LETTERS and stem in masses:
            raise ValueError(f"body {name}: its inertia I_{name} has the name of an entry of body {stem}; rename one")


def check_known(owner: str, name: str, bodies: Sequence[Body]) -> None:
    """ValueError unless the name is the base's or that of a body of the tree."""
    known = [BASE, *(body.name for body in bodies)]
    if name not in known:
        raise ValueError(f"{owner}: no body is called {name}; {did_you_mean(name, known)}")


def check_loops(loops: Sequence[Loop], bodies: Sequence[Body]) -> None:
    """ValueError unless loops join bodies that exist and share no name with anything that has parameters of its own."""
    taken = [*(body.name for body in bodies), *(joint.name for body in bodies for joint in body.joints)]
    for loop in loops:
        for end in loop.ends:
            check_known(f"loop {loop.name}", end.body, bodies)
        if loop.name in taken:
            raise ValueError(
                f"loop {loop.name}: a body, joint or loop has this name; its parameters need a name of their own"
            )
        taken.append(loop.name)


def check_carrier(joint: Joint, bodies: Sequence[Body]) -> None:
    """ValueError unless the motor rides on a body between the base and its joint, or on one that its joint moves."""
    carrier = joint.motor.on if joint.motor is not None else ""
    if carrier in ("", BASE):
        return
    check_known(f"joint {joint.name}: motor.on", carrier, bodies)
    parents = {body.name: body.parent for body in bodies}
    moved = next(body.name for body in bodies if joint in body.joints)
    fitting = [name for name in parents if moved in _up(parents, name) or name in _up(parents, moved)]
    if carrier not in fitting:
        raise ValueError(
            f"joint {joint.name}: its motor is on {carrier}, a branch that neither carries the joint nor is moved "
            "by it, so that no gear can lead from one to the other; bodies it can be on: "
            f"{', '.join([BASE, *fitting])}"
        )


def _up(parents: Mapping[str, str], body: str) -> list[str]:
    """The body and those that carry it, the base left out."""
    path = [body]
    while parents[path[-1]] != BASE:
        path.append(parents[path[-1]])
    return path
