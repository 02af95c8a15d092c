"""Causes of wrong fits, injected into exact responses of robots that are known, for `likeliest_causes`.

An `Injection` makes of a plant the responses of a robot that is not the one in its file, or that were read wrongly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from data_sheet_robots import Plant

from elastid.base.arrays import ComplexArray
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.response import Covariance, FrequencyResponse
from elastid.robot import GearCoupling, Joint, Payload, Robot, Spring

Responses: TypeAlias = Sequence[FrequencyResponse]
NOISE = 0.005


@dataclass(frozen=True)
class Injection:
    """A cause.  measured: exact responses of the plant's robot with it.  right: patterns of names that are the cause.

    exact: True if the fit takes the robot's file as exact.  file: the robot's file, of the plant's robot.
    drawn: True if the robot is off its file as CAD and data sheets are, too.
    """

    name: str
    plant: str
    measured: Callable[[Plant], Responses]
    right: tuple[str, ...]
    exact: bool = False
    file: Callable[[Robot], Robot] = lambda robot: robot
    drawn: bool = False


def exact(plant: Plant, robot: Robot, angles: Mapping[str, Sequence[float]] | None = None) -> list[FrequencyResponse]:
    """Responses of a robot in the plant's configurations, or at other angles of some of them, by name."""
    model = formulate(robot, plant.model)
    linearisation, found = Linearisation.of(model), []
    for configuration in plant.configurations:
        stood = replace(configuration, angles=tuple((angles or {}).get(configuration.name, configuration.angles)))
        linear = linearisation.at(stood, model.theta, robot.motor_locations, plant.quantity)
        response = to_response(linear, np.append(model.theta, 0.0), plant.freq_hz)
        found.append(replace(response, configuration=configuration))
    return found


def noisy(responses: Responses, rng: np.random.Generator) -> list[FrequencyResponse]:
    data = []
    for G in responses:
        std = NOISE * np.abs(G.G) + 0.1 * NOISE * np.abs(G.G).max(axis=0)
        error = std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape)) / math.sqrt(2)
        data.append(replace(G, G=G.G + error, total=Covariance(std**2, np.inf)))
    return data


def changed_robot(by: Callable[[Robot], Robot]) -> Callable[[Plant], Responses]:
    return lambda plant: exact(plant, by(plant.robot))


def numbers(**factors: float) -> Callable[[Plant], Responses]:
    """Numbers of the file times factors."""

    def of(robot: Robot) -> Robot:
        known = robot.parameters(tuple(robot.geometry))
        return robot.with_parameters({name: factor * known[name][0] for name, factor in factors.items()})

    return changed_robot(of)


def moved(**by: float) -> Callable[[Plant], Responses]:
    """Numbers of the file plus something."""

    def of(robot: Robot) -> Robot:
        known = robot.parameters(tuple(robot.geometry))
        return robot.with_parameters({name: known[name][0] + step for name, step in by.items()})

    return changed_robot(of)


def payload(mass: float, *at: float) -> Callable[[Plant], Responses]:
    """A load on the last body that the file does not have."""
    side = 0.15
    inertia = mass * side**2 / 6

    def of(robot: Robot) -> Robot:
        return replace(robot, payload=Payload(mass, tuple(at), (inertia,) * 3, robot.bodies[-1].name))

    return changed_robot(of)


def read(by: Callable[[FrequencyResponse], FrequencyResponse]) -> Callable[[Plant], Responses]:
    return lambda plant: [by(G) for G in exact(plant, plant.robot)]


def times(factor: Callable[[ComplexArray], ComplexArray]) -> Callable[[Plant], Responses]:
    """Responses times a factor (F, n_y, n_u) of s = j omega (F, 1, 1)."""
    return read(lambda G: replace(G, G=G.G * factor(2j * np.pi * G.freq_hz[:, None, None])))


def of_channel(role: str, place: int, factor: Callable[[ComplexArray], ComplexArray]) -> Callable[[Plant], Responses]:
    def by(G: FrequencyResponse) -> FrequencyResponse:
        values = G.G.copy()
        part = (slice(None), place, slice(None)) if role == "y" else (slice(None), slice(None), place)
        values[part] *= factor(2j * np.pi * G.freq_hz[:, None])
        return replace(G, G=values)

    return read(by)


