r"""What load tests and taps on the tool would take from the intervals of a plan.

.. math:: \frac{\mathrm{std}'^2}{\mathrm{std}^2} = \frac{[(A + J^T J)^{-1}]_{ii}}{[A^{-1}]_{ii}}

A: information of the planned responses. J: of load tests, those of the study or typical ones, or of responses to a
hammer on the tool with the motors held by their brakes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.note import Note
from elastid.covariance import Covariance
from elastid.design.prospect import ExpectedResponse
from elastid.fit.load_tests import LoadTest
from elastid.fit.parameter_choice import AT_TOOL
from elastid.fit.posture import default_frame
from elastid.fit.problem.elastic import linear_model
from elastid.fit.problem.static_loads import PlacedTest, StaticLoads
from elastid.fit.problem.weights import weigh
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import frequency_response
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import Configuration
from elastid.response import Response
from elastid.robot import Robot
from elastid.robot.robot import with_frames


@dataclass(frozen=True)
class ToolForecastLimits:
    """Typical load tests and taps, and what is worth a sentence. False-alarm rates: none, a forecast has no noise."""

    configurations: int = 3  # of the plan, in which they are made
    reading: float = 0.01  # std of a deflection, of the largest of its test
    response: float = 0.02  # std of a response, of the largest element of its line
    std: float = 0.01  # of a stiffness, relative, above which it is worth a sentence
    gain: float = 2.0  # by which its interval must get narrower
    named: int = 4
    unknown: float = 30.0  # std of ln p of what nothing determines


LIMITS = ToolForecastLimits()


def study_tests(tests: Sequence[PlacedTest]) -> tuple[PlacedTest, ...]:
    """The load tests of a study as they are forecast, whatever is read."""
    zeros = (each.test.n_readings for each in tests)
    return tuple(
        replace(each, test=replace(each.test, deflection=0.0 if n == 1 else (0.0, 0.0, 0.0)))
        for each, n in zip(tests, zeros, strict=True)
    )


def tool_notes(
    expected: Sequence[ExpectedResponse], A: FloatArray, std: FloatArray, robot: Robot, model: ModelSpec,
    tests: Sequence[PlacedTest],
) -> tuple[Note, ...]:  # fmt: skip
    """Notes on what load tests, and taps, would take from the stds (n,) of a plan of information A (n_x, n_x).

    tests: those of the study, `study_tests`; without any, typical ones.
    """
    near, frame = expected[: LIMITS.configurations], default_frame(robot)
    where = [each.response.configuration for each in near]
    names, parameters = ", ".join(each.name for each in where), expected[0].parameters
    taps = f"taps with a hammer on {frame} in {names} (motors held, responses to 2 %)"
    typical = f"load tests along x, y and z at {frame} in {names} (read to 1 %)"
    own = tests or _typical(where, robot)
    offers: dict[str, tuple[str, Callable[[], FloatArray]]] = {
        "loads": (f"the {len(tests)} load tests of the study" if tests else typical,
                  lambda: _of_loads(own, robot, model, parameters)),
        "tool": (taps, lambda: _of_taps(near, robot, model)),
    }  # fmt: skip
    notes = []
    for section, (said, information) in offers.items():
        is_planned = section == "loads" and bool(tests)
        try:
            gained = _gained(parameters, A, information(), std, always=is_planned)
        except (StudyError, np.linalg.LinAlgError):
            continue  # the robot finds no rest
        if gained:
            asks = "" if is_planned else f"; section `{section}` of a study takes them"
            notes.append(Note("design/forecast", f"{said} take {gained}{asks}", severity="information"))
    return tuple(notes)


def _gained(parameters: Parameters, A: FloatArray, J_J: FloatArray, std: FloatArray, always: bool) -> str:
    """`k_6 from 16 to 0.1 %` of the stiffnesses that gain most; empty where none gains enough."""
    asked = parameters.asked
    prior = np.eye(len(A)) / LIMITS.unknown**2
    before, after = (np.diag(np.linalg.inv(own + prior))[: len(asked)] for own in (A, A + J_J))
    by = np.sqrt(before / np.maximum(after, 1e-300))
    finite = np.where(np.isfinite(std), std, np.sqrt(before))
    rows = [
        (float(by[i]), f"{p.name} from {_percent(finite[i])} to {_percent(finite[i] / by[i])}")
        for i, p in enumerate(asked)
        if p.log and p.stands_for.startswith("k") and (always or (finite[i] > LIMITS.std and by[i] > LIMITS.gain))
    ]
    return ", ".join(words for _, words in sorted(rows, reverse=True)[: LIMITS.named])


def _percent(std: float) -> str:
    return f"{100 * std:.2g} %" if std < 1 else "nothing"


def _of_taps(expected: Sequence[ExpectedResponse], robot: Robot, model: ModelSpec) -> FloatArray:
    parameters, frame = expected[0].parameters, default_frame(robot)
    framed = with_frames(robot, [frame])
    linearisation, theta = Linearisation.of_robot(framed, model, parameters.names), parameters.expand(parameters.x)
    forces, motions = (tuple(f"{kind} {frame} {axis}" for axis in "xyz") for kind in ("force", "frame"))
    total = np.zeros((len(parameters.x), len(parameters.x)))
    for each in expected:
        where = replace(each.response.configuration, name=each.response.configuration.name + AT_TOOL)
        lines = each.response.freq_hz
        G = np.zeros((len(lines), 3, 3), complex)
        tapped = Response(lines, G, forces, motions, "acceleration", where, motors="held")
        G = frequency_response(linear_model(linearisation, tapped, theta), theta, lines)
        std = LIMITS.response * np.broadcast_to(np.abs(G).max(axis=(1, 2), keepdims=True), G.shape)
        tapped = replace(tapped, G=G, noise=Covariance(std**2, np.inf))
        linear = linear_model(linearisation, tapped, theta)
        total += ExpectedResponse(tapped, linear, weigh(tapped, each.fit), parameters, each.fit).information(
            parameters.x
        )
    return total


def _of_loads(tests: Sequence[PlacedTest], robot: Robot, model: ModelSpec, parameters: Parameters) -> FloatArray:
    loads = StaticLoads.of(tests, robot, model, parameters)
    y, J = loads.predicted(parameters, parameters.x)
    if all(each.test.std != _RELATIVE for each in tests):
        J = loads.whitening @ J
    else:
        largest = np.sqrt(np.bincount(loads.owners, y**2))[loads.owners]
        J = J / np.maximum(LIMITS.reading * largest, 1e-300)[:, None]
    return np.asarray(J.T @ J)


_RELATIVE = 1.0  # m: std of a typical test, whose reading errs by a share of its deflection


def _typical(where: Sequence[Configuration], robot: Robot) -> tuple[PlacedTest, ...]:
    """A small force along each axis of the base in each configuration, deflections along all."""
    frame = default_frame(robot)
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return tuple(
        PlacedTest(LoadTest(each.name, frame=frame, force=force, deflection=(0.0, 0.0, 0.0), std=_RELATIVE), each)
        for each in where
        for force in axes
    )
