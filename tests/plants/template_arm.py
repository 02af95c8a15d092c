"""The arm of the template for serial robots, its second gear rigid, and its linear model."""

from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import linearise
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.robot.simplified import with_stiff_joints
from elastid.study import load_robot
from plants.paths import TEMPLATES

TEMPLATE = TEMPLATES / "serial" / "robot.yml"


def arm() -> Robot:
    """Three driven axes, one of them rigid, four further elastic ones, under gravity."""
    return with_stiff_joints(load_robot(TEMPLATE), ["2"])


def linear(robot: Robot, configuration=(0.3, -0.4, 0.7), outputs=None, quantity="acceleration") -> LinearModel:
    model = serial(robot)
    return linearise(model, Configuration("c", configuration), model.theta, outputs or model.inputs, quantity)
