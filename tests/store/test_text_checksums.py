"""A bit that flips in a text of a run folder, or in the list of checksums, is noticed or harmless."""

import json
from pathlib import Path

import pytest

from elastid.app.inspection import described
from elastid.base.errors import DataError
from elastid.store import changed_texts, keep_checksums
from elastid.store.text_checksums import CHECKSUMS

NAMES = ("summary.json", "figures", "references/*.csv")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run folder with a text, a figure and a reference."""
    for name in ("summary.json", "figures/a.png", "references/a.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(json.dumps({"stiffness": 12345.678}))
    keep_checksums(tmp_path, NAMES)
    return tmp_path


@pytest.mark.parametrize("name", ["summary.json", "figures/a.png", "references/a.csv"])
def test_every_flipped_bit_of_a_text_is_noticed(folder: Path, name: str) -> None:
    """In a figure and in a reference, too, and `inspect` refuses it."""
    content = (folder / name).read_bytes()
    assert changed_texts(folder, NAMES) == ()
    for bit in range(8 * len(content)):
        spoilt = bytearray(content)
        spoilt[bit // 8] ^= 1 << bit % 8
        (folder / name).write_bytes(spoilt)
        assert changed_texts(folder, NAMES) == (name,)
    with pytest.raises(DataError, match=rf"{name}: its content has changed since it was written"):
        described(folder / name)


def test_a_figure_that_is_as_it_was_written_is_said_to_be(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It holds no signals; one that no run left is no file of elastid."""
    monkeypatch.chdir(folder / "figures")
    assert described(Path("a.png")) == "a.png: written by elastid, and unchanged since"
    (folder / "figures" / "b.png").write_text("another")
    with pytest.raises(DataError, match=r"b\.png: no numbers"):
        described(Path("b.png"))


def test_a_damaged_list_never_vouches_for_a_damaged_text(folder: Path) -> None:
    """It says at worst that an intact file has changed, and is written again."""
    path = folder / CHECKSUMS
    content = path.read_bytes()
    for place in range(len(content)):
        spoilt = bytearray(content)
        spoilt[place] ^= 1 << place % 8
        path.write_bytes(spoilt)
        assert len(changed_texts(folder, NAMES)) <= 1
    keep_checksums(folder, NAMES)
    assert changed_texts(folder, NAMES) == ()


def test_files_that_are_gone_are_forgotten(folder: Path) -> None:
    """A study with other figures leaves no old names."""
    (folder / "figures" / "a.png").unlink()
    keep_checksums(folder, NAMES)
    assert "a.png" not in (folder / CHECKSUMS).read_text()
    (folder / "figures" / "a.png").write_text("another")
    assert changed_texts(folder, NAMES) == ()
