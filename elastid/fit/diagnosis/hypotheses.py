r"""HYPOTHESES: a row for every kind of cause, with its typical size, sentence, remedy, plausibility and plant.

To add one, write a function and a row (`Hypothesis`), and name the row as an entry point of the group `elastid.causes`:

    def crosstalk(response: ModelResponse) -> dict[str, ComplexArray]:
        "Derivative to the fraction of motor 1's torque that is logged with that of motor 2."
        return {"crosstalk_2": -response.G @ np.array([[0.0, 0.0], [1.0, 0.0]])}

    CROSSTALK = Hypothesis("crosstalk", ("crosstalk",), Size(0.05, 0.5, unit="1"), columns=crosstalk,
                           summary="torque of one motor in the channel of another", advice="check the wiring")

    # pyproject.toml: [project.entry-points."elastid.causes"]  crosstalk = "my_package:CROSSTALK"

`hypothesis` describes the fields. `rank_hypotheses` judges causes by the drop of V, the change relative to a usual
change, and the plausibility of the family.
"""

import math
from dataclasses import replace
from itertools import pairwise

from elastid.base.display import capitalise, percent
from elastid.base.entry_points import registry
from elastid.base.errors import StudyError, did_you_mean
from elastid.fit.diagnosis.alternative_models import find_alternatives
from elastid.fit.diagnosis.channel_hypotheses import CHANNEL_HYPOTHESES, find_channel_error
from elastid.fit.diagnosis.delay_hypotheses import FORMS, find_delays
from elastid.fit.diagnosis.hypothesis import SCALE, Hypothesis, Size, axis_name
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.diagnosis.missing_springs import find_missing_springs
from elastid.fit.diagnosis.priors import relative_change
from elastid.fit.diagnosis.response_derivatives import (
    channel_delays,
    gear_couplings,
    gear_ratios,
    one_posture_values,
    posture_angles,
    stiffening,
)
from elastid.fit.result_rows import ModificationIndex

GAIN_U, GAIN_Y = Size(0.05, math.log(2), True, "1"), Size(0.01, math.log(2), True, "1")
INERTIA = Size(0.05, math.log(3), True)  # of a motor
CHANNELS = "check the torque constants, units and scales of the channels"
GAINS = "check experiment.recorded.controller, or identify it: `--set 'fit.parameters.{name}={{}}'`"
SIGNALS = {"u": "torques", "y": "positions", "r": "references", "kp": "k_p of controllers", "kd": "k_d of controllers"}
DEGREES_LOG = 0.1  # of a scale about pi / 180, within which it is said to be that


def gain_phrase(index: ModificationIndex) -> str:
    """Return the factor by which a channel, or all channels of one kind, read wrongly."""
    _, role, location = index.name.split("_", 2)
    signals, factor = SIGNALS[role], relative_change(index.step)
    if location == "*":
        return f"gain of all {signals} {factor}"
    step = index.step
    size = relative_change(step).lstrip("+-")
    error = f"wrong by {size}" if "factor" in size else f"about {size} too {'large' if step > 0 else 'small'}"
    return f"logged {signals[:-1]} at {location.replace('_', ' ')} {error}"


def angle_phrase(index: ModificationIndex) -> str:
    """Return the offset of an axis, in one configuration or in all."""
    scope = "" if "@" in index.name else " in all configurations"
    return f"angle of axis {axis_name(index)} wrong by {math.degrees(index.step):+.2g} deg{scope}"


def angles_phrase(index: ModificationIndex) -> str:
    """Return the offsets of an axis that differ between configurations, the largest first."""
    by_size = sorted(zip(index.steps.tolist(), index.members, strict=True), key=lambda pair: -abs(pair[0]))
    offsets = ", ".join(
        f"{math.degrees(step):+.2g} deg in {member.partition('@')[2]}" for step, member in by_size[: LIMITS.n_named]
    )
    return f"angles of axis {axis_name(index)} wrong by {offsets}"


