"""Where a mode's potential energy is: closed forms, and what a change of each spring does to the frequencies."""

from dataclasses import replace

import numpy as np
import pytest
from plants.gears import wrist
from plants.linkages import linkage
from plants.marks import slow

from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.modes import StrainEnergy, modes, robot_shapes, strain_energy
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Robot, Spring

WEIGHTLESS = (0.0, 0.0, 0.0)


def undamped(robot: Robot) -> Robot:
    return robot.with_parameters({name: 0.0 for name in robot.parameters() if name[0] in "df"})


LINKAGE = undamped(replace(linkage(crank=0.33, bends=True), gravity=WEIGHTLESS))


def chain(*stiffness: float) -> Robot:
    """A motor of 3 kg*m^2 on the link side, then a disc of 2 kg*m^2 behind each spring."""
    bodies = [Body("d0", joints=(Joint("0", "z", Spring(stiffness[0]), Motor(3.0)),), inertia=2.0)]
    for i, k in enumerate(stiffness[1:], start=1):
        bodies.append(Body(f"d{i}", f"d{i - 1}", joints=(Joint(f"{i}", "z", Spring(k)),), inertia=2.0))
    return Robot("chain", tuple(bodies), WEIGHTLESS)


def found(robot: Robot, angles: list[float], spec: ModelSpec | None = None) -> tuple[np.ndarray, StrainEnergy]:
    """Natural frequencies and energies of the modes without damping."""
    model = formulate(robot, spec or ModelSpec())
    at = Configuration("c", np.array(angles))
    linear = linearise(model, at, model.theta, model.inputs, "position")
    swinging = modes(linear, linear.theta_ref)
    shapes = robot_shapes(linear, swinging.shapes)
    return swinging.freq_hz, strain_energy(model, model.theta, equilibrium(model, model.theta, at), shapes)


@pytest.mark.parametrize(("angle", "sign"), [(0.0, 1), (np.pi, -1)])
def test_a_pendulum_on_a_spring_has_its_weight_s_share(angle: float, sign: int) -> None:
    """m g l beside k where it hangs; where it stands upright its weight helps the mode on: a negative share."""
    k, m, length, rotor = 4e3, 20.0, 0.7, 1.5
    joint = Joint("1", "y", Spring(k), Motor(rotor))
    robot = Robot("pendulum", (Body("a", joints=(joint,), mass=m, center_of_mass=(0, 0, -length), inertia=0.1),))
    freq_hz, energy = found(robot, [angle])
    omega, weight = 2 * np.pi * freq_hz[-1], sign * m * 9.81 * length
    motor = k / (k - rotor * omega**2)  # per rad of the arm
    springs = k * (motor - 1) ** 2
    assert energy.fraction[0, -1] == pytest.approx(springs / (springs + weight), rel=1e-9)
    assert energy.load[-1] == pytest.approx(weight / (springs + weight), rel=1e-6)
    assert np.sign(energy.load[-1]) == sign


def test_a_nonlinear_spring_counts_with_its_tangent() -> None:
    """A horizontal arm deflects its gear; only the spring and the weight store anything, and theirs is all of it."""
    joint = Joint("1", "y", Spring(2e4, cubic=5e7), Motor(1.5))
    arm = Body("a", joints=(joint,), mass=40.0, center_of_mass=(0.5, 0, 0), inertia=0.1)
    freq_hz, energy = found(Robot("arm", (arm,)), [0.0])
    model = formulate(Robot("arm", (arm,)))
    point = equilibrium(model, model.theta, Configuration("c", np.zeros(1)))
    x = point.q[1] - point.q[0]
    tangent = 2e4 + 3 * 5e7 * x**2
    motor = tangent / (tangent - 1.5 * (2 * np.pi * freq_hz[-1]) ** 2)
    weight = 40 * 9.81 * 0.5 * -np.sin(point.q[0])  # V = -m g l sin q
    springs = tangent * (motor - 1) ** 2
    assert abs(x) > 5e-3
    assert energy.fraction[0, -1] == pytest.approx(springs / (springs - weight), rel=1e-8)


ROBOTS = {
    "after the gears": (undamped(wrist("after", shafts=False, links=True)), [0.3, -0.4, 0.9], ModelSpec()),
    "before the gears": (undamped(wrist("before", shafts=False, links=True)), [0.3, -0.4, 0.9], ModelSpec()),
    "in series": (undamped(wrist("before", links=True)), [0.3, -0.4, 0.9], ModelSpec()),
    "constrained": (LINKAGE, [0.2, -0.1], ModelSpec("constrained")),
    "minimal": (LINKAGE, [0.2, -0.1], ModelSpec("minimal")),
    "series_stiffness": (LINKAGE, [0.2, -0.1], ModelSpec("minimal", "series_stiffness")),
    "bending_outside": (LINKAGE, [0.2, -0.1], ModelSpec("minimal", "bending_outside")),
}


# The others run with the slow tests.
QUICK = {"after the gears", "in series", "constrained", "minimal"}


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in ROBOTS])
def test_spring_energy_fraction_is_frequency_sensitivity(name: str) -> None:
    """d ln f^2 / d ln k (Rayleigh), by differences of the modes of other robots; without weight they sum to one."""
    robot, angles, spec = ROBOTS[name]
    freq_hz, energy = found(robot, angles, spec)
    assert len(freq_hz) >= 2
    for spring, share in zip(energy.springs, energy.fraction, strict=True):
        value, h = robot.parameters()[spring][0], 1e-4
        stiffer, softer = (found(robot.with_parameters({spring: value * np.exp(e)}), angles, spec)[0] for e in (h, -h))
        np.testing.assert_allclose(share, np.log(stiffer / softer) / h, atol=2e-6)
    np.testing.assert_allclose(energy.fraction.sum(axis=0), 1.0, rtol=1e-9)
