"""Loops in C: compiled once, by one process of several, and done without where that fails."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from elastid.base import compiled

with_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler is installed")
SOURCE = """#include <stdint.h>
int doubled(int64_t n, const double *x, double *found) {
    for (int64_t i = 0; i < n; i++)
        found[i] = FACTOR * x[i];
    return n == 0;
}
"""


@pytest.fixture(autouse=True)
def _cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """A cache folder of the test's own, and nothing remembered."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)
    compiled.loops.cache_clear()
    yield
    compiled.loops.cache_clear()


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "doubled.c"
    path.write_text(SOURCE)
    return path


def doubled(library: ctypes.CDLL | None, x: np.ndarray) -> np.ndarray:
    found = np.zeros(len(x))
    compiled.call(library, "doubled", len(x), x, found)
    return found


@with_compiler
def test_arrays_reach_c_whatever_their_strides(source: Path) -> None:
    library, x = compiled.loops((source,), "-DFACTOR=2.0"), np.arange(12.0)
    assert doubled(library, x[::3]).tolist() == [0.0, 6.0, 12.0, 18.0]
    with pytest.raises(MemoryError, match="doubled"):
        doubled(library, x[:0])


@with_compiler
def test_a_compiler_with_an_unclosed_quote_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """It ended in a traceback of shlex; the compilers of the machine do as well."""
    without = compiled.compiler()
    monkeypatch.setenv("CC", 'gcc "')
    assert compiled.compiler() == without != ()


@with_compiler
def test_other_flags_are_another_library(source: Path) -> None:
    for factor in (2.0, 3.0):
        assert doubled(compiled.loops((source,), f"-DFACTOR={factor}"), np.ones(1)) == factor
    assert len(list(compiled.cache_folder().iterdir())) == 2


@with_compiler
def test_processes_that_compile_the_same_do_not_disturb_each_other(source: Path) -> None:
    """Six at once, none with a half-written library: one file is left, and all have the same numbers."""
    program = (
        "import sys, pathlib, numpy as np\n"
        "from elastid.base.compiled import call, loops\n"
        "found = np.zeros(1)\n"
        "call(loops((pathlib.Path(sys.argv[1]),), '-DFACTOR=5.0'), 'doubled', 1, np.ones(1), found)\n"
        "print(found[0])"
    )
    running = [
        subprocess.Popen([sys.executable, "-c", program, str(source)], stdout=subprocess.PIPE, text=True)
        for _ in range(6)
    ]
    assert [process.communicate()[0] for process in running] == ["5.0\n"] * 6
    assert len(list(compiled.cache_folder().iterdir())) == 1


@with_compiler
@pytest.mark.parametrize("text", ["no C", SOURCE])  # the second without FACTOR
def test_a_source_that_does_not_compile_is_done_without(text: str, source: Path) -> None:
    source.write_text(text)
    assert compiled.loops((source,)) is None
    assert not list(compiled.cache_folder().iterdir())


def test_without_a_compiler_there_are_no_loops(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "COMPILERS", ())
    assert compiled.loops((source,), "-DFACTOR=2.0") is None
    with pytest.raises(RuntimeError, match="doubled"):
        doubled(None, np.ones(1))


def script(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o700)
    return str(path)


@pytest.mark.parametrize("text", ["exit 1", "kill -9 $$", 'echo no library > "$OUT"', "exit 0"])
def test_a_compiler_that_fails_or_writes_no_library_is_done_without(
    text: str, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The third writes a file that is none, where the last word but one of its command, -o, says."""
    find_output = 'for word; do [ "$before" = -o ] && OUT=$word; before=$word; done'
    monkeypatch.setenv("CC", script(tmp_path / "compiler", f"{find_output}\n{text}"))
    for _ in range(2):
        assert compiled.loops((source,), "-DFACTOR=2.0") is None
        compiled.loops.cache_clear()


def test_a_compiler_that_never_ends_is_done_without(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", script(tmp_path / "compiler", "exec sleep 60"))
    monkeypatch.setattr(compiled, "MAX_COMPILE_S", 0.1)
    assert compiled.loops((source,), "-DFACTOR=2.0") is None
    assert not list(compiled.cache_folder().iterdir())


def in_a_file(cache: Path) -> None:
    cache.write_text("")


def open_to_all(cache: Path) -> None:
    (cache / "elastid").mkdir(parents=True)
    (cache / "elastid").chmod(0o777)


def read_only(cache: Path) -> None:
    (cache / "elastid").mkdir(parents=True)
    (cache / "elastid").chmod(0o500)


@with_compiler
@pytest.mark.parametrize("make", [in_a_file, open_to_all, read_only])
def test_without_a_folder_of_its_own_nothing_is_compiled(
    make: Callable[[Path], None], source: Path, tmp_path: Path
) -> None:
    """Libraries that another user could exchange, and folders that cannot be made or written to."""
    if make is read_only and os.geteuid() == 0:
        pytest.skip("root writes everywhere")
    make(tmp_path / "cache")
    assert compiled.loops((source,), "-DFACTOR=2.0") is None
