"""Mutants of each room of elastid that its tests kill: the judge of what a test is worth.

    uv run --all-groups python scripts/mutants.py [ROOM ...] [--count 60] [--seed 1]
    uv run --all-groups python scripts/mutants.py --changed main

A mutant has one operator, comparison, number or condition of one function changed; so many are drawn over a room's
modules. Each of the room's fast tests and doctests first runs in a copy of the process that has loaded them, which
records its time and the lines that it executes; a mutant then meets the tests that execute its statement, fastest
first, and survives at once where there are none. What is executed at import is imported again with the mutant in it and
meets all tests. Copies are of POSIX alone. tests/kills.csv keeps the last count of each room with seed, commit and
the seconds that it took; survivors are printed. --changed takes the rooms that differ from a commit.
"""

import argparse
import ast
import csv
import gc
import io
import json
import math
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout, suppress
from copy import deepcopy
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from types import CodeType, FrameType, FunctionType
from typing import Any

import hypothesis
import pytest

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "tests" / "kills.csv"
LIMIT_S = 60
PAIRS: list[tuple[type[ast.AST], type[ast.AST]]] = [
    (ast.Add, ast.Sub), (ast.Mult, ast.Div), (ast.Lt, ast.GtE), (ast.Gt, ast.LtE), (ast.Eq, ast.NotEq),
    (ast.Is, ast.IsNot), (ast.In, ast.NotIn), (ast.And, ast.Or),
]  # fmt: skip
SWAPS = {a: b for pair in PAIRS for a, b in (pair, pair[::-1])} | {ast.MatMult: ast.Mult, ast.Pow: ast.Mult}


