"""Causes as an outsider injects them, for `likeliest_causes`: thought of after the hypotheses were written.

Those without a right name have no hypothesis: there a doubt is right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from data_sheet_robots import Plant
from injected_causes import (
    Injection,
    Responses,
    constant,
    delayed,
    exact,
    filtered,
    numbers,
    of_channel,
    payload,
    permuted,
    read,
    times,
    wrong_ratio,
)

from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.response import FrequencyResponse
from elastid.robot import Body, GearCoupling, Joint, Payload, Placement, Robot, Spring

TOOL_KG, TOOL_AT = 12.0, (0.9, 0.0, 0.15)


def stood(by: Callable[[np.ndarray], Sequence[float]]) -> Callable[[Plant], Responses]:
    """All configurations stood at other angles (n_q,) than the study states."""
    return lambda plant: exact(plant, plant.robot, {c.name: by(np.array(c.angles)) for c in plant.configurations})


def with_tool(robot: Robot) -> Robot:
    """The file of a robot with a tool that is bolted to its last body."""
    return replace(robot, payload=Payload(TOOL_KG, TOOL_AT, (0.1, 0.1, 0.1), robot.bodies[-1].name))


def loose_tool(k: float) -> Callable[[Plant], Responses]:
    """The same tool on a soft plate, which bends about y."""

    def of(plant: Plant) -> Responses:
        bend = Joint("plate", "y", Spring(k, 2e-4 * k))
        tool = Body("tool", plant.robot.bodies[-1].name, Placement(TOOL_AT), (bend,), TOOL_KG, (0.0,) * 3, (0.1,) * 3)
        return exact(plant, replace(plant.robot, bodies=(*plant.robot.bodies, tool)))

    return of


def belts(ratio: float) -> Callable[[Plant], Responses]:
    """A wrist whose belts turn motors 5 and 6 along with axis 4, and 6 with 5, which the file does not know."""

    def of(plant: Plant) -> Responses:
        pairs = (("5", "4"), ("6", "4"), ("6", "5"))
        robot = replace(plant.robot, gears=tuple(GearCoupling(*pair, ratio) for pair in pairs))
        return [replace(G, G=robot.mixing @ G.G @ robot.mixing.T) for G in exact(plant, robot)]

    return of


def eccentric(place: int, amplitude: float) -> Callable[[Plant], Responses]:
    """A resolver that reads phi + a sin(phi + phi_0): its slope differs from posture to posture."""

    def of(plant: Plant) -> Responses:
        found = []
        for i, G in enumerate(exact(plant, plant.robot)):
            values = G.G.copy()
            values[:, place] *= 1 + amplitude * math.cos(2.4 * i)
            found.append(replace(G, G=values))
        return found

    return of


def coarse(resolution: float) -> Callable[[Plant], Responses]:
    """Encoders whose steps return in every period, so that no scatter of periods shows them: errors of angle."""

    def by(G: FrequencyResponse) -> FrequencyResponse:
        rng, omega = np.random.default_rng(len(G.configuration.name)), 2 * np.pi * G.freq_hz[:, None, None]
        error = rng.standard_normal((*G.G.shape, 2)) @ np.array([1.0, 1j])
        return replace(G, G=G.G + resolution * np.abs(G.G[:1]).max(axis=0) * (omega / omega[-1]) ** 2 * error)

    return read(by)


def compensated(plant: Plant) -> Responses:
    """The logged torque lacks what the controller adds to bear the weight at the measured angles."""
    found = []
    for G in exact(plant, plant.robot):
        s, K = 2j * np.pi * G.freq_hz[:, None, None], _weight_slope(plant, G)
        found.append(replace(G, G=np.linalg.inv(np.linalg.inv(G.G) - K / s**2)))
    return found


def _weight_slope(plant: Plant, G: FrequencyResponse) -> np.ndarray:
    """d g / d q (n, n) of the rigid robot, by differences of the torques at rest."""
    from elastid.linear.equilibrium import equilibrium

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
        model, places = formulate(plant.robot, plant.model), list(plant.robot.motor_locations)
        outputs = list(places)
        outputs[place] = f"joint {plant.robot.driven[place].name}"
        linearisation, found = Linearisation.of(model), []
        for c in plant.configurations:
            linear = linearisation.at(c, model.theta, tuple(outputs), plant.quantity)
            found.append(to_response(linear, np.append(model.theta, 0.0), plant.freq_hz))
        return [replace(G, outputs=tuple(places)) for G in found]

    return of


# fmt: off
FURTHER: tuple[Injection, ...] = (
    Injection("ratio 2 1 % off", "demo", wrong_ratio("upper_arm", 0, 1, 1.01), ("ratio_2",)),
    Injection("encoders 2 and 3 exchanged", "demo", permuted((0, 2, 1), (0, 1, 2)),
              ("y at motor 2 and at motor 3 exchanged",)),
    Injection("torque constant 3 5 % off", "demo", of_channel("u", 2, constant(1 / 1.05)), ("gain_u_motor_3",)),
    Injection("resolver 2 eccentric", "demo", eccentric(1, 0.03), ("reading_2*",)),
    Injection("tool on a soft plate", "demo", loose_tool(4e3), ("swing_*",), file=with_tool),
    Injection("payload of 1 kg forgotten", "six-axis", payload(1.0, 0.05, 0.02, 0.1), ("payload_*",),
              file=lambda robot: replace(robot, payload=None)),
    Injection("belts between axes 4 to 6", "six-axis", belts(1.0), ("coupling_*",)),
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
