"""Causes as a workshop has them, at every plant of `likeliest_causes`, of robots that are off their files, too.

Each is made for any robot: of an axis in its middle, its last body, or its first posture; small and large.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from data_sheet_robots import Plant
from further_causes import behind_the_gear
from injected_causes import (
    Injection,
    Responses,
    changed_robot,
    constant,
    delayed,
    exact,
    exchanged,
    filtered,
    hardening,
    late_file,
    of_channel,
    on_a_soft_base,
    per_configuration,
    permuted,
    times,
    with_torsion,
    wrong_ratio,
)

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.response import FrequencyResponse
from elastid.robot import Body, Joint, Payload, Placement, Robot, Spring

CURRENT_NM_A, RATED_NM = 0.9, 6.0  # of the motors, motor side, where torques are in A or in per cent of rated
AXIS = {"two-axis": 1, "demo": 1, "six-axis": 2, "linkage": 1}  # that is wrong, by its place


@dataclass(frozen=True)
class Places:
    """Where a robot's causes are: an axis by its place, its body and place there, the last body, two postures."""

    axis: int
    body: str
    place: int
    last: Body
    first: str
    second: str


def places(plant: Plant) -> Places:
    axis, robot = AXIS[plant.name], plant.robot
    joint = robot.driven[axis]
    owner = next(b for b in robot.bodies if joint in b.joints)
    first, second = (c.name for c in plant.configurations[:2])
    return Places(axis, owner.name, owner.joints.index(joint), robot.bodies[-1], first, second)


def load(share: float, along: float) -> Callable[[Plant], Responses]:
    """A load of a share of the last body's mass, `along` m from its centre of mass in each axis that it can have."""

    def of(plant: Plant) -> Responses:
        body = places(plant).last
        at = np.array(body.center_of_mass) + along * np.array([1.0, 0.3, 0.5])
        mass = share * body.mass
        carried = plant.robot.payload
        robot = replace(plant.robot, payload=None) if carried is not None else plant.robot
        if carried is not None:  # the load is more on what is carried
            both = carried.mass + mass
            at = (carried.mass * np.array(carried.center_of_mass) + mass * at) / both
            return exact(plant, replace(robot, payload=replace(carried, mass=both, center_of_mass=tuple(at))))
        return exact(plant, replace(robot, payload=Payload(mass, tuple(at), 0.01 * mass, body.name)))

    return of


def ratio(factor: float) -> Callable[[Plant], Responses]:
    def of(plant: Plant) -> Responses:
        at = places(plant)
        return wrong_ratio(at.body, at.place, at.axis, factor)(plant)

    return of


def number(letters: str, factor: float) -> Callable[[Plant], Responses]:
    """A number of the axis, times a factor."""

    def of(plant: Plant) -> Responses:
        name = f"{letters}_{plant.robot.driven[places(plant).axis].name}"
        return exact(plant, plant.robot.with_parameters({name: factor * plant.robot.parameters()[name][0]}))

    return of


def one_posture(letters: str, factor: float) -> Callable[[Plant], Responses]:
    """A number of the axis, times a factor in the second posture alone."""

    def of(plant: Plant) -> Responses:
        other = number(letters, factor)(plant)
        return [b if i == 1 else a for i, (a, b) in enumerate(zip(exact(plant, plant.robot), other, strict=True))]

    return of


def at_place(role: str, factor: Callable[[ComplexArray], ComplexArray]) -> Callable[[Plant], Responses]:
    return lambda plant: of_channel(role, places(plant).axis, factor)(plant)


def current(unit: float) -> Callable[[Plant], Responses]:
    """All torques in another unit of the motor side, that were taken for N m at the link."""

    def of(plant: Plant) -> Responses:
        ratios = np.array([abs(joint.motor.ratio) for joint in plant.robot.driven if joint.motor is not None])
        return [replace(G, G=G.G * (unit * ratios)) for G in exact(plant, plant.robot)]

    return of