def changes(tree: ast.Module) -> list[tuple[int, Callable[[], None]]]:
    """Return (line, change) of all that can be changed in the functions of a module; texts and annotations stay."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    nodes = {id(node): node for function in functions for part in function.body for node in executable_nodes(part)}
    return [(node.lineno, change) for node in nodes.values() for change in changes_of(node)]


def executable_nodes(node: ast.AST) -> Iterator[Any]:
    """Yield a node and those below it, without messages, annotations and nested functions."""
    if isinstance(node, ast.JoinedStr | ast.Raise | ast.FunctionDef | ast.ClassDef):
        return
    yield node
    if isinstance(node, ast.UnaryOp) and isinstance(node.operand, ast.Constant):
        return  # -1 loses its sign; -2 is the same shape
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "slice"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from executable_nodes(child)


def changes_of(node: Any) -> Iterator[Callable[[], None]]:
    """Yield each way in which one node is changed."""
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


@dataclass(frozen=True)
class Mutant:
    """A module with one change, and the lines of the statement that has it."""

    path: Path
    lines: range
    tree: ast.Module

    def code(self) -> CodeType:
        """Return the compiled module."""
        return compile(self.tree, str(self.path), "exec")

    def is_executed(self, lines: set[tuple[str, int]]) -> bool:
        """Return True if its statement is among executed lines of files."""
        return any((str(self.path), line) in lines for line in self.lines)

    def __str__(self) -> str:
        original = ast.unparse(ast.parse(self.path.read_text(encoding="utf-8"))).splitlines()
        pairs = zip(original, ast.unparse(self.tree).splitlines(), strict=True)
        new_line = next(new.strip() for old, new in pairs if new != old)
        return f"{self.path.relative_to(ROOT)}:{self.lines[0]}: {new_line}"


def mutants(room: str, count: int, seed: int) -> list[Mutant]:
    """Draw mutants of a room by seed, module and text of the line, so that changes of other lines do not matter."""
    keys, trees = [], {}
    for path in sorted((ROOT / "elastid" / room).rglob("*.py")):
        text, occurrences = path.read_text(encoding="utf-8"), Counter[str]()
        trees[path] = ast.parse(text)
        for index, (line, _) in enumerate(changes(trees[path])):
            line_text = text.splitlines()[line - 1].strip()
            occurrences[line_text] += 1
            rank = random.Random(f"{seed} {path.relative_to(ROOT)} {line_text} {occurrences[line_text]}").random()
            keys.append((rank, path, index))
    sites = []
    for _, path, index in sorted(sorted(keys)[:count], key=lambda each: each[1:]):
        copy = deepcopy(trees[path])
        line, change = changes(copy)[index]
        change()
        sites.append(Mutant(path, statement(trees[path], line), ast.fix_missing_locations(copy)))
    return sites


def statement(tree: ast.Module, line: int) -> range:
    """Return the lines of the innermost statement at a line, without its body."""
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.stmt) and node.lineno <= line]
    inner: Any = max((node for node in nodes if (node.end_lineno or 0) >= line), key=lambda node: node.lineno)
    return range(inner.lineno, inner.body[0].lineno if hasattr(inner, "body") else inner.end_lineno + 1)


def in_copy(work: Callable[..., Any], *arguments: Any) -> Any:
    """Return the value of a function that runs in a copy of this process; None if the copy ends without a value."""
    with TemporaryFile() as file:
        if (process := os.fork()) == 0:
            try:
                os.setpgid(0, 0)
                file.write(pickle.dumps(work(*arguments)))
            except Exception as error:
                file.write(pickle.dumps(error))
            finally:
                file.flush()
                os._exit(0)
        try:
            os.waitpid(process, 0)
        finally:
            with suppress(OSError):  # workers of its tests that it left
                os.killpg(process, signal.SIGKILL)
        file.seek(0)
        value = pickle.loads(data) if (data := file.read()) else None
    if isinstance(value, Exception):
        raise value
    return value


def install(mutant: Mutant) -> None:
    """Give the functions of a loaded module the code of the mutant; tests freeze objects, which hides these."""
    gc.unfreeze()
    codes, queue = {}, [mutant.code()]
    while queue:
        code = queue.pop()
        codes[code.co_qualname, code.co_firstlineno] = code
        queue += [part for part in code.co_consts if isinstance(part, CodeType)]
    for function in [f for f in gc.get_objects() if type(f) is FunctionType]:
        code = function.__code__
        if code.co_filename == str(mutant.path) and code.co_name != "<lambda>":
            function.__code__ = codes.get((code.co_qualname, code.co_firstlineno), code)


class Judge:
    """Plugin of pytest: in copies of the process, each test of a room is recorded and each mutant meets its tests."""

    def __init__(self, room: str, drawn: list[Mutant]) -> None:
        self.room, self.drawn = room, drawn
        self.folder, self.lines = str(ROOT / "elastid" / room) + os.sep, set[tuple[str, int]]()
        self.failing, self.survive, self.seconds = ["collection"], list[bool | None](), dict[Any, float]()

    def verdict(self) -> tuple[list[str], list[bool | None], int]:
        """Return tests that fail without a mutant, whether each mutant survives (None: to be imported), limit in s."""
        threading.settrace(self.trace)
        sys.settrace(self.trace)
        run_pytest(self.room, self)
        return self.failing, self.survive, limit_s(sum(self.seconds.values()))

    def trace(self, frame: FrameType, event: str, argument: object) -> Any:
        """Note the executed lines of the room (trace function)."""
        if not frame.f_code.co_filename.startswith(self.folder):
            return None
        self.lines.add((frame.f_code.co_filename, frame.f_lineno))
        return self.trace

    def pytest_runtestloop(self, session: Any) -> bool:
        """Run the tests of pytest with records and mutants."""
        sys.settrace(None)
        line_sets, lines = self.lines, {}
        records = {test: in_copy(self.recorded, test) for test in session.items}
        self.failing = [test.nodeid for test, record in records.items() if record is None]
        for test in [] if self.failing else session.items:
            self.seconds[test], lines[test] = records[test]
        self.survive = [
            None
            if mutant.is_executed(line_sets)
            else bool(in_copy(self.survives, mutant, [test for test in lines if mutant.is_executed(lines[test])]))
            for mutant in self.drawn
        ]
        return True

    def recorded(self, test: Any) -> tuple[float, set[tuple[str, int]]]:
        """Return seconds and lines of a test."""
        begin, self.lines = time.monotonic(), set()
        sys.settrace(self.trace)
        test.config.hook.pytest_runtest_protocol(item=test, nextitem=None)
        return time.monotonic() - begin, self.lines

    def survives(self, mutant: Mutant, tests: list[Any]) -> bool:
        """Return True if all tests pass, the fast ones first; the process ends at the first failure."""
        threading.settrace(None)  # type: ignore[arg-type]
        install(mutant)
        tests.sort(key=lambda test: (round(math.log2(self.seconds[test])), str(test.path), self.seconds[test]))
        for test, following in zip(tests, [*tests[1:], None], strict=False):
            signal.alarm(limit_s(self.seconds[test]))
            test.config.hook.pytest_runtest_protocol(item=test, nextitem=following)
        return True

    def pytest_runtest_logreport(self, report: Any) -> None:
        """End the process, without a value, at a test that fails."""
        if report.failed:
            os._exit(1)


def limit_s(seconds: float) -> int:
    """Return the time limit, s, of tests with a mutant; seconds: their duration without a mutant."""
    return LIMIT_S + round(10 * seconds)


def run_pytest(room: str, *plugins: object) -> bool:
    """Run tests and doctests of a room; True if none fails."""
    phases, checks = (hypothesis.Phase.explicit, hypothesis.Phase.generate), list(hypothesis.HealthCheck)
    options = {"database": None, "deadline": None, "derandomize": True, "phases": phases}
    hypothesis.settings.register_profile("mutants", suppress_health_check=checks, **options)
    hypothesis.settings.load_profile("mutants")
    words = "-xq -p no:cacheprovider -p no:xdist -o addopts= --assert=plain --doctest-modules --import-mode=importlib"
    with TemporaryDirectory() as folder, redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        paths = ["-m", "not slow", "--basetemp", f"{folder}/base", f"tests/{room}", f"elastid/{room}"]
        return pytest.main([*words.split(), *paths], plugins=list(plugins)) == pytest.ExitCode.OK


def survives_import(mutant: Mutant, room: str, seconds: int) -> bool:
    """Return True if no test of a room fails where the mutant is imported in place of its module."""
    get_code = SourceFileLoader.get_code

    def mutant_code(loader: SourceFileLoader, name: str) -> CodeType | None:
        return mutant.code() if loader.path == str(mutant.path) else get_code(loader, name)

    SourceFileLoader.get_code = mutant_code  # type: ignore[method-assign]
    signal.alarm(seconds)
    return run_pytest(room)


def changed_rooms(base: str) -> list[str]:
    """Return rooms whose code or tests differ from a commit."""
    command = ["git", "diff", "--name-only", base, "--", "elastid", "tests"]
    output = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    names = {Path(line).parts[1].removesuffix(".py") for line in output.splitlines() if len(Path(line).parts) > 1}
    return [room for room in rooms() if room in names]


def rooms() -> list[str]:
    """Return folders of the package that have tests."""
    return sorted(path.name for path in (ROOT / "elastid").iterdir() if (ROOT / "tests" / path.name).is_dir())


def judge_room(room: str, count: int, seed: int) -> dict[str, object]:
    """Return the row of a room; print its survivors."""
    begin, drawn = time.monotonic(), mutants(room, count, seed)
    failing, survive, limit = in_copy(Judge(room, drawn).verdict)
    if failing:
        raise SystemExit(f"{room} fails without a mutant: {', '.join(failing)}")
    for index, mutant in enumerate(drawn):
        if survive[index] is None:
            survive[index] = bool(in_copy(survives_import, mutant, room, limit))
        if survive[index]:
            print("survives:", mutant, flush=True)
    revision = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    counts = {"mutants": len(drawn), "killed": survive.count(False), "seed": seed, "commit": revision.stdout.strip()}
    return {"room": room, **counts, "seconds": round(time.monotonic() - begin)}


def keep(row: dict[str, object]) -> None:
    """Write the row of a room into the table."""
    table = {line["room"]: line for line in csv.DictReader(TABLE.open(encoding="utf-8"))} | {row["room"]: row}
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ("room", "mutants", "killed", "seed", "commit", "seconds"), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table[room] for room in sorted(table))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help="default: all")
    parser.add_argument("--changed", metavar="BASE", help="the rooms that differ from this commit")
    parser.add_argument("--count", type=int, default=60, help="mutants of a room")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    import casadi  # noqa: F401  loaded once, for all copies
    import h5py  # noqa: F401
    import scipy.optimize
    import scipy.signal  # noqa: F401

    for room in changed_rooms(arguments.changed) if arguments.changed else arguments.rooms or rooms():
        row = judge_room(room, arguments.count, arguments.seed)
        keep(row)
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