def compliance_phrase(index: ModificationIndex) -> str:
    """Return the stiffness of a gear, base or body that is rigid in the robot model."""
    kind, _, location = index.name.partition("_")
    k = 1 / index.changed[0] if index.changed[0] > 0 else math.inf
    if kind == "gear":
        return f"elasticity in the gear of axis {location} of {k:.2g} N*m/rad"
    if kind == "base":
        return f"an elastic base about its {location} axis of {k:.2g} N*m/rad"
    body, _, axis = location.rpartition("_")
    return f"an elastic rotation of body {body} about its {axis} axis of {k:.2g} N*m/rad"


def payload_phrase(index: ModificationIndex) -> str:
    """Return the mass, centre and inertia of a body together; where a mass is added, its place."""
    body, mass, new = axis_name(index), float(index.values[0]), index.changed[0]
    members = zip(index.members, index.values, index.changed, strict=True)
    centre = [f"{(new * c - mass * float(c_0)) / (new - mass):.2g}" for name, c_0, c in members if name[0] == "c"]
    at = f" at about [{', '.join(centre)}] m in the axes of {body}" if new > mass and len(centre) == 3 else ""
    return f"mass of {body} = {new:.4g} kg instead of {mass:.4g} kg ({new - mass:+.2g} kg{at})"


def delay_phrase(index: ModificationIndex) -> str:
    """Return the delay or low pass of a channel, or of the motions relative to the torques."""
    T, name = index.step, index.name.partition("@")[0]
    form = next(form for form in FORMS if name.startswith(form))
    role, _, location = name.removeprefix(form).lstrip("_").replace("_", " ").partition(" ")
    signals, reference = ("motions", "torques") if T > 0 else ("torques", "motions")
    if role == "r":
        signals = f"references{location and f' of {location}'}"
    if form == "delay":
        ms, of = f"{T / 1e-3:.3g} ms", f"the {signals}" if role == "r" else f"{role} at {location}"
        lag = f": {signals} logged {ms.lstrip('-')} later than the {reference}"
        return f"a delay of {ms}{f' of {of}' if role else lag}"
    size = f"a low pass of first order of {abs(T) / 1e-3:.3g} ms ({1 / (2 * math.pi * abs(T)):.3g} Hz)"
    if role in ("", "r"):
        return f"{size} in the log of the {signals}"
    return f"{size} of {role} at {location}{'' if T > 0 else ' that was compensated and does not exist'}"


def scale_phrase(index: ModificationIndex) -> str:
    """Return the factors of channels in another unit."""
    factors = [float(word) for previous, word in pairwise(index.name.replace(",", "").split()) if previous == "times"]
    is_degrees = factors and all(abs(math.log(math.radians(1) / factor)) < DEGREES_LOG for factor in factors)
    return f"{'degrees read as radians' if is_degrees else 'channels in another scale'} ({index.name})"


def load_phrase(index: ModificationIndex) -> str:
    """Return the change of a gear's stiffness with the torque it carries."""
    gear, percent = f"gear {axis_name(index)} whose stiffness increases with torque", 100 * index.step
    if index.name.startswith("play"):
        return f"{gear} above its backlash ({-percent:+.2g} % at the smallest torque of these postures)"
    return f"{gear} ({percent:+.2g} % at the largest torque of these postures)"


def coupling_phrase(index: ModificationIndex) -> str:
    """Return the turns of a motor with another axis."""
    motor, joint = index.name.split("_")[1:3]
    return f"gear coupling of motor {motor} with axis {joint}, {index.step:+.3g} of its ratio"


def one_posture_phrase(index: ModificationIndex) -> str:
    """Return the delay, torques or stiffness of one configuration."""
    if index.name.startswith("delay"):
        return delay_phrase(index)
    quantity = "gain of the torques" if index.name.startswith("torques") else f"stiffness of gear {axis_name(index)}"
    return f"{quantity} {100 * index.step:+.2g} %"


LATE, RATIO = Size(5e-4, 0.05, unit="s"), Size(0.005, math.log(1.5), True, "1")

