"""A script run as its users do, in a copy of this process: the packages that it imports are loaded already."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
import warnings
from multiprocessing import get_all_start_methods, get_context
from pathlib import Path

TESTS = Path(__file__).parents[1]
SCRIPTS = TESTS.parent / "scripts"
TIMEOUT_S = 580.0


def run_script(script: Path, *arguments: str, folder: Path) -> tuple[int | None, str, str]:
    """Exit code (None where it took too long), stdout and stderr of a script that is run in a folder."""
    if "fork" not in get_all_start_methods():
        command = [sys.executable, str(script), *arguments]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
        return done.returncode, done.stdout, done.stderr
    said = [folder / f"{script.stem}.{stream}" for stream in ("stdout", "stderr")]
    process = get_context("fork").Process(target=_run, args=(script, arguments, folder, said))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads, one of which is that of pytest's worker
        process.start()
    process.join(TIMEOUT_S)
    if process.exitcode is None:
        process.kill()
    return process.exitcode, *(path.read_text(encoding="utf-8") for path in said)


def _run(script: Path, arguments: tuple[str, ...], folder: Path, said: list[Path]) -> None:
    """The script as `__main__`, with nothing of the tests beside it."""
    for path, stream in zip(said, (1, 2), strict=True):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), stream)
    sys.stdout, sys.stderr = (os.fdopen(stream, "w", encoding="utf-8", closefd=False) for stream in (1, 2))
    os.chdir(folder)
    warnings.resetwarnings()
    ours = (str(TESTS), str(SCRIPTS))
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(ours):
            del sys.modules[name]
    sys.path[:] = [str(script.parent), *(path for path in sys.path if not path.startswith(ours))]
    sys.argv = [str(script), *arguments]
    runpy.run_path(str(script), run_name="__main__")  # its error or exit code is that of the process
