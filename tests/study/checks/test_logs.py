"""`check` opens the logs: each mistake about a channel is reported at its line, and a right study has none."""

from pathlib import Path

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


# What nothing in the log contradicts where the motor's angle is alone in it: the fit says so, by its numbers.
ALONE = ("velocity as position, alone", "degrees as radians, alone")


def test_every_mistake_is_reported_at_its_line(rigs: dict[int, tuple[Path, tuple[Mistake, ...]]]) -> None:
    """More than 30 of as many: names, columns, rate, time, period, length, units, side, quantity, sign, order."""
    missed, made = [], set()
    for number, (folder, mistakes) in rigs.items():
        for mistake in mistakes:
            made.add(mistake.name)
            if mistake.name not in ALONE and not is_at_line(complaint(folder, mistake), folder, mistake):
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


def test_drives_that_are_alike_have_one_cure(rigs: dict[int, tuple[Path, tuple[Mistake, ...]]]) -> None:
    """Angles of both motors taken for those of the link: one line, which names the other channel."""
    folder, _ = rigs[0]
    study = (folder / "study.yml").read_text()
    (folder / "alike.yml").write_text(study.replace("unit: deg, side: motor}", "unit: deg}"))
    with pytest.raises(StudyError) as caught:
        load_with_logs(folder / "alike.yml")
    of_angles = [line for line in str(caught.value).splitlines() if "phi_" in line]
    assert len(of_angles) == 1
    assert of_angles[0].partition("; likewise ")[2].startswith("phi_2")
