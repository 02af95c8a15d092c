"""Loops of a study from the command line: results that agree, a section that runs when pasted, and wrong input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants.arm_study import STUDY, command
from ruamel.yaml import YAML

from elastid.base.errors import StudyError
from elastid.store.results import read_loops
from elastid.study import load


@pytest.mark.slow
def test_a_fitted_study_gets_loops(fitted_arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All files agree, and the pasted section is a controller of a study."""
    run = fitted_arm.parent / "run"
    assert command("loops", fitted_arm, "--draws", "12", "--delay", "1") == 0
    loops = read_loops(run / "loops.h5")
    assert loops.today is not None
    assert np.mean(loops.designed.drawn_peaks_db <= 6.0) >= 0.95
    section = (run / "loops.yml").read_text(encoding="utf-8")
    pasted = STUDY.replace("    truth:", "".join(f"    {line}\n" for line in section.splitlines()) + "    truth:")
    path = fitted_arm.parent / "pasted.yml"
    path.write_text(pasted, encoding="utf-8")
    assert load(path).study.experiment.as_simulated().controller == loops.controller
    assert (run / "loops.html").stat().st_size > 10_000
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--delay", "21"), "--delay"),
        (("--rate", "0"), "--rate"),
        (("--draws", "-1"), "--draws"),
    ],
)
def test_wrong_options_are_refused(
    words: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "study.yml").write_text(STUDY, encoding="utf-8")
    assert command("loops", tmp_path / "study.yml", *words) in (1, 2)
    assert says in capsys.readouterr().err


GAINS = {"position_gain": [10, 12], "velocity_gain": [900, 300], "integral_time": 0.1, "low_pass_hz": 60}
NOTCH = {"joint": "2", "freq_hz": 20, "width": 0.5, "depth": 0.2}


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"gains": {**GAINS, "velocity_gain": [1, 2, 3]}}, "velocity_gain: 3 numbers for 2 driven joints"),
        ({"gains": {**GAINS, "position_gain": -1}}, "gains.position_gain: "),
        ({"gains": {**GAINS, "low_pass_hz": 100}}, "low_pass_hz: 100 Hz is not below half the controller's rate"),
        ({"gains": {**GAINS, "notches": [{**NOTCH, "joint": "3"}]}}, "notches[0].joint: "),
        ({"gains": {**GAINS, "notches": [{**NOTCH, "depth": 2}]}}, "depth"),
    ],
)
def test_a_wrong_controller_is_said_at_its_line(changed: dict[str, object], says: str, tmp_path: Path) -> None:
    content = YAML(typ="safe").load(STUDY)
    content["experiment"]["simulated"]["controller"] = {"kind": "cascade", **changed}
    with (tmp_path / "study.yml").open("w", encoding="utf-8") as file:
        YAML().dump(content, file)
    with pytest.raises(StudyError) as refused:
        load(tmp_path / "study.yml")
    assert says in str(refused.value)
    assert "study.yml:" in str(refused.value)
