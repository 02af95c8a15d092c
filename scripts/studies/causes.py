"""Causes of wrong fits, injected into exact responses of robots that are known, for `likeliest_causes`.

An `Injection` makes of a plant the responses of a robot that is not the one in its file, or that were read wrongly.
INJECTIONS are those for which hypotheses were written, FURTHER those that an outsider thought of afterwards (one
without a right name has no hypothesis: there a doubt is right), and `workshop` has those of a workshop at every plant,
of robots that are off their files, too: of an axis in its middle, the last body, or the first posture; small and large.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from data_sheet_robots import Plant

from elastid.base.arrays import ComplexArray
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.response import Covariance, Response
from elastid.robot import Body, GearCoupling, Joint, Payload, Robot, Spring

Responses: TypeAlias = Sequence[Response]
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


def exact(
    plant: Plant, robot: Robot, angles: Mapping[str, Sequence[float]] | None = None, outputs: tuple[str, ...] = ()
) -> list[Response]:
    """Responses of a robot in the plant's configurations, or at other angles of some of them, by name.

    outputs: places of the angles, by default the motors.
    """
    model = formulate(robot, plant.model)
    linearisation, responses = Linearisation.of(model), []
    for configuration in plant.configurations:
        stood = replace(configuration, angles=tuple((angles or {}).get(configuration.name, configuration.angles)))
        linear = linearisation.at(stood, model.theta, outputs or robot.motor_locations, plant.quantity)
        response = to_response(linear, np.append(model.theta, 0.0), plant.freq_hz)
        responses.append(replace(response, configuration=configuration))
    return responses


def noisy(responses: Responses, rng: np.random.Generator) -> list[Response]:
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


def read(by: Callable[[Response], Response]) -> Callable[[Plant], Responses]:
    return lambda plant: [by(G) for G in exact(plant, plant.robot)]


def times(factor: Callable[[ComplexArray], ComplexArray]) -> Callable[[Plant], Responses]:
    """Responses times a factor (F, n_y, n_u) of s = j omega (F, 1, 1)."""
    return read(lambda G: replace(G, G=G.G * factor(2j * np.pi * G.freq_hz[:, None, None])))


def of_channel(role: str, place: int, factor: Callable[[ComplexArray], ComplexArray]) -> Callable[[Plant], Responses]:
    def by(G: Response) -> Response:
        values = G.G.copy()
        part = (slice(None), place, slice(None)) if role == "y" else (slice(None), slice(None), place)
        values[part] *= factor(2j * np.pi * G.freq_hz[:, None])
        return replace(G, G=values)

    return read(by)


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

        def by(G: Response) -> Response:
            scale = np.ones(G.G.shape[1])
            scale[place] = factor  # angles of the link by the file's ratio are larger by it, torques smaller
            return replace(G, G=G.G * np.outer(scale, scale))

        return [by(G) for G in exact(plant, robot)]

    return of


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
        k, deflections = at_rest(plant, body, joint)
        cubic = rise * k / (3 * max(deflections) ** 2)
        return exact(plant, with_joint(body, joint, with_spring(lambda s: replace(s, cubic=cubic)))(plant.robot))

    return of


def backlash(body: str, joint: int, share: float) -> Callable[[Plant], Responses]:
    """A gear whose gap is so much of its smallest deflection under load."""

    def of(plant: Plant) -> Responses:
        gap = share * min(at_rest(plant, body, joint)[1])
        by = with_spring(lambda s: replace(s, backlash=gap, rounding=0.5))
        return exact(plant, with_joint(body, joint, by)(plant.robot))

    return of


def at_rest(plant: Plant, body: str, joint: int) -> tuple[float, list[float]]:
    """Stiffness of a gear, and its deflections in the configurations."""
    gear = next(b for b in plant.robot.bodies if b.name == body).joints[joint]
    place = [j.name for j in plant.robot.driven].index(gear.name)
    model, k = formulate(plant.robot, plant.model), gear.spring.stiffness  # type: ignore[union-attr]
    return k, [abs(equilibrium(model, model.theta, c).u[place]) / k for c in plant.configurations]


def coupled(ratio: float, *pairs: tuple[str, str]) -> Callable[[Plant], Responses]:
    """Motors of axes that turn along with others, as belts of a wrist do, which the file does not know."""

    def of(plant: Plant) -> Responses:
        robot = replace(plant.robot, gears=tuple(GearCoupling(*pair, ratio) for pair in pairs))
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

    def by(G: Response) -> Response:
        late = np.exp(-2j * np.pi * seconds * G.freq_hz)[:, None, None]
        return replace(G, G=G.G * late) if G.configuration.name == configuration else G

    return read(by)


def constant(factor: complex) -> Callable[[ComplexArray], ComplexArray]:
    return lambda s: np.full(s.shape, factor)


def delayed(seconds: float) -> Callable[[ComplexArray], ComplexArray]:
    return lambda s: np.exp(-seconds * s)


def filtered(corner_hz: float) -> Callable[[ComplexArray], ComplexArray]:
    return lambda s: 1 / (1 + s / (2 * np.pi * corner_hz))


PAYLOAD, ALL_GAINS, NO_TOLERANCE = ("payload_*",), ("gain_u_*", "gain_y_*"), True
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
    Injection("zero of axis 2 off by 5 deg, exact file", "two-axis", moved(zero_2=math.radians(5)), ("zero_2",),
              NO_TOLERANCE),
    Injection("zero of axis 3 off by 5 deg", "demo", moved(zero_3=math.radians(5)), ("zero_3",)),
    Injection("ratio 2 61 for 60, exact file", "two-axis", wrong_ratio("fore", 0, 1, 61 / 60), ("ratio_2",),
              NO_TOLERANCE),
    Injection("ratio 3 111 for 110", "demo", wrong_ratio("fore_arm", 0, 2, 111 / 110), ("ratio_3",)),
    Injection("missing torsion of the upper arm", "demo", changed_robot(with_torsion("upper_arm", "z", 6e5)),
              ("torsion_upper_arm_z",)),
    Injection("soft base", "demo", on_a_soft_base(1e7, "x"), ("base_x",)),
    Injection("gravity left out", "two-axis", with_gravity(0.0, 0.0, 0.0), ("no gravity",)),
    Injection("mounted on a wall", "two-axis", with_gravity(-9.81, 0.0, 0.0), ("gravity along -x of the base",)),
    Injection("mounted on the ceiling", "demo", with_gravity(0.0, 0.0, 9.81), ("gravity along +z of the base",)),
    Injection("motor 2 turned along by axis 1", "two-axis", coupled(6.0, ("2", "1")), ("coupling_2_1",)),
    Injection("motor 3 turned along by axis 2", "demo", coupled(1.1, ("3", "2")), ("coupling_3_2",)),
    Injection("the file's payload not carried", "six-axis", changed_robot(lambda r: replace(r, payload=None)),
              ("the payload of the file not mounted",)),
    # Gears and friction.
    Injection("gear 1 hardens by 10 %", "two-axis", hardening("upper", 0, 0.1), ("load_1",)),
    Injection("gear 2 hardens by 10 %", "demo", hardening("upper_arm", 0, 0.1), ("load_2",)),
    Injection("backlash in gear 2", "demo", backlash("upper_arm", 0, 0.95), ("play_2",)),
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
    Injection("drive 2 late by 1 ms", "two-axis", of_channel("u", 1, delayed(1e-3)), ("delay_u_motor_2",)),
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
    Injection("velocities for accelerations", "two-axis", times(lambda s: 1 / s),
              ("responses differentiated once more in time",)),
)
# fmt: on


TOOL_KG, TOOL_AT = 12.0, (0.9, 0.0, 0.15)


def stood(by: Callable[[np.ndarray], Sequence[float]]) -> Callable[[Plant], Responses]:
    """All configurations stood at other angles (n_q,) than the study states."""
    return lambda plant: exact(plant, plant.robot, {c.name: by(np.array(c.angles)) for c in plant.configurations})


def coarse(resolution: float) -> Callable[[Plant], Responses]:
    """Encoders whose steps return in every period, so that no scatter of periods shows them: errors of angle."""

    def by(G: Response) -> Response:
        rng, omega = np.random.default_rng(len(G.configuration.name)), 2 * np.pi * G.freq_hz[:, None, None]
        error = rng.standard_normal((*G.G.shape, 2)) @ np.array([1.0, 1j])
        return replace(G, G=G.G + resolution * np.abs(G.G[:1]).max(axis=0) * (omega / omega[-1]) ** 2 * error)

    return read(by)


def compensated(plant: Plant) -> Responses:
    """The logged torque lacks what the controller adds to bear the weight at the measured angles."""
    responses = []
    for G in exact(plant, plant.robot):
        s, K = 2j * np.pi * G.freq_hz[:, None, None], _weight_slope(plant, G)
        responses.append(replace(G, G=np.linalg.inv(np.linalg.inv(G.G) - K / s**2)))
    return responses


def _weight_slope(plant: Plant, G: Response) -> np.ndarray:
    """d g / d q (n, n) of the rigid robot, by differences of the torques at rest."""
    model, step = formulate(plant.robot, plant.model), 1e-4
    columns = []
    for i in range(len(G.configuration.angles)):
        ends = []
        for sign in (1, -1):
            angles = np.array(G.configuration.angles)
            angles[i] += sign * step
            ends.append(equilibrium(model, model.theta, replace(G.configuration, angles=tuple(angles))).u)
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.array(columns).T


def behind_the_gear(place: int) -> Callable[[Plant], Responses]:
    """The angle of an axis is that of an encoder behind its gear, not of the motor's."""

    def of(plant: Plant) -> Responses:
        motors, joint = plant.robot.motor_locations, plant.robot.driven[place].name
        outputs = (*motors[:place], f"joint {joint}", *motors[place + 1 :])
        return [replace(G, outputs=motors) for G in exact(plant, plant.robot, outputs=outputs)]

    return of


