"""Typical faults of a workshop at every plant, small and large, for exact robots and robots within data-sheet errors.

A fault affects an axis in the middle of the robot, its last body, or its first configurations.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import measurement_faults as data
import numpy as np
import robot_faults as robot
from causes import Injection
from study_plants import Fault, Plant

from elastid.base.arrays import FloatArray

CURRENT_NM_A, RATED_NM = 0.9, 6.0  # torque constant, Nm/A, and rated torque, Nm, of the motors (motor side)
SAMPLE_S = 1e-3
AXIS = {"two-axis": 1, "demo": 1, "six-axis": 2, "linkage": 1}  # index of the axis with the fault
# A fit of six axes takes ten times as long as the others: it has one size of each fault.
ALL, OPEN = ("two-axis", "demo", "linkage"), ("two-axis", "demo")
SIX, OPEN_SIX = (*ALL, "six-axis"), (*OPEN, "six-axis")


def workshop(plants: Mapping[str, Plant]) -> Iterator[Injection]:
    """Yield all causes at all plants; every second robot has data-sheet errors."""
    tables = {name: tuple(causes(plant)) for name, plant in plants.items()}
    for row, (names, _) in enumerate(tables["demo"]):
        for place, name in enumerate(names):
            yield replace(tables[name][row][1], is_off_sheet=(row + place) % 2 == 1)


def causes(plant: Plant) -> Iterator[tuple[tuple[str, ...], Injection]]:
    """Yield each cause at one plant, with the names of the plants that have this cause."""
    n, axis, second = len(plant.robot.driven), AXIS[plant.name], plant.configurations[1].name
    i, order = plant.robot.driven[axis].name, [*range(n - 2), n - 1, n - 2]

    def row(
        names: tuple[str, ...], name: str, right: tuple[str, ...], fault: Fault, *arguments: object
    ) -> tuple[tuple[str, ...], Injection]:
        return names, Injection(name, plant.name, right, fault, arguments)

    def turn(degrees: float) -> Callable[[FloatArray], FloatArray]:
        return lambda q: q + np.radians(degrees) * np.eye(len(q))[axis]

    for part, along in ((0.05, 0.1), (0.1, -0.1), (0.3, 0.25)):
        name = f"load of {100 * part:.0f} % at {1e3 * along:.0f} mm"
        yield row(SIX if part == 0.1 else ALL, name, ("payload_*",), robot.increase_payload, part, along)
    yield row(SIX, "ratio 1 % off", (f"ratio_{i}",), robot.wrong_ratio, axis, 1.01)
    yield row(OPEN, "ratio 5 % off", (f"ratio_{i}",), robot.wrong_ratio, axis, 0.95)
    yield row(SIX, "motor inertia twice", (f"Jm_{i}",), robot.scale, 2.0, f"Jm_{i}")
    both = tuple(configuration.name for configuration in plant.configurations[:2])
    yield row(OPEN, "two postures exchanged", ("*exchanged*", "configuration*"), data.swap_names, *both)
    for factor, names in ((0.9, OPEN_SIX), (0.97, OPEN)):
        name, softer = f"spring {100 * (1 - factor):.0f} % softer in one file", (robot.scale, factor, f"k_{i}")
        yield row(names, name, (f"spring_{i}*",), data.in_configuration, second, *softer)
    yield row(SIX, "last y channels swapped", ("y at motor * exchanged",), data.exchange_channels, order, range(n))
    yield row(ALL, "last u channels swapped", ("u at motor * exchanged",), data.exchange_channels, range(n), order)
    for gain in (1.03, 1.1, 0.9):
        name, inverse = f"torque reads {100 * (gain - 1):+.0f} %", data.constant(1 / gain)
        names = SIX if gain == 1.1 else ALL
        yield row(names, name, (f"gain_u_motor_{i}",), data.one_channel, "u", axis, inverse)
    yield row(ALL, "motion reads +2 %", (f"gain_y_motor_{i}",), data.one_channel, "y", axis, data.constant(1.02))
    yield row(ALL, "torques in A", ("*times*", "gain_*"), data.motor_unit, CURRENT_NM_A)
    yield row(ALL, "torques in % of rated", ("*times*", "gain_*"), data.motor_unit, RATED_NM / 100)
    yield row(ALL, "gravity upside down", ("gravity along *",), robot.set_gravity, *(-g for g in plant.robot.gravity))
    yield row(SIX, "encoder behind the gear", ("*behind*",), data.encoder_behind_gear, axis)
    for part in (5.0, 30.0):
        yield row(("demo",), f"base {part:g} times gear 1", ("base_*",), robot.soft_base_of_gear, "x", part)
        yield row(("demo",), f"bending {part:g} times the gear", ("torsion_*",), robot.torsion_of_gear, axis, part)
    u_i, slow = (f"*_u_motor_{i}",), ("delay", "low_pass")
    yield row(SIX, "torque half a sample late", u_i, data.one_channel, "u", axis, data.delay(SAMPLE_S / 2))
    yield row(ALL, "encoder a sample late", (f"*_y_motor_{i}",), data.one_channel, "y", axis, data.delay(SAMPLE_S))
    yield row(ALL, "current loop of 200 Hz", u_i, data.one_channel, "u", axis, data.current_loop(200.0))
    yield row(ALL, "current loops of 100 Hz", slow, data.apply_filter, data.current_loop(100.0))
    yield row(ALL, "encoders filtered by 250 Hz", slow, data.apply_filter, data.low_pass(250.0))
    one_late = data.apply_filter, data.delay(1e-3)
    yield row(OPEN_SIX, "one file 1 ms late", (f"delay@{second}",), data.in_configuration, second, *one_late)
    for rise in (0.3, 0.05):
        name = f"gear hardens by {100 * rise:.0f} %"
        yield row(OPEN, name, (f"load_{i}", f"play_{i}"), robot.hardening, axis, rise)
    yield row(OPEN, "backlash 0.8", (f"play_{i}", f"load_{i}"), robot.backlash, axis, 0.8)
    yield row(ALL, "axis 1 deg off everywhere", (f"zero_{i}",), data.change_angles, turn(1.0))
    one = data.in_configuration, second, data.change_angles, turn(3.0)
    yield row(OPEN, "axis 3 deg off in one posture", (f"angle_{i}@{second}",), *one)
    turns = map(turn, (1.0, -2.0, 3.0, -1.5, 2.5))
    yield row(OPEN_SIX, "angles off by 1 to 3 deg", ("angle*", f"zero_{i}"), data.change_angles, *turns)
