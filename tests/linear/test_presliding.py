"""Relaxing springs of motors against the closed form s j omega / (j omega + a), a spring and a damper."""

import numpy as np
import pytest
from plants.elastic_arm import arm

from elastid.base.arrays import ComplexArray
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.presliding import RelaxingSpring
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response
from elastid.record import Configuration

FREQ_HZ = np.linspace(3.0, 40.0, 9)
S = 2j * np.pi * FREQ_HZ
MOTORS = ("motor 1", "motor 2")
POSTURE = Configuration("c1", (0.3, -0.5))


def linear(springs: dict[RelaxingSpring, tuple[float, float]]) -> LinearModel:
    """The arm with springs by s and a; angles of its motors by their torques."""
    linearisation = Linearisation.of_robot(arm(), presliding=tuple(springs))
    numbers = [number for s, a in springs.values() for number in (s, s / a)]
    return linearisation.at(POSTURE, np.append(Linearisation.of_robot(arm()).model.theta, numbers), MOTORS, "position")


def stiffness(model: LinearModel) -> ComplexArray:
    """Torques of the motors over their angles (F, 2, 2)."""
    return np.asarray(np.linalg.inv(Kernel(model, FREQ_HZ, ()).response(model.theta_ref)))


@pytest.mark.parametrize("sign", [1, -1])
def test_relaxing_spring_adds_its_closed_form(sign: int) -> None:
    """Of motor 2 alone, and of both with their own numbers; of either sign."""
    before, second = stiffness(linear({})), RelaxingSpring("2", sign)
    added = stiffness(linear({second: (5e3, 60.0)})) - before
    expected = sign * 5e3 * S / (S + 60.0)
    np.testing.assert_allclose(added[:, 1, 1], expected, rtol=1e-6)
    others = added.reshape(-1, 4)[:, :3]
    np.testing.assert_allclose(others, 0, atol=1e-8 * np.abs(before).max())
    both = stiffness(linear({second: (5e3, 60.0), RelaxingSpring("1"): (2e4, 9.0)})) - before
    np.testing.assert_allclose(both[:, 0, 0], 2e4 * S / (S + 9.0), rtol=1e-6)


def test_slow_relaxation_is_spring_and_fast_one_damper() -> None:
    """a far below and far above the band."""
    before, spring = stiffness(linear({})), RelaxingSpring("1")
    slow, fast = (stiffness(linear({spring: each})) - before for each in ((4e3, 1e-4), (1e9, 1e8)))
    np.testing.assert_allclose(slow[:, 0, 0], 4e3, rtol=1e-4)
    np.testing.assert_allclose(fast[:, 0, 0], 10.0 * S, rtol=1e-4)


def test_derivatives_equal_differences() -> None:
    """To the stiffness and to the damper of one with a negative sign."""
    spring = RelaxingSpring("2", -1)
    model = linear({spring: (5e3, 60.0)})
    _, dG = Columns(Kernel(model, FREQ_HZ, spring.names)).evaluate(model.theta_ref)
    for name, found in zip(spring.names, dG, strict=True):
        ends = []
        for factor in (1 - 1e-5, 1 + 1e-5):
            theta = np.array(model.theta_ref)
            theta[model.parameters.index(name)] *= factor
            ends.append(frequency_response(model, theta, FREQ_HZ))
        expected = (ends[1] - ends[0]) / (2e-5 * model.number(model.theta_ref, name))
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7 * np.abs(expected).max())
