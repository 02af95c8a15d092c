"""The section `experiment.simulated` against the robot: outputs, drives, units of the carrier, temperatures."""

from __future__ import annotations

from collections.abc import Iterator

from elastid.experiment.specs.disturbances import WarmingSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.experiment.specs.simulated_checks import chain_refusal, saturation_refusal
from elastid.robot import Robot
from elastid.study.checks.model import check_model
from elastid.study.checks.names import check_place, check_units
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.yaml_source import KeyPath

_SIMULATED: KeyPath = ("experiment", "simulated")


def check_simulated(study: Study, simulated: SimulatedSpec) -> Iterator[Problem]:
    """A rig that can be simulated with this robot."""
    robot, carrier = study.as_robot(), simulated.carrier
    for i, output in enumerate(simulated.outputs):
        yield from check_place((*_SIMULATED, "outputs", i), output, robot)
    if simulated.saturation and (refused := saturation_refusal(robot)):
        yield Problem((*_SIMULATED, "saturation"), refused)
    if refused := chain_refusal(robot):
        yield Problem(_SIMULATED, refused, at_key=True)
    yield from check_model((*_SIMULATED, "model"), simulated.model, robot)
    if carrier is not None:
        yield from check_units((*_SIMULATED, "carrier", "amplitude"), carrier.amplitude, robot)
        yield from check_units((*_SIMULATED, "carrier", "velocity"), carrier.velocity, robot)
    if simulated.warming is not None:
        yield from _check_temperatures(robot, simulated.warming)


def _check_temperatures(robot: Robot, warming: WarmingSpec) -> Iterator[Problem]:
    """Temperatures act on some friction law, and leave each a stiction."""
    if warming.temperature is None:
        return
    from elastid.friction.robot_friction import frictions  # brings CasADi, which few checks need

    path: KeyPath = (*_SIMULATED, "warming", "temperature")
    laws = [law for law in frictions(robot) if law.spec.temperature is not None]
    if not laws:
        message = "no friction of the robot depends on temperature; give a `temperature` to its friction, or drop this"
        yield Problem(path, message)
    for law in laws:
        for temperature in warming.temperature:
            try:
                law.curve(0.0, temperature)
            except ValueError as error:
                yield Problem(path, str(error))
