"""Text logs."""

import re
from pathlib import Path

import numpy as np
import pytest
from plants.lab_logs import Signals, measured, save_csv, study_of
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.files.formats import contents, read_channels
from elastid.logs.files.text import open_text
from elastid.logs.files.text_format import guess_format


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


def test_columns_without_headings_are_named_as_inspect_names_them(tmp_path: Path) -> None:
    """Also beside their number; a number that contradicts the name is refused, as is a column beyond the last."""
    path, text = tmp_path / "log.csv", TextFormatSpec()
    np.savetxt(path, np.arange(33.0).reshape(3, 11), delimiter=",")
    for channel in (ChannelSpec("u", "motor 1", "column 10"), ChannelSpec("u", "motor 1", "column 10", 10)):
        np.testing.assert_array_equal(read_channels(path, [channel], text)[:, 0], [9, 20, 31])
    with refused("records/channels", place="log.csv", holds=("column 12", "11")):
        read_channels(path, [ChannelSpec("u", "motor 1", "column 12")], text)
    with refused("records/channels", holds="column 10"):
        read_channels(path, [ChannelSpec("u", "motor 1", "column 10", 3)], text)


def test_text_in_number_column_is_refused_with_row(tmp_path: Path, log: Signals) -> None:
    """Line 102 of the file is sample 100 after one line of headings; a short line is recognised.

    A few such cells are missing samples; more than one in a hundred rows are refused.
    """
    save_csv(tmp_path / "log.csv", log)
    whole = (tmp_path / "log.csv").read_text().splitlines()
    for row, place in ((re.sub(r",[^,]*,", ",ERR,", whole[101], count=1), "column 2"), ("1.0,2.0", "column 3")):
        for every, wrong in ((len(whole), 1), (50, 15)):
            lines = [row if i >= 101 and (i - 101) % every == 0 else line for i, line in enumerate(whole)]
            (tmp_path / "log.csv").write_text("\n".join(lines))
            if wrong > 1:
                with refused("records/text", holds=("log.csv, row 102", place)):
                    measured(tmp_path, study_of("log.csv"))
                continue
            with open_text(tmp_path / "log.csv", TextFormatSpec()) as few:
                values = few.columns(range(4))
            assert np.argwhere(~np.isfinite(values).all(axis=1)).ravel().tolist() == [100]


@pytest.mark.parametrize("end", ["", "EOF\n", "# 3 samples\n\n", "end of measurement\nSamples: three\n"])
def test_remarks_below_the_numbers_are_no_samples(end: str, tmp_path: Path) -> None:
    """As exports of oscilloscopes and drives have them."""
    (tmp_path / "log.csv").write_text(f"a,b\n1,2\n3,4\n5,6\n{end}")
    channel = ChannelSpec("y", "motor 1", "b", quantity="position")
    assert read_channels(tmp_path / "log.csv", [channel], TextFormatSpec())[:, 0].tolist() == [2, 4, 6]


def test_an_empty_cell_is_missing_as_nan_is(tmp_path: Path) -> None:
    """First, last, between others, of blanks; an empty line is none."""
    text = TextFormatSpec("tab")
    rows = ("a,b,c,d", "1,2,3,4", ",2,,4", "", "1,nan, ,", "1,2,3,4")
    (tmp_path / "log.csv").write_text("\n".join(rows).replace(",", "\t"))
    channels = [ChannelSpec("y", "motor 1", name, quantity="position") for name in "abcd"]
    wanted = [[1, 2, 3, 4], [np.nan, 2, np.nan, 4], [1, np.nan, np.nan, np.nan], [1, 2, 3, 4]]
    np.testing.assert_array_equal(read_channels(tmp_path / "log.csv", channels, text), wanted)


@pytest.mark.parametrize(
    ("delimiter", "decimal", "encoding"),
    [(";", ",", "utf-8-sig"), ("\t", ".", "cp1252"), (",", ".", "utf-16"), ("  ", ",", "utf-8")],
)
def test_the_format_of_a_text_is_guessed(delimiter: str, decimal: str, encoding: str, tmp_path: Path) -> None:
    """Semicolons, tabs, blanks, decimal commas; UTF-8, UTF-16 and what Windows loggers write."""
    path = tmp_path / "log.csv"
    numbers = np.random.default_rng(0).standard_normal((50, 3))
    rows = [delimiter.join(("u", "°C", "yl")), *(delimiter.join(f"{x:.6f}" for x in row) for row in numbers)]
    path.write_text("\n".join([rows[0], *(row.replace(".", decimal) for row in rows[1:])]), encoding=encoding)
    assert contents(path, guess_format(path)) == dict.fromkeys(("u", "°C", "yl"), (50,))