def per_configuration(name: str, factors: Sequence[float]) -> Callable[[Plant], Responses]:
    """A number that differs between the configurations, by factors."""

    def of(plant: Plant) -> Responses:
        value = plant.robot.parameters()[name][0]
        robots = [plant.robot.with_parameters({name: factor * value}) for factor in factors]
        return [exact(plant, robot)[i] for i, robot in enumerate(robots)]

    return of


def at_angles(name: str, *by_deg: float) -> Callable[[Plant], Responses]:
    """One posture stood elsewhere than stated."""

    def of(plant: Plant) -> Responses:
        stated = next(c for c in plant.configurations if c.name == name)
        stood = [angle + math.radians(by) for angle, by in zip(stated.angles, by_deg, strict=True)]
        return exact(plant, plant.robot, {name: stood})

    return of


def one_with(by: Callable[[Robot], Robot], name: str) -> Callable[[Plant], Responses]:
    """One configuration was measured on another robot."""

    def of(plant: Plant) -> Responses:
        as_stated, other = exact(plant, plant.robot), exact(plant, by(plant.robot))
        return [b if a.configuration.name == name else a for a, b in zip(as_stated, other, strict=True)]

    return of


def with_joint(body: str, joint: int, by: Callable[[Joint], Joint]) -> Callable[[Robot], Robot]:
    """A robot with one of a body's joints changed."""

    def of(robot: Robot) -> Robot:
        bodies = tuple(
            replace(b, joints=tuple(by(j) if i == joint else j for i, j in enumerate(b.joints)))
            if b.name == body
            else b
            for b in robot.bodies
        )
        return replace(robot, bodies=bodies)

    return of


def with_spring(by: Callable[[Spring], Spring]) -> Callable[[Joint], Joint]:
    return lambda joint: replace(joint, spring=by(joint.spring))  # type: ignore[arg-type]


def with_motor(**changes: float) -> Callable[[Joint], Joint]:
    """Numbers of a motor times factors."""
    return lambda joint: replace(
        joint,
        motor=replace(joint.motor, **{k: f * getattr(joint.motor, k) for k, f in changes.items()}),  # type: ignore[type-var]
    )


def wrong_ratio(body: str, joint: int, place: int, factor: float) -> Callable[[Plant], Responses]:
    """The gear's ratio is the file's times a factor: what was read was referred to the link side by the file's."""

    def of(plant: Plant) -> Responses:
        robot = with_joint(body, joint, with_motor(ratio=factor))(plant.robot)

        def by(G: FrequencyResponse) -> FrequencyResponse:
            scale = np.ones(G.G.shape[1])
            scale[place] = factor  # angles of the link by the file's ratio are larger by it, torques smaller
            return replace(G, G=G.G * np.outer(scale, scale))

        return [by(G) for G in exact(plant, robot)]

    return of


def transmission(joint: int, slopes: Sequence[float]) -> Callable[[Plant], Responses]:
    """A gear whose effective ratio is 1 + e times its own, e by posture."""

    def of(plant: Plant) -> Responses:
        driven = plant.robot.driven[joint]
        body = next(b for b in plant.robot.bodies if driven in b.joints)
        place = body.joints.index(driven)
        return [wrong_ratio(body.name, place, joint, 1 / (1 + e))(plant)[q] for q, e in enumerate(slopes)]

    return of


def reference_times(constant: float, bandwidth_hz: float = 3.0) -> Callable[[Plant], Responses]:
    """The channel of the torque holds a constant times the reference r of a position loop, u = r - C q."""

    def by(G: FrequencyResponse) -> FrequencyResponse:
        s, n = 2j * np.pi * G.freq_hz[:, None, None], G.G.shape[1]
        bandwidth = 2 * np.pi * bandwidth_hz
        inertia = np.array([1.0 / abs(G.G[0, i, i]) for i in range(n)])
        C = (bandwidth**2 + 1.4 * bandwidth * s) * np.diag(inertia)
        return replace(G, G=G.G @ np.linalg.inv(np.eye(n) + C @ (G.G / s**2)) / constant)

    return read(by)


