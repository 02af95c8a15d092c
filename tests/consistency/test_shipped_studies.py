"""Every study that is shipped runs from end to end and finds what is known about its object."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.measured import BENCH, measured, with_records

from elastid.app import cli
from elastid.fit.fitted_robot import FittedRobot
from elastid.store.measured import read_responses
from elastid.store.results import read_fit
from elastid.study import load
from elastid.validation.agreement import resonances

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs"
BENCH_STUDY, ARM_STUDY = CONFIGS / "real" / "motor_bench.yml", CONFIGS / "real" / "daisy_robot_arm.yml"
SHIPPED = sorted([*CONFIGS.glob("*.yml"), *CONFIGS.glob("real/*.yml")])


def run(study: Path, folder: Path, *options: str) -> dict[str, Any]:
    """`elastid run`, and the summary it leaves."""
    assert cli.run_command(["run", str(with_records(study)), "--run", str(folder), "-q", *options]) == 0
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return summary


def measured_and_fitted(study: Path, folder: Path) -> tuple[Any, Any]:
    """The first configuration's response and the fitted model's, on its lines."""
    responses = read_responses(folder / "frf.h5")
    (model, *_) = FittedRobot.of(read_fit(folder / "fit.h5"), load(study).study.robot, responses).responses
    return responses[0], model


def nearest(found: Sequence[float], wanted: float) -> float:
    """Of several frequencies the one that is nearest to the wanted one, as a ratio to it."""
    return float(min(found, key=lambda f: abs(math.log(f / wanted))) / wanted)


@pytest.mark.slow
def test_the_bench_with_its_load_turned_round_ends_with_the_name_of_the_channel(tmp_path: Path) -> None:
    """The load's encoder is mounted mirrored; a study that forgets it ends with exit code 1 and a message."""
    options = ("--set", "experiment.recorded.channels.2.sign=1", "--set", "fit.starts=4")
    assert cli.run_command(["run", str(with_records(BENCH_STUDY)), "--run", str(tmp_path), "-q", *options]) == 1
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["status"] == "model_error"
    assert any(word.startswith("y at joint 1 with the other sign") for word in summary["warnings"])


@pytest.mark.slow
def test_the_bench_comes_out_as_measured(tmp_path: Path) -> None:
    """Antiresonance and resonance within 1 %, bad periods named, inertias, shaft and delay as expected."""
    study = BENCH_STUDY
    summary = run(study, tmp_path)
    value = {name: p["value"] for name, p in summary["parameters"].items()}
    assert value["Jm_1"] == pytest.approx(8e-4, rel=0.1)
    assert value["I_load"] == pytest.approx(8e-4, rel=0.1)
    assert value["k_1"] == pytest.approx(95, rel=0.03)
    assert 0.05e-3 < value["delay"] < 0.2e-3
    said = " ".join(summary["warnings"])
    assert "period 1 of 20" in said
    assert "periods 8, 15 of 20" in said
    measured, model = measured_and_fitted(study, tmp_path)
    for sign, near in ((-1, 54.0), (1, 76.0)):
        pair = [nearest(resonances(r.freq_hz, r.G[:, 0, 0], sign=sign), near) for r in (measured, model)]
        assert pair[0] == pytest.approx(pair[1], rel=0.01)
        assert pair[1] == pytest.approx(1.0, rel=0.03)
    (torque,) = json.loads((tmp_path / "validation.json").read_text())["torque"]
    assert torque["shares"]["rigid body"] + torque["shares"]["elasticity"] == pytest.approx(1.02, abs=0.02)
    assert torque["left"] < 0.015
    assert torque["left_without_friction"] == pytest.approx(0.097, abs=0.02)


@pytest.mark.slow
def test_the_bench_is_a_misfit_where_its_error_is_not_declared(tmp_path: Path) -> None:
    """Residuals 48 times the noise: exit code 3 and a whole report, and the intervals by blocks hold the stiffness."""
    options = ("--set", "fit.weights.floor=0.01", "--set", "fit.starts=4")
    assert cli.run_command(["run", str(with_records(BENCH_STUDY)), "--run", str(tmp_path), "-q", *options]) == 3
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["status"] == "misfit"
    assert (tmp_path / "report.html").stat().st_size > 100_000
    low, high = summary["parameters"]["k_1"]["interval95"]
    assert low < 95.4 < high


@pytest.mark.slow
def test_disjoint_halves_of_the_bench_agree_within_their_intervals(tmp_path: Path) -> None:
    """Fits on the first and on the last ten periods differ by no more than chance allows."""
    halves = []
    for name, samples in (("first", "[0, 25000]"), ("last", "[25000, 50000]")):
        files = f"[{{path: {measured(BENCH)}, configuration: bench, samples: {samples}}}]"
        halves.append(run(BENCH_STUDY, tmp_path / name, "--set", f"experiment.recorded.files={files}"))
    first, last = (half["parameters"] for half in halves)
    z = [(first[p]["value"] - last[p]["value"]) / math.hypot(first[p]["std"], last[p]["std"]) for p in first]
    assert np.sqrt(np.mean(np.square(z))) < 1.5
    assert max(map(abs, z)) < 3


@pytest.mark.slow
def test_the_flexible_arm_has_the_resonances_of_its_record(tmp_path: Path) -> None:
    """In units of a sampling rate that was not recorded: 0.0322, 0.1798 (dips) and 0.0583, 0.1269 (peaks)."""
    study = ARM_STUDY
    run(study, tmp_path)
    measured, model = measured_and_fitted(study, tmp_path)
    assert not measured.rate_is_known
    for sign, expected in ((-1, (0.0322, 0.1798)), (1, (0.0583, 0.1269))):
        for wanted in expected:
            found = resonances(model.freq_hz, model.G[:, 0, 0], sign=sign)
            assert nearest(found, wanted) == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("study", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_study_is_free_of_errors(study: Path) -> None:
    """check finds nothing, where its data are here."""
    assert cli.run_command(["check", str(with_records(study))]) == 0


@pytest.mark.parametrize("robot", sorted((CONFIGS / "robots").glob("*.yml")), ids=lambda path: path.stem)
def test_every_shipped_robot_has_a_linear_model(robot: Path, tmp_path: Path) -> None:
    """A robot file can be named in a study, and stands still at angle zero."""
    from elastid.linear.linearise import linearise
    from elastid.model.formulation import formulate
    from elastid.record import Configuration

    study = tmp_path / "study.yml"
    study.write_text(
        f"name: x\nrobot: {robot}\nexcitation: {{rate_hz: 500, period: 2, band_hz: [2, 50], torque_rms: 1}}\n"
        "experiment: {configurations: {}, simulated: {}}\n"
    )
    n_a = robot.read_text().count("motor:")
    study.write_text(study.read_text().replace("{}, simulated", f"{{c: {[0.0] * n_a}}}, simulated"))
    loaded = load(study).study.robot
    assert len(loaded.driven) == n_a
    model = linearise(
        formulate(loaded),
        Configuration("zero", np.zeros(n_a)),
        np.array([value for value, _ in loaded.parameters().values()]),
        loaded.motor_locations,
        "acceleration",
    )
    assert np.linalg.eigvalsh(model.M)[0] > 0
