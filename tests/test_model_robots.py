"""The published robots in configs/robots: numbers as published, behaviour as their authors describe it."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes
from elastid.model.serial import serial
from elastid.record import Configuration
from elastid.robot import Robot

ROBOTS = Path(__file__).parents[1] / "configs" / "robots"


@pytest.fixture(scope="module")
def manutec() -> Robot:
    content = YAML(typ="safe").load((ROBOTS / "manutec_r3.yml").read_text())
    robot: Robot = TypeAdapter(Robot).validate_python(content)
    return robot


def test_manutec_holds_its_weight_with_the_moment_of_its_masses(manutec):
    """Upper arm level: axis 2 holds m g x summed over arm, forearm, wrist and load by their published positions."""
    model = serial(manutec)
    rigid = {name: 1e10 for name in manutec.parameters() if name.startswith("k_")}
    theta = [rigid.get(name, value) for name, value in zip(model.parameters, model.theta, strict=True)]
    point = equilibrium(model, theta, Configuration("level", (0, np.pi / 2, 0, 0, 0, 0)))
    heights = {56.5: 0.205, 26.4: 0.65 - 0.034, 28.7: 1.064, 5.2: 1.25, 0.5: 1.425, 15.0: 1.625}
    expected = 9.81 * sum(mass * height for mass, height in heights.items())
    assert abs(point.u[1]) == pytest.approx(expected, rel=1e-5)
    assert point.u[0] == pytest.approx(0, abs=1e-6)


def test_manutec_turns_on_axis_1_with_the_inertia_of_its_bodies(manutec):
    """Upright, M_11 is the sum over the bodies by the parallel axis theorem; its lowest mode is an axis on its gear."""
    model = serial(manutec)
    axis = model.index("joint 1")
    # The arm stands 0.3 m in front of axis 1 (in z), its wrist 0.145 m.
    J = 1.16 + 0.64 + 56.5 * (0.172**2 + 0.3**2) + 0.245 + 26.4 * (0.064**2 + 0.3**2)
    J += 0.081 + 0.81 + (28.7 + 5.2) * 0.145**2 + 0.5 * (0.05**2 + 0.195**2) + 15 * (0.1**2 + 0.245**2)
    assert model.mass(np.zeros(model.n_q), model.theta)[axis, axis] == pytest.approx(J, rel=1e-12)

    linear = linearise(model, Configuration("upright", np.zeros(6)), model.theta, model.inputs, "acceleration")
    assert linear.K[axis, axis] == pytest.approx(43 * 105**2, rel=1e-12)
    assert 5 < modes(linear, linear.theta_ref).freq_hz[0] < 40
