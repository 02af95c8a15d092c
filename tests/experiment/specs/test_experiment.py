"""The sections of an experiment: one rig, channels of a quantity that goes with them, controllers and noise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec, ToolSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec, ResponseFileSpec, ResponsesSpec
from elastid.experiment.specs.simulated import CarrierSpec, SimulatedSpec
from elastid.simulation.runge_kutta import FIFTH_ORDER
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
        (LOGS, {"half_wave": True}, {"half_wave": True, "period_samples": 201.0}),
        (LOGS, {"period_samples": None, "period": "find"}, {"files": ()}),
        (RESPONSES, {"channels": ()}, {"channels": (U,)}),
        (RESPONSES, {"hold": "zero-order", "rate_hz": 50.0}, {"hold": "zero-order"}),
        (TAPS, {"stiffness": (4.0,), "damping": (1.0,)}, {"stiffness": (-1.0,)}),
        (TAPS, {"motors": "free", "stiffness": (), "damping": ()}, {"damping": (-1.0,)}),
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


def test_exactly_one_rig_with_its_kind() -> None:
    for kind, section in {"simulated": SimulatedSpec(), "recorded": LOGS, "responses": RESPONSES}.items():
        spec = ExperimentSpec(**{kind: section})
        assert (spec.kind, spec.rig) == (kind, section)
    for rigs in ({}, {"simulated": SimulatedSpec(), "recorded": LOGS}):
        with pytest.raises(ValueError, match="exactly one"):
            ExperimentSpec(**rigs)


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
