"""Frequency responses of other programs: one analytic plant through every format, universal files' units, refusals."""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from plants.lab_logs import RATIO, ROBOT
from plants.notes import said
from plants.refusals import refused
from plants.runs import run_of, summary_of
from plants.two_mass import two_inertias
from scipy.io import savemat

from elastid.app.run import run_all
from elastid.base.arrays import ComplexArray, FloatArray
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import ResponseColumnsSpec, ResponseFileSpec, ResponsesSpec
from elastid.logs.responses.reading import link_side_response, read_table
from elastid.logs.responses.universal_files import uff_geometry, uff_locations, uff_table
from elastid.record import Configuration, Motion
from elastid.response import Response
from elastid.store.measured import read_responses

pyuff = pytest.importorskip("pyuff")
CONSTANT, DELAY = 0.5, 2e-3
HOME = Configuration("home", np.zeros(2))
FREQ_HZ = np.array([2.0, 3.0, 5.0, 7.5, 11.0, 20.0])
# Current of motor 1 in mA and motor side, torque of motor 2 turned round; speed of motor 1 in rpm, angle of joint 2.
CHANNELS = (
    ChannelSpec("u", "motor 1", column=1, quantity="current", unit="mA", torque_constant=CONSTANT, side="motor"),
    ChannelSpec("u", "motor 2", column=2, sign=-1),
    ChannelSpec("y", "motor 1", column=1, quantity="velocity", unit="rpm", side="motor"),
    ChannelSpec("y", "joint 2", column=2, quantity="position", unit="deg"),
)


def plant(freq_hz: FloatArray) -> ComplexArray:
    """Acceleration per torque of two coupled motors behind a delay: -w^2 e^{-jwT} (K + jwD - w^2 J)^-1."""
    J, D, K = np.diag([2.0, 1.0]), np.array([[3.0, -1], [-1, 2]]), np.array([[900.0, -600], [-600, 1500]])
    w = 2 * np.pi * freq_hz[:, None, None]
    return -(w**2) * np.exp(-1j * w * DELAY) * np.linalg.inv(K + 1j * w * D - w**2 * J)


def in_file() -> ComplexArray:
    """The same as rpm and deg, motor side, per mA and turned torque."""
    s = 2j * np.pi * FREQ_HZ
    G = plant(FREQ_HZ)
    outputs = np.stack([RATIO / s * 60 / (2 * np.pi), 180 / np.pi / s**2], axis=1)
    return outputs[:, :, None] * G * np.array([RATIO * CONSTANT * 1e-3, -1.0])


def _spec(path: str, **changes: Any) -> ResponsesSpec:
    return ResponsesSpec(**({"files": (ResponseFileSpec(path, "home"),), "channels": CHANNELS} | changes))


def _read(base: Path, spec: ResponsesSpec, quantity: Motion = "acceleration") -> Response:
    file = spec.files[0]
    return link_side_response(read_table(base / file.path, spec, file.response), spec, HOME, ROBOT, quantity)


def _struct(**changes: Any) -> dict[str, Any]:
    G = np.moveaxis(in_file(), 0, 2)
    return {"ResponseData": G, "Frequency": 2 * np.pi * FREQ_HZ[:, None], "FrequencyUnit": "rad/TimeUnit"} | changes


def _matlab(base: Path) -> ResponsesSpec:
    savemat(base / "frf.mat", {"G": _struct(), "junk": np.arange(3)})
    return _spec("frf.mat")


def _matlab_with_names_in_hz(base: Path) -> ResponsesSpec:
    names = {
        "InputName": np.array([["torque 2"], ["current 1"]], dtype=object),
        "OutputName": np.array([["speed"], ["angle"]], dtype=object),
    }
    G = np.moveaxis(in_file()[:, :, ::-1], 0, 2)
    savemat(base / "frf.mat", {"G": _struct(ResponseData=G, FrequencyUnit="Hz", Frequency=FREQ_HZ, **names), "b": 1.0})
    labels = ("current 1", "torque 2", "speed", "angle")
    channels = tuple(replace(c, channel=name, column=None) for c, name in zip(CHANNELS, labels, strict=True))
    return _spec("frf.mat", channels=channels)