def exchanged(first: str, second: str) -> Callable[[Plant], Responses]:
    """The responses of two postures carry each other's name."""

    def of(plant: Plant) -> Responses:
        by_name = {G.configuration.name: G for G in exact(plant, plant.robot)}
        order = {first: second, second: first}
        return [replace(by_name[order.get(n, n)], configuration=G.configuration) for n, G in by_name.items()]

    return of


def permuted(rows: Sequence[int], columns: Sequence[int]) -> Callable[[Plant], Responses]:
    return read(lambda G: replace(G, G=G.G[:, list(rows)][:, :, list(columns)]))


def hardening(body: str, joint: int, rise: float) -> Callable[[Plant], Responses]:
    """A gear whose stiffness is `rise` higher at the largest torque that it carries in the configurations."""

    def of(plant: Plant) -> Responses:
        spring = next(b for b in plant.robot.bodies if b.name == body).joints[joint].spring
        model = formulate(plant.robot, plant.model)
        at = [equilibrium(model, model.theta, c) for c in plant.configurations]
        place = [j.name for j in plant.robot.driven].index(
            next(b for b in plant.robot.bodies if b.name == body).joints[joint].name
        )
        deflection = max(abs(point.u[place]) for point in at) / spring.stiffness  # type: ignore[union-attr]
        cubic = rise * spring.stiffness / (3 * deflection**2)  # type: ignore[union-attr]
        return exact(plant, with_joint(body, joint, with_spring(lambda s: replace(s, cubic=cubic)))(plant.robot))

    return of


def backlash(body: str, joint: int, share: float) -> Callable[[Plant], Responses]:
    """A gear whose gap is so much of its smallest deflection under load."""

    def of(plant: Plant) -> Responses:
        b = next(b for b in plant.robot.bodies if b.name == body).joints[joint]
        model = formulate(plant.robot, plant.model)
        at = [equilibrium(model, model.theta, c) for c in plant.configurations]
        place = [j.name for j in plant.robot.driven].index(b.name)
        gap = share * min(abs(point.u[place]) for point in at) / b.spring.stiffness  # type: ignore[union-attr]
        return exact(
            plant, with_joint(body, joint, with_spring(lambda s: replace(s, backlash=gap, rounding=0.5)))(plant.robot)
        )

    return of


def coupled(ratio: float, motor: str, joint: str) -> Callable[[Plant], Responses]:
    """The motor of an axis turns along with another, which the file does not know."""

    def of(plant: Plant) -> Responses:
        robot = replace(plant.robot, gears=(GearCoupling(motor, joint, ratio),))
        E = robot.mixing  # the file has the angles of motors for those of axes
        return [replace(G, G=E @ G.G @ E.T) for G in exact(plant, robot)]

    return of


def on_a_soft_base(k: float, axis: str) -> Callable[[Plant], Responses]:
    """The robot's first body tilts on an elastic base."""

    def of(robot: Robot) -> Robot:
        first = robot.bodies[0]
        tilting = Joint("base", axis, Spring(k, 1e-3 * k))  # type: ignore[arg-type]
        return replace(robot, bodies=(replace(first, joints=(tilting, *first.joints)), *robot.bodies[1:]))

    return changed_robot(of)


def loaded(mass: float, at: tuple[float, float, float], body: str) -> Callable[[Robot], Robot]:
    return lambda robot: replace(robot, payload=Payload(mass, at, 0.02, body))


def with_torsion(body: str, axis: str, k: float) -> Callable[[Robot], Robot]:
    def of(robot: Robot) -> Robot:
        further = Joint(f"{body}_{axis}", axis, Spring(k, 1e-3 * k))  # type: ignore[arg-type]
        bodies = (replace(b, joints=(*b.joints, further)) if b.name == body else b for b in robot.bodies)
        return replace(robot, bodies=tuple(bodies))

    return of


def with_gravity(*gravity: float) -> Callable[[Plant], Responses]:
    return changed_robot(lambda robot: replace(robot, gravity=gravity))  # type: ignore[arg-type]


def late_file(configuration: str, seconds: float) -> Callable[[Plant], Responses]:
    """Motions of one configuration are late."""

    def by(G: FrequencyResponse) -> FrequencyResponse:
        late = np.exp(-2j * np.pi * seconds * G.freq_hz)[:, None, None]
        return replace(G, G=G.G * late) if G.configuration.name == configuration else G

    return read(by)


