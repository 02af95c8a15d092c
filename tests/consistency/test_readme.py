"""Every block of the README is executed in a copy with nothing beside it, in the order in which a reader meets them."""

import re
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.paths import ROOT
from plants.reader import Reader
from plants.runs import summary_of

from elastid.app import scaffold
from elastid.store.plan import read_plan
from elastid.study import load

README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def blocks(language: str) -> list[str]:
    return [text for of, text in BLOCKS if of == language]


def test_every_block_says_its_language() -> None:
    """So that it is known how each is executed."""
    assert {language for language, _ in BLOCKS} == {"bash", "python", "yaml"}
    assert README.count("```") == 2 * len(BLOCKS)


def test_the_study_of_the_readme_is_that_of_its_template(tmp_path: Path) -> None:
    """Beside the robot and the logs that the template brings; the commands run the template's own."""
    study = scaffold.new(tmp_path / "mystudy", "recorded")
    template = load(study).study
    (text,) = blocks("yaml")
    study.write_text(text)
    assert load(study).study == template


def test_links_of_the_readme_lead_somewhere() -> None:
    assert [path for path in re.findall(r"\]\(([^)#:]+)\)", README) if not (ROOT / path).exists()] == []


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_every_block_does_what_the_readme_says(tmp_path: Path) -> None:
    """The commands and the Python, in this order and in one copy of the repository."""
    folder = tmp_path / "elastid"
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "runs", "__pycache__"))
    reader = Reader(folder)
    for text in blocks("bash"):
        reader.run_shell(text)
    assert summary_of(folder / "runs" / "demo")["status"] == "converged"
    check_demo(folder / "runs" / "demo")
    check_library(reader)
    check_pictures(folder / "runs" / "demo")


def check_demo(folder: Path) -> None:
    """Each stiffness within 3 standard deviations of 0.1 % at most, and friction, in a run with noise and gravity."""
    summary = summary_of(folder)
    Q, M, E, _, n_u = read_plan(folder / "plan.h5").R.shape
    assert Q >= 4
    assert M >= 2
    assert E == n_u == 3
    springs = {name: p for name, p in summary["parameters"].items() if name.startswith("k_")}
    assert len(springs) >= 6
    for name, p in springs.items():
        assert p["start"] != p["truth"], name
        assert abs(p["value"] - p["truth"]) < 3 * p["std"], name
        assert p["std"] < 1e-3 * p["value"], name
        assert p["interval95"][0] < p["value"] < p["interval95"][1]
    viscous = {name: p for name, p in summary["parameters"].items() if name.startswith("fm_")}
    assert len(viscous) == n_u
    for name, p in viscous.items():  # without the Coulomb friction, which is several times as large
        assert abs(p["value"] - p["truth"]) < 3 * p["std"] < 0.2 * p["truth"], name
    for motor, level in zip(summary["friction"], (9.68, 15.0, 8.8), strict=True):
        assert motor["F_c"] == pytest.approx(level, rel=0.005), motor["motor"]
    assert (folder / "report.html").stat().st_size > 100_000
    check_table(summary)


def check_table(summary: dict[str, Any]) -> None:
    """The README's column of friction taken out has the numbers of this run, each to within two of its last digit."""
    rows = [line.split("|")[3] for line in README.splitlines() if line.count("|") == 4 and "**" in line]
    said = [numbers(row.split("**")[1]) for row in rows]
    kinds = {"k_": [], "d_": []}
    for name, p in summary["parameters"].items():
        if name[:2] in kinds and "std" in p:
            kinds[name[:2]].append((100 * p["std"] / p["value"], 100 * (p["value"] / p["truth"] - 1)))
    of_springs, of_dampers = (np.array(kind) for kind in kinds.values())
    found = [
        [of_springs[:, 0].min(), of_springs[:, 0].max()],
        [of_dampers[:, 0].min(), of_dampers[:, 0].max()],
        *([float(np.sqrt(np.mean(kind[:, 1] ** 2)))] for kind in (of_springs, of_dampers)),
        [summary["parameters"]["fm_1"]["value"]],
        [motor["F_c"] for motor in summary["friction"]],
    ]
    assert len(said) == len(found)
    for in_readme, of_run in zip(said, found, strict=True):
        for (value, digit), number in zip(in_readme, of_run, strict=True):
            assert abs(value - number) < 2 * digit, (in_readme, of_run)


def check_pictures(demo: Path) -> None:
    """No picture is older than what it shows: words as they stand there, numbers within 5 % or two last digits."""
    sys.path.append(str(ROOT / "scripts" / "docs"))
    from pictures import first_screen_text

    now, then = first_screen_text(demo), (ROOT / "scripts" / "docs" / "shown.txt").read_text(encoding="utf-8")
    number = re.compile(r"\d+\.?\d*(?:e[-+]\d+)?")
    assert number.sub("#", now) == number.sub("#", then), "make the pictures again: scripts/docs/pictures.py"
    for new, old in zip(numbers(now), numbers(then), strict=True):
        assert abs(new[0] - old[0]) <= max(0.05 * abs(old[0]), 2 * old[1])


def numbers(text: str) -> list[tuple[float, float]]:
    """The numbers in a text, each with the size of its last digit."""
    return [(float(n), 10.0 ** -len(n.partition(".")[2])) for n in re.findall(r"\d+\.?\d*", text)]


def check_library(reader: Reader) -> None:
    """The Python fits what the demo fits, to the last digit; the example for a run folder reads it."""
    (text,) = blocks("python")
    summary = summary_of(reader.folder / "runs" / "demo")
    said = reader.run(sys.executable, "-c", text + "print(repr(done.result.values['k_1']))\n")
    assert float(said.splitlines()[-1]) == summary["parameters"]["k_1"]["value"]
    assert (reader.folder / "bode.png").stat().st_size > 10_000
    said = reader.run(sys.executable, "scripts/examples/ex05_run_folder_in_a_notebook.py", "runs/demo")
    assert "Fit: converged" in said
    assert "natural frequency in Hz" in said
