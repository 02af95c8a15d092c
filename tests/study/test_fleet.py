"""A fleet's members come from its file, a table or folders; whatever is none is refused with its place."""

from pathlib import Path

import pytest
from plants.refusals import refused

from elastid.study.fleet import load_fleet


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """The file of a fleet without members, next to a study."""
    (tmp_path / "study.yml").write_text("name: s\n")
    (tmp_path / "fleet.yml").write_text("name: f\nstudy: study.yml\n")
    return tmp_path / "fleet.yml"


def test_folders_are_members_by_their_names(fleet: Path) -> None:
    """Overrides have them in braces; a folder whose date is none is no member."""
    for name in ("a_2024-05-01", "a_old"):
        (fleet.parent / "logs" / name).mkdir(parents=True)
    fleet.write_text(fleet.read_text() + "folders: logs/{robot}_{date}\nset: {name: '{robot} in {folder}'}\n")
    (member,) = load_fleet(fleet).members
    assert member.overrides == ("name=a in logs/a_2024-05-01",)


@pytest.mark.parametrize("pattern", ["logs/*", "logs/{robot}_*", "logs/?_*"])
def test_folders_of_any_pattern_have_robot_and_date_in_their_names(fleet: Path, pattern: str) -> None:
    """Sorted; files, and folders without a date, are no members, and a pattern of those alone is refused."""
    for name in ("b_2024-05-01", "a_20240601", "a_2024-05-01", "a_old"):
        (fleet.parent / "logs" / name).mkdir(parents=True)
    (fleet.parent / "logs" / "a_2024-07-01").touch()
    text = fleet.read_text()
    fleet.write_text(text + f"folders: '{pattern}'\n")
    assert [each.name for each in load_fleet(fleet).members] == ["a_2024-05-01", "a_2024-06-01", "b_2024-05-01"]
    fleet.write_text(text + "folders: logs/*_old\n")
    with refused("study/invalid", holds=("fleet.yml:3:10", "2026-03-31")):
        load_fleet(fleet)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("robot,day\n", ("members.csv:1:1", "date")),
        ("robot;date\nA;2026-01-01\n", ("members.csv:1:1", "robot")),
        ("robot,date\nA,2026-01-01,4\n", "members.csv:2:1"),
        ("robot,date\na,2024-05-01\na,2024-05-01\n", "a on 2024-05-01"),
        ("robot,date\n", "members"),
    ],
)
def test_a_table_without_members_is_refused(fleet: Path, table: str, message: str) -> None:
    """By a sentence."""
    (fleet.parent / "members.csv").write_text(table)
    fleet.write_text(fleet.read_text() + "table: members.csv\n")
    with refused("files/table", "study/invalid", holds=message):
        load_fleet(fleet)
