"""Faults of a measurement: channels, clocks, units, configurations or logs differ from their description.

Each function returns the responses of the plant with one fault. A filter is a function of s = j omega.
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
    """Return the filter of a constant gain."""
    return lambda s: np.full(s.shape, factor)


def delay(seconds: float) -> Filter:
    """Return the filter of a delay."""
    return lambda s: np.exp(-seconds * s)


def low_pass(corner_hz: float) -> Filter:
    """Return a first-order low pass."""
    return lambda s: 1 / (1 + s / (2 * np.pi * corner_hz))


def inverse_low_pass(corner_hz: float) -> Filter:
    """Return the inverse of a first-order low pass: its effect on a response whose input log is filtered."""
    return lambda s: 1 / low_pass(corner_hz)(s)


def current_loop(corner_hz: float) -> Filter:
    """Return the current loop of a drive: second order, damping ratio 0.7."""
    omega = 2 * np.pi * corner_hz
    return lambda s: omega**2 / (s**2 + 2 * 0.7 * omega * s + omega**2)


def apply_filter(plant: Plant, by: Filter) -> list[Response]:
    """Multiply all responses by a filter."""
    return [replace(G, G=G.G * by(_s(G)[:, :, None])) for G in exact_responses(plant)]


def one_channel(plant: Plant, role: str, place: int, by: Filter) -> list[Response]:
    """Multiply the responses of one output (role y) or one input (role u) by a filter; place: index of the channel."""
    part, responses = (slice(None), *[slice(None)] * (role == "u"), place), []
    for G in exact_responses(plant):
        values = G.G.copy()
        values[part] *= by(_s(G))
        responses.append(replace(G, G=values))
    return responses


def _s(G: Response) -> ComplexArray:
    return 2j * np.pi * G.freq_hz[:, None]


def wrong_rate(plant: Plant, factor: float) -> list[Response]:
    """Multiply the sampling rate by a factor: frequencies by the factor, accelerations by its square."""
    return [replace(G, freq_hz=factor * G.freq_hz, G=factor**2 * G.G) for G in exact_responses(plant)]


def scale_channels(plant: Plant, rows: Sequence[float], columns: Sequence[float]) -> list[Response]:
    """Multiply each row (output) and each column (input) of the responses by a constant."""
    return [replace(G, G=G.G * np.outer(rows, columns)) for G in exact_responses(plant)]


def motor_unit(plant: Plant, unit_nm: float) -> list[Response]:
    """Interpret motor-side torques in a unit of unit_nm as link-side torques in N m."""
    ratios = [abs(joint.motor.ratio) for joint in plant.robot.driven if joint.motor is not None]
    return scale_channels(plant, np.ones(len(ratios)), unit_nm * np.array(ratios))


def exchange_channels(plant: Plant, rows: Sequence[int], columns: Sequence[int]) -> list[Response]:
    """Permute the outputs and the inputs of the responses: rows and columns are the new orders."""
    return [replace(G, G=G.G[:, list(rows)][:, :, list(columns)]) for G in exact_responses(plant)]


def swap_names(plant: Plant, first: str, second: str) -> list[Response]:
    """Exchange the responses of two configurations."""
    order, responses = {first: second, second: first}, {G.configuration.name: G for G in exact_responses(plant)}
    return [replace(responses[order.get(n, n)], configuration=G.configuration) for n, G in responses.items()]


def in_configuration(plant: Plant, name: str, fault: Fault, *arguments: object) -> list[Response]:
    """Apply a fault to a single configuration."""
    pairs = zip(exact_responses(plant), fault(plant, *arguments), strict=True)
    return [faulty if right.configuration.name == name else right for right, faulty in pairs]


def change_angles(plant: Plant, *by: Callable[[FloatArray], FloatArray]) -> list[Response]:
    """Change the true angles: each configuration applies the next of the functions to its stated angles (n_q,)."""
    pairs = zip(plant.configurations, by * len(plant.configurations), strict=False)
    return exact_responses(plant, angles={c.name: true(np.array(c.angles)) for c, true in pairs})


def coarse_encoders(plant: Plant, resolution: float) -> list[Response]:
    """Add quantisation errors of encoders that are equal in all periods and therefore not in the measured noise."""
    responses = []
    for G in exact_responses(plant):
        rng, omega = np.random.default_rng(len(G.configuration.name)), 2 * np.pi * G.freq_hz[:, None, None]
        error = rng.standard_normal((*G.G.shape, 2)) @ np.array([1.0, 1j])
        error *= resolution * np.abs(G.G[:1]).max(axis=0) * (omega / omega[-1]) ** 2
        responses.append(replace(G, G=G.G + error))
    return responses


def gravity_compensation(plant: Plant) -> list[Response]:
    """Log torques without the controller's gravity compensation at the measured angles."""
    model, responses = formulate(plant.robot, plant.model), []
    for G in exact_responses(plant):
        q = np.array(G.configuration.angles)
        K = np.empty((len(q), len(q)))  # derivative of the static torques, by central differences
        for i, h in enumerate(1e-4 * np.eye(len(q))):
            ends = (equilibrium(model, model.theta, replace(G.configuration, angles=tuple(q + e))).u for e in (h, -h))
            K[:, i] = np.subtract(*ends) / 2e-4
        s = _s(G)[:, :, None]
        responses.append(replace(G, G=np.linalg.inv(np.linalg.inv(G.G) - K / s**2)))
    return responses


def encoder_behind_gear(plant: Plant, axis: int) -> list[Response]:
    """Measure the angle of an axis at its link instead of its motor."""
    motors = plant.robot.motor_locations
    outputs = (*motors[:axis], f"joint {plant.robot.driven[axis].name}", *motors[axis + 1 :])
    return [replace(G, outputs=motors) for G in exact_responses(plant, outputs=outputs)]
