"""Whole runs of studies all of whose names are hostile: terminal, log, tables, pages and files have them as texts."""

import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest
from plants.hostile_names import FILES, HOSTILE, hostile_robot, picked
from plants.runs import summary_of

from elastid.app.cli import run_command
from elastid.app.inspection import describe_file
from elastid.study.robots import yaml_text
from tests.base.test_names import quoted
from tests.report.page.test_page import Page

STUDY = """\
name: {study}
robot: robot.yml
seed: 1
excitation: {{rate_hz: 500, period: 1 s, band_hz: [2, 100], torque_rms: 1}}
experiment:
  configurations:
    {first}: [0.1, -0.2]
    {second}: [-0.3, 0.4]
  simulated:
    truth: {{{spring}: 21000}}
    noise: {{torque_std: 1e-3, angle_std: 1e-6}}
fit:
  starts: 1
  parameters:
    {spring}: {{}}
    "d_*": {{}}
report: {{formats: {formats}}}
"""
# Besides line ends: colours and the moves of a progress bar, which are the program's own.
OWN = re.compile(r"\x1b\[(\d+(;\d+)*m|\d*[ABKGJ]|2K|\?25[lh])")
CONTROL = re.compile("[\x00-\x09\x0b\x0c\x0e-\x1f\x7f-\x9f\u200b\u2028\u2029\u202a-\u202e\u2066-\u2069\ufeff]")


def on_a_terminal(folder: Path, *arguments: str) -> tuple[int, str]:
    """The exit code of a command and all that it writes to a pseudo-terminal."""
    leader, follower = pty.openpty()
    command = [sys.executable, "-m", "elastid", *arguments]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "200", "PYTHONIOENCODING": "utf-8"}
    process = subprocess.Popen(command, cwd=folder, stdin=follower, stdout=follower, stderr=follower, env=environment)
    os.close(follower)
    pieces = []
    while True:
        try:
            piece = os.read(leader, 65536)
        except OSError:  # Linux, where the other end is closed
            break
        if not piece:
            break
        pieces.append(piece)
    os.close(leader)
    return process.wait(), b"".join(pieces).decode()


def controls_in(text: str) -> list[str]:
    return CONTROL.findall(OWN.sub("", text))


def written(folder: Path, start: int, formats: str = "[]") -> tuple[Path, list[str]]:
    """The study, and the names in it."""
    robot = hostile_robot(start)
    study, first, second = picked(FILES, start, 3)
    (folder / "robot.yml").write_text(yaml_text(robot), encoding="utf-8")
    names = {"study": study, "first": first, "second": second, "spring": f"k_{robot.joints[0].name}"}
    path = folder / "study.yml"
    path.write_text(STUDY.format(**{key: quoted(name) for key, name in names.items()}, formats=formats), "utf-8")
    return path, [study, first, second, names["spring"]]


def test_columns_of_a_log_are_said_as_texts(tmp_path: Path) -> None:
    """Of another program, whose names may hold anything."""
    (tmp_path / "log.csv").write_text('time,"\x1b[31mred\x07","\u202egnp","a\nb"\n0,1,2,3\n1,2,3,4\n', "utf-8")
    _, said = on_a_terminal(tmp_path, "inspect", "log.csv")
    assert said
    assert not controls_in(said)
    assert "\x1b[31m" not in said


@pytest.mark.slow
@pytest.mark.parametrize("start", range(0, len(HOSTILE), 12))
def test_a_whole_run_has_them_as_texts(tmp_path: Path, start: int) -> None:
    """Terminal, run.log, summary.json, report.html and its figures, every export, every file inspected."""
    path, names = written(tmp_path, start, "[png]")
    code, said = on_a_terminal(tmp_path, "run", path.name, "--run", "out", "--jobs", "1")
    assert code in (0, 3), said
    assert not controls_in(said)
    run = tmp_path / "out"
    assert not controls_in((run / "run.log").read_text("utf-8"))
    assert "Traceback" not in (run / "run.log").read_text("utf-8")
    assert names[3] in json.dumps(summary_of(run), ensure_ascii=False).replace("\\\\", "\\").replace('\\"', '"')
    source = (run / "report.html").read_text("utf-8")
    page = Page(source)
    assert "alert(1)" not in "".join(re.findall(r"<script>(.*?)</script>", source, re.DOTALL))
    assert "blink" not in page.tags
    assert names[0] in page.text
    for file in sorted(each for each in run.rglob("*") if each.suffix in (".h5", ".json")):
        assert not controls_in(describe_file(file)), file
    for target in ("robot", "control", "matlab", "urdf", "casadi", "c", "csv", "uff"):
        assert run_command(["export", str(path), "--to", target, "--run", str(run)]) == 0, target
    assert {each.name for each in tmp_path.iterdir()} <= {"robot.yml", "study.yml", "out"}
