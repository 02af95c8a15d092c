"""Finished parts of interrupted work come back to the last bit, and only those of the same key."""

import numpy as np
import pytest

from elastid.fit.problem.least_squares import LocalOptimum
from elastid.store.checkpoint import Checkpoint
from elastid.validation.comparison import Refit
from elastid.validation.frf_error import Fold

START = LocalOptimum(np.array([0.1, np.pi]), np.array([1 / 3, -1e-300]), np.inf, 7, False, "none")
REFIT = Refit("failed", "why", 3, np.inf, 2, {"a": Fold("a", 1 / 7, np.nan, 3.0)})


@pytest.fixture
def kept(tmp_path) -> Checkpoint:
    there = Checkpoint(tmp_path / "parts", "one")
    there.update({"start-0": START, "start-a/b": START, "refit-0": REFIT})
    return there


def test_parts_come_back_to_the_last_bit(kept: Checkpoint) -> None:
    """Numbers without end, infinite and undefined ones, names with a slash."""
    assert set(kept) == {"start-0", "start-a/b", "refit-0"}
    again = Checkpoint(kept.folder, "one")
    for name, value in (("start-0", START), ("start-a/b", START), ("refit-0", REFIT)):
        assert repr(again[name]) == repr(value)
    np.testing.assert_array_equal(again["start-0"].x, START.x)
    kept["start-1"] = START
    assert len(kept) == 4


def test_a_part_of_an_unknown_type_is_refused(kept: Checkpoint) -> None:
    """Nothing is written that could not be read."""
    with pytest.raises(KeyError):
        kept["start-1"] = "text"
    assert not (kept.folder / "start-1.npz").exists()


def test_parts_under_another_key_or_damaged_are_not_there(kept: Checkpoint) -> None:
    """Nor is what holds something else; they can be written again."""
    assert not Checkpoint(kept.folder, "another")
    (kept.folder / "start-0.npz").write_text("{}")
    assert "start-0" not in kept
    wrong = [f'{{"key": "one", "type": "{type_}", "value": {{"x": 1}}}}' for type_ in ("LocalOptimum", "another")]
    for text in ("", "{", "[]", "{}", '{"key": "one"}', *wrong):
        np.savez(kept.folder / "start-0.npz", part=np.array(text))
        assert sorted(kept) == ["refit-0", "start-a/b"]
    kept["start-0"] = START
    assert sorted(kept) == ["refit-0", "start-0", "start-a/b"]


def test_flipped_bit_never_changes_a_part(kept: Checkpoint) -> None:
    """Most flips of a digit leave valid JSON and another number, with which a resumed fit would end elsewhere."""
    path = kept.folder / "start-0.npz"
    content = path.read_bytes()
    for place in range(len(content)):
        flipped = bytearray(content)
        flipped[place] ^= 1
        path.write_bytes(flipped)
        assert repr(kept.get("start-0", START)) == repr(START)
