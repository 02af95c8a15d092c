"""A simulated rig of two axes, springs in both gears and two in the arm, with dry friction at its motors."""

from dataclasses import replace
from functools import cache

from elastid.base.arrays import IntArray
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, NoiseSpec, SimulatedSpec
from elastid.record import Record
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from elastid.robot.friction import Friction, LuGre, MaxwellSlip

RATIO, TORQUE_RMS = (6.0, 5.0), (58.4, 30.6)
# Nm on the link side: 0.16 of the torque.
COULOMB = tuple(0.16 * rms for rms in TORQUE_RMS)
CONFIGURATIONS = {"a": (0.0, 0.2), "b": (0.5, 0.9)}


NOISE = NoiseSpec(torque_std=0.3, angle_std=1e-7)


def robot(coulomb: tuple[float, float] = COULOMB, law: str = "coulomb", bending: float = 1.2e-3) -> Robot:
    """Resonances between 8 and 40 Hz; the second motor rides on the first link.

    law: `coulomb`, `lugre` or `maxwell slip` at the motors, or `joint`: Coulomb's behind the gears.  bending: of the
    bristles, rad.
    """
    motors, behind = [], []
    for inertia, ratio, level in zip((0.2, 0.1), RATIO, coulomb, strict=True):
        friction = _bristles(level / ratio, law, bending)
        own = level / ratio if law == "coulomb" else 0.0
        motors.append(Motor(inertia, ratio, 0.02, own, friction=friction))
        behind.append(Friction(coulomb=level) if law == "joint" else None)
    motors[1] = replace(motors[1], on="upper", axis="z")
    joints = (Joint("1", "z", Spring(30e3, 30), motors[0], friction=behind[0]), Joint("1x", "x", Spring(40e3, 30)))
    upper = Body("upper", joints=joints, mass=30,
                 center_of_mass=(0.05, 0, 0.3), inertia=(2, 2, 0.6))  # fmt: skip
    joints = (Joint("2", "y", Spring(15e3, 10), motors[1], friction=behind[1]), Joint("2x", "x", Spring(12e3, 5)))
    fore = Body("fore", "upper", Placement((0, 0, 0.6)), joints, mass=20,
                center_of_mass=(0.3, 0.05, 0.05), inertia=(0.4, 1.5, 1.5))  # fmt: skip
    return Robot("two axes", (upper, fore), gravity=(0.0, 0.0, -9.81))


def _bristles(level: float, law: str, bending: float) -> Friction | None:
    if law == "lugre":
        bristle = LuGre(level / bending, 0.05)
        return Friction(coulomb=level, stiction=1.4 * level, stribeck_velocity=3e-3, lugre=bristle)
    if law == "maxwell slip":
        shares, distances = (0.3, 0.4, 0.3), (0.3 * bending, bending, 4 * bending)
        stiffness = tuple(nu * level / each for nu, each in zip(shares, distances, strict=True))
        return Friction(coulomb=level, maxwell_slip=MaxwellSlip(stiffness, shares, attraction=200 * level))
    return None


Measured = tuple[tuple[tuple[Record, ...], ...], IntArray]


@cache
def measured(coulomb: tuple[float, float] = COULOMB, realisations: int = 3, seed: int = 1) -> Measured:
    """The records of both configurations on a slow carrier, and the planned lines."""
    return simulated(robot(coulomb), CONFIGURATIONS, realisations, seed, 2)


@cache
def measured_bristles(law: str) -> Measured:
    """Two realisations in one configuration, of friction by another law."""
    return simulated(robot(law=law), {"a": CONFIGURATIONS["a"]}, 2, 1, 8)


@cache
def measured_swing() -> Measured:
    """Without friction and nearly without noise, so that distortion is that of the arm, as it swings about "b"."""
    quiet = NoiseSpec(torque_std=0.03, angle_std=1e-8)
    return simulated(robot((0.0, 0.0)), {"b": CONFIGURATIONS["b"]}, 2, 1, 2, quiet)


def simulated(
    machine: Robot,
    configurations: dict[str, tuple[float, ...]],
    realisations: int,
    seed: int,
    substeps: int,
    noise: NoiseSpec = NOISE,
    carrier: CarrierSpec | None = CarrierSpec(0.01, 2),  # noqa: B008
) -> Measured:
    excitation = MultisineSpec(500.0, 2.0, (2.0, 50.0), TORQUE_RMS, grid="odd-random")
    rig_spec = SimulatedSpec(noise=noise, carrier=carrier, substeps=substeps)
    experiment = ExperimentSpec(configurations, realisations, 2, 1, simulated=rig_spec)
    rig = SimulatedRig(machine, experiment, make_plan(excitation, experiment, machine, seed), seed)
    records = [rig.measure(each) for each in rig.experiments]
    of_each = [tuple(r for r in records if r.configuration.name == name) for name in configurations]
    return tuple(of_each), rig.plan.lines
