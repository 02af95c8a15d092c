"""The .mat file, read back, has the response of the linear model."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from plants.fitted_models import close, responses_of
from scipy.io import loadmat

from elastid.fit.fitted_robot import FittedRobot
from elastid.targets.matlab import write_matlab


def test_matlab_file_holds_state_space_and_idfrd_and_is_read_back(model: FittedRobot, tmp_path: Path) -> None:
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
    for row in content["parameters"][:, 0]:
        name = row["name"].item()
        assert row["value"].item() == model.result.values[name]
        assert row["std"].item() == pytest.approx(model.result.std.get(name, np.nan), nan_ok=True)
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