def constant(factor: complex) -> Callable[[ComplexArray], ComplexArray]:
    return lambda s: np.full(s.shape, factor)


def delayed(seconds: float) -> Callable[[ComplexArray], ComplexArray]:
    return lambda s: np.exp(-seconds * s)


def filtered(corner_hz: float) -> Callable[[ComplexArray], ComplexArray]:
    return lambda s: 1 / (1 + s / (2 * np.pi * corner_hz))


WIDE_TRANSMISSION = (0.01, -0.012, 0.004, -0.008, 0.006)
PAYLOAD, ALL_GAINS, NO_TOLERANCE = ("payload_*",), ("gain_u_*", "gain_y_*", "rate"), True
# fmt: off
INJECTIONS: tuple[Injection, ...] = (
    # The robot carries what its file does not have, or is otherwise than its file.
    Injection("payload 0.5 kg, exact file", "two-axis", payload(0.5, 0.6, 0.0, 0.0), PAYLOAD, NO_TOLERANCE),
    Injection("payload 3 kg, exact file", "two-axis", payload(3.0, 0.6, 0.0, 0.0), PAYLOAD, NO_TOLERANCE),
    Injection("payload 5 kg", "two-axis", payload(5.0, 0.6, 0.0, 0.05), PAYLOAD),
    Injection("payload 3 kg", "demo", payload(3.0, 0.9, 0.05, 0.1), PAYLOAD),
    Injection("payload 5 kg", "demo", payload(5.0, 0.9, 0.1, 0.15), PAYLOAD),
    Injection("payload 5 kg, exact file", "linkage", payload(5.0, 0.8, 0.13, 0.14), PAYLOAD, NO_TOLERANCE),
    Injection("mass of the fore arm 30 % off", "demo", numbers(m_fore_arm=1.3), ("m_fore_arm",)),
    Injection("inertia of the fore arm doubled", "demo",
              numbers(I_fore_arm_xx=2.0, I_fore_arm_yy=2.0, I_fore_arm_zz=2.0), ("I_fore_arm", "I_fore_arm_[*]")),
    Injection("centre of the fore arm 80 mm off", "demo", moved(c_fore_arm_x=0.08), ("c_fore_arm_x",)),
    Injection("inertia of motor 2 doubled", "two-axis", numbers(Jm_2=2.0), ("Jm_2",)),
    Injection("inertia of motor 2 40 % off", "demo", numbers(Jm_2=1.4), ("Jm_2",)),
    Injection("upper arm 30 mm longer", "demo", moved(p_fore_arm_z=0.03), ("p_fore_arm_z",)),
    Injection("zero of axis 2 off by 5 deg, exact file", "two-axis", moved(zero_2=math.radians(5)), ("angle_2",),
              NO_TOLERANCE),
    Injection("zero of axis 3 off by 5 deg", "demo", moved(zero_3=math.radians(5)), ("angle_3", "zero_3")),
    Injection("ratio 2 61 for 60, exact file", "two-axis", wrong_ratio("fore", 0, 1, 61 / 60), ("ratio_2",),
              NO_TOLERANCE),
    Injection("ratio 3 111 for 110", "demo", wrong_ratio("fore_arm", 0, 2, 111 / 110), ("ratio_3",)),
    Injection("missing torsion of the upper arm", "demo", changed_robot(with_torsion("upper_arm", "z", 6e5)),
              ("torsion_upper_arm_z",)),
    Injection("soft base", "demo", on_a_soft_base(1e7, "x"), ("base_x",)),
    Injection("gravity left out", "two-axis", with_gravity(0.0, 0.0, 0.0), ("no gravity",)),
    Injection("mounted on a wall", "two-axis", with_gravity(-9.81, 0.0, 0.0), ("gravity along -x of the base",)),
    Injection("mounted on the ceiling", "demo", with_gravity(0.0, 0.0, 9.81), ("gravity along +z of the base",)),
    Injection("motor 2 turned along by axis 1", "two-axis", coupled(6.0, "2", "1"), ("coupling_2_1",)),
    Injection("motor 3 turned along by axis 2", "demo", coupled(1.1, "3", "2"), ("coupling_3_2",)),
    Injection("the file's payload not carried", "six-axis", changed_robot(lambda r: replace(r, payload=None)),
              ("the payload of the file not carried",)),
    # Gears and friction.
    Injection("gear 1 hardens by 10 %", "two-axis", hardening("upper", 0, 0.1), ("load_1",)),
    Injection("gear 2 hardens by 10 %", "demo", hardening("upper_arm", 0, 0.1), ("load_2",)),
    Injection("backlash in gear 2", "demo", backlash("upper_arm", 0, 0.95), ("play_2",)),
    Injection("Coulomb depends on the angle", "two-axis", per_configuration("fm_2", (1.0, 2.5, 0.6)), ("friction_2*",)),
    Injection("Coulomb depends on the angle", "demo", per_configuration("fm_2", (1.0, 2.5, 0.6, 1.5, 0.8)),
              ("friction_2*",)),
    Injection("transmission error of gear 1", "two-axis", transmission(0, (0.01, -0.012, 0.004)), ("transmission_1*",)),
    Injection("transmission error of gear 2", "demo", transmission(1, WIDE_TRANSMISSION), ("transmission_2*",)),
    Injection("friction behind gear 2", "two-axis", moved(f_2=60.0), ("f_2",)),
    # Channels, clocks and files.
    Injection("torque constant 2 20 % off", "two-axis", of_channel("u", 1, constant(1 / 1.2)), ("gain_u_motor_2",)),
    Injection("torque constants 20 % off", "demo", times(constant(1 / 1.2)), ALL_GAINS),
    Injection("torque constant 2 20 % off", "linkage", of_channel("u", 1, constant(1 / 1.2)), ("gain_u_motor_3",)),
    Injection("rate 2 % off, exact file", "demo", read(lambda G: replace(G, freq_hz=1.02 * G.freq_hz, G=1.02**2 * G.G)),
              ALL_GAINS, NO_TOLERANCE),
    Injection("low pass of 150 Hz", "demo", times(filtered(150)), ("low_pass",)),
    Injection("all 0.4 ms late", "two-axis", times(delayed(4e-4)), ("delay",)),
    Injection("all 0.4 ms late", "linkage", times(delayed(4e-4)), ("delay",)),
    Injection("encoder 2 one sample late", "demo", of_channel("y", 1, delayed(2e-3)), ("delay_y_motor_2",)),
    Injection("encoder 3 0.5 ms late", "six-axis", of_channel("y", 2, delayed(5e-4)), ("delay_y_motor_3",)),
    Injection("drive 2 late by 1 ms", "two-axis", of_channel("u", 1, delayed(1e-3)), ("delay_u_motor_2", "hold_u*_2")),
    Injection("one file late by 2 ms", "demo", late_file("folded", 2e-3), ("delay@folded",)),
    Injection("one file with 5 kg", "demo", one_with(loaded(5.0, (0.9, 0.0, 0.1), "fore_arm"), "reach"),
              ("payload_*@reach",)),
    Injection("exchanged postures", "demo", exchanged("folded", "reach"), ("*folded and reach exchanged",)),
    Injection("one posture 5 deg off", "demo", at_angles("folded", 0, 0, 5), ("angle_3@folded",)),
    Injection("channels y 1 and 2 exchanged", "two-axis", permuted((1, 0), (0, 1)),
              ("y at motor 1 and at motor 2 exchanged",)),
    Injection("channels u 2 and 3 exchanged", "demo", permuted((0, 1, 2), (0, 2, 1)),
              ("u at motor 2 and at motor 3 exchanged",)),
    Injection("motor 2 mirrored", "demo", read(lambda G: replace(G, G=G.G * np.outer([1, -1, 1], [1, -1, 1]))),
              ("motor 2 counted in the other direction*",)),
    Injection("sign of torque 2", "two-axis", of_channel("u", 1, constant(-1)), ("u at motor 2 with the other sign",)),
    Injection("angles in degrees", "two-axis", times(constant(180 / np.pi)), ("y at motor 1 times 0.017*",)),
    Injection("reference logged as torque, times 1.3", "two-axis", reference_times(1.3), ("reference", "loop_*")),
    Injection("velocities for accelerations", "two-axis", times(lambda s: 1 / s),
              ("responses differentiated once more in time",)),
)
# fmt: on
