"""Checks of a tree of bodies: names given once that exist, loops between bodies, motors that gears can reach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from elastid.base.errors import did_you_mean
from elastid.robot.body import BASE, Body
from elastid.robot.joint import Joint
from elastid.robot.loop import Loop


def refuse_twice(kind: str, names: Sequence[str]) -> None:
    """ValueError for a name that is given twice."""
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{kind} {name} is given twice")


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
