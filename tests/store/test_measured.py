"""Plans, records and responses come back to the last bit, and plans as tables for a controller."""

import csv
import pickle
from dataclasses import replace

import h5py
import numpy as np
import pytest
from plants.three_mass import NO_FLOOR, parameters, plant, with_covariance

from elastid.base import large_arrays
from elastid.experiment.plan.reference_trajectory import Reference
from elastid.fit.covariance import estimate_uncertainty
from elastid.fit.problem.frf_residuals import elastic_fit
from elastid.fit.problem.weights import weigh
from elastid.record import Configuration, Record
from elastid.response import Response
from elastid.store.measured import read_configurations, read_records, read_responses, write_records, write_responses
from elastid.store.trajectory import write_run


def some_reference():
    """Ten samples of which the third begins the periods."""
    columns = [np.arange(20.0).reshape(10, 2) * 10**i for i in range(4)]
    return Reference(Configuration("a/way", [1.0, 2.0]), 8.0, 2, *columns, np.linspace(0, 1, 10))


def test_movement_table_has_row_per_sample(tmp_path):
    """Time 0 where the periods begin; newtons and metres for an input that translates."""
    write_run(tmp_path / "a.csv", some_reference(), ("motor 1", "motor 2"), ("motor 2",))
    heading, *lines = csv.reader((tmp_path / "a.csv").read_text().splitlines())
    numbers = np.array(lines, float)
    assert heading[:4] == [
        "time_s",
        "torque scale",
        "position of motor 1 (rad, link side)",
        "position of motor 2 (m, link side)",
    ]
    assert heading[-1] == "feed_forward of motor 2 (N, link side)"
    np.testing.assert_allclose(numbers[:, 0], (np.arange(10) - 2) / 8)
    expected = some_reference()
    columns = [
        expected.scale,
        *(getattr(expected, n) for n in ("position", "velocity", "acceleration", "feed_forward")),
    ]
    np.testing.assert_allclose(numbers[:, 1:], np.column_stack(columns), rtol=1e-8)


def test_records_are_read_by_configuration_in_order(tmp_path):
    """Names that HDF5 would read as paths included."""
    configurations = [Configuration(name, [0.0]) for name in ("z", "a/b", "..")]
    written = [
        Record(f"{c.name}-{i}", c, i, 0, 10.0, 2, ("u",), ("y",), ("position",), np.ones((4, 1)), np.ones((4, 1)))
        for c in configurations
        for i in (1, 0)
    ]
    path = tmp_path / "records.h5"
    write_records(path, iter(written))
    assert read_configurations(path) == ("z", "a/b", "..")
    assert [r.name for r in read_records(path, "a/b")] == ["a/b-1", "a/b-0"]
    assert [r.name for r in read_records(path)] == [r.name for r in written]


def test_axes_are_dimension_scales_with_units_and_names(tmp_path):
    """G has frequencies, outputs and inputs as its axes, as other programs expect of HDF5."""
    response = Response(
        [1.0, 2.0], np.ones((2, 1, 1)), ("motor 1",), ("joint 1",), "acceleration", Configuration("c", [0.0])
    )
    write_responses(tmp_path / "frf.h5", [response])
    with h5py.File(tmp_path / "frf.h5") as file:
        G = file["responses/c/G"]
        assert [d.label for d in G.dims] == ["freq_hz", "outputs", "inputs"]
        assert all(d[0].is_scale for d in G.dims)
        assert G.attrs["units"] == "(rad/s^2)/(N*m)"
        assert G.attrs["long_name"]
        assert file["responses/c/freq_hz"].attrs["units"] == "Hz"
        assert G.dtype == np.complex128


def test_failed_write_keeps_old_file(tmp_path):
    """Killed half-way, the file of before is untouched."""
    path = tmp_path / "records.h5"
    record = Record("a", Configuration("c", [0.0]), 0, 0, 1.0, 2, ("u",), ("y",), ("position",), *[np.ones((4, 1))] * 2)
    write_records(path, [record])
    before = path.read_bytes()

    def interrupted():
        yield record
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_records(path, interrupted())
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_unknown_rate_gives_samples_as_unit(tmp_path) -> None:
    """Units of the signals are those of their places."""
    signals = [np.ones((4, 2))] * 2
    places, motions = ("motor 1", "slide"), ("position", "position")
    here = Configuration("c", [0.0])
    record = Record("a", here, 0, 0, 1.0, 2, places, places, motions, *signals, has_rate=False, sliding=("slide",))
    write_records(tmp_path / "records.h5", [record])
    with h5py.File(tmp_path / "records.h5") as file:
        group = file["records/a"]
        assert group["time_s"].attrs["units"] == "samples"
        assert (group["u"].attrs["units"], group["y"].attrs["units"]) == ("N*m, N", "rad, m")
        assert [d.label for d in group["u"].dims] == ["time_s", "inputs"]
        assert group["u"].dims[0][0] == group["time_s"]


def test_large_covariances_stay_in_file_for_workers(tmp_path, monkeypatch):
    """A task of one configuration is smaller by its covariances, a search takes none along, and bits are the same."""
    rng, model = np.random.default_rng(0), plant((0, 1, 2))
    known = with_covariance(model, rng)
    matrix = known.noise.matrix
    write_responses(tmp_path / "frf.h5", [known])
    (near,) = read_responses(tmp_path / "frf.h5")
    monkeypatch.setattr(large_arrays, "MIN_MAPPED_BYTES", matrix.nbytes)
    monkeypatch.setattr(large_arrays, "MIN_LARGE_FILE", 0)
    (tmp_path / "frf.h5").touch()
    (far,) = read_responses(tmp_path / "frf.h5")
    tasks, problems, ends = [], [], []
    for response in (near, far):
        weights = weigh(response, NO_FLOOR)
        fit = elastic_fit([response], [model], [weights], parameters(), "complex")
        tasks.append(pickle.dumps((fit.frfs[0], response, weights)))
        problems.append(pickle.dumps(fit.problem.evaluate))
        part, again, of_again = pickle.loads(tasks[-1])
        there = estimate_uncertainty(replace(fit, frfs=(part,)), [again], [of_again], parameters().x)
        ends.append((fit.evaluate(parameters().x).cost, there.covariance.tobytes()))
    assert isinstance(far.noise.matrix, large_arrays.FileArray)
    assert type(2 * far.noise.matrix) is type(np.abs(far.noise.matrix)) is np.ndarray
    assert ends[0] == ends[1]
    assert len(tasks[1]) < len(tasks[0]) - 0.95 * matrix.nbytes
    assert abs(len(problems[0]) - len(problems[1])) < 1000  # the folder
    assert pickle.loads(pickle.dumps(far.noise.matrix[3:5])).tobytes() == matrix[3:5].tobytes()
    with pytest.raises(ValueError, match="read-only"):
        far.noise.matrix[0, 0, 0] = 1.0
