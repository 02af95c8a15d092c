"""Artefacts on the disk: exact, whole or absent, the same bytes for the same value."""

import dataclasses
import math
import time

import h5py
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays

from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.experiment.plan.plan import Plan
from elastid.fit.result import FitResult, LocalOptimum
from elastid.parameters import Parameter, ParameterSet, Prior, Tie
from elastid.record import Configuration, Record
from elastid.response import Covariance, FrequencyResponse, Levels, Quality
from elastid.store import (
    Stamp,
    read_configurations,
    read_fit,
    read_plan,
    read_records,
    read_responses,
    read_stamp,
    read_validation,
    text_file,
    write_fit,
    write_plan,
    write_records,
    write_responses,
    write_validation,
)
from elastid.validation.resonances import Peak
from elastid.validation.results import Agreement, Fold, Replay, Validation

STAMP = Stamp("inputs", "code", "0.1.0", 3, "name: Kühlhaus\n" * 6000)
QUICK = settings(deadline=None, max_examples=15)

TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)
NAME = TEXT.filter(bool)
NUMBER = st.floats(allow_nan=False, allow_infinity=False, width=64)


def finite(*shape):
    return arrays(np.float64, shape, elements=st.floats(-1e6, 1e6))


def positive(*shape):
    return arrays(np.float64, shape, elements=st.floats(0, 1e6))


def complex_numbers(*shape):
    return arrays(np.complex128, shape, elements=st.complex_numbers(max_magnitude=1e6))


def names(n):
    return st.lists(NAME, min_size=n, max_size=n, unique=True).map(tuple)


def same(a, b):
    """Equal to the last bit, whatever is inside; NaN equals NaN."""
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, float) and math.isnan(a):
        return isinstance(b, float) and math.isnan(b)
    return type(a) is type(b) and a == b


NOTE = st.builds(Note, TEXT, TEXT, TEXT, st.sampled_from(["information", "warning"]))
CONFIGURATION = st.builds(Configuration, NAME, finite(2))


@st.composite
def records(draw, name=NAME, configuration=CONFIGURATION):
    N, n_u, n_y = draw(st.integers(2, 4)), draw(st.integers(1, 2)), draw(st.integers(1, 3))
    motion = st.sampled_from(["position", "velocity", "acceleration"])
    return Record(
        draw(name),
        draw(configuration),
        draw(st.integers(0, 5)),
        draw(st.integers(0, 5)),
        draw(st.floats(1e-3, 1e6)),
        N,
        draw(names(n_u)),
        draw(names(n_y)),
        tuple(draw(motion) for _ in range(n_y)),
        draw(finite(3 * N, n_u)),
        draw(finite(3 * N, n_y)),
        draw(st.none() | finite(3 * N, n_u)),
        draw(st.booleans()),
        tuple(draw(st.lists(NOTE, max_size=2))),
        draw(st.sampled_from(["band-limited", "zero-order"])),
        N % 2 == 0 and draw(st.booleans()),
    )


@st.composite
def responses(draw, name=NAME):
    F, n_y, n_u = draw(st.integers(1, 3)), draw(st.integers(1, 2)), draw(st.integers(1, 2))
    diagonal = st.builds(Covariance, positive(F, n_y, n_u), NUMBER)
    kronecker = st.builds(
        Covariance, positive(F, n_y, n_u), NUMBER, complex_numbers(F, n_u, n_u), complex_numbers(F, n_y, n_y)
    )
    full = st.builds(
        Covariance, positive(F, n_y, n_u), NUMBER, st.none(), st.none(), complex_numbers(F, n_y * n_u, n_y * n_u)
    )
    covariances = st.none() | diagonal | kronecker | full
    freq_hz = np.cumsum(draw(arrays(np.float64, F, elements=st.floats(0.1, 100))))
    return FrequencyResponse(
        freq_hz,
        draw(complex_numbers(F, n_y, n_u)),
        draw(names(n_u)),
        draw(names(n_y)),
        draw(st.sampled_from(["position", "velocity", "acceleration"])),
        Configuration(draw(name), draw(finite(3))),
        draw(covariances),
        draw(covariances),
        draw(st.booleans()),
        tuple(draw(st.lists(NOTE, max_size=2))),
        draw(covariances),
        draw(st.none() | qualities(freq_hz, n_y, n_u)),
    )


