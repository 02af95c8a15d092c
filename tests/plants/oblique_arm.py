"""Three driven axes with oblique placements, and their linear model."""

from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import linearise
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring


def arm(gravity=(0.0, 0.0, -9.81), motor_scale: float = 1.0, free_joint: bool = False) -> Robot:
    """Three driven axes, one of them rigid, three further elastic ones, oblique placements, a full inertia tensor."""
    end = (Joint("7", "y", spring=Spring(4e4, 30)),) if free_joint else ()
    return Robot(
        "arm",
        (
            Body(
                "turret",
                placement=Placement((0, 0, 0.35)),
                joints=(
                    Joint("1y", "y", Spring(1.6e6, 1500)),
                    Joint("1", "z", Spring(3e5, 500), Motor(2.4e-3, 121 * motor_scale, 1.5e-3), viscous=20),
                ),
                mass=160,
                center_of_mass=(0.1, 0, 0.15),
                inertia=(8, 9, 9.5),
            ),
            Body(
                "upper",
                "turret",
                Placement((0.2, 0, 0.35), (0.1, 0, 0)),
                (
                    Joint("2", "y", motor=Motor(2.8e-3, -125 * motor_scale, 1.8e-3)),
                    Joint("2x", "x", Spring(4.5e5, 500)),
                ),
                60,
                (0.05, 0, 0.4),
                (6, 6.2, 0.8, 0.1, -0.2, 0.3),
            ),
            Body(
                "fore",
                "upper",
                Placement((0, 0, 0.85)),
                (
                    Joint(
                        "3", (0.0, 1.0, 0.1), Spring(1.8e5, 250), Motor(1.6e-3, 110 * motor_scale, 1.2e-3), viscous=9
                    ),
                    Joint("3z", "z", Spring(6e4, 60)),
                    *end,
                ),
                75,
                (0.45, 0.05, 0.1),
                2.0,
            ),
        ),
        gravity,
    )


def linear(robot: Robot, configuration=(0.3, -0.4, 0.7), outputs=None, quantity="acceleration") -> LinearModel:
    model = serial(robot)
    return linearise(model, Configuration("c", configuration), model.theta, outputs or model.inputs, quantity)