def tool_plate(share: float, freq_hz: float, axis: str = "y") -> Callable[[Plant], Responses]:
    """A tool that is part of the last body, which bends about an axis at its mount with a resonance."""

    def of(plant: Plant) -> Responses:
        body, robot = places(plant).last, plant.robot
        size = min(1.0, 50 * float(np.linalg.eigvalsh(_tensor(body))[0]) / body.mass)
        name, mass, lever = body.name, share * body.mass, 0.12 * size
        inertia = 0.004 * mass * size**2
        k = (inertia + mass * lever**2) * (2 * math.pi * freq_hz) ** 2
        offset = np.array(body.center_of_mass) + size * np.array([0.25, 0.0, 0.05])
        # The file has both as one; its inertia is what it says with the tool where it stands.
        centre = np.zeros(3)
        centre[{"x": 1, "y": 0, "z": 0}[axis]] = lever
        tool_at = offset + centre
        rest = body.mass - mass
        c = (body.mass * np.array(body.center_of_mass) - mass * tool_at) / rest
        inertia_left = _tensor(body) - _steiner(mass, tool_at - np.array(body.center_of_mass)) - inertia * np.eye(3)
        inertia_left -= _steiner(rest, c - np.array(body.center_of_mass))
        is_planar = isinstance(body.inertia, float | int)
        left = float(inertia_left[1, 1]) if is_planar else _six(inertia_left)
        arm = replace(body, mass=rest, center_of_mass=tuple(c), inertia=left)
        bend = Joint("plate", axis, Spring(k, 2 * 0.02 * k / (2 * math.pi * freq_hz)))  # type: ignore[arg-type]
        tool = Body("tool", name, Placement(tuple(offset)), (bend,), mass, tuple(centre), (inertia,) * 3)
        bodies = (*(arm if b.name == name else b for b in robot.bodies), tool)
        return exact(plant, replace(robot, bodies=bodies))

    return of


def _tensor(body: Body) -> FloatArray:
    i = body.inertia
    values = (i,) * 3 if isinstance(i, float | int) else tuple(i)
    tensor = np.diag(np.array(values[:3], float))
    if len(values) == 6:
        for (a, b), value in zip(((0, 1), (0, 2), (1, 2)), values[3:], strict=True):
            tensor[a, b] = tensor[b, a] = value
    return tensor


def _steiner(mass: float, r: FloatArray) -> FloatArray:
    return np.asarray(mass * (r @ r * np.eye(3) - np.outer(r, r)))


def _six(tensor: FloatArray) -> tuple[float, ...]:
    return (*np.diag(tensor).tolist(), *(float(tensor[pair]) for pair in ((0, 1), (0, 2), (1, 2))))


def hose(share: float) -> Callable[[Plant], Responses]:
    """A hose between the ground and the last body: a stiffness at its angle, of a share of the gear's of the axis."""
    return _with_stiffness(lambda k, s: np.full(s.shape, share * k), "joint")


def hysteretic(share: float) -> Callable[[Plant], Responses]:
    """A gear whose loss does not depend on frequency: k (1 + j share) for k."""
    return _with_stiffness(lambda k, s: 1j * share * k * np.sign(s.imag), "gear")


def _with_stiffness(dynamic: Callable[[float, ComplexArray], ComplexArray], kind: str) -> Callable[[Plant], Responses]:
    """A dynamic stiffness (F,) of the axis's gear, or at the joint of the axis against the ground."""

    def of(plant: Plant) -> Responses:
        axis, model = places(plant).axis, formulate(plant.robot, plant.model)
        name = plant.robot.driven[axis].name
        k, linearisation, found = plant.robot.parameters()[f"k_{name}"][0], Linearisation.of(model), []
        for c in plant.configurations:
            linear = linearisation.at(c, model.theta, plant.robot.motor_locations, plant.quantity)
            read = linearisation.at(c, model.theta, (*plant.robot.motor_locations, f"joint {name}"), plant.quantity)
            found.append(_changed(linear, read, model.theta, k, plant))
        return found

    def _changed(
        linear: LinearModel, read: LinearModel, theta: FloatArray, k: float, plant: Plant
    ) -> FrequencyResponse:
        axis = places(plant).axis
        exact_response = to_response(linear, np.append(theta, 0.0), plant.freq_hz)
        s = 2j * np.pi * plant.freq_hz
        M, D, K = linear.matrices(np.append(theta, 0.0))
        C = read.readout(np.append(theta, 0.0))[0]
        y = C[-1] if kind == "joint" else C[axis] - C[-1]
        Z = K + s[:, None, None] * D + s[:, None, None] ** 2 * M
        Z_changed = Z + dynamic(k, s)[:, None, None] * np.outer(y, y)
        C_motor = linear.readout(np.append(theta, 0.0))[0]
        G = s[:, None, None] ** 2 * (
            C_motor @ np.linalg.solve(Z_changed, np.broadcast_to(linear.B, (len(s), *linear.B.shape)))
        )
        return replace(exact_response, G=G)

    return of


def drive(corner_hz: float, damping: float = 0.7) -> Callable[[ComplexArray], ComplexArray]:
    """The current loop of a drive, of second order."""
    omega = 2 * np.pi * corner_hz
    return lambda s: omega**2 / (s**2 + 2 * damping * omega * s + omega**2)


