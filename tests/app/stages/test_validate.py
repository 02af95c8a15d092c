"""The stage validate: what it holds, and when it is done again."""

import shutil
from pathlib import Path

import pytest
from plants.runs import run_of, summary_of

from elastid.app.run import run_all
from elastid.store.results import read_validation


@pytest.fixture(scope="module")
def validated(tmp_path_factory, finished):
    """The folder of a study that was run."""
    folder = Path(shutil.copytree(finished, tmp_path_factory.mktemp("validated") / "study"))
    run_all(run_of(folder / "study.yml", folder / "run"))
    return folder


def test_validation_json_says_what_validation_h5_holds(validated):
    """Errors of the fit; every number the same."""
    found = read_validation(validated / "run" / "validation.h5")
    summary_json = summary_of(validated / "run", "validation.json")
    assert (summary_json["schema"], summary_json["study"], summary_json["verdict"]) == (1, "tiny", found.verdict)
    rows = summary_json["configurations"]
    assert [(row["configuration"], row["is_validation"]) for row in rows] == [("a", False), ("b", False)]
    summary = summary_of(validated / "run")
    keys = ("configuration", "rms_log_db", "phase_rms_deg", "rms_sigma")
    assert [{key: c[key] for key in keys} for c in rows] == summary["frf_error"]


@pytest.mark.slow
def test_a_validation_is_whole_and_never_that_of_another_fit(validated, tmp_path):
    """Without its JSON file it is done again; a fit to other data takes the old one away, the same fit keeps it."""
    folder = Path(shutil.copytree(validated, tmp_path / "copy"))
    run = run_of(folder / "study.yml", folder / "run")
    assert run.is_current("validate")
    summary_json = (folder / "run" / "validation.json").read_bytes()
    (folder / "run" / "validation.json").unlink()
    assert not run.is_current("validate")
    run_all(run)
    assert (folder / "run" / "validation.json").read_bytes() == summary_json
    run_all(run, ["fit"])
    assert run.is_current("validate")
    run_all(run_of(folder / "study.yml", folder / "run", "fit.starts=3"), ["fit"])
    assert not (folder / "run" / "validation.json").exists()
