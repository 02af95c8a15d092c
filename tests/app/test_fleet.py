"""elastid fleet: one study over robots and dates, restarted, told what is wrong, and the same bytes again."""

import csv
from pathlib import Path

import pyarrow.parquet
import pytest

from elastid.app.cli import run_command
from elastid.study.fleet import load_fleet

SOFT = "r2"


def fleet_of(study: Path, robots: int, dates: tuple[str, ...], k: float, name: str = "line") -> Path:
    """A fleet by a table; the first spring of one robot is 10 % softer."""
    with (study.parent / "members.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["robot", "date", "seed", "experiment.simulated.truth.k_1"])
        for i in range(robots):
            for j, date in enumerate(dates):
                rows.writerow([f"r{i}", date, 10 * i + j, k * (0.9 if f"r{i}" == SOFT else 1.0)])
    path = study.parent / "fleet.yml"
    path.write_text(f"name: {name}\nstudy: {study.name}\ntable: members.csv\n")
    return path


@pytest.mark.slow
def test_a_soft_gear_is_found_and_a_restart_keeps_what_is_done(
    tiny: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By name on page and terminal; the table is the same, whatever --jobs says."""
    path = fleet_of(tiny, 3, ("2026-01-31", "2026-07-31"), 60.0)
    folder = tmp_path / "line"
    assert run_command(["fleet", str(path), "--run", str(folder), "--jobs", "2"]) == 0
    told = capsys.readouterr().out
    assert f"k_1 of {SOFT} is -" in told
    page = (folder / "fleet.html").read_text(encoding="utf-8")
    assert f"k_1 of {SOFT}" in page
    first = (folder / "fleet.parquet").read_bytes()
    stamps = {file: file.stat().st_mtime_ns for file in folder.glob("members/*/fit.h5")}
    assert len(stamps) == 6
    (folder / "members" / "r0_2026-01-31" / "fit.h5").unlink()
    assert run_command(["fleet", str(path), "--run", str(folder), "--jobs", "1", "-q"]) == 0
    again = {file: file.stat().st_mtime_ns for file in folder.glob("members/*/fit.h5")}
    assert sum(again[file] != stamps[file] for file in stamps) == 1
    assert (folder / "fleet.parquet").read_bytes() == first
    table = pyarrow.parquet.read_table(folder / "fleet.parquet")
    assert {"robot", "date", "parameter", "value", "std", "low", "high"} <= set(table.column_names)


def test_a_fleet_says_what_is_wrong_with_it(tiny: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """File and line: a date that is none, a missing study, two sources of members, a key that no study has."""
    path = tiny.parent / "fleet.yml"
    member = "members: [{robot: a, date: 2026-13-01}]"
    for text, words in (
        (f"name: f\nstudy: study.yml\n{member}\n", "year-month-day"),
        ("name: f\nstudy: other.yml\nmembers: [{robot: a, date: '2026-01-01'}]\n", "no such file"),
        (
            "name: f\nstudy: study.yml\ntable: t.csv\nfolders: logs/{robot}/{date}\n",
            "one of members, table",
        ),
        ("name: f\nstudy: study.yml\nmembers: [{robot: a, date: 2026-01-01, set: {nothing: 1}}]\n", "nothing"),
    ):
        path.write_text(text)
        assert run_command(["fleet", str(path)]) == 2, text
        said = capsys.readouterr().err
        assert words in said, said


def test_folders_name_their_members(tiny: Path) -> None:
    """Robot and date from a pattern, and a path that is built from them."""
    for robot, date in (("a", "2026-01-01"), ("a", "2026-02-01"), ("b", "2026-01-01"), ("b", "notes")):
        (tiny.parent / "logs" / robot / date).mkdir(parents=True)
    path = tiny.parent / "fleet.yml"
    path.write_text("name: f\nstudy: study.yml\nfolders: logs/{robot}/{date}\nset: {name: '{robot} of {folder}'}\n")
    members = load_fleet(path).members
    assert [member.name for member in members] == ["a_2026-01-01", "a_2026-02-01", "b_2026-01-01"]
    assert members[1].overrides == ("name=a of logs/a/2026-02-01",)
