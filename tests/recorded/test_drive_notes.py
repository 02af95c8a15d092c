"""Two motors that are said to have one signal are named; signals of their own are not."""

from pathlib import Path

import numpy as np
from plants.lab_logs import measured, save_csv, study_of, with_names
from plants.notes import said


def _notes(tmp_path: Path, log: dict[str, np.ndarray], second_current: str) -> list[str]:
    save_csv(tmp_path / "log.csv", log)
    channels = with_names({"i1": "i1", "i2": second_current, "phi": "phi", "w2": "w2"})
    notes = said(measured(tmp_path, study_of("log.csv", channels)).notes)
    return [note for note in notes if "holds the samples of" in note]


def test_a_column_that_stands_for_two_motors_is_named(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """With both motors, by the names of the study; of columns of their own nothing is said."""
    (note,) = _notes(tmp_path, log, "i1")
    assert "i1 (u at motor 1) holds the samples of" in note
    assert "i1 (u at motor 2): one of the two is not the signal of its motor" in note
    assert _notes(tmp_path, log, "i2") == []


def test_a_signal_that_was_logged_twice_is_named(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """A factor and an offset do not hide it; a part in a thousand of its own makes it another signal."""
    assert len(_notes(tmp_path, log | {"i2": 7.0 - 2.5 * log["i1"]}, "i2")) == 1
    own = log["i1"] + 1e-3 * log["i2"]
    assert _notes(tmp_path, log | {"i2": own}, "i2") == []


def test_signals_that_do_not_move_are_left_to_other_checks(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Two dead currents are equal, and no copy of each other."""
    assert _notes(tmp_path, log | {"i2": np.full_like(log["i1"], 3.0)}, "i2") == []
