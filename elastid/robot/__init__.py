"""Robot: a tree of rigid bodies with joints, springs, gears, motors, loops. Numbers only, no equations.

From the parent body a body is reached by its placement and then its joints, in the order listed: rotations about, or
translations along, axes of the frame reached so far. A joint is

- driven through an elastic gear:  motor and spring   (coordinates q_a and q_m)
- driven rigidly:                  motor, no spring   (one coordinate)
- elastic, not driven:             spring, no motor   (q_na of the extended flexible joint; rests at angle 0)
- passive:                         neither (moved by gravity or by a loop)

Loops close the tree: two points of bodies that coincide, are pinned, or are joined by a rod.

Stiffness and damping of a joint are on the link side; a motor's inertia, friction and shaft are on the motor side, as
data sheets give them, and its ratio (motor turns per joint turn, negative where it turns the other way) leads to the
link. Of a translation, stiffness is in N/m and a ratio in rad/m. Gears that let one axis turn the motor of another are
listed with the robot (`gears`). A motor may ride on a body, whose rotation its rotor then feels.

A compensator is a coil or a gas spring between points of two bodies, which carries part of the weight.

Every number that can be identified has a name: k_1 and d_1 (spring of joint 1; k2_1, k2s_1, k3_1 where it is a
polynomial, b_1, ki_1, e_1 where it has backlash: half gap, stiffness inside, rounding), f_1 (viscous friction in joint
1), kc_cyl and L0_cyl (coil of compensator cyl), F0_cyl, L0_cyl, h0_cyl and kappa_cyl (its gas: force and height of the
gas column at the length L0, exponent), Jm_1 and fm_1 (inertia and viscous friction of the motor of joint 1), km_1 and
dm_1 (its shaft), m_arm, c_arm_x, I_arm_xx or, where a body has the same inertia about every axis, I_arm; m_payload,
c_payload_x, I_payload of what it carries; of the rod of loop l m_l, a_l (place of its centre of mass), I_l, k_l, d_l.

So has its geometry, in m, which is identified only where a study names it: p_arm_x (placement of body arm), pj_1_x
(point that the axis of joint 1 goes through), pc1_cyl_x and pc2_cyl_x (ends of compensator cyl), p1_l_x, p2_l_x and
l_l (ends of loop l, length of its rod), and zero_1 in rad (error of the zero of joint 1). And so have the gains of the
channels: gain_y_joint_1, gain_u_motor_1.
"""

from elastid.robot.body import BASE, TOOL, Body, Frame, InertiaTensor, Payload
from elastid.robot.channel_signals import before_channels, log_signal
from elastid.robot.connections import Anchor, CoilSpring, Compensator, GasSpring, Loop, Pin, Rod
from elastid.robot.friction import (
    Directions,
    Friction,
    LoadDependence,
    LuGre,
    MaxwellSlip,
    MeasuredRange,
    TemperatureDependence,
)
from elastid.robot.gear_effects import Gear, GearRipple, Hysteresis, TransmissionError
from elastid.robot.gears import GearCoupling
from elastid.robot.joint import Joint, Limits, Motor
from elastid.robot.measurement_chain import (
    CHANNEL_NUMBERS,
    MAX_DELAY_S,
    Chain,
    Channel,
    channel_name,
    low_pass_response,
)
from elastid.robot.placement import Acceleration3, Angles3, Axis, Placement, Vector3, unit_axis
from elastid.robot.robot import FRAME_AXES, Robot
from elastid.robot.spring import Spring
from elastid.robot.tolerances import BodyTolerances, Tolerances

__all__ = [
    "BASE", "CHANNEL_NUMBERS", "FRAME_AXES", "MAX_DELAY_S", "TOOL", "Acceleration3", "Anchor", "Angles3", "Axis",
    "Body", "BodyTolerances", "Chain", "Channel", "CoilSpring", "Compensator", "Directions", "Frame", "Friction",
    "GasSpring", "Gear", "GearCoupling", "GearRipple", "Hysteresis", "InertiaTensor", "Joint", "Limits",
    "LoadDependence", "Loop", "LuGre", "MaxwellSlip", "MeasuredRange", "Motor", "Payload", "Pin", "Placement",
    "Robot", "Rod", "Spring", "TemperatureDependence", "Tolerances", "TransmissionError", "Vector3",
    "before_channels", "channel_name", "log_signal", "low_pass_response", "unit_axis"
]  # fmt: skip
