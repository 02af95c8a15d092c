"""A bit that flips in an artefact never changes a number without a word."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from plants.artefacts import STAMP, some_fit

from elastid.app.inspection import described
from elastid.base.errors import DataError
from elastid.store import has_checksum, is_intact, read_fit, read_stamp, write_fit
from elastid.store.checksum import USER_BLOCK

FLIPS = 60


def test_a_flipped_bit_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    """Behind the user block every bit counts; in it a bit spoils the checksum, or the mark that one is there."""
    path, spoilt = tmp_path / "fit.h5", tmp_path / "spoilt.h5"
    write_fit(path, some_fit(), STAMP)
    content, values = path.read_bytes(), read_fit(path).values
    random = np.random.default_rng(1)
    places = np.concatenate([random.integers(USER_BLOCK, len(content), FLIPS), random.integers(0, USER_BLOCK, 40)])
    for number, place in enumerate(places):
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(random.integers(8))
        spoilt = tmp_path / f"spoilt{number}.h5"
        spoilt.write_bytes(flipped)
        if place >= USER_BLOCK:
            with pytest.raises(DataError, match=r"spoilt\d+\.h5: its content has changed"):
                described(spoilt)
            assert read_stamp(spoilt) is None
            with pytest.raises(DataError, match=r"spoilt\d+\.h5: "):
                read_fit(spoilt)
        elif is_intact(spoilt):
            assert not has_checksum(spoilt)
            assert read_fit(spoilt).values == values


def test_other_programs_read_the_file_behind_its_checksum(tmp_path: Path) -> None:
    """The user block is HDF5's own place for a text of the owner; a file without one is read, too."""
    path = tmp_path / "fit.h5"
    write_fit(path, some_fit(), STAMP)
    assert path.read_bytes().startswith(b"elastid, SHA-256 of what follows these 512 bytes: ")
    with h5py.File(path) as file:
        assert file.userblock_size == USER_BLOCK
    (tmp_path / "bare.h5").write_bytes(path.read_bytes()[USER_BLOCK:])
    assert read_fit(tmp_path / "bare.h5").values == read_fit(path).values


def test_a_file_that_was_written_again_is_looked_at_again(tmp_path: Path) -> None:
    """What was found of a file holds for that version alone."""
    path = tmp_path / "fit.h5"
    write_fit(path, some_fit(), STAMP)
    assert is_intact(path)
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    assert not is_intact(path)
    write_fit(path, some_fit(), STAMP)
    assert is_intact(path)
