"""What only one kind of system has is not taken for granted, and every text is UTF-8."""

import ast
from functools import cache
from pathlib import Path

import pytest

import elastid

SOURCES = sorted(Path(elastid.__file__).parent.rglob("*.py"))
# Modules, and names of `os` and `signal`, that Windows lacks.
POSIX_MODULES = {"fcntl", "resource", "pwd", "grp", "termios", "pty"}
POSIX_NAMES = {
    name: set(words.split())
    for name, words in {
        "os": "fork getuid geteuid getpgid setsid killpg nice chown fchmod mkfifo uname sysconf statvfs getloadavg "
        "sched_getaffinity O_DIRECTORY O_NOFOLLOW O_CLOEXEC",
        "signal": "SIGKILL SIGHUP SIGALRM SIGUSR1 SIGPIPE SIG_BLOCK SIG_SETMASK alarm setitimer pthread_kill "
        "pthread_sigmask",
        "multiprocessing": "forkserver",
    }.items()
}


@cache
def trees() -> list[tuple[Path, ast.Module]]:
    return [(path, ast.parse(path.read_text(encoding="utf-8"))) for path in SOURCES]


def is_guarded(node: ast.AST, above: dict[ast.AST, ast.AST]) -> bool:
    """Whether the system was asked before: by a condition above, or one of the same function that returns."""
    asked = ("hasattr", "os.name", "start_method", "get_all_start_methods")
    while node in above:
        before, node = node, above[node]
        if isinstance(node, ast.If | ast.IfExp) and any(word in ast.unparse(node.test) for word in asked):
            return True
        if isinstance(node, ast.FunctionDef):
            earlier = [one for one in node.body if isinstance(one, ast.If) and one is not before]
            return any(
                any(word in ast.unparse(one.test) for word in asked) and isinstance(one.body[-1], ast.Return)
                for one in earlier
            )
    return False


def posix_uses(tree: ast.Module) -> list[str]:
    above = {child: parent for parent in ast.walk(tree) for child in ast.iter_child_nodes(parent)}
    found = []
    for node in ast.walk(tree):
        names = []
        match node:
            case ast.Import(names=aliases):
                names = [alias.name for alias in aliases if alias.name in POSIX_MODULES]
            case ast.ImportFrom(module=module, names=aliases) if module in POSIX_NAMES:
                names = [alias.name for alias in aliases if alias.name in POSIX_NAMES[module]]
            case ast.Attribute(value=ast.Name(id=module), attr=name) if name in POSIX_NAMES.get(module, ()):
                names = [f"{module}.{name}"]
        found += [f"line {node.lineno}: {name}" for name in names if not is_guarded(node, above)]
    return found


@pytest.mark.slow
def test_no_call_needs_posix() -> None:
    """It is made where the system was asked whether it has it."""
    assert [f"{path}, {use}" for path, tree in trees() for use in posix_uses(tree)] == []


@pytest.mark.slow
def test_every_text_is_utf_8() -> None:
    """Whatever the system's own encoding: `open`, `read_text` and `write_text` name it, or read bytes."""
    found = []
    for path, tree in trees():
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            methods = ("open", "read_text", "write_text") if isinstance(node.func, ast.Attribute) else ("open",)
            if name not in methods or "webbrowser" in ast.unparse(node.func):
                continue
            words = [*node.args, *(keyword.value for keyword in node.keywords)]
            modes = [one.value for one in words if isinstance(one, ast.Constant) and isinstance(one.value, str)]
            no_text = ast.unparse(node.func) in ("os.open", "nptdms.TdmsFile.open", "h5o.open")
            if not (no_text or any("b" in mode or "utf-8" in mode.lower() for mode in modes)):
                found.append(f"{path}:{node.lineno}: {ast.unparse(node)}")
    assert found == []


@pytest.mark.slow
def test_output_of_other_programs_ignores_system_encoding() -> None:
    """Their words are UTF-8 or bytes, and what is neither is replaced."""
    found = [
        f"{path}:{node.lineno}: {ast.unparse(node)}"
        for path, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and {"text", "universal_newlines"} & {word.arg for word in node.keywords}
        if ast.unparse(node.func).startswith("subprocess.")
    ]
    assert found == []


def test_the_walk_sees_what_it_is_there_for() -> None:
    """Unguarded calls are found, guarded ones are not."""
    assert posix_uses(ast.parse("import fcntl\nimport os\nos.getuid()")) == ["line 1: fcntl", "line 3: os.getuid"]
    assert posix_uses(ast.parse("import os\nif hasattr(os, 'getuid'):\n    os.getuid()")) == []