def test_repeated_or_misplaced_headings_are_not_guessed(tmp_path: Path) -> None:
    """The first of two equal headings was taken in silence, and column with it was not looked at."""
    path = tmp_path / "log.csv"
    path.write_text("x,x,y\n1,2,3\n4,5,6\n")

    def read(name: str, column: int | None) -> list[float]:
        values = read_channels(path, [ChannelSpec("u", "motor 1", name, column)], TextFormatSpec())
        return [float(v) for v in values[:, 0]]

    assert read("x", 2) == [2, 5]
    assert read("y", 3) == read("y", None) == [3, 6]
    with refused("records/channels", holds=("'x'", "1, 2")):
        read("x", None)
    with refused("records/channels", holds=("column 1", "'y'", "column 3")):
        read("y", 1)


@pytest.mark.parametrize("units", ["s;Nm;°", "[s];[N*m];[deg]", "sec;Nm;-"])
def test_units_are_read_below_the_headings(units: str, tmp_path: Path) -> None:
    """As loggers write them; a unit that is none of the table stays as it is, to be asked for."""
    path = tmp_path / "a.csv"
    path.write_text(f"bench 4;;\nZeit;Moment;Winkel\n{units}\n" + "0;1,5;2,5\n1;2,5;3,5\n", encoding="cp1252")
    with open_text(path, TextFormatSpec(";", ",")) as log:
        assert log.headings == ("Zeit", "Moment", "Winkel")
        assert log.units[1] in ("Nm", "N*m")
        assert log.units[0] == units.split(";")[0].strip("[]")


@pytest.mark.parametrize(
    ("delimiter", "decimal", "cells", "values"),
    [
        (";", ",", "1.512;-4,55043;12.345.678,5", (1512, -4.55043, 12345678.5)),
        (";", ",", "0.002;1'512,5;01.02", (0.002, 1512.5, 1.02)),
        ("tab", ".", "1,512.5\t1'512\t3.25", (1512.5, 1512, 3.25)),
        (",", ".", "1,512.5,1’512.25", (1, 512.5, 1512.25)),
    ],
)
def test_separators_of_thousands_are_no_decimals(
    delimiter: str, decimal: str, cells: str, values: tuple[float, ...], tmp_path: Path
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join([cells] * 3) + "\n", encoding="utf-8")
    with open_text(path, TextFormatSpec(delimiter, decimal)) as log:
        names = [ChannelSpec("y", "any", column=i + 1, quantity="position") for i in range(len(values))]
        assert log.values(names, slice(None))[0].tolist() == list(values)


def test_properties_above_data_are_skipped_and_scope_times_named(tmp_path: Path) -> None:
    """The documented form of TwinCAT Scope exports: properties of each channel in rows, times in ms beside each."""
    rows = [
        "Name\tdrive", "File\tC:\\drive.csv", "Starttime of export\t132959733843760000\tMonday\t15:56:24.376", "", "",
        "Name\tActTorque\tName\tActPos", "SymbolComment\t\tSymbolComment\t", "Data-Type\tREAL64\tData-Type\tREAL64",
        "SampleTime[ms]\t2\tSampleTime[ms]\t2", "Port\t851\tPort\t851", "Unit\t(None)\tUnit\t(None)",
        "Unit Offset\t0\tUnit Offset\t0", "", *(f"{2 * i}\t{i / 10}\t{2 * i}\t{-i}" for i in range(30)),
    ]  # fmt: skip
    path = tmp_path / "scope.csv"
    path.write_text("\n".join(rows) + "\n")
    form = guess_format(path)
    with open_text(path, form) as log:
        assert log.headings == ("time 1 [ms]", "ActTorque", "time 3 [ms]", "ActPos")
        np.testing.assert_array_equal(log.columns([0, 3]), [[2 * i, -i] for i in range(30)])
