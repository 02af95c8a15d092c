"""Citations are right: each numbered equation of the thesis is cited where it is implemented.

The thesis: Niglis & Oberg, Modelling High-Fidelity Robot Dynamics, LiTH-ISY-EX-15/4843-SE (2015), chapters 2 and 3.

Grammar, in docstrings of elastid: `eq. (2.10)`, `eqs. (2.10), (2.14)`, `eqs. (2.16), (2.18) to (2.21)`, `eqs. (2.16)
and (2.17)`. "to" includes both ends and all parts between them, (2.8a) and (2.8b) for one.
"""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Every number of chapters 2 and 3, as far as the project has their text: the files below elastid/ that implement the
# equation, or why none does.
BAUMGARTE = "terms against drift: motions are projected onto the closed loops instead"
EQUATIONS: dict[str, tuple[str, ...] | str] = {
    "2.1": ("model/kinematics.py",),
    "2.2": "inverse kinematics: a study gives its configurations as joint angles",
    "2.3": ("model/kinematics.py",),
    "2.4": ("model/kinematics.py",),
    "2.5": ("model/elastic.py",),
    "2.6": ("model/kinematics.py", "model/rigid_body.py"),
    "2.7": ("model/rigid_body.py", "model/rigid_body.py"),
    "2.8a": ("model/drivetrain.py", "model/elastic.py"),
    "2.8b": ("model/drivetrain.py",),
    "2.9": ("model/elastic.py",),
    "2.10": ("model/open_chain.py", "model/formulation.py", "simulation/dynamics.py"),
    "2.11": ("model/rigid_body.py",),
    "2.12": ("model/elastic.py", "model/formulation.py"),
    "2.13": ("model/drivetrain.py", "robot/joint.py"),
    "2.14": ("friction/static.py", "simulation/dynamics.py"),
    "2.15": ("friction/static.py",),
    "2.16": ("friction/dynamic.py", "friction/static.py"),
    "2.17": ("friction/static.py",),
    "2.18": ("friction/dynamic.py", "friction/static.py"),
    "2.19": ("friction/dynamic.py", "friction/static.py"),
    "2.20": ("friction/dynamic.py", "friction/static.py"),
    "2.21": ("friction/dynamic.py", "friction/static.py"),
    "2.22": ("model/drivetrain.py", "model/open_chain.py"),
    "2.23": ("robot/gears.py",),
    "2.24": ("model/drivetrain.py",),
    "2.25a": ("robot/gears.py",),
    "2.25b": ("robot/gears.py",),
    "2.25c": ("robot/gears.py",),
    "2.26": ("model/drivetrain.py",),
    "2.27": ("model/drivetrain.py",),
    "2.28": ("model/drivetrain.py",),
    "2.29": ("model/drivetrain.py",),
    "2.30": ("model/drivetrain.py",),
    "2.31": "an illustration of the torque that gravity takes; it leaves the motors' inertia out",
    "2.32": ("model/open_chain.py",),
    "2.33": ("model/formulation.py",),
    **dict.fromkeys(("2.35", "2.36", "2.37", "2.38", "2.39", "2.40"), BAUMGARTE),
    "2.34": ("model/formulation.py", "simulation/dynamics.py"),
    "3.1": ("model/drivetrain.py",),
    "3.2": ("model/drivetrain.py",),
    "3.3": "S with motor angles on the motor side: the model is on the link side, as in (3.4)",
    "3.4": ("model/drivetrain.py",),
}

NUMBER = r"\([23]\.\d+[a-z]?\)"
CITATION = re.compile(rf"\beqs?\. {NUMBER}(?:(?:, and |, | and | to ){NUMBER})*")


@cache
def docstrings(path: Path) -> list[str]:
    """The docstrings of a module, its classes and functions, the module's first, each on one line."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, kinds)]
    return [" ".join((ast.get_docstring(node) or "").split()) for node in nodes]


def numbers(citation: str) -> list[str]:
    """The equations that a citation names, ranges written out; ValueError for one that the thesis does not have."""
    found: list[str] = []
    known = list(EQUATIONS)
    for joined, number in re.findall(rf"(to )?\(({NUMBER[2:-2]})\)", citation):
        first = known.index(found[-1]) + 1 if joined else known.index(number)
        found += known[first : known.index(number) + 1]
    return found


MODULES = sorted((ROOT / "elastid").rglob("*.py"))


@pytest.mark.slow
def test_every_equation_is_cited_where_it_is_implemented_and_nowhere_else():
    found: dict[str, set[str]] = {number: set() for number in EQUATIONS}
    for path in MODULES:
        for number in {n for text in docstrings(path) for one in CITATION.findall(text) for n in numbers(one)}:
            found[number].add(path.relative_to(ROOT / "elastid").as_posix())
    expected = {number: set(files) if isinstance(files, tuple) else set() for number, files in EQUATIONS.items()}
    assert found == expected
