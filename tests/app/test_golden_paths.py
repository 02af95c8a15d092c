"""Nine paths of a user from a refusal or a misfit to a result, each by what the message advises, as it is pasted."""

import re
from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import SPEEDS, sliding_torque, trapezoids, write_log
from plants.lab_logs import N, Signals, measured, save_csv, study_of
from plants.two_axes import ROBOT, STUDY
from plants.two_axes import measured as measured_responses

from elastid.app import cli
from elastid.app.run import stamps
from elastid.base.errors import ElastidError
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.experiment.specs.logs import FileSpec, TextFormatSpec
from elastid.record import Record
from elastid.store.measured import read_responses, write_responses
from elastid.study import load

Capture = pytest.CaptureFixture[str]


def said(capture: Capture, *arguments: str) -> tuple[int, str]:
    """Exit code of a command and all that it says, in one line."""
    capture.readouterr()
    return cli.run_command(arguments), " ".join("".join(capture.readouterr()).split())


def pasted(pattern: str, text: str) -> list[str]:
    """What a message advises, by the groups of a pattern."""
    found = re.search(pattern, text)
    assert found is not None, text
    return [*found.groups()]


def two_axes(folder: Path) -> str:
    """The path of a study of two axes."""
    (folder / "robot.yml").write_text(ROBOT)
    (folder / "study.yml").write_text(STUDY)
    return str(folder / "study.yml")


def log(folder: Path, samples: int, lines: np.ndarray, **given: object) -> Signals:
    """A log of two axes that is written, too."""
    U = orthogonal_set(np.ones((len(lines), 4)), np.random.default_rng(3))[0]
    signals = np.tile(synthesise(lines, U, N), (-(-samples // N), 1))[:samples]
    content = dict(zip(("i1", "i2", "phi", "w2"), signals.T, strict=True))
    save_csv(folder / "log.csv", content, **given)
    return content


def refused(folder: Path, **keys: object) -> str:
    """Why the log is refused under keys of experiment.recorded."""
    with pytest.raises(ElastidError) as error:
        taken(folder, **keys)
    return str(error.value)


def taken(folder: Path, **keys: object) -> Record:
    return measured(folder, study_of("log.csv", **keys))


def test_an_override_without_a_value_shows_one(tmp_path: Path, capsys: Capture) -> None:
    study = two_axes(tmp_path)
    code, text = said(capsys, "check", study, "--set", "fit.starts")
    assert code == 2
    assert said(capsys, "check", study, "--set", *pasted(r"--set (fit\.starts=\d+)", text))[0] == 0


def test_logs_without_their_option_become_a_study_with_it(tmp_path: Path, capsys: Capture) -> None:
    logs = [str(tmp_path / f"{name}.csv") for name in "ab"]
    for path in logs:
        write_log(Path(path), trapezoids(SPEEDS), sliding_torque(trapezoids(SPEEDS)))
    code, text = said(capsys, "new", str(tmp_path / "study"), *logs)
    assert code == 2
    (option,) = pasted(r"(--from) before", text)
    assert said(capsys, "new", str(tmp_path / "study"), option, logs[0], option, logs[1])[0] == 0


def test_half_periods_are_stated_as_such(tmp_path: Path) -> None:
    log(tmp_path, N, np.arange(1, 60, 2))
    text = refused(tmp_path, period_samples=N // 2)
    (period,) = pasted(r"period_samples: (\d+)", text)
    assert "half_wave: true" in text
    assert taken(tmp_path, period_samples=int(period), half_wave=True).period_samples == N


def test_the_longest_piece_without_a_gap_is_taken(tmp_path: Path) -> None:
    content = log(tmp_path, 4 * N, np.arange(1, 60))
    content["w2"][100:130] = np.nan
    save_csv(tmp_path / "log.csv", content)
    keys = {"period_samples": None, "period": "none"}
    first, last = map(int, pasted(r"samples: \[(\d+), (\d+)\]", refused(tmp_path, **keys)))
    files = (FileSpec("log.csv", "home", samples=(first, last)),)
    assert taken(tmp_path, **keys, files=files).n_samples == last - first


def test_an_emergency_stop_is_left_out(tmp_path: Path) -> None:
    content = log(tmp_path, 2 * N, np.arange(1, 60))
    for x in content.values():
        x[300:] = x[300]
    save_csv(tmp_path / "log.csv", content)
    text = refused(tmp_path)
    assert "period: none" in text
    files = (FileSpec("log.csv", "home", samples=tuple(map(int, pasted(r"samples: \[(\d+), (\d+)\]", text)))),)
    assert taken(tmp_path, period_samples=None, period="none", files=files).n_samples <= 301


def test_another_delimiter_is_named(tmp_path: Path) -> None:
    log(tmp_path, 4 * N, np.arange(1, 60), delimiter=";", comma=True)
    delimiter, decimal = pasted(r"text: \{delimiter: '(.)', decimal: '(.)'", refused(tmp_path))
    assert taken(tmp_path, text=TextFormatSpec(delimiter=delimiter, decimal=decimal)).n_samples == 4 * N


@pytest.mark.slow
def test_late_torque_is_named_and_delay_fit_converges(tmp_path: Path, capsys: Capture) -> None:
    study = two_axes(tmp_path)
    run = measured_responses(Path(study), load(Path(study)).study.robot)
    late = [
        each.__class__(**{**vars(each), "G": each.G * np.exp(-2j * np.pi * each.freq_hz * 2e-3)[:, None, None]})
        for each in read_responses(run.path("estimate"))
    ]
    for more, code in (("", 3), (", delay: {}", 0)):
        key = f"fit.parameters={{k_*: {{}}, d_*: {{}}{more}}}"
        write_responses(run.path("estimate"), late, stamps(load(Path(study), [key]))["estimate"])
        assert said(capsys, "run", study, "fit", "--run", str(tmp_path / "run"), "--set", key)[0] == code