def qualities(freq_hz, n_y, n_u):
    F = len(freq_hz)
    levels = st.builds(Levels, st.just(freq_hz), positive(F, n_y), positive(F, n_y))
    return st.builds(
        Quality,
        coherence=positive(F, n_y, n_u),
        multiple_coherence=positive(F, n_y),
        singular_values=positive(F, min(n_y, n_u)),
        input_singular_values=positive(F, n_u),
        input_noise=positive(F, n_u),
        output_noise=positive(F, n_y),
        excited=levels,
        stochastic=st.none() | positive(F, n_y),
        even=st.none() | levels,
        odd=st.none() | levels,
    )


@given(record=records())
@QUICK
def test_a_record_comes_back_to_the_last_bit(tmp_path_factory, record):
    """Whatever its names, channels, notes: what is read equals what was written."""
    path = tmp_path_factory.mktemp("store") / "records.h5"
    write_records(path, [record], STAMP)
    assert same(next(read_records(path)), record)


@given(response=responses())
@QUICK
def test_a_response_comes_back_to_the_last_bit(tmp_path_factory, response):
    """Complex numbers, all covariances in every form or none, quality or none."""
    path = tmp_path_factory.mktemp("store") / "frf.h5"
    write_responses(path, [response])
    assert same(read_responses(path), (response,))


@given(data=st.data())
@QUICK
def test_a_plan_comes_back_to_the_last_bit(tmp_path_factory, data):
    """All that the rig needs."""
    n_u = data.draw(st.integers(1, 3))
    configurations = tuple(Configuration(name, data.draw(finite(n_u))) for name in data.draw(names(2)))
    R = data.draw(complex_numbers(2, 2, n_u, 3, n_u))
    plan = Plan(configurations, data.draw(names(n_u)), data.draw(st.floats(1, 1e5)), 64, 2, 1, np.array([1, 3, 5]), R)
    path = tmp_path_factory.mktemp("store") / "plan.h5"
    write_plan(path, plan, STAMP)
    assert same(read_plan(path), plan)


def some_fit(n_starts=2):
    parameters = ParameterSet(
        (
            Parameter("k_1", 100.0, "N*m/rad", 1.0, math.inf, log=True, prior=Prior(90.0, 0.1)),
            Parameter("k_2", 0.1 + 0.2, "N*m/rad", tie=Tie("k_1", 0.5)),
            Parameter("d_1", 3.0, "N*m*s/rad", free=False),
            Parameter("delay", 0.0, "s", -1e-3, 1e-3),
        )
    )
    start = LocalOptimum(np.array([1.0, 0.0]), np.array([2.0, 1e-4]), 12.5, 7, True, "Solve_Succeeded")
    return FitResult(
        parameters,
        np.array([2.0, 1e-4]),
        np.array([[1e-4, 0.0], [0.0, math.inf]]),
        12.5,
        10,
        1.1,
        "converged",
        "all is well",
        (start,) * n_starts,
        2,
        np.array([False, True]),
        np.array([1.0, 0.1]),
        "complex",
        (Note("a-code", "a word", "a place", "information"),),
    )


@pytest.mark.parametrize("n_starts", [0, 2])
def test_a_fit_comes_back_to_the_last_bit(tmp_path, n_starts):
    """Ties, priors, infinite bounds and variances, every start."""
    write_fit(tmp_path / "fit.h5", some_fit(n_starts), STAMP)
    assert same(read_fit(tmp_path / "fit.h5"), some_fit(n_starts))


