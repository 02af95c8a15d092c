"""The five nouns: twelve lines from logs to stiffness, with the numbers of the command line."""

from pathlib import Path

import numpy as np
import pytest
from plants.refusals import refused

import elastid
from elastid.app.cli import run_command
from elastid.base.errors import UnknownNameError

SCRIPT = """
import elastid
robot = elastid.read_robot(folder / "robot.yml")
current = {"role": "u", "at": "motor 1", "channel": "current", "quantity": "current", "unit": "A"}
channels = [
    current | {"torque_constant": "0.17 N*m/A"},
    {"role": "y", "at": "motor 1", "channel": "motor_angle", "quantity": "position", "unit": "rad"},
    {"role": "y", "at": "joint 1", "channel": "load_angle", "quantity": "position", "unit": "rad"},
]
files = [{"path": f"logs/bench_{i + 1}.csv", "configuration": "bench", "realisation": i} for i in range(2)]
log = {"rate_hz": 1000, "period": "2 s", "hold": "zero-order", "channels": channels, "files": files}
records = elastid.read_records(robot, configurations={"bench": [0]}, folder=folder, **log)
parameters = elastid.choose(robot, "k_1", "d_1", "Jm_1", "I_load", "fm_1")
result = elastid.identify(elastid.estimate(records), robot, parameters)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("nouns") / "bench"
    assert run_command(["new", str(folder), "--template", "recorded"]) == 0
    return folder


def test_script_finds_what_command_line_finds(folder: Path) -> None:
    """The same records, responses and fit; arrays of a file lie elsewhere in memory, which moves the last bit."""
    names = {"folder": folder}
    exec(SCRIPT, names)
    result = names["result"]
    assert isinstance(result, elastid.Result)
    command = ["run", str(folder / "study.yml"), "--run", str(folder / "run"), "--jobs", "1", "fit"]
    assert run_command(command) == 2  # no records yet
    assert run_command([*command, "measure", "estimate"]) == 0
    of_command = elastid.load(folder / "run" / "fit.h5")
    std = np.sqrt(np.diag(result.covariance))
    assert np.all(np.abs(result.x - of_command.x) < 1e-6 * std)
    np.testing.assert_allclose(result.covariance, of_command.covariance, rtol=1e-6)
    k = result["k_1"]
    assert k.low < 64.0 < k.high  # the truth of the template's logs
    assert str(k).startswith("k_1 = 6")
    assert "N*m/rad, 95 %" in str(k)
    assert list(result) == [*result.keys()] == ["k_1", "d_1", "Jm_1", "fm_1", "I_load"]
    assert dict(result)["k_1"] == result["k_*"]["k_1"] == k
    with pytest.raises(UnknownNameError, match="k_9"):
        result["k_9"]


def test_wrong_keys_are_named(folder: Path) -> None:
    robot = elastid.read_robot(folder / "robot.yml")
    with refused("study/invalid", holds=("recorded.chanels", "channels")):
        elastid.read_records(robot, configurations={"bench": [0]}, rate_hz=1000, chanels=[], channels=[], files=[])
    with refused("study/invalid", holds="k_7"):
        elastid.choose(robot, "k_7")
    with refused("study/invalid", holds="start"):
        elastid.choose(robot, k_1={"start": "5 kg"})
    with refused("frf/records"):
        elastid.estimate([])
