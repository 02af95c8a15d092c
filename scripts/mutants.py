"""Mutants of each room of elastid that its tests kill: the judge of what a test is worth.

    uv run --all-groups python scripts/mutants.py [ROOM ...] [--count 25] [--seed 1]
    uv run --all-groups python scripts/mutants.py --changed main

A mutant has one operator, comparison, number or condition of one function changed; so many are drawn over a room's
modules. Each meets its module's doctests and the fast tests at its mirrored path, `test_<module>`, and where it
survives them all fast tests of the room. Tests run in copies of one process that has loaded the libraries (POSIX
alone). tests/kills.csv keeps the last count of each room with the commit and the seconds that it took; survivors are
printed. --changed takes the rooms that differ from a commit.
"""

from __future__ import annotations

import argparse
import ast
import csv
import io
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from copy import deepcopy
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "tests" / "kills.csv"
# Seconds after which tests of a mutant, which may loop for ever, count as failed: those of a module, those of a room.
LIMIT_S, ROOM_LIMIT_S = 90, 900
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


def mutants(room: str, count: int, seed: int) -> list[tuple[Path, int, ast.Module]]:
    """(module, line, tree) of so many mutants of a room, drawn by seed and name."""
    paths = sorted([*(ROOT / "elastid" / room).rglob("*.py"), *(ROOT / "elastid").glob(f"{room}.py")])
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths if path.name != "__init__.py"}
    places = [(path, index) for path, tree in trees.items() for index in range(len(changes(tree)))]
    found = []
    for path, index in sorted(random.Random(f"{seed} {room}").sample(places, min(count, len(places)))):
        copy = deepcopy(trees[path])
        line, change = changes(copy)[index]
        change()
        found.append((path, line, ast.fix_missing_locations(copy)))
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
            signal.alarm(LIMIT_S if test.is_file() else ROOM_LIMIT_S)
            code = outcome(test, mutant)
        finally:
            os._exit(code)
    return os.waitpid(process, 0)[1] != 0


def outcome(test: Path, mutant: MutantLoader | None) -> int:
    import pytest

    if mutant is not None:
        sys.meta_path.insert(0, mutant)
    options = [
        "-x",
        "-q",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-m",
        "not slow",
        "-o",
        "addopts=",
        "--assert=plain",
    ]
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        code = pytest.main([*options, "--doctest-modules", str(test)])
    return 0 if code == pytest.ExitCode.NO_TESTS_COLLECTED else int(code)


def mirrored(path: Path) -> Path:
    inside = path.relative_to(ROOT / "elastid")
    return ROOT / "tests" / inside.parent / f"test_{inside.stem}.py"


def changed(path: Path, tree: ast.Module) -> str:
    """The line of a mutant that differs from the module's."""
    before = ast.unparse(ast.parse(path.read_text(encoding="utf-8"))).splitlines()
    return next(new.strip() for old, new in zip(before, ast.unparse(tree).splitlines(), strict=True) if new != old)


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def changed_rooms(base: str) -> list[str]:
    """Rooms whose code or tests differ from a commit."""
    command = ["git", "diff", "--name-only", base, "--", "elastid", "tests"]
    said = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    named = {Path(line).parts[1].removesuffix(".py") for line in said.splitlines() if len(Path(line).parts) > 1}
    return [room for room in rooms() if room in named]


def rooms() -> list[str]:
    """Folders of the package that have tests."""
    return sorted(path.name for path in (ROOT / "elastid").iterdir() if (ROOT / "tests" / path.name).is_dir())


def judged(room: str, count: int, seed: int) -> dict[str, object]:
    """The row of a room; its survivors are printed."""
    begin, drawn, killed = time.monotonic(), mutants(room, count, seed), 0
    if fails(ROOT / "tests" / room, None):
        raise SystemExit(f"the tests of {room} fail without a mutant")
    for path, line, tree in drawn:
        mutant = MutantLoader(module_name(path), path, tree)
        tests = [path, *[mirrored(path)] * mirrored(path).exists(), ROOT / "tests" / room]
        if any(fails(test, mutant) for test in tests):
            killed += 1
        else:
            print(f"{path.relative_to(ROOT)}:{line}: survives: {changed(path, tree)}", flush=True)
    command = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()
    seconds = round(time.monotonic() - begin)
    return {"room": room, "mutants": len(drawn), "killed": killed, "commit": commit, "seconds": seconds}


def kept(rows: dict[str, dict[str, object]]) -> None:
    """The table with new rows in it."""
    lines = list(csv.DictReader(TABLE.open(encoding="utf-8"))) if TABLE.exists() else []
    table = {line["room"]: line for line in lines} | rows
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ("room", "mutants", "killed", "commit", "seconds"), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table[room] for room in sorted(table))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help="default: all")
    parser.add_argument("--changed", metavar="BASE", help="the rooms that differ from this commit")
    parser.add_argument("--count", type=int, default=25, help="mutants of a room")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    import casadi  # noqa: F401  loaded once, for all copies
    import h5py  # noqa: F401
    import pytest  # noqa: F401
    import scipy.optimize
    import scipy.signal  # noqa: F401

    for room in changed_rooms(given.changed) if given.changed else given.rooms or rooms():
        row = judged(room, given.count, given.seed)
        kept({room: row})
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
