"""What is done with the fit of one elastic joint, and a live session: closed forms, and the truth in the intervals."""

import csv
import re
import shutil
from pathlib import Path
from unittest.mock import create_autospec

import numpy as np
import pytest
from plants.runs import summary_of

from elastid.app import cli, model_commands
from elastid.base.errors import FitError
from elastid.store.plan import read_plan
from elastid.store.results import read_fit
from elastid.study import load_robot


@pytest.fixture(scope="module")
def folder(finished, tmp_path_factory) -> Path:
    """A copy of the study that was run."""
    return Path(shutil.copytree(finished, tmp_path_factory.mktemp("joint") / "study"))


def command(name: str, folder: Path, run: Path, *words: str | Path) -> int:
    return cli.run_command([name, f"{folder}/study.yml", "--run", f"{run}", "-q", "--jobs", "1", *map(str, words)])


def test_the_impulse_of_a_move_is_that_of_viscous_friction(folder: Path) -> None:
    """The integral of u = J q_m'' + f_m q_m' + I q_l'' from rest to rest is f_m times the way."""
    (folder / "move.csv").write_text("1 deg\n0\n20\n")
    words = ("--path", folder / "move.csv", "--time", "0.5", "--samples", "2")
    assert command("tune", folder, folder / "run", *words) == 0
    with (folder / "run" / "tune.csv").open(encoding="utf-8") as file:
        t, position, torque = np.array(
            [[float(row[key]) for key in ("t", "position 1", "torque 1")] for row in csv.DictReader(file)]
        ).T
    assert position[-1] - position[0] == pytest.approx(np.deg2rad(20), rel=1e-3)
    assert np.diff(t) == pytest.approx(1 / 400)  # the rate of the study's controller
    friction = read_fit(folder / "run" / "fit.h5").values["fm_1"]
    assert np.trapezoid(torque, t) == pytest.approx(friction * np.deg2rad(20), rel=1e-2)


def test_loops_are_designed_for_rate_and_delay_of_the_controller(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That of the study, or those that are asked for."""
    design = create_autospec(model_commands.design_loops, side_effect=FitError("fit/not-trusted", "not now"))
    monkeypatch.setattr(model_commands, "design_loops", design)
    for words, expected in (((), (400.0, 1)), (("--rate", "250", "--delay", "3"), (250.0, 3))):
        assert command("loops", folder, folder / "run", *words) == 1
        _, _, family, delay, *_ = design.call_args.args
        assert (family.rate_hz, delay) == expected


def test_draws_scatter_about_the_fit(folder: Path) -> None:
    assert command("export", folder, folder / "run", "--to", "samples", "--count", "9") == 0
    robots = [load_robot(path) for path in (folder / "run" / "export" / "samples" / "robots").iterdir()]
    result = read_fit(folder / "run" / "fit.h5")
    z = (np.array([robot.parameters()["k_1"][0] for robot in robots]) - result.values["k_1"]) / result.std["k_1"]
    assert len(z) == 9
    assert 0.3 < z.std() < 2
    assert np.abs(z).max() < 4


def test_prediction_uses_other_logs_and_refuses_own_folder(folder: Path, tmp_path: Path) -> None:
    """Torque and motion of its twin within 1 %."""
    run = folder / "run"
    assert command("predict", folder, tmp_path, "--with", run, "--set", "seed=5") == 0
    prediction = summary_of(tmp_path, "prediction.json")
    assert all(signal["error"] < 1e-2 for each in prediction["simulation"] for signal in each["signals"])
    assert command("predict", folder, run, "--with", run, "--set", "seed=5") == 2
    assert command("predict", folder, tmp_path, "--with", tmp_path) == 2
    assert command("predict", folder, run, "--with", run) == 0


@pytest.mark.slow
def test_live_session_reaches_goal_and_refuses_simulated_logs(folder: Path, tmp_path: Path) -> None:
    """The log says how far it is; references are those of its plan; simulated logs are not those of a robot."""
    words = ("--goal", "k_1: 0.014 %")
    assert command("live", folder, tmp_path, *words, "--simulate") == 0
    low, high = read_fit(tmp_path / "fit.h5").interval("k_1")
    assert low < 60.0 < high < 1.00028 * low
    ((width, goal),) = re.findall(r"k_1 \D+(\S+) % \(goal (\S+) %\)", (tmp_path / "run.log").read_text())
    assert float(width) == pytest.approx(50 * (high / low - 1), rel=0.05)
    assert float(goal) == 0.014
    plan = read_plan(tmp_path / "live" / "x1.h5")
    references = {path.stem for path in (tmp_path / "live" / "references").iterdir()}
    assert references == {run.name for run in plan.experiments}
    assert command("live", folder, tmp_path, *words) == 2
