"""Meaning of fitted parameters: friction contained in viscous coefficients, and true values of a simulated robot."""

from collections.abc import Collection

from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.gear_result import GearResult
from elastid.parameters import DELAY, Parameters
from elastid.report.parameter_row import WITH_COULOMB
from elastid.robot import Robot, channel_name

VISCOUS = "viscous friction alone"
SLOPE = "viscous friction at the speeds of the records, without Coulomb friction"
NOT_SIGNIFICANT = "viscous friction. The Coulomb friction of the motor is not significant and was not compensated"
OF_LOOP = "; an error of k_d of the controller adds to it"


def mixed_numbers(robot: Robot, is_simulated: bool, friction: CompensatedFriction | None) -> frozenset[str]:
    """List the viscous coefficients that contain dry friction, since a multisine cannot distinguish both.

    These are the coefficients of motors and of joints that are rigidly coupled to their motors, except motors with
    compensated friction; on a simulated rig only if the robot model has dry friction.
    """
    rigid = {*robot.driven_names} - {joint.name for joint in robot.flexible}
    mixed = {f"fm_{name}" for name in robot.driven_names}
    if is_simulated:
        mixed = {f"fm_{joint.name}" for joint in robot.driven if joint.motor is not None and joint.motor.dry_friction}
        mixed |= {f"f_{joint.name}" for joint in robot.joints if joint.friction is not None}
    for name in _compensated_joints(friction):
        mixed -= {f"fm_{name}", f"f_{name}"} if name in rigid else {f"fm_{name}"}
    pairs = ({f"f_{name}", f"fm_{name}"} for name in rigid)  # only the sum is identifiable
    return frozenset(mixed.union(*(pair for pair in pairs if pair & mixed)))


def _compensated_joints(friction: CompensatedFriction | None) -> list[str]:
    return [] if friction is None else [location.removeprefix("motor ") for location in friction.compensated_motors()]


def parameter_contents(
    robot: Robot, is_simulated: bool, friction: CompensatedFriction | None, parameters: Parameters,
    gears: GearResult | None = None,
) -> dict[str, str]:  # fmt: skip
    """Describe the friction that viscous coefficients of motors and other mixed parameters contain.

    In responses to references, viscous friction cannot be distinguished from an error of the controller's k_d.
    """
    mixed = mixed_numbers(robot, is_simulated, friction)
    motor_names = {f"fm_{name}" for name in robot.driven_names}
    motors = () if friction is None or not friction.configurations else friction.places
    texts = {f"fm_{name}": SLOPE for name in _compensated_joints(friction)} | dict.fromkeys(mixed, WITH_COULOMB)
    texts |= {name: NOT_SIGNIFICANT for location in motors if (name := location.replace("motor ", "fm_")) in mixed}
    texts |= {f"fm_{effect.joint}": SLOPE for effect in (gears.effects if gears else ()) if effect.kind == "friction"}
    and_gain = OF_LOOP if channel_name(DELAY, "r") in parameters.names else ""
    return {
        parameter.name: texts.get(parameter.stands_for, VISCOUS) + and_gain
        for parameter in parameters.free
        if parameter.stands_for in motor_names | mixed
    }


def true_values(
    robot: Robot, simulated: SimulatedSpec | None, estimates: Collection[str],
    friction: CompensatedFriction | None = None
) -> dict[str, float] | None:  # fmt: skip
    """Return the true values of the simulated robot's parameters by name, SI; None for logs.

    estimates: parameters of the study.  friction: compensated in the responses; viscous coefficients that contain
    dry friction have no true value.
    """
    if simulated is None:
        return None
    mixed = mixed_numbers(robot, True, friction)
    names = (*robot.geometry, *(name for name in robot.channel_numbers if name in estimates))
    numbers = {name: value for name, (value, _) in robot.parameters(names).items()} | {DELAY: 0.0}
    return {name: float(value) for name, value in (numbers | simulated.truth).items() if name not in mixed}
