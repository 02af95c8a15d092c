"""The sections `friction` and `filter` of a study: experiments, the law that is tested, numbers that are followed."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from elastid.base.names import OptionalName, check_different
from elastid.base.section import Key, section
from elastid.base.units import Frequency, JointPosition, JointTorque, JointVelocity, Mass, Ratio, Time

Part: TypeAlias = Literal["auto", "yes", "no"]


@section
class LawSpec:
    """Parts of a friction law in addition to Coulomb and viscous friction.

    Each part is `no`, `auto`: where the levels determine it (an F test at 1 %, and none of its numbers wider than half
    of itself), or `yes`: without the F test, and an error where the levels cannot determine it.
    """

    # fmt: off
    stribeck: Annotated[Part, Key("Stribeck effect: stiction that falls to Coulomb friction.", "`no` where no pass is "
        "slower than a third of the Stribeck velocity; `yes` where a law without it is of no use, which needs five "
        "speeds.")] = "auto"
    exponent: Annotated[Part, Key("Exponent of the Stribeck curve, 2 unless the levels determine it.", "`no` narrows "
        "stiction by a factor of 1.6 to 4, and is right where a control law assumes 2.")] = "auto"
    quadratic: Annotated[Part, Key("Quadratic friction that grows with v |v|.", "`auto` for fans, oil baths and fast "
        "axes, where friction bends upwards at the top speed; off, since it and viscous friction are strongly "
        "correlated.")] = "no"
    directions: Annotated[Part, Key("Levels and slopes of each direction.", "`no` where a tool holds one number for "
        "both; a difference of slopes then turns up as an offset of the torque. It is tested, since real axes have "
        "it.")] = "auto"
    load: Annotated[Part, Key("Growth of friction with the load.", "`no` for logs whose loads are guesses; `auto` "
        "needs two of them, more than 5 % of the largest apart.")] = "auto"
    temperature: Annotated[Part, Key("Change of friction with temperature.", "`no` for logs of a warm robot whose "
        "thermometer drifts; `auto` needs two temperatures, and three far apart for the decay, which else is held at "
        "20 K.")] = "auto"
    presliding: Annotated[Literal["auto", "lugre", "maxwell_slip", "no"], Key("Law of the joint before it slides that "
        "the robot's file gets; by default Maxwell slip where loops were measured, else LuGre where stiffness and "
        "damping at rest were; `lugre` takes at_rest, not loops.", "`lugre` for tools that know no other; Maxwell slip "
        "has memory of inner loops, which LuGre misses by 16 % of the break-away torque in one case.")] = "auto"
    elements: Annotated[int | None, Key("Number of Maxwell slip elements (default: as few as predict other parts of "
        "the loops as well).", "4 for real-time use, at an error of some 4 % of the break-away torque, 6 and more for "
        "about 1 %.", least=1)] = None
    # fmt: on


@section
class ConstantVelocitySpec:
    """Passes there and back at constant speed, one joint at a time."""

    # fmt: off
    speeds: Annotated[tuple[JointVelocity, JointVelocity] | None, Key("Lowest and highest speed, link side (default: "
        "the slowest without sticking, and the fastest that fits into the window).", "the lowest decides about "
        "stiction: at 0.2 Stribeck velocities stiction above Coulomb is known to 3 %, at 1 only to 48 %; the highest "
        "decides about viscous friction. A lower one needs a stiffer controller, or the joint sticks and "
        "slips.", above=0, rising=True)] = None
    count: Annotated[int, Key("Number of passes of one joint at one load, those at the same speed included.",
        "more for narrower intervals, which shrink with the root; the five numbers of a Stribeck curve need at least "
        "5, and 12 let the law be tested.", least=5)] = 12
    spacing: Annotated[Literal["optimal", "logarithmic"], Key("Spacing of the speeds: `optimal` for the law's numbers "
        "(D-optimal over the guesses of the law), or `logarithmic`.", "`logarithmic` where the robot's file has no "
        "more than a rough guess of friction; `optimal` puts all passes at about five speeds, and shows nothing in "
        "between.")] = "optimal"
    window: Annotated[tuple[JointPosition, JointPosition] | None, Key("Position range [lower, upper] of the joint "
        "(default: the middle half of its limits).", "wide enough for the highest speed to settle, and free of cell "
        "and cables; a slow pass of less than one motor turn cannot average ripple.", rising=True)] = None
    repeat: Annotated[int, Key("Number of runs of the whole set.", "more where levels scatter from run to run: "
        "intervals are widened to that scatter, which after a single run cannot be distinguished from a wrong law. Two "
        "show it at the least cost.", least=1)] = 2
    reference_every: Annotated[Time, Key("Time after which one speed is repeated; its drift is the warm-up.", "shorter "
        "where a joint warms up quickly, longer once the robot is warm; each costs one more pair of passes. 5 minutes "
        "are a small part of the 10 to 60 that a gear takes to warm.", above=0)] = 300.0
    # fmt: on


@section
class LoadSpec:
    """A load under which all passes are repeated: a posture, a payload, or both."""

    # fmt: off
    name: Annotated[OptionalName, Key("Name of the load; logs name it too.", "short, since every "
        "level and figure carries it.")]
    configuration: Annotated[str | None, Key("Posture in which the other joints are held (default: the first of the "
        "experiment).", "postures in which gravity on the joint is small, medium and large give three loads without "
        "any weight.")] = None
    payload: Annotated[Mass, Key("Point mass at the robot's last frame, in addition to the robot's own payload.",
        "for joints whose gravity the posture hardly changes; the robot must carry it for real.", least=0)] = 0.0
    # fmt: on


@section
class PreslidingLoopsSpec:
    """Loops of growing torque that break away only at the end."""

    # fmt: off
    torque: Annotated[tuple[Ratio, Ratio], Key("Smallest and largest amplitude, parts of the break-away torque.",
        "a smaller first part where the encoder is fine, so that the stiffest elements show; with a last one of 1 or "
        "more the joint slides before the end.",
        above=0, rising=True)] = (0.05, 0.95)
    loops: Annotated[int, Key("Number of loops, log spaced.", "more for a finer curve of stiffness over amplitude; 12 "
        "cover 0.05 to 0.95 in steps of 31 %.", least=3)] = 12
    frequency_hz: Annotated[Frequency, Key("Frequency of a loop, slow enough that inertia does not count.",
        "lower where the arm's inertia bends the loops; higher saves time and invites creep and noise less. 0.5 Hz is "
        "a tenth of the first mode of a large robot.", above=0)] = 0.5
    # fmt: on


@section
class PreslidingTestSpec:
    """A multisine of the joint's torque at standstill, whose response gives stiffness and damping of the bristles."""

    # fmt: off
    torque: Annotated[tuple[Ratio, ...], Key("Amplitudes as parts of the Coulomb torque; two and more extrapolate to "
        "none.", "at 0.1 of the Coulomb torque stiffness reads 0.4 % low, at 0.3 already 3 %; smaller where the "
        "encoder resolves it. Two amplitudes are the least that extrapolate to none.")] = (0.05, 0.1)
    band_hz: Annotated[tuple[Frequency, Frequency], Key("Lowest and highest excited frequency.", "upwards until "
        "inertia outweighs the bristles, downwards until drift does; damping needs the high lines.",
        above=0, rising=True)] = (5.0, 80.0)
    # fmt: on

    def __post_init__(self) -> None:
        if not self.torque or not all(0 < part < 1 for part in self.torque):
            raise ValueError("torque: give at least one fraction of the Coulomb torque, above 0 and below 1")


