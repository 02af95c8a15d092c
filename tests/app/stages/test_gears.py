"""The stage gears, from a study to its files: on a simulated arm whose gears do everything at once."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.artefacts import some_fit
from plants.paths import ROOT
from plants.refusals import refused
from plants.runs import run_of
from plants.runs import summary_of as summary
from plants.two_mass_gear import LINES, Gear, records, robot
from ruamel.yaml import YAML

from elastid.app import cli
from elastid.app.stages.gears import fit_with_linear_springs, with_gear_section
from elastid.base.execution import Execution
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.model.formulation import EXACT
from elastid.nonlinear.gear_result import ARCMIN, ARCSEC
from elastid.nonlinear.identify_gears import identify_gears
from elastid.nonlinear.spec import GearsSpec
from elastid.parameters import Parameter, Parameters
from elastid.robot import Robot
from elastid.robot.simplified import with_joints
from elastid.store.results import read_gears
from elastid.study import load_robot
from tests.consistency.test_readme import numbers
from tests.report.test_content import sheets

STUDY = ROOT / "configs" / "gear.yml"
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("gear")
    assert cli.run_command(["run", str(STUDY), "--run", str(path), "-q"]) == 0
    return path


@pytest.mark.parametrize(("options", "has_gears"), [((), True), (("gears=null",), False)])
def test_stages_before_the_gears_know_whether_they_follow(
    options: tuple[str, ...], has_gears: bool, tmp_path: Path
) -> None:
    """Notes that ask for the section `gears` are not for a study that has it."""
    run = run_of(STUDY, tmp_path, *options)
    assert {run.work(stage).has_gears for stage in ("estimate", "fit")} == {has_gears}


@pytest.mark.slow
def test_gears_summary_replaces_k_and_d_and_keeps_linear_fit(folder: Path) -> None:
    """k within 0.1 %, d within 2 %; a misfit is one no more."""
    content = summary(folder)
    assert content["status"] == "converged"
    for name, p in content["parameters"].items():
        if name[:2] in ("k_", "d_"):
            assert abs(p["value"] / p["truth"] - 1) < (1e-3 if name[0] == "k" else 2e-2), name
    gears = read_gears(folder / "gears.h5")
    assert {number.name for number in gears.numbers} == set(content["gears"]["numbers"])


@pytest.mark.slow
def test_every_effect_of_the_robot_is_found_and_no_other(folder: Path) -> None:
    """Intervals, of 40 % at most, hold the levels simulated; what the robot has not is below its bound."""
    content = summary(folder)
    assert content["modification_indices"] == []  # the gears explain what the linear fit has beyond the noise
    assert "warning" not in {note["severity"] for note in content["notes"]}
    found = {name: n["interval95"] for name, n in content["gears"]["numbers"].items() if n["value"] is not None}
    truth = {"Fc_m1": 20.0, "Fc_m2": 6.0, "Fb_1": 12.0, "Fb_2": 3.0, "Fcl_m1": 0.02, "H_2": 4.0}
    truth |= {"e1_1": 2e-5, "e2_2": 4e-5}
    for name, level in truth.items():
        assert found[name][0] <= level <= found[name][1] < found[name][0] + 0.4 * level, name
    of_springs = {"k_1", "k_2", "d_1", "d_2", "h_1", "K1_1", "K2_1", "K3_1", "Hw_2"}
    assert set(found) == set(truth) | of_springs


@pytest.mark.slow
def test_the_table_of_the_readme_is_of_this_run(folder: Path) -> None:
    """Each number of the last column and of the linear fit, and their std, to within two of its last digit."""
    content = summary(folder)
    names, number = (
        ["Fc_m1", "Fc_m2", "Fb_1", "Fb_2", "Fcl_m1", "h_1", "e1_1", "e2_2", "H_2"],
        content["gears"]["numbers"],
    )
    gears = {name: n.get("in_maker_unit", n["value"]) for name, n in number.items()}
    std_of = {name: number[name]["std"] / number[name]["value"] * gears[name] for name in ("e1_1", "e2_2")}
    rows = " ".join(line.split("|", 3)[3] for line in README.splitlines() if line.count("|") == 5 and "**" in line)
    motor = content["friction"][0]
    for field, more, said in (
        ("value", [motor["F_c"], *(gears[name] for name in names)], re.sub(r"± [\d.]+", "", rows)),
        ("std", [motor["std"], *std_of.values()], " ".join(re.findall(r"± [\d.]+", rows))),
    ):
        p = {name: (q["linear"][field], q[field]) for name, q in content["parameters"].items() if "linear" in q}
        springs, dampers = (np.transpose([p[f"{kind}_{axis}"] for axis in (1, 2)]).ravel() for kind in "kd")
        expected = np.concatenate([springs / 1e3, dampers, more])
        for (value, digit), of_run in zip(numbers(said), expected, strict=True):
            assert abs(value - of_run) < 2 * digit


@pytest.mark.slow
def test_the_robot_that_was_found_moves_as_the_log(folder: Path) -> None:
    """Its file states the effects; under the torque of the log it is 4 % off in its motion."""
    first = load_robot(folder / "identified_robot.yml").driven[0]
    assert first.gear.transmission_error[0].amplitude == pytest.approx(2e-5, rel=0.1)
    assert first.friction.coulomb == pytest.approx(12.0, rel=0.01)
    (run,) = summary(folder, "validation.json")["simulation"]
    motion = [signal for signal in run["signals"] if signal["signal"] == "motor angle"]
    assert motion
    assert all(signal["error"] < 0.04 for signal in motion)


@pytest.mark.slow
def test_exports_have_the_effects_that_they_can_carry(folder: Path) -> None:
    """MuJoCo friction alone; drawn robots the effects of the identified one."""
    for target in ("mujoco", "robot"):
        assert cli.run_command(["export", str(STUDY), "--run", str(folder), "--to", target]) == 0
    assert "hysteresis" in (folder / "export" / "robot" / "robot.yml").read_text()
    assert (folder / "export" / "mujoco" / "robot.xml").read_text().count("frictionloss") == 4
    assert cli.run_command(["export", str(STUDY), "--run", str(folder), "--to", "samples", "--count", "2"]) == 0
    paths = [folder / "export" / "robot" / "robot.yml", folder / "export" / "samples" / "robots" / "robot_1.yml"]
    found, drawn = (YAML(typ="safe").load(path)["bodies"][1]["joints"][0]["gear"] for path in paths)
    assert drawn == found


@pytest.mark.slow
def test_repeated_fit_removes_outdated_gear_result(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """summary.json is the linear fit's until the gears are laid open again; without the section it stays so."""
    arguments = [str(STUDY), "--run", str(folder), "-q"]
    cli.run_command(["run", *arguments, "fit"])
    assert "gears" not in summary(folder)
    assert not (folder / "gears.h5").exists()
    assert cli.run_command(["run", *arguments, "validate"]) == 2
    assert "gears` first" in capfd.readouterr().err
    assert cli.run_command(["run", *arguments, "gears"]) == 0
    assert "gears" in summary(folder)


