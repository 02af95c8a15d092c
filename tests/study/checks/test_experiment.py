"""What a study may ask of its excitation, and how it is refused: file, line, and what would fit."""

from __future__ import annotations

from pathlib import Path

import pytest

from elastid.app.overview import overview
from elastid.base.errors import StudyError
from elastid.study import load

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["excitation.band_hz=[5, 260]"],
            "260 Hz is not below half the sampling rate (250 Hz); lower band_hz or raise",
        ),
        (["excitation.period=1.0005"], "1.0005 s is 500.25 samples at 500 Hz, not a whole number; take 1 s"),
        (["excitation.band_hz=[4.1, 4.9]"], "holds no line: the lines are odd multiples of 1 Hz"),
        (["excitation.phases=prbs", "excitation.grid=odd-random"], "prbs needs all lines or all odd lines"),
        (["excitation.grid=lines"], "grid: lines and a list under lines go together"),
        (["excitation.lines=[5, 7, 300]", "excitation.grid=lines"], "line 300 is outside band_hz"),
        (["excitation.margin=1"], "margin is 1; it is the part of each limit that stays free"),
        (["excitation.compress=[]"], "compress is empty"),
        (["experiment.simulated.carrier={kind: offset}"], "a carrier of kind offset is given by its velocity alone"),
        (["experiment.simulated.carrier={amplitude: 0.1, velocity: 0.1}"], "sine is given by its amplitude alone"),
        (["experiment.simulated.carrier={kind: square, velocity: [0.1, 0]}"], "must not be 0 for any joint"),
        (["experiment.ramp=-1"], "ramp and hold are times; they must not be negative"),
    ],
)
def test_what_cannot_be_excited_is_refused_with_what_would_fit(tiny: Path, overrides: list[str], message: str) -> None:
    """One message each, with the numbers filled in."""
    with pytest.raises(StudyError) as refusal:
        load(tiny, overrides)
    assert message in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


def test_the_overview_tells_lines(tiny: Path) -> None:
    """What `elastid check` prints."""
    plain = overview(load(tiny).study)
    assert "48 odd lines from 5 to 100 Hz" in plain


def test_a_configuration_in_which_loops_do_not_close_is_refused_at_its_line(tmp_path: Path) -> None:
    """Before anything is measured: with a rod of half the length the linkage does not even close at its start."""
    linkage, short = CONFIGS / "linkage_arm.yml", tmp_path / "short.yml"
    robot = (CONFIGS / "robots" / "linkage_arm.yml").read_text(encoding="utf-8")
    short.write_text(robot.replace("length: 0.89", "length: 0.45"), encoding="utf-8")
    with pytest.raises(StudyError, match=r"experiment\.configurations\.\w+: loop rod does not close at the start"):
        load(linkage, [f"robot={short}"])
