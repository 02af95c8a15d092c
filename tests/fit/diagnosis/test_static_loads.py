"""Static load tests against responses: faults of the tests are found and named, true ones are not."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from plants import arm as planar
from plants.load_tests import NAMED, load_tests, measure, tapped
from plants.refusals import refused
from plants.two_mass import drawn, two_inertias

import elastid as ei
from elastid.base.arrays import ComplexArray
from elastid.fit.identify import check_responses, identify
from elastid.fit.load_tests import LoadTest
from elastid.fit.problem.static_loads import PlacedTest, placed_tests
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.record import MOTION_ORDER, JointLoop
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot, Spring


def test_the_ratio_and_wider_intervals():
    """A factor 1.2 is found as such; intervals that contain the pull of both hold the truth."""
    tests = load_tests(np.random.default_rng(5), changed=lambda y, force: 1.2 * y)
    responses, spec = measure(np.random.default_rng(6)), FitSpec(parameters={"k_*": ParameterSpec()}, starts=1)
    result = identify(responses, planar.robot(), spec, loads=placed_tests(tests, NAMED))
    assert result.status == "misfit"
    assert "fit/loads" in {note.code for note in result.notes}
    assert abs(result.static.ratio - 1.2) < 4 * result.static.ratio_std + 1e-3
    assert result.static.ratio_std < 0.05
    for name, true in zip(("k_1", "k_2"), planar.STIFFNESS, strict=True):
        low, high = result.interval(name)
        assert low < true < high


LEVER, STIFFNESS = 0.4, 60.0
F_HZ = np.linspace(5.0, 80.0, 30)


def read(where: str, places: tuple[str, str], G: ComplexArray, **further: str) -> ei.Response:
    """A response with 1 % of noise."""
    G, noise = drawn(G, 0.01 * np.abs(G), np.random.default_rng(0))
    at = ei.Configuration(where, np.zeros(1))
    return replace(ei.Response(F_HZ, G, places[:1], places[1:], "acceleration", at, noise=noise), **further)


def fitted_with_force(
    held: str, stated: str, factor: float, loads: Sequence[PlacedTest] = (), softer: float = 1.0
) -> ei.Result:
    """Of one elastic joint, its motor and a force at its tool, of which the file holds another quantity or size.

    k_1 is that of the motors.  softer: of the spring that the force meets, times that of the motor's response.
    """
    joint = Joint("1", "z", Spring(STIFFNESS, 0.01), Motor(1e-3, viscous=1e-3))
    tool = Frame("tool", "load", Placement((LEVER, 0.0, 0.0)))
    robot = Robot("one", (Body("load", joints=(joint,), inertia=1e-3),), frames=(tool,), gravity=(0.0, 0.0, 0.0))
    s = 2j * np.pi * F_HZ[:, None, None]
    motion = factor * s ** MOTION_ORDER[held] * LEVER**2 / (1e-3 * s**2 + 0.01 * s + softer * STIFFNESS)
    motors = read("a", ("motor 1", "motor 1"), two_inertias(F_HZ, 1e-3, 1e-3, STIFFNESS, 0.01, 1e-3)[:, :1])
    force = read("a at the tool", ("force tool y", "frame tool y"), motion, motors="locked", quantity=stated)
    result = identify([motors, force], robot, FitSpec(parameters={"k_1": ParameterSpec()}, starts=1), loads=loads)
    assert abs(result.values["k_1"] - STIFFNESS) < 4 * result.std["k_1"]
    return result


@pytest.mark.parametrize(
    ("held", "stated", "factor"),
    [
        *(("acceleration", "acceleration", factor) for factor in (1.0, 1.3, -1.0)),
        *(("acceleration", stated, 1.0) for stated in ("velocity", "position")),
        *((held, "acceleration", 1.0) for held in ("velocity", "position")),
    ],
)
def test_another_size_at_the_tool_is_told_from_another_reading(held: str, stated: str, factor: float) -> None:
    """The size by its ratio and in dB; the numbers are those of the motors where both contradict each other."""
    result = fitted_with_force(held, stated, factor)
    tool, (compared,) = result.tool, result.tool.responses
    assert tool.disagrees == (factor != 1.0 or held != stated)
    assert tool.is_misread == (factor < 0 or held != stated)
    assert result.status == ("misfit" if tool.disagrees else "converged")
    assert [linear.configuration.name for linear in result.linear] == ["a"]
    if held == stated:
        assert abs(tool.ratio - factor) < 4 * tool.ratio_std < 0.01
        assert compared.rms_log_db == pytest.approx(20 * np.log10(abs(factor)), abs=0.1)


def test_softer_tool_spring_is_no_scale_and_no_misreading() -> None:
    """A tenth softer than that of the motors, whose number stays."""
    result = fitted_with_force("acceleration", "acceleration", 1.0, softer=0.9)
    assert result.tool.disagrees > result.tool.is_misread


def test_load_tests_that_agree_count_where_the_tool_contradicts() -> None:
    """The information on ln k is that of the motors and (y / std)^2 of a deflection y = F l^2 / k."""
    y = LEVER**2 / STIFFNESS
    test = LoadTest(angles=(0.0,), force=(0.0, 1.0, 0.0), along="y", frame="tool", deflection=y, std=4e-4 * y)
    alone = fitted_with_force("acceleration", "acceleration", -1.0)
    both = fitted_with_force("acceleration", "acceleration", -1.0, placed_tests([test], {}))
    assert both.tool.disagrees > both.static.disagrees
    assert abs(both.static.ratio - 1) < 3.5 * both.static.ratio_std
    (reading,) = both.static.readings
    assert reading.by_responses_std == pytest.approx(y * np.sqrt(alone.covariance[0, 0]), rel=0.05)
    assert 1 / both.covariance[0, 0] == pytest.approx(1 / alone.covariance[0, 0] + 4e-4**-2, rel=0.05)


def test_a_sensor_that_was_not_plugged_in_says_nothing() -> None:
    """Zeros at the tool: a warning, the motors' numbers as they are, and no disagreement."""
    result = fitted_with_force("acceleration", "acceleration", 0.0)
    assert not result.tool.disagrees
    assert result.tool.ratio_std == np.inf
    assert result.tool.sentence
    assert any("frame tool y" in note.text for note in result.notes)


def test_what_no_motor_can_do_is_refused() -> None:
    """Motors that are held and move, or are controlled by nothing; torques of motors and forces in one response."""
    response = tapped(ei.Configuration("p0", np.array([0.3, 0.5])), F_HZ, 0.0, np.random.default_rng(0))
    loop = JointLoop(*3 * [np.ones(2)])
    for wrong in (
        {"outputs": ("motor 1", "frame tool z")},
        {"motors": "controlled"},
        {"motors": "controlled", "loop": loop},
        {"inputs": ("force tool x", "motor 1")},
        {"inputs": ("motor 1", "motor 2")},
        {"inputs": ("force hok x", "force tool z")},
    ):
        with refused("fit/responses", place="configuration p0"):
            check_responses([replace(response, **wrong)], planar.robot())
