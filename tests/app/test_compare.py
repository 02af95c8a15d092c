"""elastid compare: the model that made the responses wins, what the data do not need is said to be not needed."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from plants.refusals import refused
from plants.runs import run_of, summary_of
from plants.two_axes import STUDY, measured

from elastid.app.compare import compare, variants
from elastid.app.run import Run, run_all
from elastid.robot.simplified import with_stiff_joints
from elastid.study import load
from elastid.study.robots import yaml_text


def found(run: Run) -> dict:
    return summary_of(run.folder, "compare.json")


@pytest.mark.slow
def test_the_model_that_made_the_responses_predicts_best(study: Path) -> None:
    """Motor coupling at a ratio of 5 and two elastic joints: each that is left out shows on left-out configurations."""
    run = measured(study, load(study).study.robot, seed=0)
    compare(run)
    models = {row["name"]: row for row in found(run)["models"]}
    assert next(iter(models)) == "two"
    assert set(models) == {"two", "without motor coupling", "1x rigid", "2x rigid"}
    own = models["two"]
    assert np.mean(own["misfit"]) == pytest.approx(1.0, abs=0.15)  # noise alone: no floor is declared
    assert own["criterion"] == 0
    assert own["n_free"] == models["without motor coupling"]["n_free"] == models["2x rigid"]["n_free"] + 2
    for name in ("without motor coupling", "1x rigid", "2x rigid"):
        assert np.mean(models[name]["misfit"]) > 2 * np.mean(own["misfit"])
        assert models[name]["criterion"] > 100


@pytest.mark.slow
def test_another_study_is_fitted_to_the_responses_of_the_first(study: Path) -> None:
    """Its robot, under the weights and the criterion of the first; the first alone brings no variants then."""
    run = measured(study, load(study).study.robot)
    other = study.with_name("other.yml")
    (study.parent / "lean.yml").write_text(yaml_text(with_stiff_joints(load(study).study.robot, ["2x"])))
    other.write_text(STUDY.replace("name: two", "name: lean").replace("robot.yml", "lean.yml").replace("d_2x: {},", ""))
    compare(run, [load(other, ("fit.weights.model_error=0.5",))])
    assert [row["name"] for row in found(run)["models"]] == ["two", "lean"]
    assert found(run)["models"][1]["cost"] > 10 * found(run)["models"][0]["cost"]


@pytest.mark.parametrize(
    ("option", "holds"),
    [
        ("[{name: x, rigid: [9]}]", "joint 9"),
        ('[{name: x, set: ["robot.bodies.1.mas=25"]}]', "mas"),
        ("[{name: x}, {name: x}]", "x"),
    ],
)
def test_variants_that_cannot_be_are_refused(study: Path, option: str, holds: str) -> None:
    """With the variant's name and what is wrong with it."""
    with refused("compare/variants", "study/invalid", holds=("compare.variants", holds)):
        list(variants(load(study, (f"compare.variants={option}",))))


def test_a_model_without_variants_is_refused(tiny: Path) -> None:
    run = run_of(tiny, tiny.parent / "run")
    run_all(run, ("design", "measure", "estimate"))
    with refused("compare/variants", place="study.yml"):
        compare(run)


@pytest.mark.slow
def test_the_report_shows_the_comparison(finished: Path, tmp_path: Path) -> None:
    """Once compared, the page has the table, and is current; other responses make it go."""
    shutil.copytree(finished / "run", tmp_path, dirs_exist_ok=True)
    option = 'compare.variants=[{name: heavy load, set: ["robot.bodies.0.inertia=1.3e-3"]}]'
    run, changed = (run_of(finished / "study.yml", tmp_path, option, f"seed={seed}") for seed in (1, 5))
    run_all(run)
    before = run.path("report").read_text().count("heavy load")
    compare(run)
    assert run.path("report").read_text().count("heavy load") > before
    assert run.is_current("report")
    run_all(changed)
    assert changed.path("report").read_text().count("heavy load") == before