def offset(degrees: Sequence[float], one: bool) -> Callable[[Plant], Responses]:
    """The axis stood so many degrees from the stated angle, in all postures or in the second."""

    def of(plant: Plant) -> Responses:
        axis, stood = places(plant).axis, {}
        for i, c in enumerate(plant.configurations):
            by = np.zeros(len(c.angles))
            by[axis] = math.radians(degrees[i % len(degrees)]) if i == 1 or not one else 0.0
            stood[c.name] = (np.array(c.angles) + by).tolist()
        return exact(plant, plant.robot, stood)

    return of


def tilted(degrees: float) -> Callable[[Plant], Responses]:
    """The base stands on a slope, about y."""

    def of(plant: Plant) -> Responses:
        a, g = math.radians(degrees), np.array(plant.robot.gravity)
        turned = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]]) @ g
        return exact(plant, replace(plant.robot, gravity=tuple(turned.tolist())))

    return of


def upside_down(plant: Plant) -> Responses:
    return exact(plant, replace(plant.robot, gravity=tuple(-g for g in plant.robot.gravity)))


def postures_exchanged(plant: Plant) -> Responses:
    return exchanged(places(plant).first, places(plant).second)(plant)


def late_posture(seconds: float) -> Callable[[Plant], Responses]:
    return lambda plant: late_file(places(plant).second, seconds)(plant)


def swapped(role: str) -> Callable[[Plant], Responses]:
    def of(plant: Plant) -> Responses:
        n = len(plant.robot.driven)
        order = [*range(n - 2), n - 1, n - 2]
        rows, columns = (order if role == "y" else range(n)), (order if role == "u" else range(n))
        return permuted(list(rows), list(columns))(plant)

    return of


def coulomb(plant: Plant) -> Responses:
    """Dry friction that depends on the angle: viscous one in each posture, as a multisine shows it."""
    levels = (1.0, 2.2, 0.6, 1.6, 0.8, 1.3)
    name = f"fm_{plant.robot.driven[places(plant).axis].name}"
    return per_configuration(name, [levels[i % 6] for i in range(len(plant.configurations))])(plant)


def bending(share: float) -> Callable[[Plant], Responses]:
    """A link that twists about z, with so many times the stiffness of its gear."""

    def of(plant: Plant) -> Responses:
        at = places(plant)
        k = plant.robot.parameters()[f"k_{plant.robot.driven[at.axis].name}"][0]
        return changed_robot(with_torsion(at.body, "z", share * k))(plant)

    return of


def soft_base(share: float, axis: str) -> Callable[[Plant], Responses]:
    """A base of so many times the stiffness of the first gear, about an axis."""

    def of(plant: Plant) -> Responses:
        k = plant.robot.parameters()[f"k_{plant.robot.driven[0].name}"][0]
        return on_a_soft_base(share * k, axis)(plant)

    return of


def hard(rise: float) -> Callable[[Plant], Responses]:
    def of(plant: Plant) -> Responses:
        return hardening(places(plant).body, places(plant).place, rise)(plant)

    return of


def gapped(share: float) -> Callable[[Plant], Responses]:
    """Backlash of so much of the axis's smallest deflection under load."""

    def of(plant: Plant) -> Responses:
        axis, model = places(plant).axis, formulate(plant.robot, plant.model)
        joint = plant.robot.driven[axis]
        least = min(abs(equilibrium(model, model.theta, c).u[axis]) for c in plant.configurations)
        gap = share * least / joint.spring.stiffness  # type: ignore[union-attr]

        def by(robot: Robot) -> Robot:
            spring = replace(joint.spring, backlash=gap, rounding=0.5)  # type: ignore[type-var]
            changed = replace(joint, spring=spring)
            return replace(robot, bodies=tuple(
                replace(b, joints=tuple(changed if j is joint else j for j in b.joints)) for b in robot.bodies
            ))  # fmt: skip

        return exact(plant, by(plant.robot))

    return of


def encoder_at_link(plant: Plant) -> Responses:
    return behind_the_gear(places(plant).axis)(plant)


# A fit of six axes takes as long as ten of the others: one size of each kind.
_ALL, _OPEN = ("two-axis", "demo", "linkage"), ("two-axis", "demo")
_SIX, _OPEN_SIX = (*_ALL, "six-axis"), (*_OPEN, "six-axis")
_SAMPLE_S = 1e-3