# fmt: off
FURTHER: tuple[Injection, ...] = (
    Injection("ratio 2 1 % off", "demo", wrong_ratio("upper_arm", 0, 1, 1.01), ("ratio_2",)),
    Injection("encoders 2 and 3 exchanged", "demo", permuted((0, 2, 1), (0, 1, 2)),
              ("y at motor 2 and at motor 3 exchanged",)),
    Injection("torque constant 3 5 % off", "demo", of_channel("u", 2, constant(1 / 1.05)), ("gain_u_motor_3",)),
    Injection("payload of 1 kg forgotten", "six-axis", payload(1.0, 0.05, 0.02, 0.1), ("payload_*",),
              file=lambda robot: replace(robot, payload=None)),
    Injection("belts between axes 4 to 6", "six-axis", coupled(1.0, ("5", "4"), ("6", "4"), ("6", "5")),
              ("coupling_*",)),
    Injection("encoder 1 stamped 3 ms early", "demo", of_channel("y", 0, delayed(-3e-3)), ("delay_y_motor_1",)),
    Injection("coarse encoders", "demo", coarse(0.05), ()),
    Injection("torque of drive 2 filtered by 60 Hz", "demo", of_channel("u", 1, lambda s: 1 / filtered(60)(s)),
              ("low_pass_u_motor_2", "delay_u_motor_2")),
    Injection("all torques filtered by 80 Hz", "two-axis", times(lambda s: 1 / filtered(80)(s)), ("low_pass", "delay")),
    Injection("gravity compensation not logged", "two-axis", compensated, ("no gravity", "gravity *")),
    Injection("postures in degrees", "demo", stood(np.radians), ("angle* configurations*",)),
    Injection("postures taken from degrees twice", "two-axis", stood(np.degrees), ("angle* configurations*",)),
    Injection("axis 2 counted in the other direction", "demo", stood(lambda q: q * np.array([1, -1, 1])),
              ("angle* configurations*",)),
    Injection("angles of axes 2 and 3 exchanged", "demo", stood(lambda q: q[[0, 2, 1]]), ("angle* configurations*",)),
    Injection("inertia of motor 1 in kg cm^2", "two-axis", numbers(Jm_1=1e-4), ("Jm_1", "inertia of motor 1*")),
    Injection("inertia of motor 2 on the link side", "two-axis", numbers(Jm_2=1 / 3600),
              ("Jm_2", "inertia of motor 2*")),
    Injection("encoder 2 behind the gear", "demo", behind_the_gear(1), ("*behind*",)),
)
# fmt: on


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
    return lambda plant: hardening(places(plant).body, places(plant).place, rise)(plant)


