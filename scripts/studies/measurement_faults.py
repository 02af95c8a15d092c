"""Faults of a measurement: responses whose channels, clocks, units, configurations or logs are not as stated.

Each function takes the plant and returns its responses with the fault. Functions of s = j omega are filters.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from study_plants import Fault, Plant, exact_responses

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import formulate
from elastid.response import Response

Filter: TypeAlias = Callable[[ComplexArray], ComplexArray]


def constant(factor: complex) -> Filter:
    """Return a gain."""
    return lambda s: np.full(s.shape, factor)


def delay(seconds: float) -> Filter:
    """Return a delay."""
    return lambda s: np.exp(-seconds * s)


def low_pass(corner_hz: float) -> Filter:
    """Return a low pass of first order."""
    return lambda s: 1 / (1 + s / (2 * np.pi * corner_hz))


def inverse_low_pass(corner_hz: float) -> Filter:
    """Return the inverse of a low pass of first order, in inputs that are logged behind it."""
    return lambda s: 1 / low_pass(corner_hz)(s)


def current_loop(corner_hz: float) -> Filter:
    """Return the current loop of a drive, of second order with a damping of 0.7."""
    omega = 2 * np.pi * corner_hz
    return lambda s: omega**2 / (s**2 + 2 * 0.7 * omega * s + omega**2)


def apply_filter(plant: Plant, by: Filter) -> list[Response]:
    """Filter all responses."""
    return [replace(G, G=G.G * by(_s(G)[:, :, None])) for G in exact_responses(plant)]


def one_channel(plant: Plant, role: str, place: int, by: Filter) -> list[Response]:
    """Filter one channel of outputs (y) or inputs (u)."""
    part, responses = (slice(None), *[slice(None)] * (role == "u"), place), []
    for G in exact_responses(plant):
        values = G.G.copy()
        values[part] *= by(_s(G))
        responses.append(replace(G, G=values))
    return responses


def _s(G: Response) -> ComplexArray:
    return 2j * np.pi * G.freq_hz[:, None]


def wrong_rate(plant: Plant, factor: float) -> list[Response]:
    """Multiply the sample rate: frequencies, and accelerations by its square."""
    return [replace(G, freq_hz=factor * G.freq_hz, G=factor**2 * G.G) for G in exact_responses(plant)]


def scale_channels(plant: Plant, rows: Sequence[float], columns: Sequence[float]) -> list[Response]:
    """Multiply outputs and inputs by constants."""
    return [replace(G, G=G.G * np.outer(rows, columns)) for G in exact_responses(plant)]


def motor_unit(plant: Plant, unit_nm: float) -> list[Response]:
    """Read torques as N m at the link that are in a unit on the motor side."""
    ratios = [abs(joint.motor.ratio) for joint in plant.robot.driven if joint.motor is not None]
    return scale_channels(plant, np.ones(len(ratios)), unit_nm * np.array(ratios))


def exchange_channels(plant: Plant, rows: Sequence[int], columns: Sequence[int]) -> list[Response]:
    """Exchange channels of outputs and inputs."""
    return [replace(G, G=G.G[:, list(rows)][:, :, list(columns)]) for G in exact_responses(plant)]


def swap_names(plant: Plant, first: str, second: str) -> list[Response]:
    """Exchange the names of two configurations."""
    order, responses = {first: second, second: first}, {G.configuration.name: G for G in exact_responses(plant)}
    return [replace(responses[order.get(n, n)], configuration=G.configuration) for n, G in responses.items()]


def in_configuration(plant: Plant, name: str, fault: Fault, *arguments: object) -> list[Response]:
    """Confine a fault to one configuration."""
    pairs = zip(exact_responses(plant), fault(plant, *arguments), strict=True)
    return [faulty if right.configuration.name == name else right for right, faulty in pairs]


def change_angles(plant: Plant, *by: Callable[[FloatArray], FloatArray]) -> list[Response]:
    """Measure at functions of the stated angles (n_q,), which the configurations take in turn."""
    pairs = zip(plant.configurations, by * len(plant.configurations), strict=False)
    return exact_responses(plant, angles={c.name: true(np.array(c.angles)) for c, true in pairs})


def coarse_encoders(plant: Plant, resolution: float) -> list[Response]:
    """Round angles to encoder steps that are the same in every period, so that no scatter of periods shows them."""
    responses = []
    for G in exact_responses(plant):
        rng, omega = np.random.default_rng(len(G.configuration.name)), 2 * np.pi * G.freq_hz[:, None, None]
        error = rng.standard_normal((*G.G.shape, 2)) @ np.array([1.0, 1j])
        error *= resolution * np.abs(G.G[:1]).max(axis=0) * (omega / omega[-1]) ** 2
        responses.append(replace(G, G=G.G + error))
    return responses


def gravity_compensation(plant: Plant) -> list[Response]:
    """Log torques without the weight at the measured angles, which the controller adds."""
    model, responses = formulate(plant.robot, plant.model), []
    for G in exact_responses(plant):
        q = np.array(G.configuration.angles)
        K = np.empty((len(q), len(q)))  # slope of the static torques, by differences
        for i, h in enumerate(1e-4 * np.eye(len(q))):
            ends = (equilibrium(model, model.theta, replace(G.configuration, angles=tuple(q + e))).u for e in (h, -h))
            K[:, i] = np.subtract(*ends) / 2e-4
        s = _s(G)[:, :, None]
        responses.append(replace(G, G=np.linalg.inv(np.linalg.inv(G.G) - K / s**2)))
    return responses


def encoder_behind_gear(plant: Plant, axis: int) -> list[Response]:
    """Measure the angle of an axis behind its gear and not at its motor."""
    motors = plant.robot.motor_locations
    outputs = (*motors[:axis], f"joint {plant.robot.driven[axis].name}", *motors[axis + 1 :])
    return [replace(G, outputs=motors) for G in exact_responses(plant, outputs=outputs)]
