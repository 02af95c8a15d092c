"""Every script runs: examples give their number, benches and studies end with one line of JSON."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

SCRIPTS = Path(__file__).parents[2] / "scripts"
EXAMPLES = SCRIPTS / "examples"
FOLDERS = (SCRIPTS / "benchmarks", SCRIPTS / "studies")
RUNNABLE = sorted(
    path
    for folder in FOLDERS
    for path in folder.glob("*.py")
    if path.stem not in ("study_plants", "timing", "causes", "watch")
)


def example(name: str) -> dict[str, Any]:
    """The variables of an example, without its figures; the gallery and a notebook know no __file__."""
    path = EXAMPLES / f"{name}.py"
    variables: dict[str, Any] = {"__name__": name}
    sys.path.insert(0, str(EXAMPLES))
    try:
        exec(compile(path.read_text(encoding="utf-8"), path, "exec"), variables)
        return variables
    finally:
        sys.path.remove(str(EXAMPLES))


def test_example_1_finds_the_stiffness_of_one_joint() -> None:
    """From Python alone, without a study file: within its interval, and the interval is narrow."""
    said = example("ex01_identify_from_python")
    assert said["low"] < said["true_stiffness"] < said["high"]
    assert said["high"] - said["low"] < 0.05 * said["true_stiffness"]


def test_example_2_has_one_response_of_two_formulations() -> None:
    """To rounding."""
    assert example("ex02_linkage_two_formulations")["difference"] < 1e-9


@pytest.mark.slow
def test_examples_3_and_4_fit_what_python_control_has_measured() -> None:
    """The numbers of the transfer function; a gain of 100/s behind two lags T = 2 ms has a margin of 2 / (100 T)."""
    result = example("ex03_responses_of_python_control")["result"]
    assert result.values == pytest.approx(result.values | {"k_1": 3e3, "d_1": 4.0}, rel=1e-6)
    assert result.status == "noise_unknown"
    assert example("ex04_controller_on_the_fitted_model")["gain_margin"] == pytest.approx(10, rel=0.01)


@pytest.mark.slow
def test_example_17_finds_where_an_arm_is_soft_and_where_it_chatters() -> None:
    """Three times as soft stretched as folded, and a depth of cut that differs by far more."""
    mill = example("ex17_where_can_i_mill")
    assert mill["soft"] / mill["stiff"] == pytest.approx(3.25, rel=0.03)
    assert mill["gain"] == pytest.approx(25.3, rel=0.05)


@pytest.mark.slow
def test_example_20_knows_a_wrist_by_weights() -> None:
    """From 8 to 0.7 %, all within three standard deviations of the truth."""
    weighed = example("ex20_load_tests")
    assert not weighed["both"].static.disagrees
    without, with_loads = weighed["relative"]["k_3"]
    assert without == pytest.approx(0.081, rel=0.1)
    assert with_loads == pytest.approx(0.007, rel=0.1)
    for name, (_, std) in weighed["relative"].items():
        assert abs(weighed["both"].values[name] / weighed["truth"][name] - 1) < 3 * std, name


def test_example_18_finds_the_modes_of_three_masses() -> None:
    """Shapes with a MAC of 0.999 and more."""
    found = example("ex19_modes_of_a_structure")
    assert np.all(found["agreement"] > 0.999)
    assert np.all(np.abs(found["modes"].zeta - found["zeta"]) < 4 * found["modes"].zeta_std)


@pytest.mark.slow
def test_example_18_commands_a_move_that_the_tool_follows() -> None:
    """Over a hundred times as exactly as with rigid feedforward, and with the catalogue's springs thirty times.

    The vibration is a third; draws enclose the error, within the limits of torque.
    """
    found = example("ex18_command_a_fast_move")
    assert found["gain"] > 100
    assert found["over_catalogue"] > 30
    move = found["move"]
    identified = move[found["IDENTIFIED"]]
    assert identified.residual < move[found["RIGID"]].residual / 3
    assert np.all(identified.low <= identified.high)
    assert np.all(move.most <= 900.0)
    assert not move.advice


@pytest.mark.slow
def test_example_22_finds_gains_at_their_limit() -> None:
    """Within 6 dB on the estimate and on 95 % of the draws, at a limit that a mode sets; more gain breaks it."""
    found = example("ex22_gains_of_joint_loops")
    assert 5.5 < found["designed"].peak_db.max() <= 6.0
    assert np.mean(found["peaks_db"] <= 6.0) >= 0.95
    assert any("mode at" in cause for cause in found["designed"].limited_by)
    assert found["wild"].peak_db.max() > 7.0


@pytest.mark.slow
def test_example_21_measures_until_the_springs_are_known() -> None:
    """In two thirds of the time of the plan, with the truth in intervals that are as narrow as was asked for."""
    live = example("ex21_live_identification")
    assert live["reached"]
    assert live["share"] < 2 / 3
    assert all(live["inside"].values())
    assert all(widths[-1] <= 0.05 < widths[0] for widths in live["half_widths"].values())


@pytest.mark.slow
def test_example_6_finds_the_friction_of_one_axis() -> None:
    """Coulomb and viscous friction within 0.5 % of the truth, by intervals that are as narrow."""
    found = example("ex06_friction_curve")["found"]
    for name, truth in {"Fc_m1": 22.0, "f_m1": 13.0, "Fs_m1": 31.0}.items():
        low, high = found[name]
        assert low > 0.995 * truth, name
        assert high < 1.005 * truth, name


def test_example_7_has_orthogonal_multisines_of_the_power_asked_for() -> None:
    """At every line, over the experiments; each motor has its rms."""
    said = example("ex07_multisine")
    assert said["orthogonality"] < 1e-12
    assert said["found_rms"] == pytest.approx(np.tile(said["rms"], (3, 1)), rel=1e-9)


def test_example_8_halves_the_peaks() -> None:
    """A crest factor of 1.5 at most, where Schroeder's is below 2 and random phases are above 3."""
    crest = example("ex08_crest_factor")["crest"]
    assert crest["optimised"] < 1.5 < crest["schroeder"] < 2.0 < 3.0 < crest["random"]


