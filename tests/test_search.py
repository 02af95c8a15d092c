"""elastid compare --search: the coordinates in which a robot gives way are found, those in which it does not stay out."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from test_compare import ROBOT, STUDY, measured

from elastid import cli, searching, stages
from elastid.comparing import compare
from elastid.console import Console
from elastid.errors import StudyError
from elastid.robot.variants import further_elastic
from elastid.run import Run
from elastid.searching import search_elasticity, trial_table
from elastid.store.comparison import read_comparison
from elastid.study import load
from elastid.validation.comparison import Row
from elastid.validation.search import found, found_words, search

QUICK = ("fit.starts=1",)
# What bends in the truth; the study begins at 40 kN*m/rad.
PRACTICALLY_RIGID = "robot.bodies.0.joints.1.spring.stiffness=4e8"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """The path of a study with the further elastic joints 1x and 2x, whose responses are not there yet."""
    (tmp_path / "robot.yml").write_text(ROBOT)
    (tmp_path / "study.yml").write_text(STUDY)
    return tmp_path / "study.yml"


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_joint_that_gives_way_is_found_and_the_rigid_one_stays_out(study: Path, seed: int) -> None:
    """Responses with 2 % noise of a robot that bends in 2x and, by a ten thousandth of it, in 1x."""
    run = measured(study, load(study, (PRACTICALLY_RIGID,)).study.robot, *QUICK, seed=seed)
    search_elasticity(run)
    content = json.loads((run.folder / "compare.json").read_text())
    trials = {(t["step"], *t["coordinates"]): t for t in content["search"]}
    assert list(trials) == [(1, "1x"), (1, "2x"), (2, "1x")]
    assert [t["taken"] for t in trials.values()] == [False, True, False]
    freed, spurious = trials[1, "2x"], trials[2, "1x"]
    assert -freed["change"] > freed["standard_error"]
    assert freed["criterion"] < -100
    assert freed["n_free"] + 1 == spurious["n_free"]
    assert spurious["criterion"] > 0 or -spurious["change"] <= spurious["standard_error"]
    assert freed["change"] == pytest.approx(freed["after"] - freed["before"])
    assert content["verdict"].startswith("Beyond the driven joints the elasticity sits in 2x; 1x can be rigid")
    assert {row["name"] for row in content["models"]} == {"two", "driven joints alone", "1x elastic", "2x elastic"}
