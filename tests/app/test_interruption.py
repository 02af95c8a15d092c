"""A fit that is interrupted while it searches: finished parts are kept, and it is resumed to the very same end."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from zipfile import is_zipfile

import pytest
from plants.runs import run_of

from elastid.app.run import run_all
from tests.app.test_cli import tree

STAGES = "design", "measure", "estimate", "fit"
OPTIONS = ("fit.starts=60", "fit.bootstrap=200", "fit.profile=[k_1]")


@pytest.fixture(scope="module")
def whole(tmp_path_factory, tiny_texts) -> Path:
    """The folder of a study with its run up to the fit, never stopped."""
    folder = tmp_path_factory.mktemp("whole")
    for name, text in zip(("study.yml", "robot.yml"), tiny_texts, strict=True):
        (folder / name).write_text(text)
    run_all(run_of(folder / "study.yml", folder / "run", *OPTIONS), STAGES)
    return folder


@pytest.fixture
def unfitted(whole, tmp_path) -> Path:
    """A run folder with everything before the fit."""
    shutil.copytree(whole / "run", tmp_path / "run")
    for name in ("fit.h5", "summary.json"):
        (tmp_path / "run" / name).unlink()
    return tmp_path / "run"


def stopped(command: list[str], folder: Path, parts: str, number: signal.Signals) -> tuple[int, str]:
    """Stop a command, as the terminal does it with all its processes, as soon as three such parts are kept.

    Its exit code and what it complains of.
    """
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    while process.poll() is None and len(list(folder.glob(parts))) < 3:
        time.sleep(0.002)
    assert process.poll() is None, "it ended before it could be stopped"
    os.killpg(process.pid, number)
    _, complained = process.communicate(timeout=120)
    return process.returncode, complained


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parts", "number", "jobs"),
    [
        ("start-*.npz", signal.SIGINT, "1"),
        ("start-*.npz", signal.SIGINT, "2"),
        ("bootstrap-*.npz", signal.SIGTERM, "2"),
        ("start-*.npz", signal.SIGKILL, "1"),
        ("start-*.npz", signal.SIGKILL, "2"),
    ],
)
def test_an_interrupted_fit_is_resumed(
    whole: Path, unfitted: Path, parts: str, number: signal.Signals, jobs: str
) -> None:
    """Starts that are done are not solved again, whatever the number of processes, and every file is the same."""
    options = [word for option in OPTIONS for word in ("--set", option)]
    command = [sys.executable, "-m", "elastid", "run", str(whole / "study.yml"), "fit", "--run", str(unfitted)]
    command += ["--jobs", jobs, *options]
    code, complained = stopped(command, unfitted / "fit.partial", parts, number)
    kept = {path.name: path.read_bytes() for path in (unfitted / "fit.partial").glob("*.npz")}
    assert len([name for name in kept if name.startswith(parts.partition("-")[0])]) >= 3
    assert len(kept) < 60 + 60 + 1 + 200
    assert not (unfitted / "fit.h5").exists()
    assert all(is_zipfile(unfitted / "fit.partial" / name) for name in kept), "a half-written part"
    if number != signal.SIGKILL:
        assert code == 130
        assert not list(unfitted.rglob(".*"))
        assert "parts are kept" in complained
    else:
        assert code == -9
    assert "fit: resumed from " in subprocess.run(command, capture_output=True, text=True, check=True).stdout
    ours, theirs = tree(unfitted), tree(whole / "run")
    assert ours.keys() == theirs.keys()
    assert [name for name in ours if ours[name] != theirs[name]] == ["run.log"]
