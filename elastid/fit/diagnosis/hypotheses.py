r"""HYPOTHESES: every kind of cause that a diagnosis considers, with its usual size, its words and its plausibility.

To add one, write a function and an entry.  An entry may be put into this list, or handed to `identify`:

    def crosstalk(response: HeldResponse) -> dict[str, ComplexArray]:
        "Derivative to the share of motor 1's torque that is logged with that of motor 2."
        return {"crosstalk_2": -response.G @ np.array([[0.0, 0.0], [1.0, 0.0]])}

    MINE = Hypothesis("crosstalk", ("crosstalk",), Size(0.05, 0.5, unit="1"), columns=crosstalk,
                      advice="check the wiring of the current sensors")
    identify(responses, robot, spec, hypotheses=(MINE, *HYPOTHESES))

`hypothesis` describes the fields, `judge` how causes are judged: by the drop of V, the size of the change that it
takes relative to the usual one, and the plausibility of the family.
"""

from __future__ import annotations

import math
from dataclasses import replace

from elastid.fit.diagnosis import phrases
from elastid.fit.diagnosis.hypothesis import SCALE, Hypothesis, Size
from elastid.fit.diagnosis.missing_springs import find_missing_springs
from elastid.fit.diagnosis.phrases import GAIN_U, GAIN_Y
from elastid.fit.diagnosis.readings import READINGS, find_lateness, find_misreading
from elastid.fit.diagnosis.response_columns import (
    channel_delays,
    gear_couplings,
    gear_ratios,
    of_one_posture,
    posture_angles,
    rate_column,
    stiffening,
)
from elastid.fit.diagnosis.variants import find_variants

LATE, RATIO = Size(5e-4, 0.05, unit="s"), Size(0.005, math.log(1.5), True, "1")

HYPOTHESES: tuple[Hypothesis, ...] = (
    # Channels and clocks.
    Hypothesis("gain", ("gain_u",), GAIN_U, True, phrases.gain, phrases.gain_advice),
    Hypothesis("gain", ("gain_y",), GAIN_Y, True, phrases.gain, phrases.gain_advice),
    Hypothesis(
        "rate",
        ("rate",),
        Size(0.005, 0.2, unit="1"),
        phrase=phrases.rate,
        advice="check rate_hz",
        columns=rate_column,
    ),
    Hypothesis(
        "time",
        ("delay", "low", "hold"),
        LATE,
        False,
        phrases.late,
        phrases.late_advice,
        columns=channel_delays,
        search=find_lateness,
    ),
    Hypothesis("time", ("torque", "sensor", "differentiator"), Size(0.3, math.log(10), True)),
    Hypothesis(
        "gear ratio", ("ratio",), RATIO, True, advice="check the ratios in the robot's file", columns=gear_ratios
    ),
    Hypothesis(
        "angle",
        ("angle", "zero"),
        Size(0.02, 0.6, unit="rad"),
        phrase=phrases.angle,
        advice="check the zero of the axis, and the angles that the configurations have",
        columns=posture_angles,
    ),
    Hypothesis(
        "angles by posture",
        ("angles",),
        phrase=phrases.angles,
        advice="check the angles that the configurations have; does its brake hold, and does its encoder slip?",
    ),
    # The robot's file.
    Hypothesis("motor inertia", ("Jm",), phrases.INERTIA, True, advice=phrases.inertia_advice),
    Hypothesis("mass", ("m",), Size(0.05, math.log(3), True)),
    Hypothesis("centre of mass", ("c",), Size(0.01, 0.3)),
    Hypothesis("centre of mass", ("a",), Size(0.05, 0.5)),
    Hypothesis("inertia", ("I",), Size(0.15, math.log(5), True)),
    Hypothesis("stiffness", ("k", "km", "ki", "kc", "k2", "k2s", "k3"), Size(0.3, math.log(30), True)),
    Hypothesis("damping", ("d", "dm", "f", "fm"), Size(0.5, math.log(100), True)),
    Hypothesis("length", ("p", "pj", "p1", "p2", "pc1", "pc2", "l", "L0"), Size(0.005, 0.2)),
    Hypothesis(
        "payload",
        phrase=phrases.payload,
        advice="is a payload forgotten? give it as payload in the robot's file, or check body {where}",
        plausibility=20.0,  # what a robot carries changes, its links do not
        columns=of_one_posture,
    ),
    Hypothesis(
        "payload of one posture",
        phrase=phrases.payload_of_one,
        advice="was it measured with another load? leave it out, or say which configurations carry the payload",
        is_stated=False,
    ),
    Hypothesis(
        "one posture",
        ("delay@", "torques@", "spring@"),
        Size(0.03, 2.0, unit="1"),
        phrase=phrases.of_one_posture,
        advice="check the time stamps and the start of its files; was it measured warm, on another day, or on another "
        "robot? leave it out, or measure it again",
        is_stated=False,
    ),
    # What gears do besides.
    Hypothesis(
        "load",
        ("load",),
        Size(0.1, 1.0, unit="1"),
        phrase=phrases.load,
        advice="does the gear harden, or has it backlash? give its spring cubic or backlash in the robot's file",
        columns=stiffening,
        is_stated=False,
    ),
    Hypothesis(
        "gear coupling",
        ("coupling",),
        Size(0.1, 2.0, unit="1"),
        phrase=phrases.coupling,
        advice="give it as gears in the robot's file",
        columns=gear_couplings,
        is_stated=False,
    ),
    *READINGS,
    Hypothesis(
        SCALE,
        phrase=phrases.scale,
        advice="check unit, scale, side (link or motor) and gear ratio of the channels, and the inertias of the robot",
        search=find_misreading,
    ),
    # What the robot's file lacks.
    Hypothesis(
        "compliance",
        ("torsion", "gear", "base"),
        Size(math.inf, math.inf, unit="rad/(N*m)", grows=True),
        phrase=phrases.compliance,
        advice="add it to the robot's file with a spring, and let elastid compare --search judge it",
        search=find_missing_springs,
    ),
    Hypothesis(
        "gravity",
        phrase="{name} instead of the file's",
        advice="check gravity in the robot's file: how is its base mounted?",
        search=find_variants,
    ),
    Hypothesis(
        "postures",
        phrase="{name}",
        advice="check unit, direction and order of the angles of experiment.configurations against the robot's axes",
    ),
    Hypothesis(
        "side of the gear",
        phrase="{name}",
        advice="the robot's file takes the inertia of a motor on the motor side, in kg*m^2",
    ),
    Hypothesis(
        "side of the encoder",
        phrase="the {name}",
        advice="give its channel the place that it reads, `motor` before the elastic gear or `joint` behind it",
    ),
    Hypothesis(
        "payload of the file",
        phrase="{name}",
        advice="take payload out of the robot's file, or say which configurations carry it",
    ),
    Hypothesis("number", ("*",), Size(0.1, 1.0, True)),
)
# For fits that are compared: those of other robots take longer than the fit, and no status depends on them.
WITHOUT_OTHER_ROBOTS = tuple(h if h.search is not find_variants else replace(h, search=None) for h in HYPOTHESES)
