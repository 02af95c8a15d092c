"""elastid export: rows of targets, those of other packages, the same bytes twice."""

import importlib
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from plants.installed import installed
from plants.refusals import refused

from elastid.app.cli import run_command
from elastid.app.target_table import MODULES, tags, targets
from elastid.targets.target import VALUES

PACKAGE = """
from elastid.targets.target import Target

def write_stiffness(folder, model):
    folder.mkdir(parents=True)
    path = folder / "stiffness.txt"
    path.write_text("".join(f"{name} {value}\\n" for name, value in model.result.values.items()))
    return [path]

TARGET = Target("stiffness", ("model",), "parameters as text", write_stiffness)
"""


@pytest.fixture
def installed_target(tmp_path) -> Iterator[Path]:
    entry = "stiffness = stiffness_target:TARGET"
    with installed(tmp_path, "stiffness_target", PACKAGE, "elastid.targets", entry) as info:
        yield info


@pytest.mark.parametrize("tag", MODULES)
def test_row_writes_from_the_values_that_it_needs(tag: str) -> None:
    rows = targets(tag)
    assert rows
    for row in rows:
        assert {*row.arguments} <= {*VALUES}
        assert tuple(inspect.signature(row.write).parameters)[1 : len(row.arguments) + 1] == row.arguments
        assert row.content


def test_explain_lists_targets_of_other_packages(installed_target: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert tags() == (*MODULES, "stiffness")
    assert run_command(["explain", "export.stiffness"]) == 0
    assert "Parameters as text" in capsys.readouterr().out


def test_target_of_a_wrong_type_is_refused_with_its_package(installed_target: None, tmp_path: Path) -> None:
    (tmp_path / "stiffness_target.py").write_text("TARGET = 3")
    sys.modules.pop("stiffness_target", None)
    importlib.invalidate_caches()
    with refused("install/entry-point", holds=("stiffness", "stiffness_target")):
        targets("stiffness")
    sys.modules.pop("stiffness_target", None)


def test_old_tag_is_answered_with_the_new_one(tiny: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["export", str(tiny), "--to", "draws"]) == 2
    assert "renamed to samples" in capsys.readouterr().err


@pytest.mark.slow
def test_export_requires_fit_and_repeats_bytes(
    tiny: Path, tmp_path: Path, installed_target: None, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    assert run_command(["export", str(tiny), "--to", "csv", "--run", str(run)]) == 2
    assert "estimate` first" in capsys.readouterr().err
    assert run_command(["run", str(tiny), "design", "measure", "estimate", "fit", "--run", str(run), "-q"]) == 0
    for target in (tag for tag in tags() if {*targets(tag)[0].arguments} & {"model", "linear_model", "actuators"}):
        contents = []
        for _ in range(2):
            assert run_command(["export", str(tiny), "--to", target, "--run", str(run)]) == 0
            files = sorted((run / "export" / target).iterdir())
            contents.append([(file.name, file.read_bytes()) for file in files])
        assert contents[0] == contents[1]
        assert len(contents[0]) >= 1
    assert (run / "export" / "stiffness" / "stiffness.txt").read_text().startswith("k_")
