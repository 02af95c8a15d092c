"""A fleet's members come from its file or a table; whatever is none is refused with its place."""

from pathlib import Path

import pytest
from plants.refusals import refused

from elastid.study.fleet import load_fleet


@pytest.fixture
def fleet(tmp_path) -> Path:
    """The file of a fleet without members, next to a study."""
    (tmp_path / "study.yml").write_text("name: s\n")
    (tmp_path / "fleet.yml").write_text("name: f\nstudy: study.yml\n")
    return tmp_path / "fleet.yml"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("robot,day\na,2026-01-01\n", ("members.csv:1:1", "date")),
        ("robot date\nA 2026-01-01\n", ("members.csv:1:1", "robot")),
        ("robot,date\nA,2026-01-01,4\n", "members.csv:2:1"),
        ("robot,date\na,2024-05-01\na,2024-05-01\n", "a on 2024-05-01"),
        ("robot,date\n", "members"),
    ],
)
def test_a_table_without_members_is_refused(fleet: Path, table: str, message: str) -> None:
    (fleet.parent / "members.csv").write_text(table)
    fleet.write_text(fleet.read_text() + "table: members.csv\n")
    with refused("files/table", "study/invalid", holds=message):
        load_fleet(fleet)


def test_members_have_the_keys_of_their_row_and_of_all(fleet: Path) -> None:
    """In the order of robots and dates; {robot} and {date} stand for their own."""
    (fleet.parent / "members.csv").write_text("robot;date;fit.starts\nb;2026-01-02;3\na;2026-01-03;\na;2026-01-01;4\n")
    fleet.write_text(fleet.read_text() + 'table: members.csv\nset: {name: "of {robot} {date}", fit.starts: 2}\n')
    members = load_fleet(fleet).members
    assert [member.name for member in members] == ["a_2026-01-01", "a_2026-01-03", "b_2026-01-02"]
    assert [member.overrides[1] for member in members] == ["fit.starts=4", "fit.starts=2", "fit.starts=3"]
    assert members[0].overrides[0] == "name=of a 2026-01-01"
    (fleet.parent / "study.yml").unlink()
    with refused("study/invalid", holds="study.yml"):
        load_fleet(fleet)
