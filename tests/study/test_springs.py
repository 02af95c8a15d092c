"""Nonlinear springs and compensators in a study: read with units, shown by `check`, refused in a sentence."""

from pathlib import Path

import pytest

from elastid.app.overview import overview
from elastid.fit.parameter_choice import choose
from elastid.study import Study, load

TEMPLATE = Path(__file__).parents[2] / "elastid" / "app" / "templates" / "serial"
CYLINDER = """
compensators:
  - name: cyl
    ends: [{body: turret}, {body: upper_arm, point: [0, 0, 200 mm]}]
    gas: {force: 4 kN, length: 500 mm, column: 0.4, kappa: 1.2}
"""
CUBIC = "damping: 600, cubic: 1e11 N*m/rad^3}"
GAP = "damping: 250, backlash: 0.05 mrad, inner_stiffness: 20 kN*m/rad, rounding: 20 %}"


def written(folder: Path, cubic: str = CUBIC, gap: str = GAP, cylinder: str = CYLINDER, wanted: str = "") -> Path:
    """The template with a cubic gear at joint 2, backlash at joint 3 and a gas spring."""
    robot = (TEMPLATE / "robot.yml").read_text()
    robot = robot.replace("damping: 600}", cubic, 1).replace("damping: 250}", gap, 1) + cylinder
    (folder / "robot.yml").write_text(robot)
    (folder / "study.yml").write_text(
        (TEMPLATE / "study.yml").read_text().replace("    fm_*: {}", "    fm_*: {}" + wanted)
    )
    return folder / "study.yml"


def test_springs_are_read_in_si_and_shown(tmp_path: Path) -> None:
    """Units of polynomials, gaps and gas; what `check` says of them; names that the fit may free."""
    study: Study = load(written(tmp_path, wanted="\n    k3_*: {}\n    F0_cyl: {}\n    L0_cyl: {}")).study
    numbers = {name: value for name, (value, _) in study.robot.parameters().items()}
    expected = {"k3_2": 1e11, "b_3": 5e-5, "ki_3": 2e4, "e_3": 0.2, "F0_cyl": 4e3, "L0_cyl": 0.5, "h0_cyl": 0.4}
    assert {name: numbers[name] for name in expected} == pytest.approx(expected)
    page = overview(study)
    assert "nonlinear springs: 2, 3" in page
    assert "compensators: cyl" in page
    parameters = choose(study.fit, study.robot)
    assert {"k3_2", "F0_cyl", "L0_cyl"} < set(parameters.free_names)
    assert parameters["k3_2"].log
    assert not parameters["L0_cyl"].log