def _rows() -> Iterator[tuple[str, Callable[[Plant], Responses], tuple[str, ...], tuple[str, ...]]]:
    """Name, cause, patterns of the right names with {i} for the axis and {b} for the last body, and the robots."""
    for share, along in ((0.05, 0.1), (0.1, -0.1), (0.3, 0.25)):
        yield (
            f"load of {100 * share:.0f} % at {1e3 * along:.0f} mm",
            load(share, along),
            ("payload_*",),
            _SIX if share == 0.1 else _ALL,
        )
    yield "ratio 1 % off", ratio(1.01), ("ratio_{i}",), _SIX
    yield "ratio 5 % off", ratio(0.95), ("ratio_{i}",), _OPEN
    yield "motor inertia twice", number("Jm", 2.0), ("Jm_{i}",), _SIX
    yield "two postures exchanged", postures_exchanged, ("*exchanged*", "configuration*"), _OPEN
    yield "spring 10 % softer in one file", one_posture("k", 0.9), ("spring_{i}*",), _OPEN_SIX
    yield "spring 3 % softer in one file", one_posture("k", 0.97), ("spring_{i}*",), _OPEN
    yield "last y channels swapped", swapped("y"), ("y at motor * exchanged",), _SIX
    yield "last u channels swapped", swapped("u"), ("u at motor * exchanged",), _ALL
    for gain in (1.03, 1.1, 0.9):
        yield (
            f"torque reads {100 * (gain - 1):+.0f} %",
            at_place("u", constant(1 / gain)),
            ("gain_u_motor_{i}",),
            _SIX if gain == 1.1 else _ALL,
        )
    yield "motion reads +2 %", at_place("y", constant(1.02)), ("gain_y_motor_{i}",), _ALL
    yield "torques in A", current(CURRENT_NM_A), ("*times*", "gain_*"), _ALL
    yield "torques in % of rated", current(RATED_NM / 100), ("*times*", "gain_*"), _ALL
    yield "gravity upside down", upside_down, ("gravity along *",), _ALL
    yield "base tilted by 10 deg", tilted(10), ("gravity *", "angle_1", "zero_1"), ("two-axis", "demo")
    yield "encoder behind the gear", encoder_at_link, ("*behind*",), _SIX
    yield "tool swings at 25 Hz", tool_plate(0.12, 25.0), ("swing_*",), _OPEN_SIX
    yield "tool swings at 90 Hz", tool_plate(0.12, 90.0), (), _OPEN
    for share in (5.0, 30.0):
        yield f"base {share:g} times gear 1", soft_base(share, "x"), ("base_*",), ("demo",)
        yield f"bending {share:g} times the gear", bending(share), ("torsion_*",), ("demo",)
    yield "torque half a sample late", at_place("u", delayed(_SAMPLE_S / 2)), ("*_u_motor_{i}",), _SIX
    yield "encoder a sample late", at_place("y", delayed(_SAMPLE_S)), ("*_y_motor_{i}",), _ALL
    yield "current loop of 200 Hz", at_place("u", drive(200.0)), ("*_u_motor_{i}",), _ALL
    yield "current loops of 100 Hz", times(drive(100.0)), ("delay", "low_pass", "hold"), _ALL
    yield "encoders filtered by 250 Hz", times(filtered(250.0)), ("delay", "low_pass", "hold"), _ALL
    yield "one file 1 ms late", late_posture(1e-3), ("delay@{p}",), _OPEN_SIX
    yield "friction by angle", coulomb, ("friction_{i}*",), _OPEN
    yield "gear hardens by 30 %", hard(0.3), ("load_{i}", "play_{i}"), _OPEN
    yield "gear hardens by 5 %", hard(0.05), ("load_{i}", "play_{i}"), _OPEN
    yield "backlash 0.8", gapped(0.8), ("play_{i}", "load_{i}"), _OPEN
    yield "hysteresis 5 %", hysteretic(0.05), ("loss_{i}",), _ALL
    yield "hose of 3 %", hose(0.03), ("hose_{i}",), _ALL
    yield "axis 1 deg off everywhere", offset((1.0,), False), ("angle_{i}", "zero_{i}"), _ALL
    yield "axis 3 deg off in one posture", offset((3.0,), True), ("angle_{i}@{p}",), _OPEN
    yield "angles off by 1 to 3 deg", offset((1.0, -2.0, 3.0, -1.5, 2.5), False), ("angle_*", "zero_{i}"), _OPEN_SIX


def _named(plant: Plant, patterns: tuple[str, ...]) -> tuple[str, ...]:
    at = places(plant)
    return tuple(p.format(i=plant.robot.driven[at.axis].name, p=at.second) for p in patterns)


def workshop(plants: dict[str, Plant]) -> tuple[Injection, ...]:
    """All causes at robots, every other one of robots that are off their file as data sheets are."""
    made = []
    for row, (name, cause, right, robots) in enumerate(_rows()):
        for place, robot in enumerate(robots):
            of = plants[robot]
            made.append(Injection(name, robot, cause, _named(of, right), drawn=(row + place) % 2 == 1))
    return tuple(made)
