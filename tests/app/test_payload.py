"""A study whose robot carries a payload in some of its configurations: from the rig to the gain of its drive."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from elastid.app.console import Console
from elastid.app.run import Run, run_all
from elastid.store.measured import read_responses
from elastid.study import load

LOADED = "payload: {mass: 0.03, center_of_mass: [0.2, 0, 0], at: load}\n"
EVERY = "fit.parameters={k_1: {}, d_1: {}, fm_1: {}, Jm_1: {}, I_load: {}, gain_u_motor_1: {}}"


@pytest.mark.slow
def test_a_payload_on_and_off_gives_the_torque_constant_of_a_study(tiny: Path) -> None:
    """5 % wrong, within its interval, with all else that moves unknown; records keep what was carried."""
    with (tiny.parent / "robot.yml").open("a", encoding="utf-8") as file:
        file.write(LOADED)
    overrides = [
        "experiment.configurations={loaded: [0], empty: [0]}",
        "experiment.without_payload=[empty]",
        "experiment.simulated.truth={gain_u_motor_1: 0.95}",
        EVERY,
    ]
    run = Run(load(tiny, overrides), tiny.parent / "run", 1, Console(-1))
    run_all(run)
    carried = {each.configuration.name: each.configuration.carries for each in read_responses(run.path("estimate"))}
    assert carried == {"loaded": True, "empty": False}
    summary = json.loads((run.folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["status"] == "converged"
    assert not {"fit/responses", "fit/unlike-responses"} & {note["code"] for note in summary["notes"]}
    low, high = summary["parameters"]["gain_u_motor_1"]["interval95"]
    assert low < 0.95 < high < 1.02 * low
