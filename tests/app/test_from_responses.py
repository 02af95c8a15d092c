"""`elastid new --from` of responses and iddata structs: containers of other programs become studies that run."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from plants.drafts import drafted, save
from scipy.io import savemat

from elastid.app import cli
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Robot, Spring
from elastid.store.measured import read_responses
from elastid.study.robots import yaml_text

FREQ = np.linspace(0.5, 100, 200)
K = np.array([[4e3, -4e3], [-4e3, 4e3]])


def accelerations(n_u: int) -> np.ndarray:
    """Of two masses with a spring between them, by forces on the first n_u; (F, 2, n_u)."""
    s = 2j * np.pi * FREQ
    return np.array([x**2 * np.linalg.inv(x**2 * np.diag([1.0, 0.5]) + x * 5e-4 * K + K)[:, :n_u] for x in s])


def cells(*words: str) -> np.ndarray:
    return np.array(words, object)


def idfrd(path: Path) -> Path:
    """In rad/s, with names and units."""
    fields = {"ResponseData": accelerations(1).transpose(1, 2, 0), "Frequency": 2 * np.pi * FREQ}
    units = {"FrequencyUnit": "rad/s", "InputUnit": cells("N"), "OutputUnit": cells("m/s^2", "m/s^2")}
    savemat(path.with_suffix(".mat"), {"G": fields | units | {"OutputName": cells("a1", "a2")}})
    return path.with_suffix(".mat")


def arrays(path: Path) -> Path:
    """Complex array with the frequencies last, in rad/s by the name of theirs, beside a coherence."""
    content = {"FRF": accelerations(2).transpose(1, 2, 0), "w": 2 * np.pi * FREQ}
    savemat(path.with_suffix(".mat"), content | {"coherence": np.linspace(0.9, 1.0, len(FREQ))})
    return path.with_suffix(".mat")


def archive(path: Path) -> Path:
    """Complex array of one element."""
    np.savez(path.with_suffix(".npz"), H=accelerations(1)[:, :1], freq_hz=FREQ)
    return path.with_suffix(".npz")


def parts(path: Path) -> Path:
    """Real and imaginary parts by output and input, in columns of a text."""
    G = accelerations(2)
    columns = {f"{part}_{y + 1}_{u + 1}": of(G[:, y, u]) for y in (0, 1) for u in (0, 1) for part, of in PARTS.items()}
    return table(path, {"freq_hz": FREQ} | columns)


def polar(path: Path) -> Path:
    """Magnitude in dB and unwrapped phase in degrees of one element."""
    G = accelerations(1)[:, 0, 0]
    phase = np.degrees(np.unwrap(np.angle(G)))
    return table(path, {"Frequency [Hz]": FREQ, "Magnitude (dB)": 20 * np.log10(np.abs(G)), "Phase (deg)": phase})


PARTS = {"re": np.real, "im": np.imag}


def table(path: Path, columns: dict[str, np.ndarray]) -> Path:
    return save(path.with_suffix(".csv"), ",".join(columns), *columns.values())


def estimated(folder: Path, *sources: Path) -> Response:
    """The response of the study that `elastid new` writes, once it has run."""
    drafted(folder, *sources)
    study = str(folder / "new" / "study.yml")
    assert cli.run_command(["run", study, "estimate", "-q", "--jobs", "1", "--run", str(folder / "run")]) == 0
    (response,) = read_responses(folder / "run" / "frf.h5")
    return response


@pytest.mark.parametrize("write", [idfrd, arrays, archive, parts, polar])
def test_responses_in_any_container_become_equal_studies(write: Callable[[Path], Path], tmp_path: Path) -> None:
    """Frequencies in Hz and G in SI, all elements that the file has."""
    response = estimated(tmp_path, write(tmp_path / "frf"))
    _, n_y, n_u = response.G.shape
    np.testing.assert_allclose(response.freq_hz, FREQ, rtol=1e-6)
    np.testing.assert_allclose(response.G, accelerations(n_u)[:, :n_y], rtol=1e-4)
    assert (n_y, n_u) == {"idfrd": (2, 1), "arrays": (2, 2), "parts": (2, 2)}.get(write.__name__, (1, 1))
    assert response.quantity == "acceleration"


def test_units_by_the_numbers_despite_an_empty_cell(tmp_path: Path) -> None:
    path = polar(tmp_path / "frf")
    text = path.read_text()
    path.write_text(text.replace(text.split(",")[3], "", 1))
    columns = drafted(tmp_path, path).experiment.responses.columns
    assert (columns.magnitude_unit, columns.phase_unit) == ("dB", "deg")


def test_outputs_at_motors_have_the_quantity_of_their_slope(tmp_path: Path) -> None:
    """Positions by torques, without names or units: |G| falls by f^2; as many inputs as motors, or a refusal."""
    G = accelerations(2) / (2j * np.pi * FREQ[:, None, None]) ** 2
    savemat(tmp_path / "frf.mat", {"G": G, "f": FREQ})
    bodies = [Body(f"b{i}", joints=(Joint(f"j{i}", "y", Spring(1e3, 1.0), Motor(1.0)),), mass=1.0) for i in (1, 2)]
    (tmp_path / "robot.yml").write_text(yaml_text(Robot("pair", tuple(bodies))))
    response = estimated(tmp_path, tmp_path / "robot.yml", tmp_path / "frf.mat")
    assert response.inputs == ("motor j1", "motor j2")
    np.testing.assert_allclose(response.G, accelerations(2), rtol=1e-6)
    (tmp_path / "one.yml").write_text(yaml_text(Robot("one", tuple(bodies[:1]))))
    words = ["new", str(tmp_path / "other"), "--from", str(tmp_path / "one.yml"), "--from", str(tmp_path / "frf.mat")]
    assert cli.run_command(words) != 0


def test_iddata_struct_keeps_names_units_and_period(tmp_path: Path) -> None:
    """OutputData, InputData and Ts; quantities and units of each column are in cells beside them."""
    t = np.arange(4000) / 500
    torque = np.tile(np.random.default_rng(0).standard_normal(1000), 4)
    motion = np.stack([np.cumsum(np.cumsum(torque)) * 1e-6, 5 * np.sin(t)], axis=1)
    content = {"OutputData": motion, "InputData": torque[:, None], "Ts": 2e-3, "InputUnit": cells("N*m")}
    content |= {"OutputUnit": cells("deg", "m/s^2"), "InputName": cells("tau"), "OutputName": cells("arm", "tip")}
    savemat(tmp_path / "data.mat", {"z": content})
    recorded = drafted(tmp_path, tmp_path / "data.mat").experiment.as_recorded()
    assert recorded.known_rate_hz == 500
    channels = {(c.role, c.channel, c.column, c.quantity, c.unit) for c in recorded.channels}
    assert ("u", "z.InputData", None, "torque", "N*m") in channels
    assert ("y", "z.OutputData", 1, "position", "deg") in channels


@pytest.mark.parametrize("time", ["time", "dates"])
def test_complex_signals_of_a_log_are_no_responses(time: str, tmp_path: Path) -> None:
    """An array of as many samples as the time; times may be dates."""
    t = np.arange(1200) / 200
    stamps = t if time == "time" else np.datetime64("2024-01-01") + (5 * np.arange(1200)).astype("timedelta64[ms]")
    signals = {"time": stamps, "tau_1": np.cos(t) + np.sign(np.cos(t)), "q_1": np.sin(t), "iq": np.exp(1j * t)}
    np.savez(tmp_path / "log.npz", **signals)
    study = drafted(tmp_path, tmp_path / "log.npz")
    assert study.friction is not None
    assert study.experiment.as_recorded().rate_hz == 200.0


@pytest.mark.parametrize(("value", "n_out"), [(0.0, 1), (np.nan, 1), (1e300, 1), (1e4, 1), (None, 0)])
def test_one_wrong_line_of_a_response_is_discarded(value: float | None, n_out: int, tmp_path: Path) -> None:
    """A mode between two lines is no wrong one, nor is an element without a response."""
    G = accelerations(1)
    G = np.concatenate([G, np.zeros_like(G[:, :1])], axis=1)
    if value is not None:
        G[77, 1] = value
    np.savez(tmp_path / "frf.npz", H=G, freq_hz=FREQ)
    response = estimated(tmp_path / "s", tmp_path / "frf.npz")
    assert len(response.freq_hz) == len(FREQ) - n_out
    assert (FREQ[77] in response.freq_hz) == (n_out == 0)


def test_output_without_any_value_is_drafted(tmp_path: Path) -> None:
    """A dead channel leaves the quantity of the others."""
    np.savez(tmp_path / "frf.npz", H=accelerations(1) * [[1.0], [np.nan]], freq_hz=FREQ)
    channels = drafted(tmp_path, tmp_path / "frf.npz").experiment.responses.channels
    assert {c.quantity for c in channels} == {"force", "acceleration"}
