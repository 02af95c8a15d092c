"""Links in a run folder: no command writes through one, and each is named in one sentence."""

from pathlib import Path

import pytest

from elastid.app.cli import run_command
from elastid.study.fleet import load_fleet

SAYS = "[files/folder]"


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("links") / "bench"
    assert run_command(["new", str(folder), "--template", "frf"]) == 0
    assert run_command(on(folder, "run", "measure", "estimate")) == 0
    return folder


def on(folder: Path, *command: str) -> list[str]:
    """A command on the study of a folder, in its run folder."""
    first, *rest = command
    run = str(folder / "run")
    return [first, str(folder / "study.yml"), *rest, "--run", run, "--jobs", "1", "-q"]


@pytest.mark.parametrize(
    ("name", "command"),
    [
        (".lock", ["run", "measure"]),
        ("run.log", ["run", "measure"]),
        ("records.partial", ["run", "measure"]),
        ("figures", ["run", "report"]),
        ("export", ["export", "--to", "csv"]),
        ("export/uff", ["export", "--to", "uff"]),
    ],
)
def test_nothing_is_written_through_a_link(
    name: str, command: list[str], bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`.lock` was truncated, `run.log` appended to, folders were filled, all at exit code 0."""
    victim, link = tmp_path / "victim", bench / "run" / name
    is_file = name in (".lock", "run.log")
    file = victim if is_file else victim / "thesis.txt"
    file.parent.mkdir(exist_ok=True)
    file.write_text("untouched")
    if link.exists():
        link.unlink()
    link.parent.mkdir(exist_ok=True)
    link.symlink_to(victim, target_is_directory=not is_file)
    try:
        assert run_command(on(bench, *command)) == 1
    finally:
        link.unlink()
    assert capsys.readouterr().err.strip().endswith(SAYS)
    assert file.read_text() == "untouched"
    assert is_file or [path.name for path in victim.iterdir()] == ["thesis.txt"]


def test_fleet_member_that_is_a_link_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, victim = tmp_path / "bench", tmp_path / "victim"
    assert run_command(["new", str(folder), "--template", "frf"]) == 0
    members = "members: [{robot: a, date: 2026-01-31}, {robot: b, date: 2026-01-31}]"
    (folder / "fleet.yml").write_text(f"name: line\nstudy: study.yml\n{members}\n")
    victim.mkdir()
    member = tmp_path / "run" / "members" / load_fleet(folder / "fleet.yml").members[0].name
    member.parent.mkdir(parents=True)
    member.symlink_to(victim, target_is_directory=True)
    assert run_command(["fleet", str(folder / "fleet.yml"), "--run", str(tmp_path / "run"), "--jobs", "1"]) == 1
    assert capsys.readouterr().err.strip().endswith(SAYS)
    assert not list(victim.iterdir())
