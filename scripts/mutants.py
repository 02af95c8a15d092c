"""Mutants of each module that the test at its mirrored path, `test_<module>` in the same folder of tests, kills.

A mutant has one operator, comparison, number or condition of one function changed. Tests run in copies of one process
that has loaded the libraries (POSIX alone).

    uv run python scripts/studies/mutants.py --each 3
"""

from __future__ import annotations

import ast
import io
import json
import os
import random
import signal
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from copy import deepcopy
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[2]
# Seconds after which tests of a mutant, which may loop for ever, count as failed.
LIMIT_S = 120
SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.MatMult: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


def changes(tree: ast.Module) -> list[tuple[int, Callable[[], None]]]:
    """(line, change) of all that can be changed in the functions of a module; texts and annotations stay."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    nodes = {id(node): node for function in functions for part in function.body for node in calculated(part)}
    return [(node.lineno, change) for node in nodes.values() for change in changes_of(node)]


def calculated(node: ast.AST) -> Iterator[Any]:
    """A node and those below it, without messages, annotations and nested functions, which come by themselves."""
    if isinstance(node, ast.JoinedStr | ast.Raise | ast.FunctionDef | ast.ClassDef):
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "slice"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from calculated(child)


def changes_of(node: Any) -> Iterator[Callable[[], None]]:
    """Each way in which one node is changed."""
    if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPS:
        if not any(isinstance(side, ast.Constant | ast.JoinedStr | ast.List) for side in ast.iter_child_nodes(node)):
            yield lambda: setattr(node, "op", SWAPS[type(node.op)]())
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPS:
        yield lambda: node.ops.__setitem__(0, SWAPS[type(node.ops[0])]())
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield lambda: setattr(node, "value", node.value + 1)
    elif isinstance(node, ast.If | ast.IfExp):
        yield lambda: setattr(node, "test", ast.UnaryOp(ast.Not(), node.test))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield lambda: setattr(node, "op", ast.UAdd())


def mutants(path: Path, each: int, seed: int) -> list[tuple[int, ast.Module]]:
    """(line, tree) of so many mutants of a module, drawn by seed and name."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    count = len(changes(tree))
    drawn = random.Random(f"{seed} {path.relative_to(ROOT)}").sample(range(count), min(each, count))
    found = []
    for index in sorted(drawn):
        copy = deepcopy(tree)
        line, change = changes(copy)[index]
        change()
        found.append((line, ast.fix_missing_locations(copy)))
    return found


class MutantLoader(Loader, MetaPathFinder):
    """Imports one module from a mutant's tree."""

    def __init__(self, name: str, path: Path, tree: ast.Module) -> None:
        self.name, self.path, self.tree = name, path, tree

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """The mutant in place of the module."""
        if fullname != self.name:
            return None
        package = [str(self.path.parent)] if self.path.name == "__init__.py" else None
        return spec_from_file_location(fullname, self.path, loader=self, submodule_search_locations=package)

    def exec_module(self, module: ModuleType) -> None:
        """The mutant's definitions."""
        exec(compile(self.tree, str(self.path), "exec"), module.__dict__)


def fails(test: Path, mutant: MutantLoader | None) -> bool:
    """True if a test fails, in a process of its own."""
    process = os.fork()
    if process == 0:
        code = 3
        try:
            signal.alarm(LIMIT_S)
            code = outcome(test, mutant)
        finally:
            os._exit(code)
    return os.waitpid(process, 0)[1] != 0


def outcome(test: Path, mutant: MutantLoader | None) -> int:
    import pytest

    if mutant is not None:
        sys.meta_path.insert(0, mutant)
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow", "-o", "addopts="]
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        return int(pytest.main([*options, str(test)]))


def mirrored(path: Path) -> Path:
    inside = path.relative_to(ROOT / "elastid")
    return ROOT / "tests" / inside.parent / f"test_{inside.stem}.py"


def changed(path: Path, tree: ast.Module) -> str:
    """The line of a mutant that differs from the module's."""
    before = ast.unparse(ast.parse(path.read_text(encoding="utf-8"))).splitlines()
    return next(new.strip() for old, new in zip(before, ast.unparse(tree).splitlines(), strict=True) if new != old)


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=3, help="mutants of a module")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sample", type=int, help="so many modules, drawn at random (default: all)")
    parser.add_argument("--under", default="elastid", help="only modules whose path begins so")
    parser.add_argument("--quick", action="store_true", help="one mutant of each of two modules")
    given = parser.parse_args()
    each, count = (1, 2) if given.quick else (given.each, given.sample)
    import casadi  # noqa: F401  loaded once, for all copies
    import h5py  # noqa: F401
    import pytest  # noqa: F401
    import scipy.optimize
    import scipy.signal  # noqa: F401

    paths = sorted((ROOT / "elastid").rglob("*.py"))
    modules = [p for p in paths if p.name != "__init__.py" and str(p.relative_to(ROOT)).startswith(given.under)]
    if count is not None:
        modules = sorted(random.Random(given.seed).sample(modules, min(count, len(modules))))
    counts = {"modules": 0, "with a test": 0, "with a mutant killed": 0, "mutants": 0, "killed": 0}
    for path in modules:
        trees = mutants(path, each, given.seed)
        if not trees:
            continue
        counts["modules"] += 1
        test = mirrored(path)
        if not test.exists() or fails(test, None):
            words = "its mirrored test fails unchanged" if test.exists() else "has no mirrored test"
            print(f"{path.relative_to(ROOT)}: {words}", flush=True)
            continue
        alive = [(line, tree) for line, tree in trees if not fails(test, MutantLoader(module_name(path), path, tree))]
        counts["with a test"] += 1
        counts["mutants"] += len(trees)
        counts["killed"] += len(trees) - len(alive)
        counts["with a mutant killed"] += len(alive) < len(trees)
        for line, tree in alive:
            print(
                f"{path.relative_to(ROOT)}:{line}: survives {test.relative_to(ROOT)}: {changed(path, tree)}", flush=True
            )
    print(json.dumps(counts))


if __name__ == "__main__":
    main()
