"""Checks before a fit: responses of this robot, none twice; possible geometry, an effect of each parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from elastid.base.errors import DataError, FitError, StudyError, check_kind
from elastid.fit.problem.elastic import ElasticFit
from elastid.linear.linear_model import is_load
from elastid.response import Response
from elastid.robot import Robot


def check_responses(responses: Sequence[Response], robot: Robot) -> None:
    """Refuse responses that cannot be of this robot, or not in one fit.

    Raises DataError for none at all, a configuration given twice or under two names, angles for another number of
    joints, places that the robot does not have, and quantities or sampling rates that differ.  TypeError for a single
    response, or for a robot that is none.
    """
    check_kind(responses, Sequence, "responses", "give a sequence of Response, such as [response]")
    for response in responses:
        check_kind(response, Response, "one of the responses", "read_responses and estimate make them")
    check_kind(robot, Robot, "robot", "elastid.read_robot(path) reads one")
    if not responses:
        raise DataError("fit/responses", "there is no response to fit; measure at least one configuration")
    names = [response.configuration.name for response in responses]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DataError(
            "fit/responses",
            f"configuration {', '.join(twice)} is given by two responses; its lines would count twice: leave one out, "
            "or give each its own name where they are separate measurements",
        )
    for response in responses:
        _check_robot(response, robot)
    measured = [response for response in responses if response.uncertainty is not None]
    for first, second in combinations(measured, 2):
        if first.inputs == second.inputs and first.outputs == second.outputs and np.array_equal(first.G, second.G):
            raise DataError(
                "fit/responses",
                f"the responses of {first.configuration.name} and {second.configuration.name} are the same numbers: "
                "one measurement under two names, or one file for two postures; leave one of them out",
            )
    if len({response.rate_is_known for response in responses}) > 1:
        unknown = ", ".join(r.configuration.name for r in responses if not r.rate_is_known)
        raise DataError(
            "fit/responses", f"the lines of {unknown} are in units of an unknown sampling rate, the others in Hz"
        )


def _check_robot(response: Response, robot: Robot) -> None:
    where, angles = f"configuration {response.configuration.name}", response.configuration.angles
    other = "is this response from another robot?"
    if refused := robot.count_refusal(angles.size):
        raise DataError("fit/responses", f"{where}: {refused}" + (f"; {other}" if angles.size else ""))
    if not np.all(np.isfinite(angles)):
        raise DataError("fit/responses", "an angle is not a finite number", where)
    at_tool = any(map(is_load, response.inputs))
    known = robot.load_locations if at_tool else robot.motor_locations
    missing = [name for name in response.inputs if name not in known]
    if missing:
        has_not = f"the response has the input {', '.join(missing)}, which robot {robot.name} has not"
        both = " beside forces at frames, and a response is by the ones or by the others" if at_tool else ""
        raise DataError("fit/responses", f"{has_not}{both}; there are {', '.join(known)}; {other}", where)
    if response.motors != "free" and not at_tool:
        raise DataError(
            "fit/responses", f"torques of its motors, which are {response.motors}, cannot act on them", where
        )
    if response.motors == "held" and (still := [place for place in response.outputs if place.startswith("motor ")]):
        move = "does not move" if len(still) == 1 else "do not move"
        raise DataError(
            "fit/responses", f"{', '.join(still)} {move} while the motors are held; leave out what is read there", where
        )
    if response.motors == "controlled" and (response.loop is None or np.any(response.loop.ki)):
        raise DataError(
            "fit/responses", "its motors are controlled; give their loop, stiffness kp and damping kd without ki", where
        )
    for place in response.outputs:
        try:
            robot.check_location(place)
        except StudyError as error:
            raise DataError("fit/responses", f"an output, {error}; {other}", where) from None


def check_effects(fit: ElasticFit, robot: Robot) -> None:
    """FitError that names the free parameters without effect on the responses that count."""
    x = fit.parameters.x
    information = np.diag(replace(fit, inertias=()).evaluate(x).hessian) / 2 - fit.prior_slopes**2
    # A plausible change of x: a factor e, or the range of the bounds of a linear parameter.
    spans = [1.0 if p.log or not np.isfinite(p.upper - p.lower) else p.upper - p.lower for p in fit.parameters.free]
    effect = np.sqrt(np.maximum(information, 0.0)) * np.array(spans)
    without = effect <= 1e-9 * effect.max()  # rounding leaves about 1e-16
    if without.any():
        names = ", ".join(name for name, none in zip(fit.parameters.free_names, without, strict=True) if none)
        places = any(name.partition("@")[0] in robot.geometry for name in names.split(", "))
        hint = "; a coordinate along the axis of a joint does nothing, one across it may from another start"
        raise FitError(
            "fit/undetermined",
            f"{names}: without effect on any of the {len(fit.parts)} frequency responses, so that no fit can find it; "
            f"fix it (fit.parameters: {{{names.split(', ')[0]}: {{fixed: true}}}}), or measure what it moves"
            + (hint if places else ""),
        )