HYPOTHESES: tuple[Hypothesis, ...] = (
    # Channels and clocks.
    Hypothesis("gain", ("gain_u",), GAIN_U, True, gain_phrase, CHANNELS, "torque constant, unit or scale of a torque",
               "torque constant 2 20 % off"),
    Hypothesis("gain", ("gain_y",), GAIN_Y, True, gain_phrase, CHANNELS, "unit or scale of a position signal"),
    Hypothesis("controller gain", ("gain_kp", "gain_kd"), GAIN_U, True, gain_phrase, GAINS, "gain of a controller"),
    Hypothesis("time", ("delay", "low"), LATE, False, delay_phrase,
               "check time stamps, filters and hold of the channels; state their delay or low_pass_hz, or identify "
               "it: `--set 'fit.parameters.{name}={{}}'`", summary="time delay or low-pass filter of a channel",
               plant="delay left out", columns=channel_delays, search=find_delays),
    Hypothesis("time", ("torque", "sensor", "differentiator"), Size(0.3, math.log(10), True)),
    Hypothesis("gear ratio", ("ratio",), RATIO, True, advice="check the ratios in the robot model",
               summary="gear ratio", plant="gear ratio 1 % wrong", columns=gear_ratios),
    Hypothesis("angle", ("angle", "zero"), Size(0.02, 0.6, unit="rad"), phrase=angle_phrase,
               advice="check the zero of the axis, the angles of the configurations, its brake and its encoder",
               summary="angle of an axis in one configuration, or in all", plant="zero of axis 3 off by 5 deg",
               columns=posture_angles),
    Hypothesis("angles by posture", ("angles",), Size(0.02, 0.6, unit="rad"), phrase=angles_phrase,
               advice="check the angles of the configurations, the brake of the axis and its encoder",
               summary="angles of an axis that differ between configurations", plant="angles of an axis"),
    # The robot's file.
    Hypothesis("motor inertia", ("Jm",), INERTIA, True, summary="inertia of a motor",
               plant="inertia of motor 2 doubled"),
    Hypothesis("mass", ("m",), Size(0.05, math.log(3), True), summary="mass of a body", plant="link mass +5 %"),
    Hypothesis("centre of mass", ("c",), Size(0.01, 0.3, unit="m"), summary="centre of mass of a body",
               plant="centre of the fore arm 80 mm off"),
    Hypothesis("centre of mass", ("a",), Size(0.05, 0.5, unit="m")),
    Hypothesis("inertia", ("I",), Size(0.15, math.log(5), True), summary="inertia of a body", plant="inertia +20 %"),
    Hypothesis("stiffness", ("k", "km", "ki", "kc", "k2", "k2s", "k3"), Size(0.3, math.log(30), True),
               summary="fixed stiffness"),
    Hypothesis("damping", ("d", "dm", "f", "fm"), Size(0.5, math.log(100), True),
               summary="fixed damping or viscous friction", plant="friction behind gear 2"),
    Hypothesis("length", ("p", "pj", "p1", "p2", "pc1", "pc2", "l", "L0"), Size(0.005, 0.2, unit="m"),
               summary="length or position of a joint", plant="link length"),
    # Plausibility: payloads change, links do not.
    Hypothesis("payload", phrase=payload_phrase,
               advice="correct mass and centre of body {where}, or state the payload that it carries",
               summary="payload that the robot model lacks", plant="payload 5 kg", plausibility=20.0,
               columns=one_posture_values),
    Hypothesis("payload of one posture", phrase=payload_phrase,
               advice="state the payload of each configuration (without_payload), or exclude the configuration",
               summary="payload of one configuration", plant="one file with 5 kg", is_stated=False),
    Hypothesis("one posture", ("delay@", "torques@", "spring@"), Size(0.03, 2.0, unit="1"),
               phrase=one_posture_phrase,
               advice="check time stamps and start of its files, and whether robot, day and temperature are the "
                      "same; else exclude or repeat it",
               summary="delay, torque scale or stiffness of one configuration", plant="soft day", is_stated=False),
    # Effects of gears.
    Hypothesis("load", ("load", "play"), Size(0.1, 1.0, unit="1"), phrase=load_phrase,
               advice="give the spring of the gear cubic (hardening) or backlash in the robot model",
               summary="stiffness of a gear that increases with its torque", plant="gear 2 hardens by 10 %",
               columns=stiffening, is_stated=False),
    Hypothesis("gear coupling", ("coupling",), Size(0.1, 2.0, unit="1"), phrase=coupling_phrase,
               advice="add the coupling as gears in the robot model", summary="gear coupling between axes",
               plant="motor 3 turned along by axis 2", columns=gear_couplings, is_stated=False),
    *CHANNEL_HYPOTHESES,
    Hypothesis(SCALE, phrase=scale_phrase,
               advice="check unit, scale, side (link or motor) and gear ratio of the channels, and the inertias of "
                      "the robot", summary="channels in another unit", plant="torque constants 20 % off",
               search=find_channel_error),
    # Effects that the robot model lacks.
    Hypothesis("compliance", ("torsion", "gear", "base"), Size(math.inf, math.inf, unit="rad/(N*m)", grows=True),
               phrase=compliance_phrase,
               advice="add it to the robot model with a spring, and compare: `elastid compare STUDY --search`",
               summary="missing elasticity of a gear, a body or the base", plant="missing torsion",
               search=find_missing_springs),
    Hypothesis("gravity", phrase="{name} instead of the stated gravity",
               advice="check gravity in the robot model, and the mounting of the base",
               summary="direction of gravity", plant="ceiling", search=find_alternatives),
    Hypothesis("postures", phrase="{name}",
               advice="check unit, direction and order of the angles in experiment.configurations",
               summary="unit, direction or order of all angles", plant="degrees"),
    Hypothesis("side of the gear", phrase="{name}",
               advice="give the inertia of a motor on the motor side in the robot model, in kg*m^2",
               summary="inertia of a motor on the other side of the gear", plant="rotors on the link side"),
    Hypothesis("side of the encoder", phrase="the {name}",
               advice="correct the location of its channel: motor before the elastic gear, joint behind it",
               summary="encoder on the other side of the gear", plant="behind the gear"),
    Hypothesis("payload of the file", phrase="{name}",
               advice="remove payload from the robot model, or list the configurations without it (without_payload)",
               summary="payload of the robot model that is not carried", plant="the file's payload not carried"),
    Hypothesis("number", ("*",), Size(0.1, 1.0, True)),
)  # fmt: skip
GROUP = "elastid.causes"


