"""Texts that are too large for memory are read as small ones are: numbers, headings, pieces and places of faults."""

from pathlib import Path

import numpy as np
import pytest
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files import lines, text
from elastid.logs.files.formats import open_log, size_in_pieces

CHANNEL = ChannelSpec("y", "motor 1", "pos", quantity="position", unit="rad")


@pytest.fixture
def small_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every text is a large one, with a known place every 7 lines, read in blocks of 10 lines and 50 bytes."""
    for module, name, value in (
        (text, "LARGE_BYTES", 0), (text, "BLOCK_LINES", 10), (lines, "_STEP", 7), (lines, "_CHUNK", 50),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, value)
    lines._starts.cache_clear()


@pytest.mark.parametrize("count", [1, 6, 7, 8, 20, 21, 22, 64])
@pytest.mark.parametrize(("end", "last"), [("\n", "\n"), ("\r\n", "\r\n"), ("\n", "")])
@pytest.mark.usefixtures("small_steps")
def test_part_of_large_text_equals_text_in_memory(count: int, end: str, last: str, tmp_path: Path) -> None:
    table = np.random.default_rng(count).normal(size=(count, 2)).round(6)
    rows = ["Zeit;pos", "s;rad", *(";".join(map(str, row)).replace(".", ",") for row in table.tolist())]
    path, form = tmp_path / "log.csv", TextFormatSpec(";", ",")
    path.write_bytes((end.join(rows) + last).encode())
    assert size_in_pieces(path, [CHANNEL], form)[0] == count
    with open_log(path, form) as log:
        assert isinstance(log, text.TextLog)
        assert log.is_large
        assert (log.headings, log.units) == (("Zeit", "pos"), ("s", "rad"))
        for part in (slice(None), slice(0, 3), slice(3, 15), slice(count - 1, count + 9), slice(count, None)):
            np.testing.assert_array_equal(log.values([CHANNEL], part)[:, 0], table[part, 1])


@pytest.mark.usefixtures("small_steps")
def test_wrong_cell_of_large_text_has_its_row(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("pos\n" + "".join("oops\n" if i in (33, 34, 35) else f"{i}\n" for i in range(60)))
    with open_log(path, TextFormatSpec()) as log:
        with refused("records/text", holds="35"):
            log.values([CHANNEL])
        assert log.values([CHANNEL], slice(0, 33)).sum() == sum(range(33))
