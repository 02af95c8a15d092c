"""Derivatives that need no model of their own, as causes that a fit names first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from plants.faults import CONFIGURATIONS, FREQ_HZ, SPEC, Case, drawn, exact, true_case

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.identify import identify
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import serial
from elastid.record import Configuration

HOSE, LOSS, SOFT = 1e-3, 0.05, 0.95


def with_stiffness(case: Case, further: Callable[[float, FloatArray, FloatArray], ComplexArray]) -> Case:
    """The case with a dynamic stiffness of axis 2: further(k_2, y of its motor, y of its joint) (n, n)."""
    model, s = serial(case.truth), 2j * np.pi * FREQ_HZ[:, None, None]
    linearisation, responses = Linearisation.of(model), []
    places, k = ("motor 2", "joint 2"), case.stiffness["k_2"]
    for G, angles in zip(case.responses, CONFIGURATIONS, strict=True):
        read = linearisation.at(Configuration("c", angles), model.theta, places, "position")
        motors = linearisation.at(Configuration("c", angles), model.theta, G.outputs, "position")
        Z = s**2 * read.M + s * read.D + read.K + further(k, *read.C)
        B = np.broadcast_to(motors.B, (len(FREQ_HZ), *motors.B.shape))
        responses.append(replace(G, G=s**2 * (motors.C @ np.linalg.solve(Z, B))))
    return replace(case, responses=tuple(responses))


def with_hose(case: Case) -> Case:
    """A stiffness between the link and the body before it, beside the gear."""
    return with_stiffness(case, lambda k, _, joint: HOSE * k * np.outer(joint, joint).astype(complex))


def with_loss(case: Case) -> Case:
    """A gear that loses as much at all frequencies."""
    return with_stiffness(case, lambda k, motor, joint: 1j * LOSS * k * np.outer(motor - joint, motor - joint))


def with_soft_day(case: Case) -> Case:
    """One posture was measured when the gear was softer."""
    soft = exact(case.truth.with_parameters({"k_2": SOFT * case.stiffness["k_2"]}))
    return replace(case, responses=(*case.responses[:2], soft[2]))


def behind_gear(case: Case) -> Case:
    """The angle of axis 2 is that of its link."""
    model, s = serial(case.truth), 2j * np.pi * FREQ_HZ[:, None, None]
    linearisation, responses = Linearisation.of(model), []
    for G, angles in zip(case.responses, CONFIGURATIONS, strict=True):
        read = linearisation.at(Configuration("c", angles), model.theta, ("motor 1", "joint 2"), "position")
        Z = s**2 * read.M + s * read.D + read.K
        B = np.broadcast_to(read.B, (len(FREQ_HZ), *read.B.shape))
        responses.append(replace(G, G=s**2 * (read.C @ np.linalg.solve(Z, B))))
    return replace(case, responses=tuple(responses))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "name", "step"),
    [
        (with_hose, "hose_2", HOSE),
        (with_loss, "loss_2", LOSS),
        (with_soft_day, "spring_2@c3", np.log(SOFT)),
        (behind_gear, "encoder of axis 2 behind the gear", None),
    ],
)
def test_a_cause_is_named_first_with_its_size(fault: Callable[[Case], Case], name: str, step: float | None) -> None:
    """To a fifth of its size, by one linear step; or next to what the data cannot distinguish from it."""
    case = true_case()
    result = identify(drawn(fault(case), np.random.default_rng(0)), case.robot, SPEC)
    first = result.indices[0]
    assert name in (first.name, *first.alike)
    assert first.share > 0.8
    if step is not None:
        index = next(each for each in result.indices if each.name == name)
        assert index.steps[0] == pytest.approx(step, rel=0.2)