def all_hypotheses() -> tuple[Hypothesis, ...]:
    """Return the rows of other packages (entry points of GROUP), then HYPOTHESES.

    Raises StudyError for a row that cannot be loaded.
    """
    return (*registry(GROUP, Hypothesis), *HYPOTHESES)


def explain_causes(family: str = "") -> str:
    """Explain the hypotheses of a family, or all: error, typical size and remedy. StudyError for an unknown family."""
    rows = [row for row in all_hypotheses() if row.summary and family in ("", row.family)]
    if not rows:
        families = dict.fromkeys(row.family for row in all_hypotheses() if row.summary)
        raise StudyError("study/unknown-key", f"no cause '{family}'; {did_you_mean(family, tuple(families))}")
    return "\n".join(f"{row.family}: {row.summary}\n  {_typical(row)}{capitalise(_remedy(row))}." for row in rows)


def _typical(row: Hypothesis) -> str:
    size = row.size.usual
    if not row.numbers or math.isinf(size):
        return ""
    is_relative = row.size.log or row.size.unit == "1"
    return f"Typical error: {percent(size) if is_relative else f'{size:g} {row.size.unit}'}. "


def _remedy(row: Hypothesis) -> str:
    advice = row.advice or "correct the value in the robot model, or estimate it with a prior"
    return advice.format(name="NAME", where="NAME", usual=row.size.usual, size="")


# For compared fits: hypotheses of other robots take longer than the fit, and no status depends on them.
WITHOUT_OTHER_ROBOTS = tuple(h if h.search is not find_alternatives else replace(h, search=None) for h in HYPOTHESES)
