"""A planar arm of two elastic axes without gravity, as a robot and as its file."""

from elastid.robot import Body, Joint, Limits, Motor, Placement, Robot, Spring
from elastid.study.robots import yaml_text

LIMITS = Limits((-2.0, 2.0))
TWO = Robot(
    "two axes",
    (
        Body(
            "upper",
            joints=(Joint("1", "z", Spring(2000, 2), Motor(1e-3, 30, 1e-3), limits=LIMITS),),
            mass=5.0,
            center_of_mass=(0.2, 0, 0),
            inertia=0.1,
        ),
        Body(
            "fore",
            "upper",
            Placement((0.4, 0, 0)),
            (Joint("2", "z", Spring(800, 1), Motor(4e-4, 30, 1e-3), limits=LIMITS),),
            3.0,
            (0.2, 0, 0),
            0.05,
        ),
    ),
    gravity=(0, 0, 0),
)
TWO_FILE = yaml_text(TWO)
