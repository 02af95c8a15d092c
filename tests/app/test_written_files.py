"""A command writes below its run folder and nowhere else; SECURITY.md names the exceptions."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

# Notes every file that Python opens for writing, makes, renames or removes, and runs a command.
TRACED = """
import json, os, sys
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
written = set()

def note(event, arguments):
    if event == "open" and isinstance(arguments[0], (str, bytes)) and arguments[2] & WRITING:
        written.add(os.path.abspath(os.fsdecode(arguments[0])))
    elif event in ("os.remove", "os.rmdir") and arguments[1] != -1:
        pass  # inside of a folder that is removed, which has an event of its own
    elif event in ("os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.chmod", "shutil.rmtree"):
        written.add(os.path.abspath(os.fsdecode(arguments[0])))
    elif event in ("os.rename", "os.link", "os.symlink"):
        written.update(os.path.abspath(os.fsdecode(path)) for path in arguments[:2])
    elif event == "socket.connect":
        written.add(f"socket {arguments[1]}")

sys.addaudithook(note)
from elastid.app.cli import run_command
found = [run_command(sys.argv[2:]), sorted(written)]
with open(sys.argv[1], "w", encoding="utf-8") as file:
    json.dump(found, file)
"""


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_a_study_writes_in_its_run_folder_alone(tiny: Path, tmp_path: Path) -> None:
    """From design to report: besides it there is the cache of compiled loops, and those of libraries."""
    homes = {"HOME": "home", "USERPROFILE": "home", "TMPDIR": "temporary", "XDG_CACHE_HOME": "cache"}
    for name in {*homes.values(), "work", "cache/matplotlib"}:
        (tmp_path / name).mkdir(exist_ok=True, parents=True)
    environment = os.environ | {name: str(tmp_path / folder) for name, folder in homes.items()}
    environment |= {
        "MPLCONFIGDIR": str(tmp_path / "cache" / "matplotlib"),
        "PYTHONDONTWRITEBYTECODE": "1",  # those of modules are Python's own
    }
    given, run = contents(tiny.parent), tmp_path / "run"
    command = ["run", str(tiny), "--run", str(run), "--jobs", "1", "-q"]
    done = subprocess.run(
        [sys.executable, "-c", TRACED, str(tmp_path / "traced.json"), *command],
        cwd=tmp_path / "work",
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    code, written = json.loads((tmp_path / "traced.json").read_text(encoding="utf-8"))
    assert code == 0, done.stderr
    assert sum(Path(path).is_relative_to(run) for path in written) > 10, "nothing was traced"
    allowed = (run, *(tmp_path / "cache" / name for name in ("elastid", "matplotlib")), tmp_path / "temporary")
    elsewhere = [path for path in written if not any(Path(path).is_relative_to(folder) for folder in allowed)]
    assert [path for path in elsewhere if path not in (os.devnull, str(tmp_path / "cache"))] == []
    # What other languages write is not traced, and would be found here.
    assert contents(tiny.parent) == given
    assert [list((tmp_path / name).iterdir()) for name in ("home", "work", "temporary")] == [[], [], []]
    assert {path.name for path in (tmp_path / "cache").iterdir()} <= {"elastid", "matplotlib"}