def _matlab_73(base: Path) -> ResponsesSpec:
    G = np.moveaxis(in_file(), 0, 2)
    with h5py.File(base / "new.mat", "w", userblock_size=512) as file:
        data = np.zeros(G.T.shape, dtype=[("real", "f8"), ("imag", "f8")])
        data["real"], data["imag"] = G.T.real, G.T.imag
        file["s/ResponseData"], file["s/Frequency"] = data, FREQ_HZ[None] * 2 * np.pi
        file["s/Units"] = np.array([[ord(c)] for c in "rad/s"], dtype=np.uint16).T
    with (base / "new.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(512))
    return _spec("new.mat")


def _hdf5(base: Path) -> ResponsesSpec:
    with h5py.File(base / "frf.h5", "w") as file:
        file["data/G"], file["data/w"] = np.moveaxis(in_file(), 0, 2), 2 * np.pi * FREQ_HZ
        file["data/w"].attrs["units"] = "rad/s"
    return _spec("frf.h5", columns=ResponseColumnsSpec(frequency="data/w", response="data/G"))


def _csv_of(base: Path, parts: dict[str, FloatArray]) -> None:
    columns = {"freq_hz": FREQ_HZ} | parts
    rows = [",".join(f"{v:.17g}" for v in row) for row in zip(*columns.values(), strict=True)]
    (base / "frf.csv").write_text("\n".join([",".join(columns), *rows]))


def _elements(*parts: tuple[str, Callable[[ComplexArray], FloatArray]]) -> dict[str, FloatArray]:
    G = in_file()
    return {f"{name}_{i + 1}_{j + 1}": f(G[:, i, j]) for i in range(2) for j in range(2) for name, f in parts}


def _csv_times(factor: float, base: Path) -> ResponsesSpec:
    _csv_of(base, _elements(("re", lambda g: factor * g.real), ("im", lambda g: factor * g.imag)))
    return _spec("frf.csv")


def _csv_in_db_and_degrees(base: Path) -> ResponsesSpec:
    _csv_of(
        base,
        _elements(("mag", lambda g: 20 * np.log10(np.abs(g))), ("arg", lambda g: np.degrees(np.unwrap(np.angle(g))))),
    )
    columns = ResponseColumnsSpec(magnitude="mag_{y}_{u}", phase="arg_{y}_{u}", magnitude_unit="dB")
    return _spec("frf.csv", columns=columns)


def _csv_in_rad(base: Path) -> ResponsesSpec:
    _csv_of(base, _elements(("mag", np.abs), ("arg", np.angle)) | {"freq_hz": 2 * np.pi * FREQ_HZ})
    columns = ResponseColumnsSpec(magnitude="mag_{y}_{u}", phase="arg_{y}_{u}", phase_unit="rad")
    return _spec("frf.csv", columns=columns, frequency_unit="rad/s")


def _uff_set(
    x: FloatArray, g: ComplexArray, response: tuple[int, int], reference: tuple[int, int], what: int
) -> dict[str, Any]:
    """A data set 58 of double precision complex numbers at uneven frequencies."""
    return {
        "type": 58, "binary": 0, "func_type": 4, "id1": "a", "id2": "b", "id3": "c", "id4": "d", "id5": "e",
        "rsp_ent_name": "NONE", "rsp_node": response[0], "rsp_dir": response[1],
        "ref_ent_name": "NONE", "ref_node": reference[0], "ref_dir": reference[1],
        "abscissa_spec_data_type": 18, "ordinate_spec_data_type": what, "orddenom_spec_data_type": 13,
        "ord_data_type": 6, "abscissa_spacing": 0, "abscissa_min": x[0], "abscissa_inc": 0.0, "data": g, "x": x,
    }  # fmt: skip


def _uff(base: Path) -> ResponsesSpec:
    G, signs = in_file(), np.array([[1, -1], [1, -1]])  # motor 2 is driven along -z
    places = {"rsp": [(11, 6), (12, 6)], "ref": [(1, 6), (2, -6)]}
    sets = [
        _uff_set(FREQ_HZ, signs[i, j] * G[:, i, j], places["rsp"][i], places["ref"][j], (11, 8)[i])
        for i in range(2)
        for j in range(2)
    ]
    pyuff.UFF(str(base / "frf.uff")).write_sets(sets, "overwrite")
    channels = tuple(
        replace(c, channel=name, column=None) for c, name in zip(CHANNELS, ("1rz", "2rz", "11rz", "12rz"), strict=True)
    )
    return _spec("frf.uff", channels=channels)


_csv = partial(_csv_times, 1.0)
WRITERS = [_matlab, _matlab_with_names_in_hz, _matlab_73, _hdf5, _csv, _csv_in_db_and_degrees, _csv_in_rad, _uff]


@pytest.mark.parametrize("write", WRITERS)
def test_formats_give_analytic_plant_in_si_link_side(write: Callable[[Path], ResponsesSpec], tmp_path: Path) -> None:
    """Phase (a delay turns it down), units, sides, signs, quantities, names: not conjugated, not transposed."""
    response = _read(tmp_path, write(tmp_path))
    np.testing.assert_allclose(response.freq_hz, FREQ_HZ, rtol=1e-5 if write is _uff else 1e-14)
    np.testing.assert_allclose(response.G, plant(FREQ_HZ), rtol=1e-4 if write is _uff else 1e-12)
    assert (response.inputs, response.outputs) == (("motor 1", "motor 2"), ("motor 1", "joint 2"))
    assert (response.quantity, response.noise, said(response.notes)) == ("acceleration", None, ())


def test_variance_follows_units_and_stated_one_is_relative(tmp_path: Path) -> None:
    """CovarianceData holds real and imaginary part, std of a CSV the complex number: both end at 1 % and 3 % of |G|."""
    G = in_file()
    covariance = np.zeros((2, 2, len(FREQ_HZ), 2, 2))
    covariance[..., 0, 0] = np.moveaxis((0.006 * np.abs(G)) ** 2, 0, 2)
    covariance[..., 1, 1] = np.moveaxis((0.008 * np.abs(G)) ** 2, 0, 2)
    savemat(tmp_path / "frf.mat", {"G": _struct(CovarianceData=covariance)})
    _csv_of(tmp_path, _elements(("re", np.real), ("im", np.imag), ("std", lambda g: 0.03 * np.abs(g))))
    cases = (
        (_spec("frf.mat", relative_std=0.5), 0.01),
        (_spec("frf.csv", columns=ResponseColumnsSpec(std="std_{y}_{u}")), 0.03),
        (_spec("frf.csv", relative_std=0.02), 0.02),
    )
    for spec, relative in cases:
        response = _read(tmp_path, spec, "velocity")
        np.testing.assert_allclose(np.sqrt(response.noise.variance), relative * np.abs(response.G), rtol=1e-10)


def test_lines_at_zero_or_not_finite_are_discarded(tmp_path: Path) -> None:
    """A line at 0 Hz has no acceleration; a NaN would spoil the fit."""
    G = in_file()
    G[3, 0, 1] = np.nan
    s = _struct(ResponseData=np.moveaxis(G, 0, 2), Frequency=np.r_[0, FREQ_HZ[1:]], FrequencyUnit="Hz")
    savemat(tmp_path / "frf.mat", {"G": s})
    response = _read(tmp_path, _spec("frf.mat"))
    assert "2 of 6 lines" in said(response.notes)[0]
    np.testing.assert_allclose(response.freq_hz, FREQ_HZ[[1, 2, 4, 5]])
    assert response.notes[-1].severity == "warning"
    s = _struct(ResponseData=np.moveaxis(in_file(), 0, 2), Frequency=np.r_[0, FREQ_HZ[1:]], FrequencyUnit="Hz")
    savemat(tmp_path / "frf.mat", {"G": s})  # every analyser's file begins with a line at rest
    assert [note.severity for note in _read(tmp_path, _spec("frf.mat")).notes] == ["information"]


def _saved(**variables: Any) -> Callable[[Path], ResponsesSpec]:
    def write(base: Path) -> ResponsesSpec:
        savemat(base / "frf.mat", variables)
        return _spec("frf.mat")

    return write


@pytest.mark.parametrize(
    ("write", "changes", "code", "holds"),
    [
        (_saved(G=_struct(FrequencyUnit="")), {}, "responses/table", "frf.mat"),
        (_saved(G=_struct(), H=_struct()), {}, "responses/table", "frf.mat"),
        (_saved(x=np.arange(5)), {}, "responses/table", "frf.mat"),
        (_saved(G={"ResponseData": np.ones((2, 2, 6))}), {}, "responses/table", "frf.mat"),
        (_saved(G=_struct(Frequency=FREQ_HZ[:5])), {}, "responses/table", "frf.mat"),
        (_saved(G=_struct(Frequency=np.r_[2.0, FREQ_HZ[:5]])), {}, "responses/lines", "frf.mat"),
        (_saved(G=_struct(CovarianceData=np.ones((2, 2, 6)))), {}, "responses/table", "frf.mat"),
        (_matlab, {"channels": (replace(CHANNELS[0], column=3), *CHANNELS[1:])}, "responses/table", "frf.mat"),
        # At multiples of its rate a held command is zero.
        (_matlab, {"hold": "zero-order", "rate_hz": 30.0}, "responses/lines", ("frf.mat", "20 Hz", "30 Hz", "15 Hz")),
        (_csv, {"columns": ResponseColumnsSpec(real="Re {y}/{u}")}, "responses/table", ("Re 1/1", "freq_hz", "re_1_1")),
        (_hdf5, {"columns": ResponseColumnsSpec()}, "responses/table", "data/G (2 x 2 x 6)"),
        # Outputs or lines: both axes are of six.
        (_saved(G=np.ones((6, 2, 6)), f=FREQ_HZ), {"columns": ResponseColumnsSpec("f")}, "responses/table", "2, 6"),
        # Squares of such sizes would overflow or vanish.
        (partial(_csv_times, 1e250), {}, "responses/lines", "frf.csv"),
        (partial(_csv_times, 1e-250), {}, "responses/lines", "frf.csv"),
    ],
)
def test_unusable_file_is_refused_with_its_content(
    write: Callable[[Path], ResponsesSpec], changes: dict[str, Any], code: str, holds: Any, tmp_path: Path
) -> None:
    """No unit, two responses, none, no frequencies, shapes that disagree, a line twice, a channel too many."""
    spec = replace(write(tmp_path), **changes)
    with refused(code, holds=holds):
        _read(tmp_path, spec)


def test_universal_files_say_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An element that is not there, another quantity than the channel's, and the extra that reads them."""
    spec = _uff(tmp_path)
    text = (tmp_path / "frf.uff").read_text()
    (tmp_path / "frf.uff").write_text("    -1\n    58" + "    -1\n    58".join(text.split("    -1\n    58")[1:4]))
    with refused("responses/table", place="frf.uff", holds=("12rz", "2rz")):
        _read(tmp_path, spec)
    channels = (*spec.channels[:2], replace(spec.channels[2], quantity="acceleration", unit=""), spec.channels[3])
    with refused("responses/table", place="frf.uff", holds=("11rz", "velocity", "acceleration")):
        _read(tmp_path, replace(spec, channels=channels))
    monkeypatch.setitem(sys.modules, "pyuff", None)
    with refused("install/missing-package", place="frf.uff", holds="elastid[uff]"):
        _read(tmp_path, spec)


STUDY = """\
name: elsewhere
robot: robot.yml
experiment:
  configurations: {a: [0], b: [30 deg]}
  responses:
    relative_std: 0.01
    channels:
      - {role: u, at: motor 1, column: 1}
      - {role: y, at: motor 1, column: 1, quantity: velocity}
    files:
      - {path: a.mat, configuration: a}
      - {path: b.mat, configuration: b}
fit:
  starts: 2
  weights: {model_error: 0}
  parameters: {k_1: {}, d_1: {}}
"""


@pytest.fixture
def elsewhere(tmp_path, tiny_texts) -> Path:
    """A study of the robot of one elastic joint: stiffness 60, damping 0.01, from velocity responses with 1 % noise."""
    freq_hz, rng = np.linspace(5, 100, 60), np.random.default_rng(4)
    G = two_inertias(freq_hz, 1e-3, 1e-3, 60.0, 0.01, 1e-3)[:, 0, 0] / (2j * np.pi * freq_hz)
    for name in ("a", "b"):
        noise = 0.01 * np.abs(G) * (rng.normal(size=60) + 1j * rng.normal(size=60)) / np.sqrt(2)
        s_ = {"ResponseData": (G + noise)[None, None], "Frequency": freq_hz, "Units": "Hz"}
        savemat(tmp_path / f"{name}.mat", {"G": s_})
    (tmp_path / "robot.yml").write_text(tiny_texts[1])
    (tmp_path / "study.yml").write_text(STUDY)
    return tmp_path / "study.yml"


def test_a_study_runs_from_responses_alone_to_parameters_and_page(elsewhere: Path) -> None:
    """estimate (import), fit, validate, report: the true stiffness within its interval; again from that frf.h5."""
    folder = elsewhere.parent / "run"
    run = run_of(elsewhere, folder)
    assert tuple(run.stages) == ("estimate", "fit", "validate", "report")
    run_all(run)
    found = summary_of(folder)
    low, high = found["parameters"]["k_1"]["interval95"]
    assert low < 60 < high
    assert high - low < 0.5
    assert (folder / "report.html").is_file()
    assert not (folder / "records.h5").exists()
    assert run_of(elsewhere, folder).is_current("estimate")
    with refused("study/stage", place="study.yml"):
        run_all(run, ["measure"])
    again = elsewhere.with_name("again.yml")
    text = STUDY.replace("a.mat", "run/frf.h5").replace("b.mat", "run/frf.h5")
    again.write_text(text[: text.index("    relative")] + text[text.index("    files") :])
    run_all(run_of(again, folder / "again"), ["estimate"])
    for old, same in zip(read_responses(folder / "frf.h5"), read_responses(folder / "again/frf.h5"), strict=True):
        np.testing.assert_array_equal(old.G, same.G)
        np.testing.assert_array_equal(old.noise.variance, same.noise.variance)


def test_a_response_measured_at_other_angles_is_refused(elsewhere: Path) -> None:
    """frf.h5 of elastid knows its configuration."""
    folder = elsewhere.parent / "run"
    run_all(run_of(elsewhere, folder), ["estimate"])
    text = STUDY.replace("a.mat", "run/frf.h5").replace("b: [30 deg]", "b: [40 deg]").replace("b.mat", "run/frf.h5")
    elsewhere.write_text(text)
    with refused("responses/table", place="frf.h5"):
        run_all(run_of(elsewhere, folder / "again"), ["estimate"])


@pytest.mark.parametrize(
    ("section", "first", "rates"),
    [
        ({"hold": "zero-order", "rate_hz": 50.0}, {}, (50.0, 50.0)),
        ({"rate_hz": 50.0}, {"hold": "zero-order"}, (50.0, None)),
        ({"hold": "zero-order", "rate_hz": 50.0}, {"hold": "band-limited"}, (None, 50.0)),
        ({"hold": "zero-order", "rate_hz": 50.0}, {"rate_hz": 100.0}, (100.0, 50.0)),
    ],
)
def test_the_hold_of_commands_is_taken_out_once(
    tmp_path: Path, section: dict[str, Any], first: dict[str, Any], rates: tuple[float | None, ...]
) -> None:
    """The file holds G H, H = (1 - e^{-s T}) / (s T) of each command: the plant is found to rounding."""
    s = 2j * np.pi * FREQ_HZ
    H = np.stack([np.ones(len(s)) if f is None else (1 - np.exp(-s / f)) / (s / f) for f in rates], axis=1)
    savemat(tmp_path / "frf.mat", {"G": _struct(ResponseData=np.moveaxis(in_file() * H[:, None, :], 0, 2))})
    channels = (replace(CHANNELS[0], **first), *CHANNELS[1:])
    response = _read(tmp_path, _spec("frf.mat", channels=channels, relative_std=0.1, **section))
    np.testing.assert_allclose(response.G, plant(FREQ_HZ), rtol=1e-9)
    np.testing.assert_allclose(response.noise.variance, np.abs(0.1 * plant(FREQ_HZ)) ** 2, rtol=1e-9)


LINES_HZ = np.arange(1.0, 40.0)
G = 1 / (400 - LINES_HZ**2 + 8j * LINES_HZ)


def written(path: Path, units: int) -> Path:
    """One response of node 2 along z to node 1, three nodes 100 of their units apart, two trace lines."""
    nodes = {"node_nums": [1, 2, 3], "def_cs": [0] * 3, "disp_cs": [0] * 3, "color": [0] * 3}
    coordinates = {"x": [0.0, 100.0, 200.0], "y": [0.0] * 3, "z": [0.0, 0.0, 50.0]}
    sets = [
        {"type": 164, "units_code": units, "units_description": "own", "temp_mode": 1, "length": 1e3, "force": 1e3,
         "temp": 1.0, "temp_offset": 273.15},
        {"type": 15, **nodes, **coordinates},
        {"type": 82, "trace_num": 1, "n_nodes": 4, "color": 1, "id": "edge", "nodes": np.array([1, 2, 0, 3])},
        {"type": 82, "trace_num": 2, "n_nodes": 2, "color": 1, "id": "edge", "nodes": np.array([2, 3])},
        _uff_set(LINES_HZ, G, (2, -3), (1, 3), 12),
    ]  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


TAPPED = (
    ChannelSpec("u", "hammer", channel="1z", quantity="force", unit="N"),
    ChannelSpec("y", "tip", channel="2z", quantity="acceleration", unit="m/s^2", sign=-1),
)


@pytest.mark.parametrize(
    ("code", "metre", "newton"), [(1, 1, 1), (5, 1e-3, 1e-3), (7, 0.0254, 4.4482216), (9, 1e-3, 1e-3)]
)
def test_units_of_a_file_are_believed(tmp_path: Path, code: int, metre: float, newton: float) -> None:
    """Metres, millimetres with millinewton, inches with pounds, and factors of the file's own."""
    table = uff_table(written(tmp_path / "a.uff", code), TAPPED)
    np.testing.assert_allclose(table.G[:, 0, 0], -G * metre / newton, rtol=1e-6)
    assert [note.code for note in table.notes] == ([] if code == 1 else ["responses/units"])


def test_geometry_is_that_of_nodes_and_trace_lines(tmp_path: Path) -> None:
    """Millimetres in m; a trace line is interrupted at 0; a place with the other sign moves the other way."""
    geometry = uff_geometry(written(tmp_path / "a.uff", 10), TAPPED)
    np.testing.assert_allclose([geometry.points[name] for name in "123"], [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0.05]])
    assert geometry.lines == (("1", "2"), ("2", "3"))
    assert geometry.motion == {"hammer": ("1", "z"), "tip": ("2", "-z")}
    other = (ChannelSpec("y", "tip", channel="9z", quantity="acceleration"),)
    assert uff_geometry(tmp_path / "a.uff", other) is None


def test_places_are_those_of_the_responses(tmp_path: Path) -> None:
    """Node 2 along z answers node 1: the channels of a study that `new --from` writes."""
    assert uff_locations(written(tmp_path / "a.uff", 1)) == ({"2z": "acceleration"}, ("1z",))