@pytest.mark.slow
def test_lost_motion_is_identified_beside_backlash_of_robot_file() -> None:
    """About rest within the gap of the file, k shows in no response: the search starts from straight springs."""
    gear = Gear(gap=1e-4, loose=0.3)
    measured, spec = records(gear, seed=1, experiments=4), EstimatorSpec(friction="none", transient_periods=0)
    response = estimate(measured, spec, LINES)
    fit = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}, starts=1)
    worn = with_spring(backlash=1e-4, inner_stiffness=0.3 * gear.k)
    result = identify([response], worn, fit)
    start = fit_with_linear_springs(worn, [response], result, EXACT, fit, Execution())
    found = identify_gears([measured], [response], *start, spec, GearsSpec(), planned=LINES)
    numbers = {number.name: number for number in found.numbers if number.is_significant}
    assert numbers["k_1"].value == pytest.approx(gear.k, rel=1e-3)
    assert numbers["lost_1"].value == pytest.approx(2 * 0.7 * 1e-4, rel=0.03)


def test_a_term_of_a_spring_is_not_fitted_and_found() -> None:
    """Its number would act twice; a robot of straight springs goes through as it is."""
    hard, fit = with_spring(cubic=1e9), FitSpec()
    free = Parameters((Parameter("k_1", 2e5, log=True), Parameter("k3_1", 1e9)))
    none = np.zeros(2, bool)
    result = Result(free, free.x, np.eye(2), 1.0, 1, 1.0, "converged", "", (), 1, none, np.ones(2), "complex")
    with refused("fit/parameters"):
        fit_with_linear_springs(hard, [], result, EXACT, fit, Execution())
    straight = robot(Gear())
    assert fit_with_linear_springs(straight, [], result, EXACT, fit, Execution()) == (result, straight)


def test_the_summary_has_numbers_of_gears_in_makers_units_too() -> None:
    """Nm/arcmin and arcsec where they are usual; of what was not seen its bound."""
    result, empty = some_fit(), {"parameters": {}, "notes": [], "warnings": []}
    gears = replace(sheets(), x=result.x, covariance=result.covariance)
    numbers = with_gear_section(empty, result, (), gears)["gears"]["numbers"]
    assert numbers["k_1"]["in_maker_unit"] == pytest.approx(2e5 / ARCMIN)
    assert numbers["e1_1"]["in_maker_unit"] == pytest.approx(2e-5 * ARCSEC)
    assert "in_maker_unit" not in numbers["H_1"]
    assert (numbers["H_1"]["value"], numbers["H_1"]["bound95"]) == (None, 0.3)


def with_spring(**terms: float) -> Robot:
    return with_joints(robot(Gear()), lambda joint: replace(joint, spring=replace(joint.spring, **terms)))