@section
class WarmUpSpec:
    """The joint moves to and fro until it is warm, and passes in between follow its friction."""

    # fmt: off
    speed: Annotated[JointVelocity, Key("Speed of the motion.", "the fastest that the axis may keep up: heat grows "
        "with friction times speed.", above=0)]
    time: Annotated[Time, Key("Duration of the warm-up.", "two to three time constants of the gear, which are 10 to 60 "
        "minutes; shorter leaves the final temperature to extrapolation.")] = 7200.0
    test_every: Annotated[Time, Key("Time between groups of test passes.", "shorter shows the quick beginning; every "
        "group interrupts the heating by its passes.")] = 300.0
    # fmt: on

    def __post_init__(self) -> None:
        if not 0 < self.test_every < self.time:
            raise ValueError(
                f"test_every is {self.test_every:g} s and time {self.time:g} s; tests must come within the warm-up"
            )


@section
class FrictionSpec:
    """Friction of one joint after the other: the experiments that find it, and the law."""

    # fmt: off
    joints: Annotated[tuple[str, ...], Key("Joints by name or number, the first is 1 (default: every driven joint).",
        "name a few where an hour is what is available: each joint takes its own passes, one after the other.")] = ()
    rate_hz: Annotated[Frequency, Key("Sampling rate of the controller and the logs of a design.", "that of the "
        "controller; logs that exist state theirs in experiment.recorded. 1 kHz is enough for passes, which are "
        "evaluated below 60 Hz.", above=0)] = 1000.0
    constant_velocity: Annotated[ConstantVelocitySpec | Literal["detect"] | None, Key("Constant-velocity runs: their "
        "design, or `detect` to find constant velocity in logs.", "give {} to design the runs. Use `detect` for logs "
        "of any motion with stretches of constant velocity.")] = None
    loads: Annotated[tuple[LoadSpec, ...], Key("Loads under which passes are repeated (default: the robot as it is).",
        "two show how levels grow with load, three the Stribeck velocity of it; gravity on the joint must differ "
        "between them, so that a vertical axis has none.")] = ()
    presliding_loops: Annotated[PreslidingLoopsSpec | None, Key("Hysteresis loops of growing torque before the joint "
        "slides.", "give {} to identify a LuGre or Maxwell slip model of small motions. Coulomb friction does not need "
        "it.")] = None
    presliding_test: Annotated[PreslidingTestSpec | None, Key("Small multisine of the torque at zero velocity.", "give "
        "{} if the encoder resolves a tenth of the presliding deflection, typically 1 to 3 counts; otherwise use "
        "presliding_loops.")] = None
    warm_up: Annotated[WarmUpSpec | None, Key("Hours of motion, for friction that falls with temperature (default: "
        "none).", "where friction at two in the afternoon is not that of eight in the morning; it takes hours of the "
        "robot.")] = None
    law: Annotated[LawSpec, Key("Parts of the friction law that are tested.", "switch parts off that later tools "
        "cannot hold; `yes` is a demand, and the fit fails with the reason where the levels cannot determine the "
        "part.")] = LawSpec()
    # fmt: on

    def __post_init__(self) -> None:
        check_different("joints:", self.joints)
        if not all(load.name for load in self.loads):
            raise ValueError("loads: a load has an empty name; give it one, which logs name too")
        check_different("loads:", [load.name for load in self.loads])

    @property
    def designed_passes(self) -> ConstantVelocitySpec:
        """Passes of a design, all by default where none are given."""
        return (
            self.constant_velocity
            if isinstance(self.constant_velocity, ConstantVelocitySpec)
            else ConstantVelocitySpec()
        )


