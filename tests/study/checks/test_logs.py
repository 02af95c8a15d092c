"""`check` opens the logs: each mistake about a channel is reported at its line, and a right study has none."""

import re
from pathlib import Path

import numpy as np
import pytest
from plants.channel_mistakes import Mistake, complaint, is_at_line, write_rig

from elastid.base.errors import StudyError
from elastid.study import load, load_with_logs

# Rigs with encoders of the links and a time, with speeds, with motor angles alone, and a multisine log.
RIGS = (0, 2, 4, 1)


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> dict[int, tuple[Path, tuple[Mistake, ...]]]:
    """Folder and mistakes of each rig."""
    folders = {number: tmp_path_factory.mktemp(f"rig{number}") for number in RIGS}
    return {number: (folder, write_rig(folder, number, 0)) for number, folder in folders.items()}


def test_every_mistake_is_reported_at_its_line(rigs: dict[int, tuple[Path, tuple[Mistake, ...]]]) -> None:
    """More than 30 of as many: names, columns, rate, time, period, length, units, side, quantity, sign, order."""
    missed, made = [], set()
    for number, (folder, mistakes) in rigs.items():
        for mistake in mistakes:
            made.add(mistake.name)
            if not is_at_line(complaint(folder, mistake), folder, mistake):
                missed.append((number, mistake.name))
    assert not missed
    assert len(made) >= 30


def test_other_commands_do_not_open_the_logs(rigs: dict[int, tuple[Path, tuple[Mistake, ...]]]) -> None:
    """A doubt does not stop who is sure: run reads the study alone."""
    folder, mistakes = rigs[4]
    assert complaint(folder, next(mistake for mistake in mistakes if mistake.name == "sign of an angle"))
    assert load(folder / "tried.yml").study.name == "motion"
    with pytest.raises(StudyError):
        load_with_logs(folder / "tried.yml")


STRUCTURE = """name: bench
experiment:
  configurations: {bench: []}
  recorded:
    rate_hz: 100
    text: {delimiter: ';'}
    channels:
      - {role: u, at: shaker, channel: force, quantity: force, unit: N}
      - {role: y, at: tip, channel: acc, quantity: acceleration, unit: m/s^2}
    files:
      - {path: log.csv, configuration: bench}
"""


def structure_log(folder: Path, delimiter: str, gap: int) -> str:
    """What check says of the study of a log with samples missing."""
    rows = np.random.default_rng(0).standard_normal((3000, 2))
    rows[1000 : 1000 + gap] = np.nan
    np.savetxt(folder / "log.csv", rows, "%.6g", delimiter, header=f"force{delimiter}acc", comments="")
    (folder / "study.yml").write_text(STRUCTURE)
    try:
        load_with_logs(folder / "study.yml")
    except StudyError as error:
        return str(error)
    return ""


def test_a_gap_that_measure_refuses_is_reported_and_its_advice_works(tmp_path: Path) -> None:
    """Also where the log has a time that leaves the samples out: rows of the file count."""
    said = structure_log(tmp_path, ";", 7)
    assert "study.yml:11:" in said
    assert "samples: [1007, 3000]" in said
    t = np.delete(np.arange(3000) / 100, np.s_[1000:1007])
    rows = np.column_stack([t, np.random.default_rng(0).standard_normal((len(t), 2))])
    np.savetxt(tmp_path / "log.csv", rows, "%.8g", ";", header="t;force;acc", comments="")
    (tmp_path / "study.yml").write_text(STRUCTURE.replace("    text:", "    time: t\n    text:"))
    with pytest.raises(StudyError, match=re.escape("samples: [1000, 2993]")):
        load_with_logs(tmp_path / "study.yml")
    text = (tmp_path / "study.yml").read_text().replace("log.csv,", "log.csv, samples: [1000, 2993],")
    (tmp_path / "study.yml").write_text(text)
    load_with_logs(tmp_path / "study.yml")
