"""Log files of every format: contents, channels, and messages about what is not in them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest
from plants.lab_logs import CHANNELS, measured, save_csv, study_of, write_csv, write_hdf5, write_matlab, write_matlab_73

from elastid.app.inspection import described as inspected
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec, TextFormatSpec
from elastid.experiment.specs.responses import ResponseFileSpec, ResponsesSpec
from elastid.recorded.files import formats, hdf5
from elastid.recorded.files.formats import contents, read_channels
from elastid.recorded.files.log import ArrayLog, StoredArray
from elastid.recorded.files.text import described_format, guess_format


def test_contents_lists_every_signal_of_a_file(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Names and shapes as a channel would be written in a study; no texts, scalars or references."""
    text = TextFormatSpec()
    write_matlab(tmp_path, log)
    assert contents(tmp_path / "log.mat", text) == {
        "rec.cur": (2, 800),
        "rec.phi": (1, 800),
        "run(1).w": (1, 800),
        "run(2).w": (1, 800),
        "cells{1}": (1, 50),
    }
    write_matlab_73(tmp_path, log)
    assert contents(tmp_path / "new.mat", text) == {"rec.cur": (800, 2), "rec.phi": (800, 1), "w2": (800, 1)}
    write_csv(tmp_path, log)
    assert contents(tmp_path / "log.csv", text) == dict.fromkeys(("t", "i1", "i2", "phi", "w2"), (800,))


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        (
            ChannelSpec("y", "motor 1", "phy", quantity="position"),
            r"'phy' is not in it; did you mean phi\? There are i1",
        ),
        (ChannelSpec("y", "motor 1", column=9, quantity="position"), "there is no column 9; it has 4"),
    ],
)
def test_a_channel_that_a_text_log_does_not_have_is_named_with_those_it_has(
    channel: ChannelSpec, message: str, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """By heading and by number."""
    save_csv(tmp_path / "log.csv", log)
    with pytest.raises(DataError, match=message):
        measured(tmp_path, study_of("log.csv", (*CHANNELS[:2], channel)))


@pytest.mark.parametrize(
    ("name", "column", "message"),
    [
        ("rec.psi", None, r"'rec.psi' is not in it; did you mean rec.phi\? There are rec.cur \(2 x 800\)"),
        ("rec.cur", None, "holds 2 signals of 800 samples; give column: 1 to 2"),
        ("rec.cur", 3, "has no column 3; it has 2, the first is column 1"),
        ("rec.note", None, "channel rec.note is no signal but <U5"),
        ("fs", None, "channel fs is no signal but"),
        ("cells{1}", None, "differ in length: run.1..w 800, cells.1. 50 samples"),
        ("", None, "give the name of a channel"),
    ],
)
def test_a_channel_that_a_matlab_file_does_not_hold_is_named_with_those_it_has(
    name: str, column: int | None, message: str, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Missing, a matrix without a column, a wrong column, a text, a scalar, another length, no name at all."""
    write_matlab(tmp_path, log)
    u = ChannelSpec("u", "motor 1", "run(1).w")
    y = ChannelSpec("y", "motor 1", name, column or (None if name else 1), "position")
    with pytest.raises(DataError, match=message):
        measured(tmp_path, study_of("log.mat", (u, y)))


@pytest.mark.parametrize(
    ("line", "delimiter", "headings"),
    [
        ('"time, s","torque, motor 1 (Nm)","#3"', ",", ("time, s", "torque, motor 1 (Nm)", "#3")),
        ('"time; s" ; "torque, 1";x', ";", ("time; s", "torque, 1", "x")),
        ('  "time s"  "motor 1"\tx # of the bench', "whitespace", ("time s", "motor 1", "x")),
        ('3" pipe,b,c', ",", ('3" pipe', "b", "c")),
        ('"say ""stop""","2, 3",4', ",", ('say "stop"', "2, 3", "4")),
    ],
)
def test_headings_in_quotes_are_whole(line: str, delimiter: str, headings: tuple[str, ...], tmp_path: Path) -> None:
    """Delimiters and signs of comments inside of quotes belong to the heading; a lone quotation mark is an inch."""
    separator = " " if delimiter == "whitespace" else delimiter
    rows = "".join(f"{separator.join(map(str, (i, 2 * i, 3 * i)))}\n" for i in range(9))
    (tmp_path / "log.csv").write_text(f"{line}\n{rows}")
    text = TextFormatSpec(delimiter, header_lines=1)
    assert contents(tmp_path / "log.csv", text) == dict.fromkeys(headings, (9,))
    channel = ChannelSpec("y", "motor 1", headings[1], quantity="position")
    np.testing.assert_array_equal(read_channels(tmp_path / "log.csv", [channel], text)[:, 0], 2 * np.arange(9))


