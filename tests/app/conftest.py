"""The study of two axes, whose responses are not there yet, and one of an arm that has been fitted."""

from pathlib import Path

import pytest
from plants.arm_study import STUDY, command
from plants.two_axes import study as study


@pytest.fixture(scope="session")
def fitted_arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One that has been fitted, in its own folder, with a move."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "study.yml").write_text(STUDY, encoding="utf-8")
    (folder / "move.csv").write_text("1 deg,2 deg\n-10,30\n25,10\n", encoding="utf-8")
    assert command("run", folder / "study.yml", "design", "measure", "estimate", "fit") in (0, 3)
    return folder / "study.yml"