def test_example_9_ranks_the_estimators_of_a_closed_loop() -> None:
    """The mean of realisations and the joint estimate are nearer to the exact response than H1."""
    error = example("ex09_closed_loop_estimators")["error"]
    assert max(error["arithmetic"], error["joint"]) < 0.8 * error["h1"]


def test_example_10_resolves_a_resonance_from_one_experiment() -> None:
    """Rational functions follow it to some percent where polynomials over the same lines do not."""
    error = example("ex10_local_methods")["error"]
    assert error["local_rational"] < 0.03
    assert error["local_rational"] < 0.2 * error["local_polynomial"]


@pytest.mark.slow
def test_example_11_finds_mass_and_centre_of_mass_beside_the_springs() -> None:
    """All within 3 standard deviations, and the mass much better than its prior of 2 %."""
    said = example("ex11_geometry_and_priors")
    result, std = said["result"], said["result"].std
    for name, truth in said["truth"].items():
        assert abs(result.values[name] - truth) < 3 * std[name], name
    assert std["m_fore"] < 0.005 * said["truth"]["m_fore"]


def test_example_12_follows_friction_while_a_joint_warms_up() -> None:
    """Coulomb friction has fallen by 15 %, viscous friction by 30 %; each is followed to some percent."""
    said = example("ex12_friction_observer")
    for name, tolerance in {"Fc": 0.05, "f": 0.1, "offset": 0.05}.items():
        assert said["end"][name] == pytest.approx(said["true"][name][-1], rel=tolerance), name


@pytest.mark.slow
def test_example_13_finds_seven_springs_of_three_axes() -> None:
    """Within 0.3 % of the truth at a noise of 2 %."""
    off = example("ex13_three_axes")["off"]
    assert len(off) == 7
    assert max(abs(each) for each in off.values()) < 3e-3


@pytest.mark.slow
def test_example_14_finds_the_bearing_that_tilts() -> None:
    """It is elastic in the best model, and without it the misfit of left-out configurations is 100 times larger."""
    said = example("ex14_search")
    assert said["codes"] == [0, 0]
    models = {model["name"]: sum(model["misfit"]) for model in said["comparison"]["models"]}
    assert "1x" in said["comparison"]["verdict"].split(".")[0]
    assert models["driven joints alone"] > 100 * models[said["comparison"]["models"][0]["name"]]


def test_example_15_replays_the_measured_torque() -> None:
    """The fitted model explains the motion up to the noise; with half the stiffness it does not."""
    said = example("ex15_twin")
    assert said["explained"] > 97
    assert said["of_the_soft"] < 60


def test_example_16_names_the_soft_gear_and_the_friction_that_grows() -> None:
    """And no other robot or parameter."""
    findings = example("ex16_fleet")["findings"]
    assert {(each.robot, each.parameter) for each in findings} == {("robot 3", "k_2"), ("robot 6", "Fc_m2")}
    assert {each.robot for each in findings if each.kind == "drifts"} == {"robot 6"}


def test_every_example_is_short_and_asserted() -> None:
    """A new example comes with its test, here or, of example 5, with the run folder of the README."""
    tests = "".join(path.read_text() for path in Path(__file__).parent.glob("test_*.py"))
    for path in EXAMPLES.glob("ex[0-9]*.py"):
        assert path.stem in tests, path.name
        assert len(path.read_text().splitlines()) <= 60, path.name


@pytest.mark.slow
@pytest.mark.parametrize("script", RUNNABLE, ids=lambda path: f"{path.parent.name} {path.stem}")
def test_every_bench_and_study_ends_with_json(script: Path, tmp_path: Path) -> None:
    """--quick is a small problem; the full size is for scripts' users."""
    done = subprocess.run(
        [sys.executable, str(script), "--quick"], cwd=tmp_path, capture_output=True, text=True, timeout=580, check=False
    )
    assert done.returncode == 0, done.stderr
    assert isinstance(json.loads(done.stdout.splitlines()[-1]), dict)
