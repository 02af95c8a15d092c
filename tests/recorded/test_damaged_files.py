"""Whatever is in a stranger's file, a sentence with its name comes out, and this process goes on."""

import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from plants.lab_logs import CHANNELS, measured, save_csv, study_of
from scipy.io import savemat

from elastid.app.inspection import described
from elastid.base.errors import DataError
from elastid.experiment.specs.recorded import TextFormatSpec
from elastid.recorded.files import matlab_5
from elastid.recorded.files.formats import contents


def test_a_reader_of_matlab_files_that_dies_takes_nothing_along(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """SciPy's compiled reader is replaced by one that ends its process as a bad address does."""
    (tmp_path / "scipy").mkdir()
    (tmp_path / "scipy" / "__init__.py").touch()
    (tmp_path / "scipy" / "io.py").write_text("import ctypes\n\ndef loadmat(path):\n    ctypes.string_at(0)\n")
    savemat(tmp_path / "log.mat", {"a": np.arange(5.0)})
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    with pytest.raises(DataError, match=r"log\.mat: damaged.*\(the process that read it died, exit code .*save it"):
        contents(tmp_path / "log.mat", TextFormatSpec())


def test_what_matlab_files_hold_comes_whole_from_the_process_that_reads(tmp_path: Path):
    """Types, shapes and texts, names of struct members and cells; what is no array is left out."""
    from scipy.sparse import eye_array

    cells = np.empty(2, object)
    cells[:] = [np.arange(3), "ab"]
    values = {"a": np.array([[1 + 2j, 3]]), "b": np.array([[True, False]]), "c": cells, "s": {"x": np.float32([1, 2])}}
    savemat(tmp_path / "log.mat", values | {"sparse": eye_array(5)})
    with matlab_5.opened(tmp_path / "log.mat", TextFormatSpec()) as log:
        found = {name: (array.shape, array.dtype.kind, array.read().tolist()) for name, array in log.arrays.items()}
    assert found == {
        "a": ((1, 2), "c", [[1 + 2j, 3]]),
        "b": ((1, 2), "u", [[1, 0]]),
        "c{1}": ((1, 3), "i", [[0, 1, 2]]),
        "c{2}": ((1,), "U", ["ab"]),
        "s.x": ((1, 2), "f", [[1.0, 2.0]]),
    }


def test_no_module_of_the_users_folder_is_loaded_to_read_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A folder of logs may hold a module of anybody, under the name of NumPy."""
    (tmp_path / "numpy.py").write_text("open('loaded', 'w')\n")
    savemat(tmp_path / "log.mat", {"a": np.arange(5.0)})
    monkeypatch.chdir(tmp_path)
    assert contents(Path("log.mat"), TextFormatSpec()) == {"a": (1, 5)}
    assert not Path("loaded").exists()


@pytest.mark.parametrize("placeholder", [1e308, -1e120])
def test_a_number_that_no_sensor_gives_is_refused(tmp_path: Path, log, placeholder: float):
    """Its square, which covariances are made of, would overflow."""
    spoilt = np.where(np.arange(len(log["phi"])) == 7, placeholder, log["phi"])
    save_csv(tmp_path / "log.csv", log | {"phi": spoilt})
    with pytest.raises(DataError, match=r"log\.csv: .* reaches .*, which no sensor gives; check its name"):
        measured(tmp_path, study_of("log.csv", CHANNELS))


def test_labels_of_another_type_than_they_had_are_not_taken_on_trust(tmp_path: Path):
    """HDF5 ends the process on an attribute of labels that is a number."""
    with h5py.File(tmp_path / "frf.h5", "w") as file:
        file.attrs["elastid"], file.attrs["format"] = "frf", 1
        file.create_dataset("a", data=np.zeros((2, 3))).attrs["DIMENSION_LABELS"] = np.nan
    assert "a (2, 3) = 0" in described(tmp_path / "frf.h5")