def test_a_delimiter_of_several_characters_is_refused(tmp_path: Path) -> None:
    """It ended in `damaged, cut short or no text file`."""
    (tmp_path / "log.csv").write_text("1,,2\n3,,4\n")
    with pytest.raises(StudyError, match="delimiter is ',,'; give a single character, tab or whitespace"):
        contents(tmp_path / "log.csv", TextFormatSpec(",,"))


def test_a_file_without_signals_says_so(tmp_path: Path) -> None:
    """`There are ` with nothing behind it."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["note"] = "text"
    for name in ("phi", "note"):
        channel = ChannelSpec("y", "motor 1", name, quantity="position")
        with pytest.raises(DataError, match=r"(There are no signals in it|there are none)$"):
            read_channels(tmp_path / "log.h5", [channel], TextFormatSpec())


@pytest.mark.parametrize("rate_hz", [-1.0, 0.0])
def test_a_sampling_rate_is_positive(rate_hz: float) -> None:
    """A channel at -1 Hz passed `check`, and logs without a period were read at -1 Hz."""
    with pytest.raises(ValueError, match=f"rate_hz is {rate_hz:g}; it must be positive"):
        ChannelSpec("y", "motor 1", "phi", quantity="position", rate_hz=rate_hz)
    with pytest.raises(ValueError, match=f"rate_hz is {rate_hz:g}; it must be positive"):
        RecordedSpec(rate_hz, CHANNELS, (FileSpec("log.csv"),))
    with pytest.raises(ValueError, match=f"rate_hz is {rate_hz:g}; it must be positive"):
        ResponsesSpec(files=(ResponseFileSpec("frf.csv", "bench"),), rate_hz=rate_hz)


def test_a_text_that_is_not_a_number_is_refused_with_the_line_of_the_file(
    tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Line 102 of the file is sample 100 after one line of headings; a short line is recognised."""
    save_csv(tmp_path / "log.csv", log)
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[101] = re.sub(r",[^,]*,", ",ERR,", lines[101], count=1)
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(DataError, match=r"log.csv, line 102, column 2 \('i2'\): 'ERR' is not a number"):
        measured(tmp_path, study_of("log.csv"))
    lines[101] = "1.0,2.0"
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(DataError, match=r"line 102: it has 2 columns, column 3 \('phi'\) is needed"):
        measured(tmp_path, study_of("log.csv"))


def test_files_that_are_no_logs_are_refused(tmp_path: Path) -> None:
    """A damaged MATLAB file, a text without numbers, a format that contradicts itself."""
    (tmp_path / "bad.mat").write_bytes(b"MATLAB 5.0 MAT-file, but not really".ljust(200, b"x"))
    (tmp_path / "words.csv").write_text("no,numbers\nin,here\n")
    (tmp_path / "empty.csv").write_text("\n")
    for name, text, error, message in (
        ("bad.mat", TextFormatSpec(), DataError, "damaged, cut short or no MATLAB file"),
        ("words.csv", TextFormatSpec(), DataError, "no numbers in its 2 lines"),
        ("empty.csv", TextFormatSpec(), DataError, "the file is empty"),
        ("words.csv", TextFormatSpec(",", ","), StudyError, "delimiter and decimal are both ','"),
    ):
        with pytest.raises(error, match=message):
            measured(tmp_path, study_of(name, text=text))


