"""Budget of the house: sizes that may only fall, counted and compared with scripts/budget.toml.

    python scripts/budget.py            exit code 1 where a number exceeds the budget
    python scripts/budget.py --lower    lower the file to what stands; it never raises a number

`lines` and `nodes` are counted in the Python files of elastid, tests and scripts; packing lines or cutting docstrings
does not reduce the nodes of the syntax tree. `thresholds` are module constants that are numbers and numeric fields of
classes called ...Limits or ...Thresholds. `names` are public, `commands` are commands of `elastid`. `sentences` are
texts of five words or more, docstrings apart, that end as a sentence does or have holes for numbers. `prose` counts the
sentences of pages and package that scripts/prose.py flags.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

import prose

ROOT = Path(__file__).parents[1]
ROOMS = ("elastid", "tests", "scripts")
Budget = Mapping[str, Mapping[str, int]]


def counted(root: Path) -> dict[str, dict[str, int]]:
    """All numbers of the house at `root`."""
    found: dict[str, dict[str, int]] = {}
    for room in ROOMS:
        texts = [path.read_text(encoding="utf-8") for path in sorted((root / room).rglob("*.py"))]
        trees = [ast.parse(text) for text in texts]
        found[room] = {
            "lines": sum(len(text.splitlines()) for text in texts),
            "nodes": sum(1 for tree in trees for _ in ast.walk(tree)),
        }
        if room == "elastid":
            for kind in (thresholds, sentences, commands):
                found[room][kind.__name__] = sum(1 for tree in trees for _ in kind(tree))
    found["prose"] = prose.counted(root)
    found["elastid"]["names"] = public_names((root / "elastid" / "__init__.pyi").read_text(encoding="utf-8"))
    return found


def thresholds(tree: ast.Module) -> Iterator[ast.stmt]:
    """Constants of a module that are numbers, and fields of Limits and Thresholds whose default is one."""
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    bodies = [each.body for each in classes if each.name.endswith(("Limits", "Thresholds"))]
    for statement in [each for body in (tree.body, *bodies) for each in body]:
        if isinstance(statement, ast.Assign | ast.AnnAssign) and is_number(statement.value):
            yield statement


def is_number(node: ast.expr | None) -> bool:
    """True for a number or an arithmetic of numbers."""
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def sentences(tree: ast.Module) -> Iterator[ast.AST]:
    """Texts of five words and more that end as a sentence does, and those with holes for numbers."""
    nodes = [*ast.walk(tree)]
    apart = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    apart |= {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        holes = isinstance(node, ast.JoinedStr)
        parts = [node, *node.values] if isinstance(node, ast.JoinedStr) else [node]
        said = "".join(str(part.value) for part in parts if isinstance(part, ast.Constant) and part.value is not None)
        if id(node) not in apart and len(said.split()) > 4 and (holes or said.rstrip()[-1] in ".!?:;"):
            yield node


def commands(tree: ast.Module) -> Iterator[ast.AST]:
    """Decorators that make a function a command, and stages that have a help of their own."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            yield from (each for each in node.decorator_list if ast.unparse(each).split("(")[0].endswith(".command"))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "Stage":
            yield from (each for each in node.keywords if each.arg == "help")


def public_names(text: str) -> int:
    """Names that a stub file exports."""
    return sum(len(node.names) for node in ast.parse(text).body if isinstance(node, ast.ImportFrom))


def exceeded(stands: Budget, budget: Budget) -> list[str]:
    """A line for each number above the budget: what, where, how much."""
    over = []
    for room, numbers in stands.items():
        for what, number in numbers.items():
            if number > (allowed := budget.get(room, {}).get(what, 0)):
                over.append(f"{room}: {what}: {number}, {number - allowed} more than the budget of {allowed}")
    return over


def written(stands: Budget, budget: Budget) -> str:
    """The file with each number that fell; a number that it does not have is taken as it stands."""
    text = "# Sizes that may only fall: `python scripts/budget.py --lower` writes those that did.\n"
    for room, numbers in stands.items():
        lower = {what: min(number, budget.get(room, {}).get(what, number)) for what, number in numbers.items()}
        text += "".join([f"\n[{room}]\n", *(f"{what} = {number}\n" for what, number in lower.items())])
    return text


def main(arguments: list[str], root: Path = ROOT) -> int:
    """Exit code of the comparison, after the file was lowered where that is asked for."""
    path = root / "scripts" / "budget.toml"
    budget = tomllib.loads(path.read_text(encoding="utf-8"))
    stands = counted(root)
    if arguments == ["--lower"]:
        path.write_text(written(stands, budget), encoding="utf-8")
    over = exceeded(stands, budget)
    print("\n".join([*over, *(["take away as much as you add: scripts/budget.toml only goes down"] if over else [])]))
    return int(bool(over))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
