"""summary.json has the same keys however a fit ends, and what was taken out of the responses."""

import json
import math
from typing import Any

import pytest
from plants.artefacts import some_fit
from plants.taken_friction import LEVELS, ROBOT, STDS, THRESHOLD, taken_friction

from elastid.app.summaries import summary
from elastid.base.statistics import QUANTILE_95
from elastid.nonlinear.compensated_friction import CompensatedFriction


def summary_of(friction: CompensatedFriction | None) -> Any:
    return summary("s", ROBOT, some_fit(), (), (), (), (), friction)["friction"]


def test_the_summary_has_levels_shapes_and_what_they_explain() -> None:
    """An entry a motor, as JSON; on the motor side as the robot file has it."""
    assert summary_of(None) is None
    entries = summary_of(taken_friction())
    assert entries is not None
    first, second = json.loads(json.dumps(entries))
    std = math.hypot(*STDS)
    assert (first["motor"], first["F_c"], first["std"]) == ("motor 1", 4.5, pytest.approx(std))
    assert first["interval95"] == pytest.approx([4.5 - QUANTILE_95 * std, 4.5 + QUANTILE_95 * std])
    assert first["coulomb"] == pytest.approx(4.5 / 50)
    assert second["coulomb"] is None
    assert first["shapes"] == [
        {"kind": "sign", "threshold": 0.0, "torque": LEVELS[0], "std": pytest.approx(STDS[0])},
        {"kind": "stop", "threshold": THRESHOLD, "torque": LEVELS[1], "std": pytest.approx(STDS[1])},
    ]
    assert (first["before"], first["after"]) == ({"c1": 0.41, "c2": 0.43}, {"c1": 0.11, "c2": 0.13})
    assert (second["compensated"], second["F_c"], second["shapes"]) == (False, None, [])
