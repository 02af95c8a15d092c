"""Logs that contradict the plan they were measured by are named for what they are, and clean ones are not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from plants.limited_arm import arm, experiment

from elastid.base.arrays import FloatArray
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.movement import reference
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.simulated.plant import feed_forward_of, model_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.recorded.planned_run import PlannedRun, contradiction
from elastid.robot import Frame, Payload, Placement, Robot

EXCITATION = MultisineSpec(rate_hz=500.0, period=1.0, band_hz=(2.0, 60.0), torque_rms=(60.0, 50.0))
EXPERIMENT = experiment(CarrierSpec(amplitude=0.01, cycles=1), ramp=0.25, hold=0.1)
# The springs that the fit is to find.
TRUTH = {"k_1": 2.4e5, "k_2": 2.4e5}

Log = tuple[FloatArray, FloatArray, FloatArray]


def robot() -> Robot:
    return replace(arm(), frames=(Frame("tool", "beam", Placement((0.0, 0.0, 0.6))),))


@pytest.fixture(scope="module")
def planned() -> PlannedRun:
    plan = make_plan(EXCITATION, EXPERIMENT, robot(), 3)
    rig = SimulatedRig(robot(), EXPERIMENT, plan, 3)
    run = plan.experiments[0]
    given = reference(plan, EXPERIMENT.as_simulated().carrier, feed_forward_of(model_of(robot())), run.configuration)
    return PlannedRun(plan, run, given, rig.rehearse(run), robot(), True)


@pytest.fixture(scope="module")
def clean(planned: PlannedRun) -> Log:
    return measured(robot(), planned.plan)


def measured(truth: Robot, plan: Plan, spec: ExperimentSpec = EXPERIMENT) -> Log:
    return SimulatedRig(truth, spec.with_truth(dict(TRUTH)), plan, 3).log(plan.experiments[0])


def said(planned: PlannedRun, log: Log) -> str:
    return contradiction(planned, *log)


def test_a_clean_log_of_a_robot_with_other_springs_contradicts_nothing(planned: PlannedRun, clean: Log) -> None:
    assert said(planned, clean) == ""


FAULTS: dict[str, tuple[Callable[[Log], Log], str]] = {
    "short": (lambda log: (log[0][:-7], log[1][:-7], log[2][:-7]), "samples"),
    "late": (lambda log: tuple(np.roll(x, -100, axis=0) for x in log), "0.2 s after"),  # type: ignore[dict-item]
    "missing": (lambda log: (log[0], np.where(log[1] == log[1].max(), np.nan, log[1]), log[2]), "u has samples"),
    "injected exchanged": (lambda log: (log[0][:, ::-1], *log[1:]), "(r) of motor 1"),
    "injected motor side": (lambda log: (log[0] / [100, 90], *log[1:]), "0.0100 times"),
    "injected nothing like it": (lambda log: (np.cumsum(log[0], axis=0), *log[1:]), "(r) of motor 1"),
    "torques exchanged": (lambda log: (log[0], log[1][:, ::-1], log[2]), "(u) of motor"),
    "torque mirrored": (lambda log: (log[0], log[1] * [1, -1], log[2]), "(u) of motor 2"),
    "torque motor side": (lambda log: (log[0], log[1] / [100, 1], log[2]), "(u) of motor 1"),
    "positions exchanged": (lambda log: (*log[:2], log[2][:, ::-1]), "(y) of motor 1"),
    "position mirrored": (lambda log: (*log[:2], 0.4 - log[2] * [1, 1] + [0, 0.4]), "(y) of motor 1"),
    "degrees": (lambda log: (*log[:2], np.degrees(log[2])), "(y) of motor 1"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_log_is_named(fault: str, planned: PlannedRun, clean: Log) -> None:
    spoil, words = FAULTS[fault]
    message = said(planned, spoil(clean))
    assert words in message, message


@pytest.mark.parametrize("mass", [12.0, 25.0])
def test_another_payload_is_seen(planned: PlannedRun, mass: float) -> None:
    """By the torques that hold it, on a robot whose springs are unknown."""
    loaded = replace(robot(), payload=Payload(mass=mass, at="tool"))
    message = said(planned, measured(loaded, planned.plan))
    assert "(u) of motor" in message, message
