"""elastid compare --search: elastic joints are found, rigid ones stay rigid."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from plants.paths import ROBOTS
from plants.refusals import refused
from plants.runs import summary_of
from plants.two_axes import measured

from elastid.app.compare import search_elasticity
from elastid.robot.simplified import with_stiff_joints
from elastid.study import load
from elastid.study.robots import yaml_text

# In the truth 1x is as good as rigid; the study may find it so, since its bounds are wide.
STIFF = "robot.bodies.0.joints.1.spring.stiffness=4e8"
FIT = "fit.starts=1", "fit.parameters.k_1x={start: 1e6, bounds: [1e3, 1e10]}"


@pytest.mark.slow
def test_elastic_search_frees_soft_joint_and_locks_rigid_joint(study: Path) -> None:
    """From 20 sigma to the noise in one step; the rigid joint buys nothing for its parameter."""
    run = measured(study, load(study, (STIFF,)).study.robot, *FIT, seed=0)
    search_elasticity(run)
    content = summary_of(run.folder, "compare.json")
    trials = {(t["step"], *t["coordinates"]): t for t in content["search"]}
    assert {key: t["taken"] for key, t in trials.items()} == {
        (1, "1x"): False,
        (1, "2x"): True,
        (2, "1x"): False,
        (2, "gear 1"): False,
        (2, "gear 2"): False,
    }
    freed, spurious = trials[1, "2x"], trials[2, "1x"]
    assert freed["after"] < 0.1 * freed["before"]
    assert freed["after"] == spurious["before"] == pytest.approx(0.9, abs=0.15)
    assert spurious["after"] == pytest.approx(spurious["before"], abs=0.05)


LINKAGE = """\
name: linkage
robot: robot.yml
excitation: {rate_hz: 500, period: 2 s, band_hz: [2, 50], torque_rms: 10}
experiment:
  configurations: {a: [0, 0], b: [0.5, -0.1], c: [-0.4, 0.4], d: [0.2, 0.9]}
  simulated: {}
fit:
  starts: 6
  start_factor: 20
  parameters: {"k_*": {}, k_2: {bounds: [1e4, 1e11]}, k_b2: {bounds: [1e4, 1e11]}, k_rod: {start: 2e7}, d_rod: {}}
compare: {folds: 2}
"""


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "formulation"), [(0, "constrained"), (1, "minimal")])
def test_elastic_search_locks_stiff_gear_and_frees_elastic_rod(tmp_path: Path, seed: int, formulation: str) -> None:
    """The gear of axis 2 is 1000 times stiffer than that of axis 3, nor does the lower arm bend: the rod stretches.

    Beyond 36 Hz, or below 5 % of noise, a compliance of a thousandth would begin to show.
    """
    shutil.copy(ROBOTS / "linkage_arm.yml", tmp_path / "robot.yml")
    study = tmp_path / "study.yml"
    study.write_text(LINKAGE)
    truth = load(study).study.robot.with_parameters({"k_2": 5e8, "k_b2": 2e9})
    lines = np.linspace(3, 36, 30)
    run = measured(study, truth, f"model.formulation={formulation}", seed=seed, freq_hz=lines, noise=0.05)
    search_elasticity(run)
    content = summary_of(run.folder, "compare.json")
    assert [(t["becomes"], *t["coordinates"]) for t in content["search"] if t["taken"]] == [
        ("free", "rod rod"),
        ("rigid", "gear 2"),
    ]
    for trial in content["search"]:
        if trial["coordinates"] in (["gear 3"], ["rod rod"]):
            assert abs(trial["after"] - trial["before"]) > 1
        else:
            assert abs(trial["after"] - trial["before"]) < 0.2


def test_a_search_that_cannot_be_is_refused(study: Path) -> None:
    """Nothing to judge by, nothing to identify where the search begins, nothing to search among."""
    run = measured(study, load(study).study.robot, "experiment.configurations={a: [0, 0.2]}")
    with refused("compare/variants", place="study.yml"):
        search_elasticity(run)
    run = measured(study, load(study).study.robot, "fit.parameters={k_1x: {}, d_2x: {}}", folder="further")
    with refused("compare/variants", place="search"):
        search_elasticity(run)
    rigid = with_stiff_joints(load(study).study.robot, ["1", "1x", "2", "2x"])
    (study.parent / "robot.yml").write_text(yaml_text(rigid))
    friction = 'fit.parameters={"fm_*": {}}'
    run = measured(study, load(study, (friction,)).study.robot, friction, folder="stiff")
    with refused("compare/variants", place="study.yml"):
        search_elasticity(run)
