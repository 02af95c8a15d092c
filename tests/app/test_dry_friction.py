"""What the viscous numbers of a study contain, and friction in summary.json and on the terminal."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from plants.taken_friction import LEVELS, STDS, THRESHOLD, taken_friction

from elastid.app.dry_friction import VISCOUS, WITH_COULOMB, contents, friction_line, friction_summary
from elastid.app.summaries import truth
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.parameters import Parameter
from elastid.robot import Body, Joint, Motor, Robot, Spring
from elastid.study import Study

ROUGH, SMOOTH = Motor(1e-3, 50, 1e-3, coulomb=0.1), Motor(1e-3, 50, 1e-3)
ROBOT = Robot(
    "an elastic axis and two rigid ones",
    (
        Body("a", joints=(Joint("1", "z", Spring(1e4, 10.0), ROUGH, 1.0),), inertia=1.0),
        Body("b", "a", joints=(Joint("2", "y", None, ROUGH, 1.0),), inertia=1.0),
        Body("c", "b", joints=(Joint("3", "y", None, SMOOTH, 1.0),), inertia=1.0),
    ),
)
SIMULATED = Study("s", experiment=ExperimentSpec({"home": (0.0, 0.0, 0.0)}, simulated=SimulatedSpec()), robot=ROBOT)
PARAMETERS = tuple(Parameter(name, 1e-3) for name in ("k_1", "fm_1", "fm_1@warm", "f_1", "fm_2", "f_2", "fm_3"))


def test_a_viscous_number_is_marked_with_the_coulomb_friction_in_it() -> None:
    """Also that of a joint which turns rigidly with its motor; a motor without dry friction has none."""
    assert contents(SIMULATED, None, PARAMETERS) == {
        "fm_1": WITH_COULOMB,
        "fm_1@warm": WITH_COULOMB,
        "fm_2": WITH_COULOMB,
        "f_2": WITH_COULOMB,
        "fm_3": VISCOUS,
    }


def test_friction_taken_out_leaves_viscous_friction_which_then_has_a_truth() -> None:
    """At motor 1 alone."""
    marked = contents(SIMULATED, taken_friction(), PARAMETERS)
    assert (marked["fm_1"], marked["fm_2"]) == (VISCOUS, WITH_COULOMB)
    known = truth(SIMULATED, taken_friction())
    assert known is not None
    assert {"fm_1", "fm_3", "f_3"} <= set(known)
    assert not {"fm_2", "f_2"} & set(known)


def test_of_a_recorded_robot_no_motor_is_known_to_be_without_friction() -> None:
    """Whatever its file says."""
    channels = (ChannelSpec("u", "motor 1", "u"), ChannelSpec("y", "motor 1", "y", quantity="position"))
    logs = RecordedSpec(rate_hz=100.0, files=(FileSpec("a.csv", "home"),), channels=channels)
    study = replace(SIMULATED, experiment=ExperimentSpec({"home": (0.0, 0.0, 0.0)}, recorded=logs))
    marked = contents(study, taken_friction(), PARAMETERS)
    assert (marked["fm_1"], marked["fm_2"], marked["fm_3"]) == (VISCOUS, WITH_COULOMB, WITH_COULOMB)
    assert "f_1" not in marked


def test_the_summary_has_levels_shapes_and_what_they_explain() -> None:
    """An entry a motor, as JSON; on the motor side as the robot file has it."""
    assert friction_summary(ROBOT, None) is None
    found = friction_summary(ROBOT, taken_friction())
    assert found is not None
    first, second = json.loads(json.dumps(found))
    std = math.hypot(*STDS)
    assert (first["motor"], first["F_c"], first["std"]) == ("motor 1", 4.5, pytest.approx(std))
    assert first["interval95"] == pytest.approx([4.5 - 1.96 * std, 4.5 + 1.96 * std])
    assert first["coulomb"] == pytest.approx(4.5 / 50)
    assert second["coulomb"] is None
    assert first["shapes"] == [
        {"kind": "sign", "threshold": 0.0, "level": LEVELS[0], "std": pytest.approx(STDS[0])},
        {"kind": "stop", "threshold": THRESHOLD, "level": LEVELS[1], "std": pytest.approx(STDS[1])},
    ]
    assert (first["before"], first["after"]) == ({"c1": 0.41, "c2": 0.43}, {"c1": 0.11, "c2": 0.13})
    assert (second["taken_out"], second["F_c"], second["shapes"]) == (False, None, [])


def test_the_terminal_has_one_line() -> None:
    """With the levels; nothing where nothing was taken out."""
    line = friction_line(taken_friction())
    assert "motor 1 4.50 ± 0.22 N*m" in line
    assert "at most 3.2 % is left" in line
    assert "motor 2" not in line
