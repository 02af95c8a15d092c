"""The study of two axes, whose responses are not there yet, one joint that was run, and an arm that was fitted."""

from pathlib import Path

import pytest
from plants.arm_study import STUDY, command
from plants.runs import run_of
from plants.two_axes import study as study

from elastid.app.run import run_all


@pytest.fixture(scope="session")
def fitted_arm(tmp_path_factory) -> Path:
    """One that has been fitted, in its own folder, with a move."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "study.yml").write_text(STUDY)
    (folder / "move.csv").write_text("1 deg,2 deg\n-10,30\n25,10\n")
    assert command("run", folder / "study.yml", "design", "measure", "estimate", "fit") in (0, 3)
    return folder / "study.yml"


@pytest.fixture(scope="session")
def finished(tmp_path_factory, tiny_texts) -> Path:
    """The folder of the tiny study that was run, at 400 Hz and with a delay of its controller."""
    folder, (study, robot) = tmp_path_factory.mktemp("finished"), tiny_texts
    (folder / "robot.yml").write_text(robot)
    delayed = "    controller: {delay_samples: 1}\n    noise:"
    (folder / "study.yml").write_text(study.replace("rate_hz: 500", "rate_hz: 400").replace("    noise:", delayed))
    run_all(run_of(folder / "study.yml", folder / "run"))
    return folder
