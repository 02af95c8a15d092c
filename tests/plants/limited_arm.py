"""Two elastic axes with limits, friction and gravity, and the excitation that is to fill the limits."""

from dataclasses import replace
from typing import Any

from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, NoiseSpec, SimulatedSpec
from elastid.robot import Body, Joint, Limits, Motor, Placement, Robot, Spring

LIMITS = Limits(angle=(-1.5, 1.5), velocity=0.8, torque=1500.0, acceleration=40.0)
EXCITATION = MultisineSpec(rate_hz=500.0, period=1.0, band_hz=(2.0, 60.0), torque_rms="limits")

CARRIERS = [
    None,
    CarrierSpec(amplitude=0.02),
    CarrierSpec(kind="square", velocity=0.05),
    CarrierSpec(kind="offset", velocity=0.1),
]


def arm(limits: Limits = LIMITS) -> Robot:
    """Two elastic axes with friction under gravity."""
    motor = Motor(3e-3, 100, 2e-3, 0.15)
    upper = Joint("1", "z", Spring(3e5, 300), motor, limits=limits)
    lower = Joint("2", "y", Spring(2e5, 200), replace(motor, ratio=-90), limits=limits)
    return Robot(
        "arm",
        (
            Body("turret", joints=(upper,), mass=80, center_of_mass=(0.1, 0, 0.1), inertia=6),
            Body("beam", "turret", Placement((0.1, 0, 0.4)), (lower,), 40, (0.0, 0.02, 0.3), 4),
        ),
    )


def experiment(carrier: CarrierSpec | None = None, **changes: Any) -> ExperimentSpec:
    noise = NoiseSpec(torque_std=0.5, disturbance_std=0.5, encoder_counts=1 << 20)
    simulated = SimulatedSpec(carrier=carrier, noise=noise, substeps=4)
    return replace(ExperimentSpec({"a": (0.2, 0.4)}, 1, simulated=simulated), **changes)
