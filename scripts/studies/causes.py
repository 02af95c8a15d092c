"""Causes of wrong fits for `likeliest_causes`: faults of robots and of measurements at simulated plants.

elastid has a hypothesis for each of INJECTIONS. FURTHER are causes from a later, independent list. A cause without a
right name has no hypothesis: the correct result is doubt. `workshop.py` has typical causes at every plant.
"""

import math
from dataclasses import dataclass
from typing import Any

import measurement_faults as data
import numpy as np
import robot_faults as robot
from study_plants import Fault, Plant

from elastid.response import Response


@dataclass(frozen=True)
class Injection:
    """A cause: a fault at a plant, with its arguments.  right: patterns of the correct names of the cause.

    is_exact: True if the fit uses no tolerances of the robot model.  has_payload: False if the payload is removed from
    the model.  is_off_sheet: True if the robot also differs from its model within the errors of data sheets.
    """

    name: str
    plant: str
    right: tuple[str, ...]
    fault: Fault
    arguments: tuple[Any, ...] = ()
    is_exact: bool = False
    has_payload: bool = True
    is_off_sheet: bool = False

    def responses(self, plant: Plant) -> list[Response]:
        """Return the responses of the plant with the fault, without noise."""
        return self.fault(plant, *self.arguments)


PAYLOAD, ALL_GAINS, EXACT = ("payload_*",), ("gain_u_*", "gain_y_*"), True
BY_DEGREE, ANGLES = math.radians(5), ("angle* configurations*",)
# fmt: off
INJECTIONS: tuple[Injection, ...] = (
    # The robot differs from its robot model.
    Injection("payload 0.5 kg, exact file", "two-axis", PAYLOAD, robot.add_payload, (0.5, (0.6, 0.0, 0.0)), EXACT),
    Injection("payload 3 kg, exact file", "two-axis", PAYLOAD, robot.add_payload, (3.0, (0.6, 0.0, 0.0)), EXACT),
    Injection("payload 5 kg", "two-axis", PAYLOAD, robot.add_payload, (5.0, (0.6, 0.0, 0.05))),
    Injection("payload 3 kg", "demo", PAYLOAD, robot.add_payload, (3.0, (0.9, 0.05, 0.1))),
    Injection("payload 5 kg", "demo", PAYLOAD, robot.add_payload, (5.0, (0.9, 0.1, 0.15))),
    Injection("payload 5 kg, exact file", "linkage", PAYLOAD, robot.add_payload, (5.0, (0.8, 0.13, 0.14)), EXACT),
    Injection("mass of the fore arm 30 % off", "demo", ("m_fore_arm",), robot.scale, (1.3, "m_fore_arm")),
    Injection("inertia of the fore arm doubled", "demo", ("I_fore_arm", "I_fore_arm_[*]"),
              robot.scale, (2.0, "I_fore_arm_xx", "I_fore_arm_yy", "I_fore_arm_zz")),
    Injection("centre of the fore arm 80 mm off", "demo", ("c_fore_arm_x",), robot.shift, (0.08, "c_fore_arm_x")),
    Injection("inertia of motor 2 doubled", "two-axis", ("Jm_2",), robot.scale, (2.0, "Jm_2")),
    Injection("inertia of motor 2 40 % off", "demo", ("Jm_2",), robot.scale, (1.4, "Jm_2")),
    Injection("upper arm 30 mm longer", "demo", ("p_fore_arm_z",), robot.shift, (0.03, "p_fore_arm_z")),
    Injection("zero of axis 2 off by 5 deg, exact file", "two-axis", ("zero_2",),
              robot.shift, (BY_DEGREE, "zero_2"), EXACT),
    Injection("zero of axis 3 off by 5 deg", "demo", ("zero_3",), robot.shift, (BY_DEGREE, "zero_3")),
    Injection("ratio 2 61 for 60, exact file", "two-axis", ("ratio_2",), robot.wrong_ratio, (1, 61 / 60), EXACT),
    Injection("ratio 3 111 for 110", "demo", ("ratio_3",), robot.wrong_ratio, (2, 111 / 110)),
    Injection("missing torsion of the upper arm", "demo", ("torsion_upper_arm_z",), robot.torsion, ("upper_arm", 6e5)),
    Injection("soft base", "demo", ("base_x",), robot.soft_base, ("x", 1e7)),
    Injection("gravity left out", "two-axis", ("no gravity",), robot.set_gravity, (0.0, 0.0, 0.0)),
    Injection("mounted on a wall", "two-axis", ("gravity along -x of the base",), robot.set_gravity, (-9.81, 0.0, 0.0)),
    Injection("mounted on the ceiling", "demo", ("gravity along +z of the base",), robot.set_gravity, (0.0, 0.0, 9.81)),
    Injection("motor 2 turned along by axis 1", "two-axis", ("coupling_2_1",), robot.couple_motors, (6.0, ("2", "1"))),
    Injection("motor 3 turned along by axis 2", "demo", ("coupling_3_2",), robot.couple_motors, (1.1, ("3", "2"))),
    Injection("the file's payload not carried", "six-axis", ("the payload of the file not mounted",), robot.unload),
    # Gears and friction.
    Injection("gear 1 hardens by 10 %", "two-axis", ("load_1",), robot.hardening, (0, 0.1)),
    Injection("gear 2 hardens by 10 %", "demo", ("load_2",), robot.hardening, (1, 0.1)),
    Injection("backlash in gear 2", "demo", ("play_2",), robot.backlash, (1, 0.95)),
    Injection("friction behind gear 2", "two-axis", ("f_2",), robot.shift, (60.0, "f_2")),
    # Channels, clocks and files.
    Injection("torque constant 2 20 % off", "two-axis", ("gain_u_motor_2",),
              data.one_channel, ("u", 1, data.constant(1 / 1.2))),
    Injection("torque constants 20 % off", "demo", ALL_GAINS, data.apply_filter, (data.constant(1 / 1.2),)),
    Injection("torque constant 2 20 % off", "linkage", ("gain_u_motor_3",),
              data.one_channel, ("u", 1, data.constant(1 / 1.2))),
    Injection("rate 2 % off, exact file", "demo", ALL_GAINS, data.wrong_rate, (1.02,), EXACT),
    Injection("low pass of 150 Hz", "demo", ("low_pass",), data.apply_filter, (data.low_pass(150),)),
    Injection("all 0.4 ms late", "two-axis", ("delay",), data.apply_filter, (data.delay(4e-4),)),
    Injection("all 0.4 ms late", "linkage", ("delay",), data.apply_filter, (data.delay(4e-4),)),
    Injection("encoder 2 one sample late", "demo", ("delay_y_motor_2",), data.one_channel, ("y", 1, data.delay(2e-3))),
    Injection("encoder 3 0.5 ms late", "six-axis", ("delay_y_motor_3",), data.one_channel, ("y", 2, data.delay(5e-4))),
    Injection("drive 2 late by 1 ms", "two-axis", ("delay_u_motor_2",), data.one_channel, ("u", 1, data.delay(1e-3))),
    Injection("one file late by 2 ms", "demo", ("delay@folded",),
              data.in_configuration, ("folded", data.apply_filter, data.delay(2e-3))),
    Injection("one file with 5 kg", "demo", ("payload_*@reach",),
              data.in_configuration, ("reach", robot.add_payload, 5.0, (0.9, 0.0, 0.1), 0.02)),
    Injection("exchanged postures", "demo", ("*folded and reach exchanged",), data.swap_names, ("folded", "reach")),
    Injection("one posture 5 deg off", "demo", ("angle_3@folded",),
              data.in_configuration, ("folded", data.change_angles, lambda q: q + np.array([0, 0, BY_DEGREE]))),
    Injection("channels y 1 and 2 exchanged", "two-axis", ("y at motor 1 and at motor 2 exchanged",),
              data.exchange_channels, ((1, 0), (0, 1))),
    Injection("channels u 2 and 3 exchanged", "demo", ("u at motor 2 and at motor 3 exchanged",),
              data.exchange_channels, ((0, 1, 2), (0, 2, 1))),
    Injection("motor 2 mirrored", "demo", ("motor 2 counted in the other direction*",),
              data.scale_channels, ((1, -1, 1), (1, -1, 1))),
    Injection("sign of torque 2", "two-axis", ("u at motor 2 with the other sign",),
              data.one_channel, ("u", 1, data.constant(-1))),
    Injection("angles in degrees", "two-axis", ("y at motor 1 times 0.017*",),
              data.apply_filter, (data.constant(180 / np.pi),)),
    Injection("velocities for accelerations", "two-axis", ("responses differentiated once more in time",),
              data.apply_filter, (lambda s: 1 / s,)),
)
FURTHER: tuple[Injection, ...] = (
    Injection("ratio 2 1 % off", "demo", ("ratio_2",), robot.wrong_ratio, (1, 1.01)),
    Injection("encoders 2 and 3 exchanged", "demo", ("y at motor 2 and at motor 3 exchanged",),
              data.exchange_channels, ((0, 2, 1), (0, 1, 2))),
    Injection("torque constant 3 5 % off", "demo", ("gain_u_motor_3",),
              data.one_channel, ("u", 2, data.constant(1 / 1.05))),
    Injection("payload of 1 kg forgotten", "six-axis", PAYLOAD, robot.add_payload, (1.0, (0.05, 0.02, 0.1)),
              has_payload=False),
    Injection("belts between axes 4 to 6", "six-axis", ("coupling_*",),
              robot.couple_motors, (1.0, ("5", "4"), ("6", "4"), ("6", "5"))),
    Injection("encoder 1 stamped 3 ms early", "demo", ("delay_y_motor_1",),
              data.one_channel, ("y", 0, data.delay(-3e-3))),
    Injection("coarse encoders", "demo", (), data.coarse_encoders, (0.05,)),
    Injection("torque of drive 2 filtered by 60 Hz", "demo", ("low_pass_u_motor_2", "delay_u_motor_2"),
              data.one_channel, ("u", 1, data.inverse_low_pass(60))),
    Injection("all torques filtered by 80 Hz", "two-axis", ("low_pass", "delay"),
              data.apply_filter, (data.inverse_low_pass(80),)),
    Injection("gravity compensation not logged", "two-axis", ("no gravity", "gravity *"), data.gravity_compensation),
    Injection("postures in degrees", "demo", ANGLES, data.change_angles, (np.radians,)),
    Injection("postures taken from degrees twice", "two-axis", ANGLES, data.change_angles, (np.degrees,)),
    Injection("axis 2 counted in the other direction", "demo", ANGLES,
              data.change_angles, (lambda q: q * np.array([1, -1, 1]),)),
    Injection("angles of axes 2 and 3 exchanged", "demo", ANGLES, data.change_angles, (lambda q: q[[0, 2, 1]],)),
    Injection("inertia of motor 1 in kg cm^2", "two-axis", ("Jm_1", "inertia of motor 1*"),
              robot.scale, (1e-4, "Jm_1")),
    Injection("inertia of motor 2 on the link side", "two-axis", ("Jm_2", "inertia of motor 2*"),
              robot.scale, (1 / 3600, "Jm_2")),
    Injection("encoder 2 behind the gear", "demo", ("*behind*",), data.encoder_behind_gear, (1,)),
)
# fmt: on
