"""Every study that is shipped runs from end to end and finds what is known about its object."""

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.measured import BENCH, DATA, measured, with_records
from plants.paths import CONFIGS
from plants.runs import summary_of

from elastid.app import cli
from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import EXACT, formulate
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.robot import Robot
from elastid.store.measured import read_responses
from elastid.store.results import read_fit
from elastid.study import load, load_robot

BENCH_STUDY, ARM_STUDY = CONFIGS / "real" / "motor_bench.yml", CONFIGS / "real" / "daisy_robot_arm.yml"
SHIPPED = sorted([*CONFIGS.glob("*.yml"), *CONFIGS.glob("real/*.yml")])


def run(study: Path, folder: Path, *options: str, commands: Sequence[str] = (), code: int = 0) -> dict[str, Any]:
    """`elastid run` with its exit code, and the summary it leaves."""
    assert cli.run_command(["run", str(with_records(study)), *commands, "--run", str(folder), "-q", *options]) == code
    return summary_of(folder)


def measured_and_fitted(study: Path, folder: Path) -> tuple[Any, Any]:
    """The first configuration's response and the fitted model's, on its lines."""
    responses = read_responses(folder / "frf.h5")
    (model, *_) = FittedRobot.of(read_fit(folder / "fit.h5"), load(study).study.robot, responses).responses
    return responses[0], model


def nearest(freq_hz: FloatArray, G: ComplexArray, wanted: float, sign: int = 1) -> float:
    """Frequency of the largest |G| (sign 1) or the smallest (-1) within a fifth of the wanted one, as a ratio to it."""
    level = sign * np.log(np.abs(G))
    line = max(np.flatnonzero(np.abs(freq_hz / wanted - 1) < 0.2), key=lambda k: float(level[k]))
    a, b, _ = np.polyfit(freq_hz[line - 1 : line + 2], level[line - 1 : line + 2], 2)
    return float(-b / (2 * a) / wanted)


@pytest.mark.slow
def test_bench_with_reversed_load_names_the_channel(tmp_path: Path) -> None:
    """The load's encoder is mounted mirrored; a study that forgets it ends with exit code 1 and a message."""
    options = ("--set", "experiment.recorded.channels.2.sign=1", "--set", "fit.starts=4")
    summary = run(BENCH_STUDY, tmp_path, *options, code=1)
    assert summary["status"] == "model_error"
    (note,) = (note for note in summary["notes"] if note["code"] == "fit/likely-cause")
    first = summary["modification_indices"][0]
    assert (first["place"], first["group"]) == (1, "sign")
    assert "y at joint 1" in note["text"]


