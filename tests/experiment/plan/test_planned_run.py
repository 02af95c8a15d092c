"""Records that contradict the plan they were measured by are named for what they are, and clean ones are not."""

from dataclasses import replace

import numpy as np
import pytest
from plants.limited_arm import arm, experiment

from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.plan.planned_run import contradiction
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.friction.robot_friction import coulomb_torques
from elastid.record import Record
from elastid.robot import Frame, Payload, Placement, Robot

EXCITATION = MultisineSpec(rate_hz=500.0, period=1.0, band_hz=(2.0, 60.0), torque_rms=(60.0, 50.0))
EXPERIMENT = experiment(CarrierSpec(amplitude=0.01, cycles=1), ramp=0.25, hold=0.1)
# The springs that the fit is to find.
TRUTH = {"k_1": 2.4e5, "k_2": 2.4e5}


def robot() -> Robot:
    return replace(arm(), frames=(Frame("tool", "beam", Placement((0.0, 0.0, 0.6))),))


@pytest.fixture(scope="module")
def plan() -> Plan:
    return make_plan(EXCITATION, EXPERIMENT, robot(), 3)


@pytest.fixture(scope="module")
def clean(plan) -> Record:
    return measured(robot(), plan)


def measured(truth: Robot, plan: Plan) -> Record:
    return SimulatedRig(truth, EXPERIMENT.with_truth(dict(TRUTH)), plan, 3).measure(plan.experiments[0])


def said(plan: Plan, record: Record) -> str:
    rehearsal = SimulatedRig(robot(), EXPERIMENT, plan, 3).rehearse(plan.experiments[0])
    return contradiction(record, plan, rehearsal, coulomb_torques(robot()), True)


def test_clean_log_of_robot_with_other_springs_contradicts_nothing(plan: Plan, clean: Record) -> None:
    """Nor one that begins some samples after the plan."""
    assert said(plan, clean) == ""
    assert said(plan, replace(clean, **{name: np.roll(getattr(clean, name), -5, axis=0) for name in "ruy"})) == ""


FAULTS = {
    "late": (lambda log: {name: np.roll(getattr(log, name), -100, axis=0) for name in "ruy"}, "0.2 s"),
    "injected exchanged": (lambda log: {"r": log.r[:, ::-1]}, "(r) of motor 1"),
    "injected motor side": (lambda log: {"r": log.r / [100, 90]}, "gain 0.0100"),
    "injected nothing like it": (lambda log: {"r": np.cumsum(log.r, axis=0)}, "(r) of motor 1"),
    "torque mirrored": (lambda log: {"u": log.u * [1, -1]}, "(u) of motor 2"),
    "torque motor side": (lambda log: {"u": log.u / [100, 1]}, "(u) of motor 1"),
    "position mirrored": (lambda log: {"y": 0.4 - log.y * [1, 1] + [0, 0.4]}, "(y) of motor 1"),
    "degrees": (lambda log: {"y": np.degrees(log.y)}, "(y) of motor 1"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_log_is_named(fault: str, plan: Plan, clean: Record) -> None:
    spoil, words = FAULTS[fault]
    message = said(plan, replace(clean, **spoil(clean)))
    assert words in message, message


@pytest.mark.parametrize("mass", [12.0, 25.0])
def test_another_payload_is_seen(plan: Plan, mass: float) -> None:
    """By the torques that hold it, on a robot whose springs are unknown."""
    loaded = replace(robot(), payload=Payload(mass=mass, at="tool"))
    message = said(plan, measured(loaded, plan))
    assert "(u) of motor" in message, message
