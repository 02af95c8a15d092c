"""`check` opens the logs: each mistake about a channel is reported at its line, and a right study has none."""

import sys
from pathlib import Path

import pytest

from elastid.app import cli
from elastid.base.errors import StudyError
from elastid.study import load, load_with_logs
from elastid.study.checks.logs import is_time

sys.path.insert(0, str(Path(__file__).parents[3] / "scripts" / "studies"))
from wrong_channels import Mistake, complaint, is_at_line, write_rig

# Rigs with encoders of the links and a time, with speeds, with motor angles alone, and a multisine log.
RIGS = (0, 2, 4, 1)


@pytest.fixture(scope="module")
def rigs(tmp_path_factory: pytest.TempPathFactory) -> dict[int, tuple[Path, tuple[Mistake, ...]]]:
    """Folder and mistakes of each rig."""
    folders = {number: tmp_path_factory.mktemp(f"rig{number}") for number in RIGS}
    return {number: (folder, write_rig(folder, number, 0)) for number, folder in folders.items()}


@pytest.mark.parametrize("number", RIGS)
def test_a_right_study_is_accepted(rigs: dict[int, tuple[Path, tuple[Mistake, ...]]], number: int) -> None:
    assert complaint(rigs[number][0], None) == ""


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


def test_the_message_says_what_to_write(rigs: dict[int, tuple[Path, tuple[Mistake, ...]]]) -> None:
    """And the advice, written into the study, is accepted."""
    folder, mistakes = rigs[2]
    said = complaint(folder, next(mistake for mistake in mistakes if mistake.name == "rpm as rad/s"))
    assert "velocity w_1" in said
    assert "unit: rpm would make both agree" in said


def test_other_commands_do_not_open_the_logs(rigs: dict[int, tuple[Path, tuple[Mistake, ...]]]) -> None:
    """A doubt does not stop who is sure: run reads the study alone."""
    folder, mistakes = rigs[4]
    assert complaint(folder, next(mistake for mistake in mistakes if mistake.name == "sign of an angle"))
    assert load(folder / "tried.yml").study.name == "motion"
    with pytest.raises(StudyError):
        load_with_logs(folder / "tried.yml")


def test_the_command_ends_with_exit_code_2(
    rigs: dict[int, tuple[Path, tuple[Mistake, ...]]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = rigs[0]
    option = "experiment.recorded.channels.0.channel=tau1"
    assert cli.run_command(["check", str(folder / "study.yml"), "--set", option]) == 2
    assert "did you mean tau_1?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "expected"),
    [("t", True), ("rec.time_cont", True), ("Time (s)", True), ("torque", False), ("tau_1", False)],
)
def test_times_are_known_by_their_names(name: str, expected: bool) -> None:
    assert is_time(name) is expected
