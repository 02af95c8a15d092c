"""The sections `friction` and `filter` of a study: experiments, the law that is tested, numbers that are followed."""

from typing import Annotated, Literal, TypeAlias

from elastid.base.names import OptionalName, check_different
from elastid.base.section import Key, section
from elastid.base.units import Frequency, JointPosition, JointTorque, JointVelocity, Mass, Ratio, Time

Part: TypeAlias = Literal["auto", "yes", "no"]


@section
class LawSpec:
    """Parts of a friction law in addition to Coulomb and viscous friction.

    Each part is `no`, `auto` (included if an F test at 1 % is significant and each std is below half of its value), or
    `yes` (included without the F test; an error if the friction torques do not identify it).
    """

    # fmt: off
    stribeck: Annotated[Part, Key("Stribeck effect: stiction decreases to Coulomb friction.", "`no` if no run is "
        "slower than a third of the Stribeck velocity; `yes` needs five speeds.")] = "auto"
    exponent: Annotated[Part, Key("Exponent of the Stribeck curve, 2 unless it is identifiable.", "`no` narrows the "
        "interval of stiction by a factor of 1.6 to 4.")] = "auto"
    quadratic: Annotated[Part, Key("Quadratic friction, proportional to v |v|.", "`auto` for fans, oil baths and fast "
        "axes; it is strongly correlated with viscous friction.")] = "no"
    directions: Annotated[Part, Key("Separate Coulomb and viscous friction for each direction.", "`no` if a later tool "
        "accepts one value only; a difference then appears as a torque offset.")] = "auto"
    load: Annotated[Part, Key("Load-dependent friction.", "`auto` needs two loads that differ by more than 5 % of the "
        "largest; `no` if the loads are guesses.")] = "auto"
    temperature: Annotated[Part, Key("Temperature-dependent friction.", "`auto` needs two temperatures, and three to "
        "identify the decay, which is otherwise fixed at 20 K.")] = "auto"
    presliding: Annotated[Literal["auto", "lugre", "maxwell_slip", "no"], Key("Presliding model (default: Maxwell slip "
        "from presliding_loops, else LuGre from presliding_test).", "`lugre` for tools that know no other model; "
        "Maxwell slip also has the memory of inner loops.")] = "auto"
    elements: Annotated[int | None, Key("Number of Maxwell slip elements (default: by cross-validation over the "
        "loops).", "4 for real-time use, at an error of 4 % of the break-away torque; 6 and more for about "
        "1 %.", least=1)] = None
    # fmt: on


@section
class ConstantVelocitySpec:
    """Passes there and back at constant speed, one joint at a time."""

    # fmt: off
    speeds: Annotated[tuple[JointVelocity, JointVelocity] | None, Key("Lowest and highest link-side speed (default: "
        "slowest without stick-slip, fastest within the window).", "lower speeds identify stiction (to 3 % at 0.2 "
        "Stribeck velocities), higher speeds viscous friction.", above=0, rising=True)] = None
    count: Annotated[int, Key("Number of runs of one joint at one load.", "more for narrower intervals; 12 also test "
        "the friction model.", least=5)] = 12
    spacing: Annotated[Literal["optimal", "logarithmic"], Key("Spacing of the speeds: D-optimal for the friction "
        "model, or logarithmic.", "`logarithmic` if the friction of the robot model is a rough guess.")] = "optimal"
    window: Annotated[tuple[JointPosition, JointPosition] | None, Key("Position range of the joint (default: middle "
        "half of its limits).", "wide enough for the highest speed, free of obstacles; at least one motor turn "
        "averages the ripple.", rising=True)] = None
    repeat: Annotated[int, Key("Number of repetitions of the whole set.", "more if torques scatter between "
        "repetitions; the intervals include this scatter.", least=1)] = 2
    reference_every: Annotated[Time, Key("Time between runs at one reference speed, whose drift is the warm-up.",
        "shorter for a joint that warms up quickly.", above=0)] = 300.0
    # fmt: on


@section
class LoadSpec:
    """A load under which all passes are repeated: a posture, a payload, or both."""

    # fmt: off
    name: Annotated[OptionalName, Key("Name of the load; logs name it too.", "short, since every "
        "table and figure states it.")]
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
    torque: Annotated[tuple[Ratio, Ratio], Key("Smallest and largest amplitude, as fractions of the break-away torque.",
        "a smaller first amplitude for a fine encoder.", above=0, rising=True)] = (0.05, 0.95)
    loops: Annotated[int, Key("Number of loops, log spaced.", "more for a finer stiffness curve.", least=3)] = 12
    frequency_hz: Annotated[Frequency, Key("Frequency of a loop.", "lower if the inertia of the arm distorts the "
        "loops; higher reduces creep and noise.", above=0)] = 0.5
    # fmt: on


