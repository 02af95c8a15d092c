"""A simulated rig of two axes, springs in both gears and one in the arm, with dry friction at its motors."""

from __future__ import annotations

from functools import cache

from elastid.base.arrays import IntArray
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, NoiseSpec, SimulatedSpec
from elastid.record import Record
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring

RATIO, TORQUE_RMS = (6.0, 5.0), (58.4, 30.6)
# Nm on the link side: 0.16 of the torque.
COULOMB = tuple(0.16 * rms for rms in TORQUE_RMS)
CONFIGURATIONS = {"a": (0.0, 0.2), "b": (0.5, 0.9)}


def robot(coulomb: tuple[float, float] = COULOMB) -> Robot:
    """Resonances between 8 and 40 Hz."""
    motors = [
        Motor(inertia, ratio, 0.02, level / ratio)
        for inertia, ratio, level in zip((0.2, 0.1), RATIO, coulomb, strict=True)
    ]
    upper = Body("upper", joints=(Joint("1", "z", Spring(30e3, 30), motors[0]),), mass=30,
                 center_of_mass=(0.05, 0, 0.3), inertia=(2, 2, 0.6))  # fmt: skip
    joints = (Joint("2", "y", Spring(15e3, 10), motors[1]), Joint("2x", "x", Spring(12e3, 5)))
    fore = Body("fore", "upper", Placement((0, 0, 0.6)), joints, mass=20,
                center_of_mass=(0.3, 0.05, 0.05), inertia=(0.4, 1.5, 1.5))  # fmt: skip
    return Robot("two axes", (upper, fore), gravity=(0.0, 0.0, -9.81))


@cache
def measured(
    coulomb: tuple[float, float] = COULOMB, realisations: int = 3, seed: int = 1
) -> tuple[tuple[tuple[Record, ...], ...], IntArray]:
    """The records of both configurations on a slow carrier, and the planned lines."""
    excitation = MultisineSpec(500.0, 4.0, (2.0, 50.0), TORQUE_RMS, grid="odd-random")
    simulated = SimulatedSpec(noise=NoiseSpec(torque_std=0.3, angle_std=1e-7), carrier=CarrierSpec(0.01, 2))
    experiment = ExperimentSpec(CONFIGURATIONS, realisations, 2, 1, simulated=simulated)
    machine = robot(coulomb)
    rig = SimulatedRig(machine, experiment, make_plan(excitation, experiment, machine, seed), seed)
    records = [rig.measure(each) for each in rig.experiments]
    of_each = [tuple(r for r in records if r.configuration.name == name) for name in CONFIGURATIONS]
    return tuple(of_each), rig.plan.lines