@pytest.mark.parametrize(
    ("delimiter", "decimal", "encoding"),
    [(";", ",", "utf-8-sig"), ("\t", ".", "cp1252"), (",", ".", "utf-16"), ("  ", ",", "utf-8")],
)
def test_inspect_and_messages_tell_how_a_text_log_is_written(
    delimiter: str, decimal: str, encoding: str, tmp_path: Path
) -> None:
    """Semicolons, tabs, blanks, decimal commas; UTF-8, UTF-16 and what Windows loggers write; the text fits a study."""
    path = tmp_path / "log.csv"
    numbers = np.random.default_rng(0).standard_normal((50, 3))
    rows = [delimiter.join(("u", "°C", "yl")), *(delimiter.join(f"{x:.6f}" for x in row) for row in numbers)]
    path.write_text("\n".join([rows[0], *(row.replace(".", decimal) for row in rows[1:])]), encoding=encoding)
    assert contents(path, guess_format(path)) == dict.fromkeys(("u", "°C", "yl"), (50,))
    page, text = inspected(path), guess_format(path)
    assert [line.split()[1] for line in page.splitlines()[-3:]] == ["50"] * 3
    if text == TextFormatSpec():
        return
    assert described_format(text) in page
    with pytest.raises(DataError, match=re.escape(described_format(text))):
        read_channels(path, [ChannelSpec("u", "motor 1", "u")], TextFormatSpec())


def test_headings_that_are_given_twice_or_elsewhere_are_not_guessed_at(tmp_path: Path) -> None:
    """The first of two equal headings was taken in silence, and column with it was not looked at."""
    path = tmp_path / "log.csv"
    path.write_text("x,x,y\n1,2,3\n4,5,6\n")

    def read(name: str, column: int | None) -> list[float]:
        values = read_channels(path, [ChannelSpec("u", "motor 1", name, column)], TextFormatSpec())
        return [float(v) for v in values[:, 0]]

    assert read("x", 2) == [2, 5]
    assert read("y", 3) == read("y", None) == [3, 6]
    with pytest.raises(DataError, match="'x' is the heading of column 1, 2; give column, too"):
        read("x", None)
    with pytest.raises(DataError, match="column 1 is not headed 'y', but column 3 is"):
        read("y", 1)


def test_an_hdf5_log_that_is_cut_short_is_named(tmp_path: Path) -> None:
    """The message of the library below does not say which of many files it was."""
    path = tmp_path / "cut.h5"
    with h5py.File(path, "w") as file:
        file["u"] = np.arange(5000.0)
    path.write_bytes(path.read_bytes()[:20000])
    with pytest.raises(DataError, match=r"cut\.h5: damaged, cut short or no HDF5 file .* copy it or export it again"):
        contents(path, TextFormatSpec())


@pytest.mark.parametrize("write", [write_matlab, write_matlab_73, write_hdf5])
def test_a_format_is_known_by_its_content_whatever_the_suffix(
    write: Callable[[Path, dict[str, np.ndarray]], ExperimentSpec], tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """MATLAB 5, MATLAB 7.3 and HDF5 as .dat."""
    recorded = write(tmp_path, log).recorded
    assert recorded is not None
    path = tmp_path / recorded.files[0].path
    before = contents(path, recorded.text)
    assert contents(path.rename(tmp_path / "log.dat"), recorded.text) == before


def test_an_array_that_cannot_be_read_is_refused_with_the_file_and_what_to_do(
    tmp_path: Path, log: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Arrays are read after the file was opened; the guard is around each of them."""

    def broken(*_: object) -> None:
        raise RuntimeError("checksum")

    write_hdf5(tmp_path, log)
    monkeypatch.setattr(hdf5, "_read", broken)
    with pytest.raises(DataError, match=r"log\.h5: damaged, cut short or no HDF5 file \(checksum\); copy it"):
        read_channels(tmp_path / "log.h5", [ChannelSpec("u", "motor 1", "w2")], TextFormatSpec())


def test_a_further_format_is_one_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader of raw doubles, in front of the others."""

    @contextmanager
    def opened(path: Path, text: TextFormatSpec) -> Iterator[ArrayLog]:
        values = np.frombuffer(path.read_bytes()[4:])
        yield ArrayLog(path, {"x": StoredArray(values.shape, values.dtype, lambda: values)})

    row = formats.Format("raw", lambda path, head: head.startswith(b"RAW!"), opened, "export it again")
    monkeypatch.setattr(formats, "FORMATS", (row, *formats.FORMATS))
    (tmp_path / "log.raw").write_bytes(b"RAW!" + np.arange(5.0).tobytes())
    assert contents(tmp_path / "log.raw", TextFormatSpec()) == {"x": (5,)}
    read = read_channels(tmp_path / "log.raw", [ChannelSpec("u", "motor 1", "x")], TextFormatSpec())
    np.testing.assert_array_equal(read[:, 0], np.arange(5.0))
