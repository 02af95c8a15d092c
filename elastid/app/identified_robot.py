"""Identified robot: the robot model with fitted parameters, friction and gear effects, as a value and as a file."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from elastid.fit.fitted_robot import remaining_tolerances, robots_by_group
from elastid.fit.result import Result
from elastid.nonlinear.compensated_friction import CompensatedFriction, friction_rows
from elastid.nonlinear.gear_result import GearResult
from elastid.nonlinear.robot_with_gears import with_effects
from elastid.robot import Friction, Robot
from elastid.robot.friction_numbers import law_of, through_gear, with_laws
from elastid.robot.simplified import without_dry_friction
from elastid.store.files import write_text
from elastid.study.robots import yaml_text
from elastid.targets.numbers import header_lines
from elastid.targets.target import Target

if TYPE_CHECKING:
    from elastid.friction_study.result import FrictionResult


MOTOR_SIDE = "Numbers of friction are on the side of the motor"


def with_identified_friction(robot: Robot, result: "FrictionResult") -> Robot:
    """Return the study's robot with the friction model of each joint and its measured ranges.

    Presliding parameters that the study did not measure keep their values in the robot model.
    """
    laws = {
        joint.joint: (_with_presliding(robot, joint.joint, joint.friction, joint.viscous), joint.viscous)
        for joint in result.joints
        if joint.friction is not None and joint.viscous is not None
    }
    return with_laws(robot, laws)


def robot_files(
    name: str, robot: Robot, result: Result, friction: CompensatedFriction | None, configurations: Sequence[str],
    gears: GearResult | None = None,
) -> Iterator[tuple[str, str]]:  # fmt: skip
    """Yield name and text of identified_robot.yml, or of identified_robot-<group>.yml for each group.

    The name robot.yml is avoided, since a study in its own run folder may read a robot model of this name.
    """
    for label, (estimated, members) in robots_by_group(result, robot, configurations).items():
        file = f"identified_robot-{label}.yml" if label else "identified_robot.yml"
        estimated = replace(estimated, tolerances=remaining_tolerances(result, robot))
        yield file, robot_of_fit(name, estimated, friction, header_lines(result, members[0]), gears)


def robot_of_fit(
    name: str, robot: Robot, friction: CompensatedFriction | None, intervals: tuple[str, ...],
    gears: GearResult | None = None,
) -> str:  # fmt: skip
    """Return a fitted robot as text with friction and gear effects; intervals: lines on its parameters."""
    comments = [f"Robot {robot.name} with the numbers that study {name} has identified."]
    if gears is not None and not gears.refused:
        comments.append(f"{MOTOR_SIDE}, of `gear` on that of the link; friction and gears were found in the records:")
        comments += [f"  {number.sentence}" for number in gears.numbers]
        return yaml_text(with_effects(robot, gears), (*comments, *intervals))
    laws = _compensated_laws(robot, friction)
    if laws:
        comments.append(f"{MOTOR_SIDE}; Coulomb friction of joints {', '.join(laws)} was found in the records.")
    return yaml_text(with_laws(robot, laws), (*comments, *intervals))


def with_identified_effects(
    robot: Robot, friction: CompensatedFriction | None, gears: GearResult | None = None
) -> Robot:
    """Return a fitted robot with the friction and gear effects that were identified from its records.

    Other dry friction is removed: the fitted viscous coefficients contain friction that was not compensated.
    """
    if gears is None or gears.refused:
        return with_laws(without_dry_friction(robot), _compensated_laws(robot, friction))
    return with_effects(robot, gears)


def _compensated_laws(robot: Robot, friction: CompensatedFriction | None) -> dict[str, tuple[Friction, float]]:
    laws = {}
    motors = {f"motor {joint.name}": joint for joint in robot.driven}
    for row in () if friction is None else friction_rows(friction):
        joint = motors[row.place]
        if row.coulomb_torque is not None and row.coulomb_torque > 0 and joint.motor is not None:
            law = Friction(row.coulomb_torque)
            with suppress(ValueError):  # raised if the friction model in the file contradicts the torque
                law = replace(law_of(robot, joint.name) or law, coulomb=row.coulomb_torque)
            laws[joint.name] = law, joint.motor.link_viscous
    return laws


def _with_presliding(robot: Robot, joint: str, law: Friction, viscous: float) -> Friction:
    nominal, ratio = law_of(robot, joint), robot.ratio(joint)
    if nominal is None or law.lugre is not None or law.maxwell_slip is not None:
        return law
    lugre_law = replace(law, lugre=nominal.lugre, maxwell_slip=nominal.maxwell_slip)
    with suppress(ValueError):
        through_gear(lugre_law, ratio, to_motor=True).check_passive(viscous / ratio**2)
        return lugre_law
    return law


def write_robot(folder: Path, robot_file: str) -> tuple[Path]:
    """Write robot.yml."""
    write_text(path := folder / "robot.yml", robot_file)
    return (path,)


TARGETS = (Target("robot", ("robot_file",), "robot model with the identified parameters", write_robot, True),)
