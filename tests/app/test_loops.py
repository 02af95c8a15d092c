"""Loops of a study from the command line: results that agree, a section that runs when pasted, and wrong input."""

from pathlib import Path

import numpy as np
import pytest
from plants.arm_study import STUDY, command

from elastid.store.results import read_loops
from elastid.study import load


@pytest.mark.slow
def test_a_fitted_study_gets_loops(fitted_arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All files agree, and the pasted section is a controller of a study."""
    run = fitted_arm.parent / "run"
    assert command("loops", fitted_arm, "--samples", "12", "--delay", "1") == 0
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