def test_a_validation_comes_back_to_the_last_bit(tmp_path):
    """NaN where nothing could be said, and configurations without peaks."""

    def agreement(name, peaks):
        block = np.arange(2.0).reshape(2, 1)
        lags = np.full((3, 2, 1), np.nan)
        return Agreement(
            name,
            name == "b",
            ("y1", "y2"),
            ("u",),
            block.astype(int),
            block,
            block,
            block,
            0.95,
            lags,
            lags,
            block,
            block,
            peaks,
        )

    peaks = (Peak("y1", "u", "resonance", 10.0, math.nan),)
    validation = Validation((agreement("b", peaks), agreement("a", ())), "carries over")
    write_validation(tmp_path / "validation.h5", validation, STAMP)
    assert same(read_validation(tmp_path / "validation.h5"), validation)
    fits, signals = np.array([[90.0], [np.nan]]), np.arange(3.0)[:, None]
    replay = Replay(
        "a",
        ("r1", "r/2"),
        ("y1",),
        "velocity",
        ("m/s",),
        (1.0, 4.5),
        fits,
        fits,
        fits,
        "r/2",
        10.0,
        False,
        signals,
        -signals,
    )
    folds = (Fold("b", 1.5, 0.2, 3.0), Fold("a", math.nan, math.nan, math.nan, "no start led anywhere"))
    more = dataclasses.replace(
        validation, cost="is high", replays=(replay,), replayed="90 %", folds=folds, folded="does not hang on any"
    )
    write_validation(tmp_path / "more.h5", more, STAMP)
    assert same(read_validation(tmp_path / "more.h5"), more)


def test_records_are_read_one_configuration_at_a_time_in_the_order_measured(tmp_path):
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


def test_the_same_value_gives_the_same_bytes(tmp_path):
    """No clock in a file: a second apart, bit for bit the same."""
    write_fit(tmp_path / "one.h5", some_fit(), STAMP)
    time.sleep(1.1)
    write_fit(tmp_path / "two.h5", some_fit(), STAMP)
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


def test_the_stamp_comes_back(tmp_path):
    """Long studies included (an HDF5 attribute holds 64 KB at most)."""
    write_fit(tmp_path / "fit.h5", some_fit(), STAMP)
    assert read_stamp(tmp_path / "fit.h5") == STAMP


def test_axes_are_dimension_scales_with_units_and_names(tmp_path):
    """G hangs on its frequencies, outputs and inputs, as other programs expect of HDF5."""
    response = FrequencyResponse(
        [1.0, 2.0], np.ones((2, 1, 1)), ("motor 1",), ("joint 1",), "acceleration", Configuration("c", [0.0])
    )
    write_responses(tmp_path / "frf.h5", [response])
    with h5py.File(tmp_path / "frf.h5") as file:
        G = file["c/G"]
        assert [d.label for d in G.dims] == ["freq_hz", "output", "input"]
        assert all(d[0].is_scale for d in G.dims)
        assert G.attrs["units"] == "(rad/s^2)/(N*m)"
        assert G.attrs["long_name"]
        assert file["c/freq_hz"].attrs["units"] == "Hz"
        assert G.dtype == np.complex128


def test_a_write_that_fails_leaves_the_old_file_and_no_other(tmp_path):
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


def test_a_text_file_is_whole_or_absent(tmp_path):
    """The same for text."""

    def half() -> None:
        with text_file(tmp_path / "a.json") as file:
            file.write("half")
            raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        half()
    assert list(tmp_path.iterdir()) == []


def test_a_foreign_truncated_or_missing_file_is_refused_by_name(tmp_path):
    """One sentence that names the file, no HDF5 noise."""
    path = tmp_path / "fit.h5"
    with pytest.raises(DataError, match=r"fit\.h5: no such file"):
        read_fit(path)
    write_fit(path, some_fit(), STAMP)
    with pytest.raises(DataError, match=r"fit\.h5: holds fit, expected frf"):
        read_responses(path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(DataError, match=r"fit\.h5: not a readable HDF5 file"):
        read_fit(path)
    assert read_stamp(path) is None
    path.write_text("not HDF5")
    with pytest.raises(DataError, match=r"fit\.h5: not a readable HDF5 file"):
        read_fit(path)
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(DataError, match="not written by elastid"):
        read_fit(path)
    assert read_stamp(path) is None


def test_reading_does_not_touch_the_file(tmp_path):
    """Opened read-only: bytes and time stay."""
    path = tmp_path / "fit.h5"
    write_fit(path, some_fit())
    path.chmod(0o444)
    before = (path.read_bytes(), path.stat().st_mtime_ns)
    read_fit(path)
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before
