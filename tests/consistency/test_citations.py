"""Citations of docstrings: each equation of the thesis is cited where it is implemented, each quoted name exists.

The thesis: Niglis & Oberg, Modelling High-Fidelity Robot Dynamics, LiTH-ISY-EX-15/4843-SE (2015), chapters 2 and 3.

Grammar, in docstrings of elastid: `eq. (2.10)`, `eqs. (2.10), (2.14)`, `eqs. (2.16), (2.18) to (2.21)`, `eqs. (2.16)
and (2.17)`. "to" includes both ends and all parts between them, (2.8a) and (2.8b) for one.
"""

import ast
import builtins
import re
from pathlib import Path

import pytest
from plants.paths import ROOT

from elastid.study.reference import list_keys

# Every number of chapters 2 and 3, as far as the project has their text: the files below elastid/ that implement them.
# Not implemented: inverse kinematics (2.2), since a study gives joint angles; an illustration of the torque of gravity
# (2.31); terms against drift (2.35) to (2.40), since motions are projected onto the loops; S on the motor side (3.3).
TABLE = """
friction/dynamic.py 2.16 2.18 2.19 2.20 2.21
friction/static.py 2.14 2.15 2.16 2.17 2.18 2.19 2.20 2.21
model/drivetrain.py 2.8a 2.8b 2.13 2.22 2.24 2.26 2.27 2.28 2.29 2.30 3.1 3.2 3.4
model/elastic.py 2.5 2.8a 2.9 2.12
model/formulation.py 2.10 2.12 2.33 2.34
model/kinematics.py 2.1 2.3 2.4 2.6
model/open_chain.py 2.10 2.22 2.32
model/rigid_body.py 2.6 2.7 2.11
robot/gears.py 2.23 2.25a 2.25b 2.25c
robot/spring.py 2.13
simulation/dynamics.py 2.10 2.14 2.34
not-implemented 2.2 2.31 2.35 2.36 2.37 2.38 2.39 2.40 3.3
"""
ROWS = [line.split() for line in TABLE.strip().splitlines()]
NUMBERS = sorted({number for _, *row in ROWS for number in row}, key=lambda n: (n[0], len(n.rstrip("abc")), n))
EQUATIONS = {n: {file for file, *row in ROWS if n in row} - {"not-implemented"} for n in NUMBERS}

NUMBER = r"\([23]\.\d+[a-z]?\)"
CITATION = re.compile(rf"\beqs?\. {NUMBER}(?:(?:, and |, | and | to ){NUMBER})*")


def docstrings(path: Path) -> list[str]:
    """The docstrings of a module, its classes and functions, the module's first, each on one line."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, kinds)]
    return [" ".join((ast.get_docstring(node) or "").split()) for node in nodes]


def numbers(citation: str) -> list[str]:
    """The equations that a citation names, ranges written out; ValueError for one that the thesis does not have."""
    found = []
    known = list(EQUATIONS)
    for joined, number in re.findall(rf"(to )?\(({NUMBER[2:-2]})\)", citation):
        first = known.index(found[-1]) + 1 if joined else known.index(number)
        found += known[first : known.index(number) + 1]
    return found


MODULES = sorted((ROOT / "elastid").rglob("*.py"))


@pytest.mark.slow
def test_equations_are_cited_where_they_are_implemented():
    found = {number: set() for number in EQUATIONS}
    for path in MODULES:
        for number in {n for text in docstrings(path) for one in CITATION.findall(text) for n in numbers(one)}:
            found[number].add(path.relative_to(ROOT / "elastid").as_posix())
    assert found == EQUATIONS


# Definitions at the left margin, and names in backticks.
DEFINED = re.compile(r"^(?:(?:async )?def |class )?(\w+)(?=\(|:| =)", re.MULTILINE)
QUOTED = re.compile(r"(?<!`)`([A-Za-z_]\w*)(?:\(\))?`(?!`)")


@pytest.mark.slow
def test_names_in_docstrings_exist() -> None:
    """In the code of the module, among definitions of the package, modules beside it, rooms, keys or builtins."""
    codes = {path: re.sub(r'"""(?:.|\n)*?"""', "", path.read_text(encoding="utf-8")) for path in MODULES}
    texts = (*(key.path for key in list_keys()), *dir(builtins), *dir(object), *map(str, MODULES[0].parent.iterdir()))
    known = {*DEFINED.findall("\n".join(codes.values())), *re.findall(r"\w+", " ".join(texts))}
    for path, code in codes.items():
        words = known.union(re.findall(r"\w+", code), (each.stem for each in path.parent.rglob("*.py")))
        assert words.issuperset(QUOTED.findall(" ".join(docstrings(path)))), path