# Numbers that a filter may follow: Coulomb friction, viscous friction, of each direction, and slow torque errors.
Followed: TypeAlias = Literal["Fc", "f", "f+", "f-", "offset"]


@section
class FilterSpec:
    """A Kalman filter that follows friction over the motions of a joint, from motor angle and torque alone."""

    # fmt: off
    states: Annotated[tuple[Followed, ...], Key("States of the filter: Fc (Coulomb friction), f (viscous friction) or "
        "f+ and f- (of each direction), offset (slow error of the torque, as of gravity).", "f+ and f- for axes whose "
        "slopes differ, without offset where gravity is known well; each more widens all where motion is "
        "poor.")] = ("Fc", "f", "offset")
    drift: Annotated[Ratio, Key("Relative change of a number that is expected within 20 minutes, as a random walk.",
        "larger follows faster and scatters more; the report's check of the innovations says which of both it is. 20 % "
        "is a robot that warms up.", above=0)] = 0.2
    correlation_time: Annotated[Time, Key("Correlation time of the torque noise that is not white, 0 for none; ripple "
        "and cables need it.", "the time of a motor turn or of a ripple at working speed, where innovations are "
        "correlated; 0 would trust such logs too much: intervals come out too narrow.", least=0)] = 0.0
    torque_std: Annotated[JointTorque | None, Key("Standard deviation of the torque noise of a sample (default: from "
        "the innovations of up to a minute of the longest motion).", "where that minute is not typical, as with the "
        "robot at rest; larger makes the filter slower and its intervals wider.", above=0)] = None
    settle: Annotated[Time, Key("Time that a filter takes before it is judged.", "longer where the start is far from "
        "the truth, so that the swing-in does not count against the filter. 10 s hold several motions with "
        "reversals.", least=0)] = 10.0
    # fmt: on

    def __post_init__(self) -> None:
        if not self.states:
            raise ValueError("states is empty; follow at least one of Fc, f, f+, f-, offset")
        check_different("states:", self.states)
        if "f" in self.states and {"f+", "f-"} & set(self.states):
            raise ValueError("states: f is viscous friction of both directions; give f, or f+ and f-, not both")