@section
class PreslidingTestSpec:
    """Multisine of the joint torque at zero velocity; its response gives the presliding stiffness and damping."""

    # fmt: off
    torque: Annotated[tuple[Ratio, ...], Key("Amplitudes relative to the Coulomb torque; from two amplitudes, elastid "
        "extrapolates to zero.", "at 0.1 the stiffness is 0.4 % too low, at 0.3 by 3 %. Lower it if the encoder "
        "resolves the motion.", above=0, below=1,
        filled=True)] = (0.05, 0.1)
    band_hz: Annotated[tuple[Frequency, Frequency], Key("Lowest and highest excited frequency.", "upwards until "
        "inertia outweighs the bristles, downwards until drift does; damping needs the high lines.",
        above=0, rising=True)] = (5.0, 80.0)
    # fmt: on


@section
class WarmUpSpec:
    """The joint moves to and fro until it is warm, and passes in between follow its friction."""

    # fmt: off
    speed: Annotated[JointVelocity, Key("Speed of the motion.", "the fastest continuous speed of the axis.", above=0)]
    time: Annotated[Time, Key("Duration of the warm-up.", "two to three thermal time constants of the gear, which are "
        "10 to 60 minutes.")] = 7200.0
    test_every: Annotated[Time, Key("Time between groups of test runs.", "shorter resolves the fast initial "
        "change.")] = 300.0
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
        "name a few to save time: joints are measured one after the other.")] = ()
    rate_hz: Annotated[Frequency, Key("Sampling rate of controller and logs of a design.", "the controller's rate; "
        "runs are evaluated below 60 Hz.", above=0)] = 1000.0
    constant_velocity: Annotated[ConstantVelocitySpec | Literal["detect"] | None, Key("Constant-velocity runs: their "
        "design, or `detect` to find constant velocity in logs (default: no such runs).", "give {} to design the runs. "
        "Use `detect` for logs of any motion with stretches of constant velocity.")] = None
    loads: Annotated[tuple[LoadSpec, ...], Key("Loads under which all runs are repeated (default: the robot as it "
        "is).", "two identify load-dependent Coulomb friction, three also its Stribeck velocity; the gravity torque "
        "must differ.")] = ()
    presliding_loops: Annotated[PreslidingLoopsSpec | None, Key("Hysteresis loops of growing torque before the joint "
        "slides (default: no loops).", "give {} to identify a LuGre or Maxwell slip model of small motions. Coulomb "
        "friction does not need it.")] = None
    presliding_test: Annotated[PreslidingTestSpec | None, Key("Small multisine of the torque at zero velocity "
        "(default: no such test).", "give {} if the encoder resolves a tenth of the presliding deflection, typically 1 "
        "to 3 counts; otherwise use presliding_loops.")] = None
    warm_up: Annotated[WarmUpSpec | None, Key("Warm-up: hours of motion, for temperature-dependent friction (default: "
        "no warm-up).", "give it if friction changes during a shift; it takes hours of robot time.")] = None
    law: Annotated[LawSpec, Key("Terms of the friction model that are tested.", "switch off terms that later tools "
        "cannot represent; `yes` fails if the term is not identifiable.")] = LawSpec()
    # fmt: on

    def __post_init__(self) -> None:
        check_different("joints:", self.joints)
        if not all(load.name for load in self.loads):
            raise ValueError("loads: the name of a load is empty. Give the name that the logs use")
        check_different("loads:", [load.name for load in self.loads])

    @property
    def designed_passes(self) -> ConstantVelocitySpec:
        """Constant-velocity runs of a design, by default with default keys."""
        runs = self.constant_velocity
        return runs if isinstance(runs, ConstantVelocitySpec) else ConstantVelocitySpec()


# Numbers that a filter may follow: Coulomb friction, viscous friction, of each direction, and slow torque errors.
Followed: TypeAlias = Literal["Fc", "f", "f+", "f-", "offset"]


@section
class FilterSpec:
    """A Kalman filter that follows friction over the motions of a joint, from motor angle and torque alone."""

    # fmt: off
    states: Annotated[tuple[Followed, ...], Key("States of the filter: Fc (Coulomb friction), f (viscous friction) or "
        "f+ and f- (of each direction), offset (slow torque error).", "f+ and f- for axes with different slopes; each "
        "further state widens all intervals.", filled=True)] = ("Fc", "f", "offset")
    drift: Annotated[Ratio, Key("Expected relative change of a state within 20 minutes, as a random walk.", "a larger "
        "value tracks faster and scatters more; the report's innovation test shows which.", above=0)] = 0.2
    correlation_time: Annotated[Time, Key("Correlation time of the torque noise, 0 for white noise.", "the time of a "
        "motor turn or ripple period if innovations are correlated.", least=0)] = 0.0
    torque_std: Annotated[JointTorque | None, Key("Standard deviation of the torque noise per sample (default: from "
        "the innovations of one minute of the longest motion).", "give it if that minute is not typical.",
        above=0)] = None
    settle: Annotated[Time, Key("Settling time of the filter before it is assessed.", "longer if the start values are "
        "far off.", least=0)] = 10.0
    # fmt: on

    def __post_init__(self) -> None:
        check_different("states:", self.states)
        if "f" in self.states and {"f+", "f-"} & set(self.states):
            raise ValueError("states: f is viscous friction of both directions; give f, or f+ and f-, not both")
