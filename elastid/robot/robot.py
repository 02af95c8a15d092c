"""Robot: tree of bodies, loops, attached components, and checks of their consistency."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Annotated, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen
from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import StudyError, UnknownNameError, did_you_mean
from elastid.base.names import Name, check_different
from elastid.base.section import Key, section
from elastid.robot.body import BASE, TENSOR_LETTERS, TOOL, Body, Frame, Payload
from elastid.robot.connections import Compensator, Loop
from elastid.robot.gears import Gearbox, GearCouplings, check_gears, check_series, gearboxes, mixing
from elastid.robot.joint import Joint
from elastid.robot.measurement_chain import CHANNEL_NUMBERS, Chain, Channel
from elastid.robot.placement import Acceleration3, Numbers, Path, Placement, below, number_at, replaced
from elastid.robot.tolerances import FileTolerances, Tolerances


def check_unique_names(robot: "Robot") -> None:
    """Raise ValueError for duplicate names of one kind, and for a body with the name of the base."""
    bodies = [body.name for body in robot.all_bodies]
    for name in bodies:
        if name.casefold() == BASE:
            raise ValueError(f"body {name}: this name is reserved for the base. Rename the body")
    check_different("body", bodies)
    for kind, items in (
        ("joint", robot.joints), ("frame", robot.frames), ("loop", robot.loops), ("compensator", robot.compensators)
    ):  # fmt: skip
        check_different(kind, [item.name for item in items])
    masses = [*bodies, *(loop.name for loop in robot.loops)]
    for name in masses:
        stem, _, letters = name.rpartition("_")
        if letters in TENSOR_LETTERS and stem in masses:
            raise ValueError(f"body {name}: its inertia I_{name} has the name of an entry of body {stem}; rename one")


def check_body_exists(owner: str, name: str, robot: "Robot") -> None:
    """Raise ValueError unless the name is the base or a body of the tree."""
    names = [BASE, *(body.name for body in robot.bodies)]
    if name not in names:
        raise ValueError(f"{owner}: no body is called {name}; {did_you_mean(name, names)}")


def check_loops(robot: "Robot") -> None:
    """Raise ValueError unless loops join existing bodies and have unique names among bodies, joints and loops."""
    names = [*(body.name for body in robot.bodies), *(joint.name for joint in robot.joints)]
    for loop in robot.loops:
        for end in loop.ends:
            check_body_exists(f"loop {loop.name}", end.body, robot)
        if loop.name in names:
            raise ValueError(
                f"loop {loop.name}: a body, joint or loop has this name; its parameters need a name of their own"
            )
        names.append(loop.name)


def check_carrier(joint: Joint, robot: "Robot") -> None:
    """Raise ValueError unless the motor is on a body between base and joint, or on a body that its joint moves."""
    carrier = joint.motor.on if joint.motor is not None else ""
    if carrier in ("", BASE):
        return
    check_body_exists(f"joint {joint.name}: motor.on", carrier, robot)
    carried_by: dict[str, list[str]] = {BASE: []}
    for body in robot.bodies:
        carried_by[body.name] = [*carried_by[body.parent], body.name]
    body_of_joint = next(body.name for body in robot.bodies if joint in body.joints)
    candidates = [
        body for body, path in carried_by.items() if body_of_joint in path or body in carried_by[body_of_joint]
    ]
    if carrier not in candidates:
        raise ValueError(
            f"joint {joint.name}: its motor is on {carrier}, in a branch without this joint. Possible bodies: "
            f"{', '.join([BASE, *candidates])}"
        )


def check_tolerances(robot: "Robot") -> None:
    """Raise ValueError for tolerances of a body, loop or payload that the robot does not have."""
    names = [*(body.name for body in robot.all_bodies), *(loop.name for loop in robot.loops)]
    for entry in robot.tolerances.bodies if isinstance(robot.tolerances, Tolerances) else ():
        if entry.name not in names:
            raise ValueError(f"tolerances: no body is called {entry.name}; {did_you_mean(entry.name, names)}")


# Translation of a frame's origin along its axes, and rotation about them.
FRAME_AXES = ("x", "y", "z", "rx", "ry", "rz")


def split_location(location: str) -> tuple[str, str, str]:
    """Return kind, name and axis of a location on a body or a frame, such as `frame tool rz`."""
    kind, _, axis_name = location.partition(" ")
    name, _, axis = axis_name.rpartition(" ")
    return kind, name, axis


# Keys that all forms of a robot have.
# fmt: off
Gravity: TypeAlias = Annotated[Acceleration3, Key("Acceleration of gravity in the base frame.", "change it for a robot "
    "on a wall or ceiling, unless `base` is rotated; [0, 0, 0] removes gravity from springs and postures.")]
Frames: TypeAlias = Annotated[tuple[Frame, ...], Key("Named frames fixed to bodies, such as the tool.", "one for each "
    "sensor or marker, and `tool` for the payload.")]
OptionalPayload: TypeAlias = Annotated[Payload | None, Key("Payload at one of the frames or bodies (default: no "
    "payload).", "change it instead of the last link for another tool, since the payload has its own parameters.")]
Source: TypeAlias = Annotated[str, Key("Source of the robot's numbers, as free text (default: no source).", "give "
    "paper and table, date of a measurement, or the word synthetic; exports include it.")]
RobotTolerances: TypeAlias = Annotated[FileTolerances, Key("Prior standard deviations of the values in this file: `{}` "
    "for typical ones, or `exact` (default: typical for measured data, exact for a simulated robot unless `truth` "
    "changes such a value).", "`exact` only if all numbers were identified or calibrated; otherwise the intervals "
    "include the tolerances.")]
# fmt: on


@section
class Robot:
    """Tree of bodies with joints, closed into loops, and all attached components.

    The parameters are keys of `robot` (`elastid explain robot`).

    Raises
    ------
    ValueError
        For duplicate names, unknown parents or frames, a robot without a motor, a motor on an impossible body, or gear
        couplings with a singular matrix.

    Examples
    --------
    >>> from elastid import Body, Joint, Motor, Spring
    >>> joint = Joint("1", spring=Spring(100.0, damping=0.1), motor=Motor(0.01))
    >>> robot = Robot("bench", (Body("load", joints=(joint,), inertia=0.02),))
    >>> robot.motor_locations
    ('motor 1',)
    """

    # fmt: off
    name: Annotated[Name, Key("Name of the robot.", "choose a new name for each set of numbers, so that reports are "
        "not confused.")]
    bodies: Annotated[tuple[Body, ...], Key("Rigid bodies of the robot, each listed after its parent.", "one per part "
        "that moves separately; springs in series are joints of one body.")]
    gravity: Gravity = (0.0, 0.0, -9.81)
    source: Source = ""
    frames: Frames = ()
    payload: OptionalPayload = None
    loops: Annotated[tuple[Loop, ...], Key("Closed loops: connections between bodies beyond the tree.",
        "for parallel linkages and closed gears; omit them in a first serial fit.")] = ()
    compensators: Annotated[tuple[Compensator, ...], Key("Gravity compensators: coil or gas springs that support part "
        "of the weight.", "give every compensator; otherwise the fit attributes its stiffness to the gear of the "
        "axis.")] = ()
    gears: GearCouplings = ()
    chain: Annotated[Chain, Key("Measurement chain: lags and gains of drives, sensors and filters.", "if the phase "
        "falls faster with frequency than the delay explains.")] = Chain()
    tolerances: RobotTolerances = None
    # fmt: on

    def __post_init__(self) -> None:
        check_unique_names(self)
        names = [BASE]
        for body in self.bodies:
            if body.parent not in names:
                raise ValueError(
                    f"body {body.name}: its parent {body.parent} is not listed before it; there are {', '.join(names)}"
                )
            names.append(body.name)
        for frame in self.frames:
            check_body_exists(f"frame {frame.name}", frame.body, self)
        for compensator in self.compensators:
            for end in compensator.ends:
                check_body_exists(f"compensator {compensator.name}", end.body, self)
        check_loops(self)
        if not self.driven:
            raise ValueError(f"robot {self.name}: no joint has a motor; there is nothing to excite")
        for joint in self.driven:
            check_carrier(joint, self)
        check_gears(self.driven, self.gears)
        check_series(self.driven, self.gearboxes)
        self.chain.check_locations(self.motor_locations, self.locations)
        check_tolerances(self)

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Number of components, and the joints with motor and spring."""
        counts = (
            (len(self.bodies), "bodies"), (self.n_u, "motors"), (len(self.loops), "loops"),
            (len(self.compensators), "compensators"), (len(self.gears), "gear couplings")
        )  # fmt: skip
        words = [f"{n} {noun if n > 1 else noun.replace('ies', 'y').rstrip('s')}" for n, noun in counts if n]
        load = [] if self.payload is None else [f"payload {self.payload.mass:g} kg"]
        rows = [(joint.name, body.name, *joint.cells) for body in self.bodies for joint in body.joints]
        headings = ("joint", "moves", "axis", "gear ratio", "stiffness", "damping")
        return Display(f"Robot {self.name}: {', '.join([*words, *load])}", headings, rows)

    @cached_property
    def all_bodies(self) -> tuple[Body, ...]:
        """The bodies and, last, the payload."""
        if self.payload is None:
            return self.bodies
        mount = self.payload.at
        bodies = {body.name: (body.name, Placement()) for body in self.bodies}
        seats = bodies | {frame.name: (frame.body, frame.placement) for frame in self.frames}
        if mount not in seats:
            raise ValueError(f"payload: {mount} is no frame or body. There are {', '.join(seats)}")
        return (*self.bodies, self.payload.body(*seats[mount]))

    def carrying(self, carries: bool) -> "Robot":
        """Return the robot with its payload, or without it."""
        return self if carries or self.payload is None else replace(self, payload=None)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """All joints, in the order of the tree: the link coordinates q_l."""
        return tuple(joint for body in self.bodies for joint in body.joints)

    @cached_property
    def n_l(self) -> int:
        """The number of joints."""
        return len(self.joints)

    @cached_property
    def driven(self) -> tuple[Joint, ...]:
        """The joints with a motor, in order: inputs, and the angles of a configuration."""
        return tuple(self.joints[i] for i in self.driven_indices)

    @cached_property
    def n_u(self) -> int:
        """The number of motors."""
        return len(self.driven)

    @cached_property
    def driven_names(self) -> tuple[str, ...]:
        """The names of the joints with a motor, in order."""
        return tuple(joint.name for joint in self.driven)

    @cached_property
    def driven_indices(self) -> tuple[int, ...]:
        """The index of each driven joint among all joints, in order."""
        return tuple(i for i, joint in enumerate(self.joints) if joint.motor is not None)

    def joint_positions(self, angles: FloatArray) -> FloatArray:
        """Return the joints (..., n_l) at the driven joints' angles (..., n_u), all others at 0."""
        q = np.zeros((*angles.shape[:-1], self.n_l))
        q[..., list(self.driven_indices)] = angles
        return q

    @cached_property
    def flexible(self) -> tuple[Joint, ...]:
        """The driven joints with an elastic gear, in order: the motor coordinates q_m.

        Elastic by their own spring, or by a spring before a coupling with another motor.
        """
        elastic = {i for box in self.gearboxes for i in box.gears}
        return tuple(joint for i, joint in enumerate(self.driven) if i in elastic)

    @property
    def motor_locations(self) -> tuple[str, ...]:
        """`motor <joint>` of each motor: the inputs, and the outputs unless a study says otherwise."""
        return tuple(f"motor {joint.name}" for joint in self.driven)

    @cached_property
    def gearboxes(self) -> tuple[Gearbox, ...]:
        """Elastic gears; gears with a common spring are in one gearbox."""
        return gearboxes(self.driven, self.gears)

    @cached_property
    def mixing(self) -> FloatArray:
        """E (n_u, n_u) of eta = diag(ratio) E, the identity without couplings.

        For motor angles and torques referred to the link side by the ratios: q_m' = E q_a, tau_a = E^T tau_m'.
        """
        return frozen(mixing(self.driven, self.gears))

    @cached_property
    def eta(self) -> FloatArray:
        """The matrix of gear ratios (n_u, n_u): q_m = eta q_a from the link side to the motors, tau_a = eta^T tau_m."""
        return frozen(np.array([[self.ratio(joint.name)] for joint in self.driven]) * self.mixing)

    def ratio(self, joint: str) -> float:
        """Return gear ratio of the motor of a joint; raise UnknownNameError for an undriven joint."""
        ratios = {driven.name: driven.motor.ratio for driven in self.driven if driven.motor is not None}
        if joint in ratios:
            return ratios[joint]
        raise UnknownNameError(f"joint {joint} has no motor; driven joints: {', '.join(self.driven_names)}")

    def count_refusal(self, count: int, noun: str = "angles") -> str:
        """Return why a number of values does not match the driven joints; empty if it does."""
        joints = f"{self.n_u} driven joints ({', '.join(self.driven_names)})"
        return "" if count == self.n_u else f"{count} {noun} for {joints} of robot {self.name}; give one for each"

    def check_location(self, location: str) -> None:
        """Raise StudyError with all locations for an unknown location."""
        if location not in self.locations:
            raise StudyError(
                "robot/unknown-name",
                f"'{location}' is not a place on robot {self.name}; there are {', '.join(self.locations)}",
            )

    @cached_property
    def locations(self) -> tuple[str, ...]:
        """All locations of signals on the robot."""
        return (
            *(f"motor {joint.name}" for joint in self.driven),
            *(f"joint {joint.name}" for joint in self.joints),
            *(f"body {body.name} {axis}" for body in self.all_bodies for axis in "xyz"),
            *(f"frame {frame.name} {axis}" for frame in self.frames for axis in FRAME_AXES),
            *(f"accelerometer {frame.name} {axis}" for frame in self.frames for axis in "xyz"),
        )

    @cached_property
    def load_locations(self) -> tuple[str, ...]:
        """Inputs at frames: forces along their axes, and torques about them."""
        return tuple(
            f"{kind} {frame.name} {axis}" for kind in ("force", "torque") for frame in self.frames for axis in "xyz"
        )

    def slides(self, location: str) -> bool:
        """Return True for locations in m or N: a sliding joint, its motor, the origin of a frame, a force."""
        kind, _, rest = location.partition(" ")
        if kind in ("motor", "joint"):
            return any(joint.slides for joint in self.joints if joint.name == rest)
        return kind in ("accelerometer", "force") or (kind == "frame" and rest.rpartition(" ")[2] in ("x", "y", "z"))

    def sliding(self, locations: Iterable[str]) -> tuple[str, ...]:
        """Return the locations in m or N among `locations`."""
        return tuple(dict.fromkeys(location for location in locations if self.slides(location)))

    @cached_property
    def branches(self) -> tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]:
        """Branches of each loop: joints from each end to the last common body, nearest to the end first."""
        paths: dict[str, tuple[int, ...]] = {BASE: ()}
        count = 0
        for body in self.bodies:
            paths[body.name] = (*paths[body.parent], *range(count, count := count + len(body.joints)))
        return tuple(
            (tuple(i for i in reversed(first) if i not in second), tuple(i for i in reversed(second) if i not in first))
            for first, second in [[paths[end.body] for end in loop.ends] for loop in self.loops]
        )

    @cached_property
    def joints_in_loops(self) -> tuple[int, ...]:
        """Indices of the joints in loops, in order."""
        return tuple(sorted({i for branches in self.branches for branch in branches for i in branch}))

    @cached_property
    def numbers(self) -> Numbers:
        """Unit and path of every named number of joints, bodies and attached components."""
        numbers: Numbers = {}
        for path, item in (*self._joints_and_bodies, *self._attached):
            numbers |= below(path, item.numbers)
        payload = below("payload", self.payload.numbers) if self.payload is not None else {}
        return numbers | payload | below("chain", self.chain.numbers)

    @cached_property
    def geometry(self) -> Numbers:
        """Unit and path of every named length and coordinate; parameters only on demand.

        A model with all of them as symbols would be several times as large.
        """
        numbers: Numbers = {}
        for path, item in (*sorted(self._joints_and_bodies, key=lambda item: item[0]), *self._attached):
            numbers |= below(path, item.geometry)
        return numbers

    @cached_property
    def channel_numbers(self) -> dict[str, tuple[Channel, str]]:
        """Channel and kind of gain, delay and low pass of every possible channel; parameters only on demand."""
        return self.chain.channel_numbers(self.motor_locations, self.locations)

    @property
    def on_demand(self) -> tuple[str, ...]:
        """Names of numbers that are parameters only on demand: geometry and channels."""
        return (*self.geometry, *self.channel_numbers)

    @property
    def _joints_and_bodies(self) -> Iterator[tuple[Path, Joint | Body]]:
        for b, body in enumerate(self.bodies):
            yield from ((("bodies", b, "joints", j), joint) for j, joint in enumerate(body.joints))
        yield from ((("bodies", b), body) for b, body in enumerate(self.bodies))

    @property
    def _attached(self) -> Iterator[tuple[Path, Loop | Compensator]]:
        yield from ((("loops", i), loop) for i, loop in enumerate(self.loops))
        yield from ((("compensators", i), compensator) for i, compensator in enumerate(self.compensators))

    def parameters(self, geometry: Collection[str] = ()) -> dict[str, tuple[float, str]]:
        """Return value and SI unit of every named number; of geometry and channels only names in `geometry`, last."""
        geometric = {name: entry for name, entry in self.geometry.items() if name in geometry} if geometry else {}
        table = {name: (number_at(self, path), unit) for name, (unit, path) in (self.numbers | geometric).items()}
        return table | {
            name: (getattr(channel, kind), CHANNEL_NUMBERS[kind][0])
            for name, (channel, kind) in (self.channel_numbers.items() if geometry else ())
            if name in geometry
        }

    def with_parameters(self, values: Mapping[str, float]) -> "Robot":
        """Return the robot with other numbers; StudyError for an unknown name, ValueError for an impossible number."""
        numbers = self.numbers | (self.geometry if any(name not in self.numbers for name in values) else {})
        channel_table = self.channel_numbers
        channel_names = {name: channel_table[name] for name in values if name in channel_table and name not in numbers}
        if channel_names:
            channels = {(channel.role, channel.at): channel for channel in self.chain.channels}
            for name, (channel, kind) in channel_names.items():
                key = channel.role, channel.at
                channels[key] = replaced(channels.get(key, channel), {(kind,): values[name]})
            robot: Robot = replace(self, chain=replace(self.chain, channels=tuple(channels.values())))
            return robot.with_parameters({name: value for name, value in values.items() if name not in channel_names})
        for name in values:
            if name not in numbers:
                raise StudyError(
                    "robot/unknown-name", f"robot {self.name} has no parameter {name}; there are {', '.join(numbers)}"
                )
        result: Robot = replaced(self, {numbers[name][1]: value for name, value in values.items()})
        return result


def with_frames(robot: Robot, names: Iterable[str]) -> Robot:
    """Return the robot with a frame for each name; raise StudyError for an unknown frame or body.

    A missing frame `tool` is placed at the centre of mass of the last body.
    """
    for name in dict.fromkeys(names):
        frame_names = [frame.name for frame in robot.frames]
        if name in frame_names:
            continue
        bodies, last = [body.name for body in robot.bodies], robot.bodies[-1]
        if name not in (*bodies, TOOL):
            raise StudyError(
                "robot/unknown-name",
                f"robot {robot.name} has no frame {name}; {did_you_mean(name, [*frame_names, *bodies])}",
            )
        frame = Frame(name, name) if name in bodies else Frame(TOOL, last.name, Placement(last.center_of_mass))
        robot = replace(robot, frames=(*robot.frames, frame))
    return robot
