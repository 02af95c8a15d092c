"""A command writes below its run folder and nowhere else, and replaces no file that is open."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

# Notes every file that Python opens for writing, makes, renames or removes, and which of these were open when they were
# replaced or removed, and runs a command twice, the second time with another seed.
TRACED = """
import json, os, sys
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
written, in_use = set(), []

def still_open(place):
    # At a path or below it, in memory too; none where the system does not say.
    if not os.path.isdir("/proc/self/fd"):
        return []
    there = [f"/proc/self/fd/{handle}" for handle in os.listdir("/proc/self/fd")]
    opened = {os.readlink(link) for link in there if os.path.lexists(link)}
    with open("/proc/self/maps", encoding="utf-8") as maps:
        opened |= {line.split(maxsplit=5)[-1].strip() for line in maps}
    return [path for path in opened if path == place or path.startswith(place + os.sep)]

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
    if event in ("os.rename", "shutil.rmtree") or (event == "os.remove" and arguments[1] == -1):
        for place in arguments[: 2 if event == "os.rename" else 1]:
            in_use.extend(still_open(os.path.realpath(os.fsdecode(place))))

sys.addaudithook(note)
from elastid.app.cli import run_command
codes = [run_command([*sys.argv[2:], "--set", f"seed={seed}"]) for seed in (1, 2)]
found = [codes, sorted(written), in_use]
with open(sys.argv[1], "w", encoding="utf-8") as file:
    json.dump(found, file)
"""


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_a_study_writes_in_its_run_folder_alone(tiny: Path, tmp_path: Path) -> None:
    """From design to report: besides it there are temporary files and the caches of libraries.

    And again with another seed, which replaces every file: none is open by then.
    """
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
    codes, written, in_use = json.loads((tmp_path / "traced.json").read_text(encoding="utf-8"))
    assert codes == [0, 0], done.stderr
    assert sum(Path(path).is_relative_to(run) for path in written) > 10, "nothing was traced"
    allowed = (run, tmp_path / "cache" / "matplotlib", tmp_path / "temporary")
    elsewhere = [path for path in written if not any(Path(path).is_relative_to(folder) for folder in allowed)]
    assert [path for path in elsewhere if path not in (os.devnull, str(tmp_path / "cache"))] == []
    # Windows replaces and removes no file that is open; the lock is let go before it is removed there.
    assert set(in_use) == ({str(run / ".lock")} if Path("/proc/self/fd").is_dir() else set())
    # What other languages write is not traced, and would be found here.
    assert contents(tiny.parent) == given
    assert [list((tmp_path / name).iterdir()) for name in ("home", "work", "temporary")] == [[], [], []]
    assert {path.name for path in (tmp_path / "cache").iterdir()} <= {"elastid", "matplotlib"}
