"""Files and folders below a run folder: none is reached through a symbolic link; tables with their lines."""

import csv
import io
import os
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pytest
from hypothesis import given, settings, strategies
from plants.refusals import refused

from elastid.base.errors import ElastidError
from elastid.base.files import RENAME_PAUSES_S, clear_folder, open_regular_file, path_below, write_atomically
from elastid.base.hdf5_check import check_self_contained
from elastid.base.tables import name_and_unit, read_table


@pytest.fixture
def elsewhere(tmp_path) -> Path:
    """A folder of the user's with a file in it."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "victim").write_text("untouched")
    return folder


def test_a_link_on_the_way_is_refused_at_every_depth(tmp_path: Path, elsewhere: Path) -> None:
    run = tmp_path / "run"
    path_below(run, "export", "c").mkdir(parents=True)
    (run / "export" / "robot").symlink_to(elsewhere, target_is_directory=True)
    (run / "figures").symlink_to(elsewhere, target_is_directory=True)
    (run / "later").symlink_to(tmp_path / "not there yet")
    for names in (("figures",), ("figures", "deeper"), ("export", "robot"), ("later",)):
        for work in (path_below, clear_folder):
            with refused("files/folder"):
                work(run, *names)
    assert os.listdir(elsewhere) == ["victim"]
    assert not (tmp_path / "not there yet").exists()


def test_the_run_folder_itself_may_be_a_link(tmp_path: Path, elsewhere: Path) -> None:
    """Its user has named it."""
    run = tmp_path / "run"
    run.symlink_to(elsewhere, target_is_directory=True)
    assert path_below(run, "figures") == run / "figures"
    clear_folder(run, "figures")
    assert not (elsewhere / "figures").exists()


@pytest.mark.parametrize("mode", ["w", "a", "x", "a+b", "r"])
def test_a_file_that_is_a_link_is_not_opened(mode: str, tmp_path: Path, elsewhere: Path) -> None:
    """One to a file that is not there yet would be made there."""
    link, dangling, pipe = tmp_path / "link", tmp_path / "dangling", tmp_path / "pipe"
    os.mkfifo(pipe)
    link.symlink_to(elsewhere / "victim")
    dangling.symlink_to(elsewhere / "new")
    for path in (link, dangling, pipe):
        with pytest.raises((ElastidError, FileExistsError)):
            open(path, mode, opener=open_regular_file).close()
    assert (elsewhere / "victim").read_text() == "untouched"
    assert not (elsewhere / "new").exists()


def with_virtual_dataset(file: h5py.File) -> None:
    """Add a dataset whose values are in another file."""
    layout = h5py.VirtualLayout((2,), "f8")
    layout[:] = h5py.VirtualSource("b.h5", "x", (2,))
    file.create_virtual_dataset("x", layout)


def many_ways(file: h5py.File) -> None:
    """25 groups, 2^25 paths."""
    inner = file.create_group("g0")
    for i in range(1, 25):
        group = file.create_group(f"g{i}")
        group["left"], group["right"], inner = inner, inner, group


@pytest.mark.parametrize(
    "fault",
    [
        lambda file: file.create_dataset("x", (2,), "f8", external=[("values", 0, 16)]),
        lambda file: file.update({"a/x": h5py.ExternalLink("b.h5", "/x")}),
        with_virtual_dataset,
        lambda file: file.update({"a/x": file["a"]}),
        lambda file: file.update({"a/x": h5py.SoftLink("/")}),
        lambda file: file.create_group("/".join("g" * 40)),
        lambda file: file.create_dataset("x", (1 << 26,), "f8", chunks=(1 << 20,)),
        pytest.param(many_ways, marks=pytest.mark.slow),
    ],
)
def test_hdf5_file_with_external_data_or_endless_groups_is_refused(fault: Callable, tmp_path: Path) -> None:
    """Internal links, a dataset below the size limit without values, and 30 nested groups are accepted."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a/b"], file["same"], file["nowhere"] = np.zeros(3), h5py.SoftLink("/a/b"), h5py.SoftLink("/c")
        file.create_dataset("unwritten", (1 << 25,), "f8", chunks=(1 << 20,))
        file.create_group("/".join("g" * 30))
        check_self_contained(file)
        fault(file)
        with refused("files/unsafe"):
            check_self_contained(file)


CELL = strategies.tuples(strategies.sampled_from('ab,;"1.'), strategies.text('ab #,;"1.')).map("".join).map(str.strip)
ROW = strategies.lists(CELL, min_size=3, max_size=3)


def written(row: list[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(row)
    return text.getvalue()


@settings(deadline=None, max_examples=40)
@given(
    ROW.filter(lambda row: len(set(row)) == 3), strategies.lists(ROW | strategies.sampled_from(["", "# a, b", ",,"]))
)
def test_a_table_has_its_cells_with_their_lines(heads: list[str], rows: list[list[str] | str]) -> None:
    """As the writer of the library of Python writes them, without empty rows and remarks; short rows are refused."""
    lines = [row if isinstance(row, str) else written(row) for row in (heads, *rows)]
    expected = [(n, dict(zip(heads, row, strict=True))) for n, row in enumerate(rows, start=2) if isinstance(row, list)]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        path.write_text("\n".join(lines))
        if expected:
            assert list(read_table(path)) == expected
        path.write_text("\n".join([*lines, "alone"]))
        with refused("files/table", place=f"{path}:{len(lines) + 1}:1"):
            list(read_table(path))


@pytest.mark.parametrize("code", ["utf-8", "utf-8-sig", "utf-16"])
def test_table_of_a_spreadsheet_has_its_numbers(tmp_path: Path, code: str) -> None:
    """A first row `sep=;`, a separator at the end of each row, and a decimal comma before a unit."""
    path = tmp_path / "table.csv"
    path.write_text("sep=;\nname;m [kg];q1 [°];\na, b;20,5 kg;-1,5e2;\n", encoding=code)
    assert list(read_table(path)) == [(3, {"name": "a, b", "m [kg]": "20.5 kg", "q1 [°]": "-1.5e2"})]
    assert [name_and_unit(head) for head in ("m [kg]", "q1 °")] == [("m", "kg"), ("q1", "°")]


@pytest.mark.parametrize("refusals", [0, 1, len(RENAME_PAUSES_S), len(RENAME_PAUSES_S) + 1])
def test_a_refused_renaming_is_tried_again_for_two_seconds(
    refusals: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As Windows refuses it while a scanner reads; afterwards the file is new and whole, or as before."""
    path, pauses, rename = tmp_path / "fit.h5", [], Path.replace
    path.write_bytes(b"before")

    def refusing(source: Path, target: Path) -> Path:
        if len(pauses) < refusals:
            raise PermissionError(13, "in use", str(source))
        return rename(source, target)

    monkeypatch.setattr(Path, "replace", refusing)
    monkeypatch.setattr("elastid.base.files.time.sleep", lambda pause: pauses.append(pause))
    if refusals <= len(RENAME_PAUSES_S):
        write_atomically(path, b"after")
        assert path.read_bytes() == b"after"
    else:
        with pytest.raises(OSError, match="in use") as error:
            write_atomically(path, b"after")
        assert error.value.filename == str(path)
        assert path.read_bytes() == b"before"
    assert [child.name for child in tmp_path.iterdir()] == ["fit.h5"]
    assert pauses == list(RENAME_PAUSES_S[:refusals])
    assert RENAME_PAUSES_S[0] == 0.1
    assert sum(RENAME_PAUSES_S) == pytest.approx(2.0)
