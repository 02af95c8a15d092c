"""The command line: a thin skin, one clear message for each mistake, no half-written file however it ends."""

import codecs
import contextlib
import logging
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any
from unittest.mock import create_autospec

import pytest

from elastid.app import cli
from elastid.app import run as running
from elastid.app.cli import repeated_interrupts, run_command
from elastid.app.stage_table import SIMULATED, stages_of


def chatter(item: object) -> str:
    """A library that warns in both of Python's ways."""
    warnings.warn("overflow encountered in exp", RuntimeWarning, stacklevel=1)
    logging.getLogger("library").warning("findfont: no such font")
    return str(item)


def test_libraries_do_not_write_on_terminal(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """Of a command that keeps no log; afterwards Python is as it was."""
    monkeypatch.setattr("elastid.app.inspection.describe_file", chatter)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        before = warnings.showwarning, list(logging.getLogger().handlers)
        assert run_command(["inspect", "log.csv"]) == 0
        assert (warnings.showwarning, list(logging.getLogger().handlers)) == before
    assert capfd.readouterr() == ("log.csv\n", "")


STAGES = ["design", "measure", "estimate", "fit", "validate", "report"]


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_demo_is_a_study_of_ones_own_and_one_call(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In runs/demo, to copy and edit; edits are kept."""
    run_all = create_autospec(running.run_all)
    monkeypatch.setattr(running, "run_all", run_all)
    assert cli.run_command(["demo"]) == 0
    study = here / "runs" / "demo" / "study.yml"
    study.write_text("# mine\n" + study.read_text())
    assert cli.run_command(["demo"]) == 0
    (run,), _ = run_all.call_args
    assert (run.folder, run.loaded.path) == (Path("runs/demo"), Path("runs/demo/study.yml"))
    assert study.read_text().startswith("# mine")


def test_new_does_not_touch_what_is_there(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2 and a word."""
    (here / "mine").mkdir()
    (here / "mine" / "study.yml").write_text("precious")
    assert cli.run_command(["new", "mine", "--template", "recorded"]) == 2
    assert "not empty" in capsys.readouterr().err
    assert tree(here) == {"mine/study.yml": b"precious"}


def test_check_lists_all_errors_and_writes_nothing(tiny: Path, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2; one line each on stderr."""
    tiny.write_text(tiny.read_text().replace("rate_hz", "rate_hs"))
    assert cli.run_command(["check", str(tiny)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert [line.split(": ")[1] for line in err.splitlines()] == ["excitation.rate_hz", "excitation.rate_hs"]
    assert tree(here) == {}


def test_a_run_writes_nowhere_else(tiny: Path, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Results in runs/tiny alone; inspect reads them."""
    study_folder = tree(tiny.parent)
    assert cli.run_command(["run", str(tiny), "--jobs", "1"]) == 0
    assert tree(tiny.parent) == study_folder
    written = tree(here)
    assert all(name.startswith("runs/tiny/") for name in written)
    stages = [stage for stage in stages_of(SIMULATED).values() if not stage.needs]
    files = [name for stage in stages for name in stage.leaves if "." in name and "*" not in name]
    assert {f"runs/tiny/{name}" for name in (*files, "run.log")} <= written.keys()
    for name in ("plan", "records", "frf", "fit", "validation"):
        assert cli.run_command(["inspect", f"runs/tiny/{name}.h5"]) == 0
        assert f"{name}, written by elastid" in capsys.readouterr().out


def refused(study: Path, code: int, capsys: pytest.CaptureFixture[str], *options: str) -> str:
    """The one message with which `run` ends; nothing half-written is left."""
    capsys.readouterr()
    assert cli.run_command(["run", str(study), "--jobs", "1", "-q", *options]) == code
    err = capsys.readouterr().err
    last = [line for line in err.splitlines() if not line.startswith("warning: ")]
    assert len(last) == 1, err
    assert "Traceback" not in err
    assert not list(Path().rglob(".*"))
    return last[0]


@pytest.mark.parametrize("override", ["fit.strats=1", f"fit{'.a' * 2000}=1", "robot=nope.yml"])
def test_a_wrong_study_ends_before_anything_is_written(
    tiny: Path, here: Path, capsys: pytest.CaptureFixture[str], override: str
) -> None:
    """Exit code 2, no run folder."""
    refused(tiny, 2, capsys, "--set", override)
    assert tree(here) == {}


@pytest.mark.parametrize(
    "arguments",
    [
        *(["fly"], ["run"], ["run", "x.yml", "--jobs", "0"], ["check", "nope.yml"], ["new", "d", "--template", "x"]),
        *(["run", "x.yml", "--run", ""], ["fit", "x.yml"], ["tune", "x.yml", "--path", "x", "--rate", "1e9"]),
        *(["new", "s", "--from", "log.csv"], ["inspect", "fit.h5"], ["predict", "r.yml", "--log", "a"]),
    ],
)
def test_usage_errors_and_missing_files_end_with_code_2(arguments, here, capsys):
    assert cli.run_command(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err
    assert "Traceback" not in err


def test_signs_that_a_terminal_lacks_are_letters() -> None:
    """One after the other; no letter is lost."""
    codecs.register_error("letters", cli._ascii_replacement)
    assert "5±2 µm at 3°".encode("ascii", "letters") == b"5+-2 um at 3deg"


@pytest.mark.slow
def test_ascii_terminal_and_notebook_backend_are_supported(tiny: Path, here: Path) -> None:
    """Signs are written in letters, and the figures are drawn."""
    strange = {"PYTHONIOENCODING": "ascii", "MPLBACKEND": "module://nowhere.inline"}
    command = [sys.executable, "-m", "elastid", "run", str(tiny), "--png", "--jobs", "1", "--run", "2±1"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | strange)
    assert ended.returncode == 0, ended.stderr
    assert "2+-1/report.html" in ended.stdout
    assert list(here.glob("*/figures/*.png"))


def test_a_full_disk_is_one_sentence(
    tiny: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing half-written stays."""

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "runs/tiny/frf.h5")

    monkeypatch.setattr("elastid.app.stages.estimate.write_responses", full)
    assert "runs/tiny/frf.h5: No space left on device" in refused(tiny, 1, capsys)


# The run receives the signal where a stage is about to write its result, or in the middle of measuring.
DRIVER = """
import os, sys
from importlib import import_module
from elastid.app.cli import run_command

def stop(*_, **__):
    os.kill(os.getpid(), int(sys.argv[2]))

stage = sys.argv[1]
module = None if stage == "none" else import_module(f"elastid.app.stages.{stage}")
if stage == "measure":
    inner = module._measure_part
    def measure_part(*arguments):
        inner(*arguments)
        stop()
    module._measure_part = measure_part
elif module is not None:
    name = dict(design="write_plan", estimate="write_responses", fit="write_fit", validate="write_validation")
    setattr(module, (name | dict(report="html"))[stage], stop)
sys.exit(run_command(["run", sys.argv[3], "--run", sys.argv[4], "--jobs", "1"]))
"""


def driven(stage: str, number: int, study: Path, folder: str = "runs/tiny") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", DRIVER, stage, str(number), str(study), folder]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=["ctrl-c", "kill -9"])
def test_run_stopped_in_every_stage_gives_same_bytes(tiny: Path, here: Path, number: signal.Signals) -> None:
    """Each time what was finished is kept, and the next run goes on; the results are the same to the bit."""
    code = 130 if number == signal.SIGINT else -9
    leaves = {name: stage.leaves[0] for name, stage in stages_of(SIMULATED).items()}
    for i, stage in enumerate(STAGES):
        done = driven(stage, number, tiny)
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        if number == signal.SIGINT:
            assert "`elastid run " in done.stderr
            assert not list(here.rglob(".*")), "a half-written file"
        kept = [leaves[before] for before in STAGES[:i]]
        assert all(f"{name} kept" in done.stdout for name in kept[:-1])
        assert all((here / "runs/tiny" / name).is_file() for name in kept)
        assert not (here / "runs/tiny" / leaves[stage]).exists()
    assert driven("none", 0, tiny).returncode == 0
    stopped = tree(here / "runs/tiny")
    assert driven("none", 0, tiny, "whole").returncode == 0
    whole = tree(here / "whole")
    assert stopped.keys() == whole.keys()
    assert [name for name in whole if whole[name] != stopped[name]] == ["run.log"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["elastid.app.cli", "click"])
def test_a_signal_before_anything_is_loaded_has_no_traceback(module: str, number: signal.Signals) -> None:
    """As long as the command line itself is being imported, even where an import makes another error of Ctrl-C."""
    code = f"""
import runpy, signal, sys
class Interrupted:
    def find_spec(self, name, *rest):
        if name == {module!r}:
            try:
                signal.raise_signal({int(number)})
            except BaseException:
                raise ImportError("something was interrupted") from None
sys.meta_path.insert(0, Interrupted())
sys.argv = ["elastid", "--help"]
runpy.run_module("elastid", run_name="__main__")
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_is_raised_again_where_it_was_swallowed() -> None:
    """As CasADi's wrappers do; it does not wait for the work to end by itself."""

    def swallowing() -> None:
        with repeated_interrupts() as pressed:
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
            assert pressed.is_set()
            for _ in range(1000):
                time.sleep(0.02)

    with pytest.raises(KeyboardInterrupt):
        swallowing()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_whatever_error_ctrl_c_turns_into_the_command_was_interrupted(
    tiny: Path, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """CasADi makes a RuntimeError of it, or returns None where an array was expected."""

    def disguised(*_: object) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise RuntimeError("Error calling CallbackInternal::finalize") from None

    monkeypatch.setattr(running, "run_all", disguised)
    assert cli.run_command(["run", str(tiny)]) == 130
    assert capsys.readouterr().err.count("`elastid run ")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks /proc for processes")
def test_the_workers_of_a_killed_run_end(tiny: Path, here: Path) -> None:
    """kill -9 of the parent leaves no process behind that waits for work for ever."""
    code = "from elastid.base.execution import Execution; import time; Execution(2).ordered(time.sleep, [60.0, 60.0])"
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        assert _wait_until(lambda: len(_descendants(parent.pid)) >= 3)
        workers = _descendants(parent.pid)
    finally:
        parent.kill()
        parent.wait()
    assert _wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))


def _wait_until(happened: Any) -> bool:
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        if happened():
            return True
        time.sleep(0.05)
    return False


def _descendants(pid: int) -> list[int]:
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            child = int(status.parent.name)
            found += [child, *_descendants(child)]
    return found


@pytest.mark.parametrize("error", [MemoryError(), ImportError("failed to map segment from shared object")])
def test_exhausted_memory_is_named_with_a_code(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    """An allocator gives no text, and a library that finds no room an import error."""
    assert cli.report_error(error) == 2
    text = capsys.readouterr().err
    assert "[run/memory]" in text
    assert (str(error) or "MemoryError") in text