@pytest.mark.slow
def test_the_bench_comes_out_as_measured(tmp_path: Path) -> None:
    """Antiresonance and resonance within 1 %, bad periods named, inertias, shaft and delay as expected."""
    study = BENCH_STUDY
    summary = run(study, tmp_path)
    value = {name: p["value"] for name, p in summary["parameters"].items()}
    assert summary["status"] == "converged"
    assert value["Jm_1"] == pytest.approx(8e-4, rel=0.1)
    assert value["I_load"] == pytest.approx(8e-4, rel=0.1)
    assert value["k_1"] == pytest.approx(95, rel=0.03)
    assert 0.05e-3 < value["delay"] < 0.2e-3
    said = " ".join(summary["warnings"])
    assert " 1 of 20" in said
    assert " 8, 15 of 20" in said
    measured, model = measured_and_fitted(study, tmp_path)
    for sign, near in ((-1, 54.0), (1, 76.0)):
        pair = [nearest(r.freq_hz, r.G[:, 0, 0], near, sign) for r in (measured, model)]
        assert pair[0] == pytest.approx(pair[1], rel=0.01)
        assert pair[1] == pytest.approx(1.0, rel=0.03)
    (torque,) = summary_of(tmp_path, "validation.json")["torque"]
    assert torque["fractions"]["rigid body"] + torque["fractions"]["elasticity"] == pytest.approx(1.02, abs=0.02)
    assert torque["unexplained_fraction"] < 0.015
    assert torque["unexplained_without_friction"] == pytest.approx(0.097, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("error", [0.01, 0.05])
def test_bench_with_undeclared_error_is_misfit(error: float, tmp_path: Path) -> None:
    """Residuals 48 times the noise, of 16 %: exit code 3, a whole report, and the intervals include the stiffness."""
    options = ("--set", f"fit.weights.model_error={error}", "--set", "fit.starts=4")
    summary = run(BENCH_STUDY, tmp_path, *options, code=3)
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
    assert not measured.has_rate
    for sign, expected in ((-1, (0.0322, 0.1798)), (1, (0.0583, 0.1269))):
        for wanted in expected:
            assert nearest(model.freq_hz, model.G[:, 0, 0], wanted, sign) == pytest.approx(1.0, rel=0.01)


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
        "experiment: {configurations: {}, simulated: {}}\nfit: {parameters: {Jm_*: {}}}\n"
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


SPREAD = ((0.0, 0.0), (0.5, -0.1), (-0.4, 0.4), (0.2, 0.9), (0.6, -0.2), (-0.3, -0.8))
FREE = ("k_2", "k_3", "k_rod", "d_3", "d_rod")


def planar() -> Robot:
    return load_robot(CONFIGS / "robots" / "linkage_arm.yml")


@cache
def exact_responses(angles: tuple[tuple[float, float], ...], highest: float) -> list[Response]:
    """As many lines in all, whatever the number of configurations."""
    model = formulate(planar())
    linearisation, lines, responses = Linearisation.of(model), np.linspace(3, highest, 300 // len(angles)), []
    for i, at in enumerate(angles):
        linear = linearisation.at(Configuration(f"c{i}", np.array(at)), model.theta, model.inputs, "acceleration")
        responses.append(to_response(linear, linear.theta_ref, lines))
    return responses


def fitted(angles) -> Result:
    """A fit of the planar arm's springs from responses of the exact model with 3 % noise, from a start 40 % off."""
    robot, random, responses = planar(), np.random.default_rng(0), []
    for exact in exact_responses(angles, 30.0):
        level = 0.03 * np.abs(exact.G)
        noise = random.standard_normal((2, *level.shape)) / np.sqrt(2)
        total = Covariance(level**2, 100.0)
        responses.append(replace(exact, G=exact.G + level * (noise[0] + 1j * noise[1]), total=total))
    start = robot.with_parameters({name: 1.4 * dict(robot.parameters())[name][0] for name in FREE})
    parameters = {name: ParameterSpec() for name in FREE}
    weights = WeightSpec(model_error=0.01)  # of noise alone a single posture would know more
    return identify(responses, start, FitSpec(parameters=parameters, starts=1, weights=weights), model=EXACT)


def relative(result: Result, name: str) -> float:
    i = result.parameters.free_names.index(name)
    return float(np.sqrt(result.covariance[i, i]))


@pytest.mark.slow
def test_a_single_posture_is_said_to_confuse_gear_and_rod():
    """Below the third mode k_3 and k_rod are one spring there; with the angle spread they are two."""
    one = fitted(SPREAD[:1])
    assert "k_3 and k_rod" in str(one.notes)
    names = one.parameters.free_names
    assert one.correlation[names.index("k_3"), names.index("k_rod")] < -0.98
    six = fitted(SPREAD)
    assert "k_3 and k_rod" not in str(six.notes)
    for name in ("k_3", "k_rod"):
        assert relative(six, name) < 0.3 * relative(one, name)


UP_TO_FIT = ("design", "measure", "estimate", "fit")


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("study", "seed", "commands"),
    [
        pytest.param("linkage_arm.yml", 2, [], marks=pytest.mark.slow),
        pytest.param("irb4400_linkage.yml", 1, UP_TO_FIT, marks=pytest.mark.slow),
    ],
)
def test_shipped_linkages_are_identified_from_the_simulated_rig(
    study: str, seed: int, commands: Sequence[str], tmp_path: Path
):
    """Gears, rod and bending within 3 standard deviations and 5 % of the truth, with friction, noise and gravity."""
    summary = run(CONFIGS / study, tmp_path / "run", "--set", f"seed={seed}", commands=commands)
    found = {name: p for name, p in summary["parameters"].items() if name.startswith("k_")}
    assert {"k_2", "k_3", "k_rod", "k_b2"} <= set(found)
    for name, p in found.items():
        assert abs(p["value"] / p["truth"] - 1) < 0.05, name
        assert abs(p["value"] - p["truth"]) < 3 * p["std"], name


EMPS_STUDY = CONFIGS / "real" / "emps_response.yml"
# Motor current in A to the angles of motor and load: the bench of configs/real/motor_bench.yml, nothing known of it.
BENCH_AS_STRUCTURE = f"""
name: bench
experiment:
  configurations: {{bench: []}}
  recorded:
    rate_hz: 2500
    period: 1 s
    channels:
      - {{role: u, at: current, channel: iq_adx, quantity: current, unit: A}}
      - {{role: y, at: motor, channel: theta_mx, quantity: position, unit: rad}}
      - {{role: y, at: load, channel: theta_my, quantity: position, unit: rad, sign: -1}}
    files:
      - {{path: {json.dumps(str(DATA / BENCH))}, configuration: bench}}
report: {{formats: []}}
"""


def ran(study: Path, folder: Path, *overrides: str) -> Response:
    options = [part for override in ("report.formats=[]", *overrides) for part in ("--set", override)]
    assert cli.run_command(["run", str(with_records(study)), "--run", str(folder), "-q", *options]) == 0
    (response,) = read_responses(folder / "frf.h5")
    return response


@pytest.mark.parametrize(
    "overrides",
    [(), ("experiment.recorded.period=none", "estimator.method=h1")],
    ids=["as-shipped", "as-one-transient"],
)
def test_shipped_axis_study_has_mass_in_response(overrides: tuple[str, ...], tmp_path: Path) -> None:
    """Force over acceleration above 2 Hz is the published 95.11 kg within 5 %."""
    response = ran(EMPS_STUDY, tmp_path / "run", *overrides)
    assert (response.inputs, response.outputs, response.unit) == (("drive",), ("carriage",), "(m/s^2)/(N)")
    high = response.freq_hz > 2.0
    assert high.sum() > 30
    assert np.median(1 / response.G[high, 0, 0].real) == pytest.approx(95.11, rel=0.05)


def test_shipped_axis_study_names_source_of_record() -> None:
    """Its head has repository, commit and path; with another file in its place it is a study of responses."""
    head = EMPS_STUDY.read_text(encoding="utf-8").partition("\nname:")[0]
    for part in ("github.com/forgi86/sysid-neural-continuous", "956aa7ecd7", "examples/EMPS/data/DATA_EMPS.mat"):
        assert part in head
    assert load(EMPS_STUDY, (f"experiment.recorded.files.0.path={Path(__file__)}",)).study.kind == "frf"


def test_the_bench_as_a_structure_has_its_resonance_and_antiresonance(tmp_path: Path) -> None:
    """Without a robot, per ampere: 54 Hz in the dip of the motor, 76 Hz in the peak of both, within 3 %."""
    (tmp_path / "study.yml").write_text(BENCH_AS_STRUCTURE)
    response = ran(tmp_path / "study.yml", tmp_path / "run")
    assert response.unit == "(rad/s^2)/(A)"
    motor, load_side = response.G[:, 0, 0], response.G[:, 1, 0]
    assert nearest(response.freq_hz, motor, 54.0, -1) == pytest.approx(1.0, rel=0.03)
    for side in (motor, load_side):
        assert nearest(response.freq_hz, side, 76.0) == pytest.approx(1.0, rel=0.03)
    rows = list(csv.DictReader((tmp_path / "run" / "modes.csv").read_text().splitlines()))
    assert any(abs(float(row["frequency"]) / 76 - 1) < 0.03 for row in rows)