def gapped(share: float) -> Callable[[Plant], Responses]:
    """Backlash of so much of the axis's smallest deflection under load."""
    return lambda plant: backlash(places(plant).body, places(plant).place, share)(plant)


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
    yield "encoder behind the gear", encoder_at_link, ("*behind*",), _SIX
    for share in (5.0, 30.0):
        yield f"base {share:g} times gear 1", soft_base(share, "x"), ("base_*",), ("demo",)
        yield f"bending {share:g} times the gear", bending(share), ("torsion_*",), ("demo",)
    yield "torque half a sample late", at_place("u", delayed(_SAMPLE_S / 2)), ("*_u_motor_{i}",), _SIX
    yield "encoder a sample late", at_place("y", delayed(_SAMPLE_S)), ("*_y_motor_{i}",), _ALL
    yield "current loop of 200 Hz", at_place("u", drive(200.0)), ("*_u_motor_{i}",), _ALL
    yield "current loops of 100 Hz", times(drive(100.0)), ("delay", "low_pass"), _ALL
    yield "encoders filtered by 250 Hz", times(filtered(250.0)), ("delay", "low_pass"), _ALL
    yield "one file 1 ms late", late_posture(1e-3), ("delay@{p}",), _OPEN_SIX
    yield "gear hardens by 30 %", hard(0.3), ("load_{i}", "play_{i}"), _OPEN
    yield "gear hardens by 5 %", hard(0.05), ("load_{i}", "play_{i}"), _OPEN
    yield "backlash 0.8", gapped(0.8), ("play_{i}", "load_{i}"), _OPEN
    yield "axis 1 deg off everywhere", offset((1.0,), False), ("zero_{i}",), _ALL
    yield "axis 3 deg off in one posture", offset((3.0,), True), ("angle_{i}@{p}",), _OPEN
    yield "angles off by 1 to 3 deg", offset((1.0, -2.0, 3.0, -1.5, 2.5), False), ("angle*", "zero_{i}"), _OPEN_SIX


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
