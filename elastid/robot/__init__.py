"""Robot: a tree of rigid bodies with joints, springs, gears, motors and loops, as numbers without equations.

The frame of a body follows from its parent's frame by its placement and then its joints in order: rotations about, or
translations along, axes of the previous frame. A joint is

- driven through an elastic gear:  motor and spring   (coordinates q_a and q_m)
- driven rigidly:                  motor, no spring   (one coordinate)
- elastic, not driven:             spring, no motor   (q_na of the extended flexible joint; 0 without load)
- passive:                         neither (moved by gravity or by a loop)

Loops close the tree: two points of bodies that coincide, are pinned, or are joined by a rod. A compensator is a coil or
gas spring between points of two bodies, which supports part of the weight.

Stiffness and damping of a joint are link-side values. Inertia, friction and shaft of a motor are motor-side values, as
in data sheets. The ratio is motor revolutions per joint revolution, negative for opposite directions. For a translation
the stiffness is in N/m and the ratio in rad/m. Couplings of axes are in `gears`. If a motor is carried by a body, the
kinetic energy of its rotor includes the rotation of this body.

Every number that can be identified has a name:

- k_1, d_1 (spring of joint 1); k2_1, k2s_1, k3_1 (polynomial); b_1, ki_1, e_1 (backlash: half gap, stiffness inside,
  rounding); f_1 (viscous friction of joint 1); Jm_1, fm_1 (inertia and viscous friction of its motor); km_1, dm_1
  (shaft)
- kc_cyl, L0_cyl (coil of compensator cyl); F0_cyl, L0_cyl, h0_cyl, kappa_cyl (gas: force and column at length L0,
  exponent)
- m_arm, c_arm_x, I_arm_xx, or I_arm for an isotropic inertia; m_payload, c_payload_x, I_payload
- m_l, a_l (location of the centre of mass), I_l, k_l, d_l (rod of loop l)
- geometry in m, only if a study names it: p_arm_x (placement of body arm), pj_1_x (point on the axis of joint 1),
  pc1_cyl_x, pc2_cyl_x (ends of compensator cyl), p1_l_x, p2_l_x, l_l (ends and rod of loop l); zero_1 in rad (zero
  offset)
- gains of channels, only if a study names them: gain_y_joint_1, gain_u_motor_1
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
