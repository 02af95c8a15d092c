"""elastid fleet: one study over robots and dates, restarted, with messages on faults, and the same bytes again."""

import csv
import json
import os
import shutil
import signal
import time
from collections.abc import Callable
from multiprocessing import active_children
from pathlib import Path
from threading import Thread

import pyarrow.parquet
import pytest

from elastid.app.cli import run_command
from elastid.app.fleet import _values, rows_of
from elastid.store.files import save_checksums
from elastid.study.fleet import Member
from elastid.validation.fleet import MEANINGS, find_changes

SOFT = "r2"


def fleet_of(study: Path, robots: int, dates: tuple[str, ...], k: float) -> Path:
    """A fleet by a table; the first spring of one robot is 10 % softer."""
    with (study.parent / "members.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["robot", "date", "seed", "experiment.simulated.truth.k_1"])
        for i in range(robots):
            for j, date in enumerate(dates):
                rows.writerow([f"r{i}", date, 10 * i + j, k * (0.9 if f"r{i}" == SOFT else 1.0)])
    path = study.parent / "fleet.yml"
    path.write_text(f"name: line\nstudy: {study.name}\ntable: members.csv\n")
    return path


def killed_in_the_middle(folder: Path, done: int, pids: Callable[[], list[int]]) -> Thread:
    """A thread that kills one of the workers as soon as so many members are done."""

    def kill() -> None:
        while len(list(folder.glob("members/*/fit.h5"))) < done:
            time.sleep(0.05)
        os.kill(pids()[0], signal.SIGKILL)

    thread = Thread(target=kill, daemon=True)
    thread.start()
    return thread


@pytest.fixture(scope="module")
def finished(tmp_path_factory, tiny_texts) -> tuple[Path, Path]:
    """A fleet of three robots and two dates, and its folder: run by two processes, of which one was killed."""
    home = tmp_path_factory.mktemp("fleet")
    for name, text in zip(("study.yml", "robot.yml"), tiny_texts, strict=True):
        (home / name).write_text(text)
    path, folder = fleet_of(home / "study.yml", 3, ("2026-01-31", "2026-07-31"), 60.0), home / "line"
    killing = killed_in_the_middle(folder, 1, lambda: [child.pid or 0 for child in active_children()])
    assert run_command(["fleet", str(path), "--run", str(folder), "--jobs", "2"]) == 0
    killing.join()
    return path, folder


@pytest.mark.slow
def test_fleet_names_soft_gear_and_resumes_finished_members(
    finished: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """By name on page and terminal; the table is the same, whatever --jobs says and although a worker was killed.

    A bit of the table that flipped is reported, and made right.
    """
    path, folder = finished
    assert f"k_1 of {SOFT}" in (folder / "fleet.html").read_text(encoding="utf-8")
    first = (folder / "fleet.parquet").read_bytes()
    stamps = {file: file.stat().st_mtime_ns for file in folder.glob("members/*/fit.h5")}
    assert len(stamps) == 6
    (folder / "members" / "r0_2026-01-31" / "fit.h5").unlink()
    (folder / "fleet.parquet").write_bytes(first[:-1] + b"x")
    assert run_command(["inspect", str(folder / "fleet.parquet")]) == 1
    assert "fleet.parquet" in capsys.readouterr().err
    assert run_command(["fleet", str(path), "--run", str(folder), "--jobs", "1"]) == 0
    said = capsys.readouterr()
    assert "fleet.parquet" in said.err
    assert f"k_1 of {SOFT} is -" in said.out
    again = {file: file.stat().st_mtime_ns for file in folder.glob("members/*/fit.h5")}
    assert sum(again[file] != stamps[file] for file in stamps) == 1
    assert (folder / "fleet.parquet").read_bytes() == first
    table = pyarrow.parquet.read_table(folder / "fleet.parquet")
    assert {"robot", "date", "parameter", "value", "std", "low", "high"} <= set(table.column_names)
    assert table.schema.metadata[b"format"] == b"1"


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_cluster_with_killed_worker_gives_same_bytes(finished: tuple[Path, Path], tmp_path: Path) -> None:
    """Two workers for three members that are left; table, page and summaries are those of processes."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed (extra dask)")
    path, folder = finished
    for member in sorted(folder.glob("members/*"))[:3]:
        shutil.copytree(member, tmp_path / "members" / member.name)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        killing = killed_in_the_middle(tmp_path, 4, lambda: [nanny.pid for nanny in cluster.workers.values()])
        command = ["fleet", str(path), "--run", str(tmp_path), "--dask", cluster.scheduler_address, "-q"]
        assert run_command(command) == 0
        killing.join()
    names = ["fleet.parquet", "fleet.html", *(f"members/{file.name}/summary.json" for file in folder.glob("members/*"))]
    assert len(names) == 8
    assert all((tmp_path / name).read_bytes() == (folder / name).read_bytes() for name in names)


@pytest.mark.slow
def test_members_that_fail_are_named_and_the_others_go_on(
    finished: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1 and its reason for one that cannot be written, 3 for a misfit, neither compared with the others."""
    path, folder = finished
    shutil.copytree(folder / "members", tmp_path / "members")
    summary = tmp_path / "members" / "r1_2026-01-31" / "summary.json"
    summary.write_text(summary.read_text().replace('"converged"', '"misfit"', 1))
    save_checksums(summary.parent, [summary.name])  # as written so by a fit, not damaged
    assert run_command(["fleet", str(path), "--run", str(tmp_path), "--jobs", "2"]) == 3
    output = capsys.readouterr()
    assert "1 of 6 " in output.err
    assert "r1 on 2026-01-31: " in output.err
    broken = tmp_path / "members" / "r0_2026-07-31"
    shutil.rmtree(broken)
    broken.write_text("no folder")
    assert run_command(["fleet", str(path), "--run", str(tmp_path), "--jobs", "2"]) == 1
    output = capsys.readouterr()
    assert "1 of 6 " in output.err
    assert "r0 on 2026-07-31: " in output.err
    assert "3 robots, 5 of 6 " in output.out
    table = pyarrow.parquet.read_table(tmp_path / "fleet.parquet").to_pylist()
    assert ("r0", "2026-07-31") not in {(row["robot"], row["date"]) for row in table}


def test_a_fleet_says_what_is_wrong_with_it(tiny: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """File and line: a date that is none, a missing study, two sources of members, a key that no study has."""
    path = tiny.parent / "fleet.yml"
    member = "members: [{robot: a, date: 2026-13-01}]"
    (tiny.parent / "wrong.csv").write_text(
        "robot,date,seed\na,2026-01-01,1\nb,2026-01-01,x\nc,2026-01-01,y\nd,2026-01-01,x\n"
    )
    for text, words in (
        (f"name: f\nstudy: study.yml\n{member}\n", "year-month-day"),
        ("name: f\nstudy: study.yml\nmembers: [{robot: a, date: 2026-01-01, set: {nothing: 1}}]\n", "nothing"),
        ("name: f\nstudy: study.yml\ntable: t.csv\n", "fleet.yml:3:8: table: no such file"),
        ("name: f\nstudy: study.yml\ntable: wrong.csv\n", "c on 2026-01-01: "),
    ):
        path.write_text(text)
        assert run_command(["fleet", str(path)]) == 2, text
        said = capsys.readouterr().err
        assert words in said, said
    assert said.count("study.yml:") + said.count("--set") <= 2, "b and d have the same error"


def test_a_fleet_follows_what_was_found_at_the_gears(tmp_path: Path) -> None:
    """Each number that was seen once, those of the fit from there, a bound as 0; and no stiffness of a range."""
    seen = {"value": 20.0, "std": 0.1, "interval95": [19.8, 20.2], "unit": "N*m"}
    numbers = {
        "k_1": seen, "Fb_1": seen, "K1_1": seen,
        "H_1": seen | {"value": None, "std": None, "interval95": None, "bound95": 3.3},
    }  # fmt: skip
    parameter = {"value": 2e5, "std": 20.0, "interval95": [1.9e5, 2.1e5], "unit": "N*m/rad"}
    content = {"status": "converged", "parameters": {"k_1": parameter}, "gears": {"numbers": numbers}}
    member = Member("a", "2026-11-01", ())
    folder = tmp_path / "members" / member.name
    folder.mkdir(parents=True)
    (folder / "summary.json").write_text(json.dumps(content))
    rows = {row["parameter"]: row for row in rows_of(tmp_path, member)}
    assert rows.keys() == {"k_1", "Fb_1", "H_1"}
    assert (rows["H_1"]["value"], rows["H_1"]["high"]) == (0.0, 3.3)
    assert rows["H_1"]["std_noise"] == pytest.approx(2.0, rel=0.01)
    assert rows["k_1"]["value"] == 2e5
    assert (rows["Fb_1"]["low"], rows["Fb_1"]["std_noise"]) == (19.8, 0.1)
    assert MEANINGS["Fb", True] == "running torque behind the gear grows"


def test_lost_motion_that_appears_later_is_reported() -> None:
    """Of one robot of three, from below its bound; what no robot shows at any date is no parameter."""
    days, bound = ("2026-01-01", "2026-07-01", "2027-01-01"), {"low": 0.0, "high": 1e-5}
    rows = [
        {"robot": robot, "date": day, "status": "converged", "parameter": name, "unit": "rad", "value": value,
         "std": 6e-6, "std_noise": 6e-6, **bound}
        for robot in ("a", "b", "c")
        for day, lost in zip(days, (0.0, 9e-5, 1.6e-4), strict=True)
        for name, value in (("lost_1", lost if robot == "b" else 0.0), ("lost_2", 0.0))
    ]  # fmt: skip
    values = _values(rows)
    assert {value.parameter for value in values} == {"lost_1"}
    drift = next(finding for finding in find_changes(values, 0.05) if finding.kind == "drifts")
    assert (drift.robot, drift.meaning) == ("b", "lost motion grows")
    assert "lost_1 of b drifts: lost motion grows, +0.0001" in drift.sentence
    assert all(finding.robot == "b" for finding in find_changes(values, 0.05))
