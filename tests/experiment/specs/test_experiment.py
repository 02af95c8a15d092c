"""The sections of an experiment: one rig, channels of a quantity that goes with them, controllers and noise."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from plants.lab_logs import CHANNELS, ROBOT

from elastid.experiment.specs.channels import QUANTITY_UNIT, ChannelSpec, Structure, channel_refusal, input_units
from elastid.experiment.specs.experiment import ExperimentSpec, ToolSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec, ResponseFileSpec, ResponsesSpec
from elastid.experiment.specs.simulated import CarrierSpec, SimulatedSpec
from elastid.simulation.dynamics import FIFTH_ORDER
from elastid.simulation.spec import ControllerSpec

U, Y = ChannelSpec("u", "motor 1", "u"), ChannelSpec("y", "motor 1", "q", quantity="position")
HEAT = ChannelSpec("t", "joint 1", "T", quantity="temperature")
SENSOR = replace(Y, at="accelerometer tool x", quantity="acceleration")
FILE = FileSpec("a.csv", "home", also=("b.csv",))
LOGS = RecordedSpec(100.0, (U, Y), (FILE,), period_samples=2.0)
RESPONSES = ResponsesSpec((ResponseFileSpec("tap.csv", "a"),), (U, Y))
TAPS = ToolSpec(RESPONSES, "controlled", (0.0,), (0.0,))


@pytest.mark.parametrize(
    ("section", "right", "wrong"),
    [
        (U, {"file": 1}, {"file": 0}),
        (U, {"column": 1}, {"column": 0}),
        (U, {"channel": "", "column": 2}, {"channel": ""}),
        (U, {"hold": "zero-order", "side": "motor"}, {"scale": 0.0}),
        (Y, {"side": "motor"}, {"hold": "zero-order"}),
        (HEAT, {"side": "link"}, {"side": "motor"}),
        (SENSOR, {"quantity": "acceleration"}, {"quantity": "velocity"}),
        (LOGS, {"channels": (U, replace(Y, file=2))}, {"channels": (U, replace(Y, file=3))}),
        (LOGS, {"time": "t"}, {"channels": (replace(U, file=2), Y)}),
        (LOGS, {"channels": (U, Y, HEAT)}, {"channels": (U,)}),
        (LOGS, {"period_samples": None, "period": 0.02}, {"period_samples": None, "period": 0.0199}),
        (LOGS, {"rate_hz": "unknown"}, {"rate_hz": "unknown", "time": "t"}),
        (LOGS, {"period_samples": 2.5}, {"rate_hz": "unknown", "channels": (U, replace(Y, rate_hz=50.0))}),
        (LOGS, {"period_samples": None}, {"rate_hz": "unknown", "period_samples": None, "period": 2.0}),
        (LOGS, {"half_wave": True}, {"half_wave": True, "period_samples": 201.0}),
        (LOGS, {"period_samples": 201.0}, {"half_wave": True, "period_samples": None}),
        (LOGS, {"files": (replace(FILE, period=1.0),)}, {"period": 2.0}),
        (LOGS, {"period_samples": None, "period": "find"}, {"files": ()}),
        (RESPONSES, {"channels": ()}, {"channels": (U,)}),
        (RESPONSES, {"hold": "zero-order", "rate_hz": 50.0}, {"hold": "zero-order"}),
        (RESPONSES, {"rate_hz": 50.0}, {"channels": (replace(U, hold="zero-order"), Y)}),
        (RESPONSES, {"channels": (replace(U, hold="zero-order", rate_hz=9.0), Y)}, {"files": ()}),
        (TAPS, {"stiffness": (4.0,), "damping": (1.0,)}, {"stiffness": (-1.0,)}),
        (TAPS, {"motors": "free", "stiffness": (), "damping": ()}, {"damping": (-1.0,)}),
        (TAPS, {"stiffness": (1.0, 2.0), "damping": (0.1, 0.2)}, {"damping": (0.1, 0.2)}),
        (TAPS, {"motors": "held", "stiffness": (), "damping": ()}, {"stiffness": (), "damping": ()}),
        (CarrierSpec(0.1), {"cycles": 2}, {"velocity": 0.1}),
        (CarrierSpec(0.1), {"kind": "square", "amplitude": None, "velocity": (0.1, -0.1)}, {"amplitude": None}),
        (CarrierSpec(kind="offset", velocity=0.1), {"velocity": -0.1}, {"velocity": (0.1, 0.0)}),
        (ControllerSpec(kind="cascade"), {"damping_ratio": 0.2}, {"damping_ratio": 0.2, "integral_time": 0.01}),
    ],
)
def test_a_section_is_what_can_be(section: Any, right: dict[str, Any], wrong: dict[str, Any]) -> None:
    """A drive that pushes away, a period in s of logs without a rate, half a wave of an odd period cannot."""
    replace(section, **right)
    with pytest.raises(ValueError):  # noqa: PT011
        replace(section, **wrong)


def test_a_role_goes_with_its_quantities_alone() -> None:
    efforts, motions = {"torque", "force", "current", "voltage"}, {"position", "velocity", "acceleration"}
    fitting = {"r": efforts, "u": efforts, "d": efforts, "y": motions, "t": {"temperature"}, "reference": {"position"}}
    taken = set()
    for role, quantity in product(fitting, QUANTITY_UNIT):
        try:
            taken.add((role, ChannelSpec(role, "motor 1", "c", quantity=quantity).quantity))  # type: ignore[arg-type]
        except ValueError:
            continue
    assert taken == {(role, quantity) for role, quantities in fitting.items() for quantity in quantities}


@pytest.mark.parametrize(
    ("quantity", "turning", "translating"),
    [("position", "deg", "mm"), ("velocity", "rpm", "mm/s"), ("acceleration", "rad/s^2", "m/s^2"), ("force", "", "kN")],
)
def test_without_a_robot_a_unit_shows_whether_a_place_turns(quantity: Any, turning: str, translating: str) -> None:
    """One place does not do both; a unit of another quantity, or none, is refused."""
    role = "u" if quantity == "force" else "y"
    turns, slides, other, bare = (
        ChannelSpec(role, "tip x", "c", quantity=quantity, unit=unit) for unit in (turning, translating, "V", "")
    )
    structure = Structure.from_channels([U, slides, replace(turns, at="b")])
    assert structure.slides("tip x")
    assert structure.slides("b") == (quantity == "force")
    assert structure.sliding(["tip x", "motor 1", "tip x"]) == ("tip x",)
    assert channel_refusal(turns, (turns,), structure) == channel_refusal(slides, (slides, U), structure) == ("", "")
    assert channel_refusal(other, (other,), structure)[0] == ("" if quantity == "force" else "unit")
    assert channel_refusal(bare, (bare,), structure)[0] == ("" if quantity == "force" else "unit")
    both = replace(Y, at="tip x", unit="rad")
    assert channel_refusal(slides, (slides, both), structure)[0] == "at"
    assert channel_refusal(replace(slides, side="motor"), (slides,), structure)[0] == "side"


def test_a_robot_takes_currents_with_a_torque_constant_and_a_structure_any_drive() -> None:
    volts, amperes = (replace(U, quantity=quantity) for quantity in ("voltage", "current"))
    torque = replace(amperes, torque_constant=0.1)
    keys = [channel_refusal(channel, (), ROBOT)[0] for channel in (U, torque, amperes, volts)]
    assert keys == ["", "", "quantity", "quantity"]
    structure = Structure.from_channels((replace(volts, at="shaker"), replace(U, quantity="force"), Y))
    assert structure.motor_locations == ("shaker", "motor 1")
    assert not structure.count_refusal(0)
    assert structure.count_refusal(1)
    assert input_units((volts, amperes, torque, replace(U, quantity="force"), Y), structure) == ("V", "A", "N", "N")
    assert input_units((U, torque, Y), structure) == ()


def test_temperatures_are_in_degrees_celsius_and_nothing_else_is_moved() -> None:
    """Water freezes at 0 and boils at 100."""
    for unit, freezes, boils in (("", 0.0, 100.0), ("K", 273.15, 373.15), ("degF", 32.0, 212.0)):
        channel = replace(HEAT, unit=unit)
        celsius = np.array([freezes, boils]) * channel.unit_factor(False) + channel.offset
        np.testing.assert_allclose(celsius, [0, 100], atol=1e-9)
    assert [channel.offset for channel in CHANNELS] == 4 * [0.0]


@pytest.mark.parametrize(
    ("change", "is_refused"),
    [
        ({"path": "b.csv"}, False),
        ({}, True),
        ({"samples": (0, 9)}, False),
        ({"experiment": 1, "period": "none"}, False),
        ({"path": "b.csv", "period": 3.0}, True),
        ({"path": "b.csv", "period": "none"}, True),
    ],
)
def test_files_of_one_run_are_other_samples_of_one_known_period(change: dict[str, Any], is_refused: bool) -> None:
    logs = replace(LOGS, files=(FILE, replace(FILE, **change)))
    assert not logs.repeat_refusal(0)
    assert bool(logs.repeat_refusal(1)) == is_refused


def test_exactly_one_rig_with_its_kind() -> None:
    for kind, section in {"simulated": SimulatedSpec(), "recorded": LOGS, "responses": RESPONSES}.items():
        spec = ExperimentSpec(**{kind: section})  # type: ignore[arg-type]
        assert (spec.kind, spec.rig) == (kind, section)
    for rigs in ({}, {"simulated": SimulatedSpec(), "recorded": LOGS}):
        with pytest.raises(ValueError, match="exactly one"):
            ExperimentSpec(**rigs)  # type: ignore[arg-type]


@pytest.mark.parametrize("highest_hz", [20.0, 60.0, 90.0, 200.0])
def test_steps_are_as_few_as_turn_by_the_right_angle(highest_hz: float) -> None:
    """Of what rotates at the end of the band the frequency is right to 4e-6, and one step less is too few."""

    def error(steps: int) -> float:
        angle = 2 * np.pi * highest_hz / 500.0 / steps
        return float(abs(np.angle(FIFTH_ORDER.amplification(np.array(1j * angle))) / angle - 1))

    steps = SimulatedSpec().steps(500.0, highest_hz)
    assert error(steps) < 4.2e-6
    assert steps == 2 or error(steps - 1) > 3.9e-6
    assert SimulatedSpec(substeps=1).steps(500.0, highest_hz) == 1
