"""CSV, python-control and MATLAB: what is exported has the response of the linear model and the numbers of the fit."""

import csv
import importlib.util
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from plants.fitted_models import DELAY, close, responses_of
from scipy.io import loadmat

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import ResponseFileSpec, ResponsesSpec
from elastid.fit.fitted_robot import FittedRobot
from elastid.linear.modes import modes
from elastid.logs.responses.reading import link_side_response, read_table
from elastid.targets.control import write_control
from elastid.targets.csv import write_csv
from elastid.targets.matlab import write_matlab


def test_csv_responses_are_what_a_study_reads(model: FittedRobot, tmp_path: Path) -> None:
    write_csv(tmp_path, model)
    channels = [ChannelSpec("u", place, channel=place) for place in model.linear[0].inputs]
    channels += [ChannelSpec("y", place, channel=place, quantity="acceleration") for place in model.linear[0].outputs]
    for kind, expected in (("fitted", responses_of(model)), ("measured", model.measured[0].G)):
        file = f"one-{kind}.csv"
        spec = ResponsesSpec((ResponseFileSpec(file, "one"),), tuple(channels), relative_std=0.1)
        table = read_table(tmp_path / file, spec, "")
        G = link_side_response(table, spec, model.measured[0].configuration, model.robot, "acceleration")
        assert close(G.G, expected, 1e-12)


def test_csv_modes_are_those_of_every_configuration(serial_model: FittedRobot, tmp_path: Path) -> None:
    """Frequency and damping ratio, numbered from 1."""
    write_csv(tmp_path, serial_model)
    table = list(csv.DictReader((tmp_path / "modes.csv").read_text().splitlines()))
    for linear in serial_model.linear:
        its = [row for row in table if row["configuration"] == linear.configuration.name]
        found = modes(linear, serial_model.theta)
        assert [int(row["mode"]) for row in its] == list(range(1, len(found.freq_hz) + 1))
        assert [float(row["frequency_hz"]) for row in its] == pytest.approx(np.asarray(found.freq_hz).tolist())
        assert [float(row["damping_ratio"]) for row in its] == pytest.approx(np.asarray(found.zeta).tolist())


def test_python_control_reads_the_response_back(model: FittedRobot, tmp_path: Path) -> None:
    """State space by the loader, times the delay; within 1e-7 without loops, 1e-6 with them."""
    _, script = write_control(tmp_path, model)
    specification = importlib.util.spec_from_file_location("load_model", script)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    systems, delays = module.load()
    for i, name in enumerate(("one", "two")):
        assert tuple(systems[name].input_labels) == model.linear[i].inputs
        assert delays[name] == pytest.approx(0.0 if model.robot.loops else DELAY)
        f = model.measured[i].freq_hz
        G = np.moveaxis(np.asarray(systems[name](2j * np.pi * f, squeeze=False)), 2, 0)
        delayed = G * np.exp(-2j * np.pi * f * delays[name])[:, None, None]
        assert close(delayed, responses_of(model, i), 1e-6 if model.robot.loops else 1e-7)
        late = module.load(pade=4)[0][name]
        slow = f < 30
        G = np.moveaxis(np.asarray(late(2j * np.pi * f[slow], squeeze=False)), 2, 0)
        assert close(G, responses_of(model, i)[slow], 1e-6)
        assert np.array_equal(np.moveaxis(module.measured()[name].frdata, 2, 0), model.measured[i].G)
    names, covariance = module.covariance()
    std = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))
    assert std == pytest.approx(dict(model.result.std), nan_ok=True)


def test_matlab_file_has_state_space_and_idfrd(model: FittedRobot, tmp_path: Path) -> None:
    """ss within 1e-9 without loops, 1e-8 with them; the fields of an idfrd to the last digits."""
    data, script = write_matlab(tmp_path, model)
    content = loadmat(data, squeeze_me=False, struct_as_record=True)
    for i in range(2):
        system = content["model"][i, 0]
        A, B, C, D = (np.asarray(system[name], float) for name in "ABCD")
        s = 2j * np.pi * model.measured[i].freq_hz[:, None, None]
        G = C @ np.linalg.solve(s * np.eye(len(A)) - A, B.astype(complex)) + D
        delayed = G * np.exp(-s * system["InputDelay"].item())
        assert close(delayed, responses_of(model, i), 1e-8 if model.robot.loops else 1e-9)
        for kind, expected in (("fitted", responses_of(model, i)), ("measured", model.measured[i].G)):
            assert close(np.moveaxis(content[kind][i, 0]["ResponseData"], 2, 0), expected, 1e-14)
    assert "idfrd(" in script.read_text()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")
def test_the_script_runs_in_octave(model: FittedRobot, tmp_path: Path) -> None:
    """And its response is the linear model's."""
    _, script = write_matlab(tmp_path, model)
    f = float(model.measured[0].freq_hz[7])
    lines = f"""run('{script}'); G = response{{1}}({f!r}); printf('%.17g %.17g\\n', [real(G(:)).'; imag(G(:)).']);"""
    done = subprocess.run(["octave-cli", "-q", "--eval", lines], capture_output=True, text=True, check=True)
    pairs = np.array(done.stdout.split(), float).reshape(-1, 2)
    G = (pairs[:, 0] + 1j * pairs[:, 1]).reshape(responses_of(model)[7].T.shape).T
    assert close(G[None], responses_of(model)[7:8], 1e-8)
