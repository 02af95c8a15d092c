"""Loops in C: compiled once, by one process of several, and done without where that fails."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
from collections.abc import Iterator
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
    library, x = compiled.loops(source, "-DFACTOR=2.0"), np.arange(12.0)
    assert doubled(library, x[::3]).tolist() == [0.0, 6.0, 12.0, 18.0]
    with pytest.raises(MemoryError, match="doubled"):
        doubled(library, x[:0])


@with_compiler
def test_other_flags_are_another_library(source: Path) -> None:
    for factor in (2.0, 3.0):
        assert doubled(compiled.loops(source, f"-DFACTOR={factor}"), np.ones(1)) == factor
    assert len(list(compiled.cache_folder().iterdir())) == 2


@with_compiler
def test_processes_that_compile_the_same_do_not_disturb_each_other(source: Path) -> None:
    """Six at once, none with a half-written library: one file is left, and all have the same numbers."""
    program = (
        "import sys, pathlib, numpy as np\n"
        "from elastid.base.compiled import call, loops\n"
        "found = np.zeros(1)\n"
        "call(loops(pathlib.Path(sys.argv[1]), '-DFACTOR=5.0'), 'doubled', 1, np.ones(1), found)\n"
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
    assert compiled.loops(source) is None
    assert not list(compiled.cache_folder().iterdir())


def test_without_a_compiler_there_are_no_loops(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "COMPILERS", ())
    assert compiled.loops(source, "-DFACTOR=2.0") is None
    with pytest.raises(RuntimeError, match="doubled"):
        doubled(None, np.ones(1))
