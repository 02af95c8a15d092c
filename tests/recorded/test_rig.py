"""The recorded rig: any file format, faults of a log in one message, held torques and known disturbances."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants import friction_logs
from plants.friction_logs import COULOMB, VISCOUS, logs, sliding_torque, trapezoids
from plants.lab_logs import CHANNELS, RATE, ROBOT, N, U, Y, measured, save_csv, study_of, with_names, write_csv
from plants.notes import said
from plants.refusals import refused
from scipy.signal import lfilter

from elastid.base.errors import StudyError
from elastid.excitation.multisine import synthesise
from elastid.experiment.specs.channels import ChannelSpec, Structure
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.recorded.friction_logs import read_friction_logs
from elastid.recorded.link_side import UNWRAPPED, drive_notes
from elastid.recorded.rig import RecordedRig
from elastid.study import Study, load
from elastid.study.checks import check_study


def test_an_encoder_that_starts_again_after_a_turn_is_unwrapped(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Angle modulo 360 deg on the motor side gives the same motion, with a word; its mean turns are lost."""
    save_csv(tmp_path / "whole.csv", log)
    save_csv(tmp_path / "wrapped.csv", log | {"phi": np.mod(log["phi"], 360.0)})
    whole, wrapped = (measured(tmp_path, study_of(f"{name}.csv")) for name in ("whole", "wrapped"))
    np.testing.assert_allclose(wrapped.y[:, 0] - wrapped.y[0, 0], whole.y[:, 0] - whole.y[0, 0], atol=1e-12)
    assert [note.code for note in wrapped.notes] == [UNWRAPPED]


def test_an_input_that_stands_still_while_another_moves_is_taken_as_not_excited(
    tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """One motor at a time is a lawful experiment; the estimator judges all of them together."""
    save_csv(tmp_path / "log.csv", log | {"i2": np.full(800, 0.5)})
    notes = said(measured(tmp_path, study_of("log.csv")).notes)
    sentence = "channel i2 (u at motor 2) is constant at 0.5: taken as not excited in this experiment"
    assert notes == (f"record home-r0-e0: {sentence}",)


def test_a_last_period_that_is_not_whole_is_left_out_with_a_word(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """780 samples are 3 periods of 200 and 180 more; also when a window of the file is asked for."""
    save_csv(tmp_path / "log.csv", {k: v[:780] for k, v in log.items()})
    record = measured(tmp_path, study_of("log.csv"))
    assert record.n_samples == 600
    assert "the last 180 of 780 samples are no whole period of 200" in said(record.notes)[0]
    window = study_of("log.csv", files=(FileSpec("log.csv", "home", samples=(30, 450)),))
    record = measured(tmp_path, window)
    assert record.n_samples == 400
    np.testing.assert_allclose(record.u[0, 0], -log["i2"][30] * 0.5e-3)


def test_a_log_of_one_row_is_refused_as_one(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """And not each of its channels as constant; a study says whether it has a period."""
    save_csv(tmp_path / "log.csv", {name: x[:1] for name, x in log.items()})
    with refused("records/values", place="log.csv", holds="one row"):
        measured(tmp_path, study_of("log.csv"))


@pytest.mark.parametrize("dead", [lambda x: 0 * x + 0.25, lambda x: np.nan * x, lambda x: 1e-300 * x])
def test_a_dead_sensor_is_refused(
    dead: Callable[[np.ndarray], np.ndarray], tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Constant, no number, or too small to compute with."""
    save_csv(tmp_path / "log.csv", log | {"w2": dead(log["w2"])})
    with refused("records/values", place="log.csv", holds="w2"):
        measured(tmp_path, study_of("log.csv"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"files": (FileSpec("gone.csv", "home"),)}, "gone.csv"),
        ({"files": (FileSpec("log.csv", "away"),)}, ("away", "home")),
        ({"files": (FileSpec("log.csv", "home"),) * 2}, "configuration home"),
        ({"channels": (U, replace(Y, at="motor 7"))}, ("motor 7", "motor 1")),
        ({"channels": (replace(U, at="joint 1"), Y)}, ("joint 1", "motor 1")),
        ({"channels": (U, replace(Y, unit="N*m"))}, "N*m"),
        ({"channels": (U, Y, replace(Y, channel="w2"))}, "motor 1"),
        ({"channels": (U, Y, ChannelSpec("r", "motor 2", "i2"))}, "motor 2"),
    ],
)
def test_a_study_that_does_not_fit_robot_or_files_is_refused_before_anything_is_read(
    changes: dict[str, Any], message: str | tuple[str, ...], tmp_path: Path
) -> None:
    """Each with the name at fault and what there is."""
    (tmp_path / "log.csv").write_text("nothing is read")
    problems = list(check_study(Study("a", robot=ROBOT, experiment=study_of("log.csv", **changes)), tmp_path))
    words = (message,) if isinstance(message, str) else message
    assert any(all(word in problem.message for word in words) for problem in problems), problems


def test_a_motor_side_without_a_gear_and_half_of_an_odd_period_are_refused(
    tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    write_csv(tmp_path, log)
    with refused("study/recorded", holds=("side: motor", "body arm z")):
        measured(tmp_path, study_of("log.csv", channels=(U, replace(Y, at="body arm z"))))
    with pytest.raises(ValueError, match="half_wave needs an even number of samples per period, not 201"):
        study_of("log.csv", period_samples=201, half_wave=True)


def test_logs_of_two_amplitudes_are_configurations_of_one_posture(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """The level of a file makes a response of its own, at the same angles."""
    write_csv(tmp_path, log)
    rig = RecordedRig(
        ROBOT, study_of("log.csv", files=(FileSpec("log.csv", "home"), FileSpec("log.csv", "home", level=2))), tmp_path
    )
    first, second = (rig.measure(experiment) for experiment in rig.experiments)
    assert (first.configuration.name, second.configuration.name) == ("home", "home level 2")
    np.testing.assert_array_equal(second.configuration.angles, first.configuration.angles)
    np.testing.assert_array_equal(second.u, first.u)
    with pytest.raises(ValueError, match=r"^level: "):
        FileSpec("log.csv", "home", level=0)


FIRST, SECOND, *MOTIONS = CHANNELS


@pytest.mark.parametrize(
    ("section", "first", "second", "held"),
    [
        ("band-limited", None, None, (0.0, 0.0)),
        ("zero-order", None, None, (1.0, 1.0)),
        ("zero-order", "band-limited", None, (0.0, 1.0)),
        ("band-limited", None, "zero-order", (0.0, 1.0)),
    ],
)
def test_a_torque_is_held_as_its_channel_says_or_else_as_the_section_does(
    tmp_path: Path, log: dict[str, np.ndarray], section: Any, first: Any, second: Any, held: tuple[float, ...]
) -> None:
    """Y = G H U with H = 1 for a measured current, and the half sample and sinc of the rate for a command."""
    save_csv(tmp_path / "log.csv", log)
    channels = (replace(FIRST, hold=first), replace(SECOND, hold=second), *MOTIONS)
    record = measured(tmp_path, study_of("log.csv", channels, hold=section))
    freq_hz = np.array([RATE / 10])
    expected = np.sinc(0.1 * np.array(held)) * np.exp(-0.1j * np.pi * np.array(held))
    np.testing.assert_allclose(record.hold_response(freq_hz), [expected], rtol=1e-12)


def test_hold_is_a_key_of_torques_that_act() -> None:
    """Not of motions, nor of the reference, on which no response depends."""
    for channel in (MOTIONS[0], ChannelSpec("r", "motor 1", "r1")):
        with pytest.raises(ValueError, match=r"hold is of an acting torque \(role u\).*leave it out"):
            replace(channel, hold="zero-order")


def _notes(r: np.ndarray, u: np.ndarray, N: int | None = N) -> list[str]:
    channels = ChannelSpec("r", "motor 1", "r"), ChannelSpec("u", "motor 1", "u")
    return [note.code for note in drive_notes(channels, np.stack([r, u], axis=1), N, "record a")]


@pytest.mark.parametrize("step", [1, 2, 3])
@pytest.mark.parametrize("periodic", [True, False])
def test_a_mirrored_motor_is_named_whatever_the_lines(step: int, periodic: bool) -> None:
    """Odd lines too, where minus the signal is half a period of delay."""
    lines = np.arange(step, 60, 2 * step)
    phases = np.exp(2j * np.pi * np.random.default_rng(3).random((len(lines), 1)))
    x = np.tile(synthesise(lines, phases, N)[:, 0], 4)
    assert _notes(x, -x + 0.0, N if periodic else None) == ["records/torque"]
    assert _notes(x, 0.9 * x, N if periodic else None) == []


@pytest.mark.parametrize("step", [1, 2, 4])
@pytest.mark.parametrize("sign", [1, -1])
def test_feedback_that_turns_the_phase_mirrors_nothing(step: int, sign: int) -> None:
    """U = s^2 / (s^2 + 2 zeta w s + w^2) R of a stiff loop leads, as lines 3, 7, 11 do a quarter of a period late."""
    lines = np.arange(3, 80, step)
    ratio = 1j * lines / 15.0
    feedback = ratio**2 / (1 + 0.8 * ratio + ratio**2)
    for seed in range(10):
        phases = np.exp(2j * np.pi * np.random.default_rng(seed).random((len(lines), 1)))
        r, u = (np.tile(synthesise(lines, U, 400)[:, 0], 3) for U in (phases, phases * feedback[:, None]))
        assert _notes(r, sign * u, 400) == ([] if sign > 0 else ["records/torque"])


def _same_signal_notes(tmp_path: Path, log: dict[str, np.ndarray], second_current: str) -> list[str]:
    save_csv(tmp_path / "log.csv", log)
    channels = with_names({"i1": "i1", "i2": second_current, "phi": "phi", "w2": "w2"})
    notes = said(measured(tmp_path, study_of("log.csv", channels)).notes)
    return [note for note in notes if "holds the samples of" in note]


def test_a_signal_that_was_logged_twice_is_named(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """A factor and an offset do not hide it; a part in a thousand of its own makes it another signal."""
    assert len(_same_signal_notes(tmp_path, log | {"i2": 7.0 - 2.5 * log["i1"]}, "i2")) == 1
    own = log["i1"] + 1e-3 * log["i2"]
    assert _same_signal_notes(tmp_path, log | {"i2": own}, "i2") == []
    # Two dead currents are equal, and no copy of each other.
    assert _same_signal_notes(tmp_path, log | {"i2": np.full_like(log["i1"], 3.0)}, "i2") == []


SHAKER = (
    ChannelSpec("u", "shaker", "u", quantity="force", unit="N"),
    ChannelSpec("y", "tip", "y", quantity="acceleration", unit="m/s^2"),
)
PULSES = ChannelSpec("d", "shaker", "d", quantity="force", unit="N", sign=-1)
SPEC = EstimatorSpec(method="arithmetic", quantity="acceleration", lines="excited")


def shaken(folder: Path, channels: tuple[ChannelSpec, ...]) -> np.ndarray:
    """|G| relative std (F,) of a structure that is shaken periodically, and struck by pulses that do not repeat."""
    rng, n, periods = np.random.default_rng(5), 250, 8
    lines = np.arange(4, 80, 5)
    angle = rng.uniform(0, 2 * np.pi, len(lines))
    u = np.tile(np.cos(2 * np.pi * np.outer(np.arange(n), lines) / n + angle).sum(axis=1), periods)
    d = np.zeros(periods * n)
    for start, width in zip(rng.integers(0, periods * n, 12), rng.integers(1, 6, 12), strict=True):
        d[start : start + width] = 5.0
    y = lfilter([0, 1, 0.5], [1, -0.9, 0.5], np.tile(u[:n], periods + 1) + np.append(np.zeros(n), d))[n:]
    y += 0.01 * rng.standard_normal(len(y))
    rows = "\n".join(f"{a:.12g},{-b:.12g},{c:.12g}" for a, b, c in zip(u, d, y, strict=True))
    (folder / "log.csv").write_text(f"u,d,y\n{rows}\n")
    recorded = RecordedSpec(100.0, channels, (FileSpec("log.csv", "bench"),), period_samples=n)
    rig = RecordedRig(Structure.from_channels(channels), ExperimentSpec({"bench": ()}, recorded=recorded), folder)
    record = rig.measure(rig.experiments[0])
    if PULSES in channels:
        np.testing.assert_allclose(record.u[:, 0], u + d, atol=1e-9)
        assert said(record.notes) == ()
    noise = estimate([record], SPEC).noise
    return np.sqrt(noise.variance[:, 0, 0])


def test_pulses_that_are_known_are_no_noise_of_a_response(tmp_path: Path) -> None:
    """Pulses of one to five samples, none taken for a spike: the std of G is that of the sensor, a tenth and less."""
    known, unknown = shaken(tmp_path, (*SHAKER, PULSES)), shaken(tmp_path, SHAKER)
    assert np.median(unknown / known) > 10
    # Noise of 0.01 in 2000 samples, lines of amplitude 1.
    assert np.median(known) == pytest.approx(0.01 * np.sqrt(4 / 2000), rel=0.5)


def pushed(folder: Path, with_pulses: bool) -> tuple[float, float, float]:
    """Coulomb and viscous friction, and the share of the torque that is left, of an axis pushed by known pulses."""
    q = trapezoids([0.2, 0.5, 0.35])
    d = np.zeros(len(q))
    for start in range(300, len(q) - 300, 700):
        d[start : start + 150] = 40.0
    u = sliding_torque(q) - d
    rows = "\n".join(f"{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(u, q, d, strict=True))
    (folder / "log.csv").write_text(f"u,q,d\n{rows}\n")
    channels = (ChannelSpec("u", "motor 1", "u"), ChannelSpec("y", "motor 1", "q", quantity="position"))
    known = (ChannelSpec("d", "motor 1", "d"),) if with_pulses else ()
    measured = read_friction_logs(
        friction_logs.ROBOT, logs(FileSpec("log.csv"), channels=(*channels, *known)), folder, ["1"], {}
    )
    (record,) = measured.records
    if with_pulses:
        np.testing.assert_allclose(record.torque, u + d, atol=1e-6)
        np.testing.assert_allclose(record.disturbance, d)
    else:
        assert record.disturbance is None
    motion = find_joint_levels(friction_logs.ROBOT, friction_logs.ROBOT.driven, measured)[0].motion
    return motion.chosen["coulomb"], motion.chosen["viscous"], motion.chosen.relative_error


def test_pulses_that_are_known_are_no_friction(tmp_path: Path) -> None:
    """As those of a prismatic axis on which a second actuator pushes."""
    coulomb, viscous, left = pushed(tmp_path, with_pulses=True)
    assert coulomb == pytest.approx(COULOMB, rel=0.05)
    assert viscous == pytest.approx(VISCOUS, rel=0.1)
    assert left < 0.03
    assert pushed(tmp_path, with_pulses=False)[2] > 10 * left


def test_a_reference_without_a_controller_is_a_note(tmp_path: Path) -> None:
    q = trapezoids([0.2, 0.5])
    rows = "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(sliding_torque(q), q, strict=True))
    (tmp_path / "log.csv").write_text(f"u,q\n{rows}\n")
    places = [("u", "u", "torque"), ("y", "q", "position"), ("reference", "q", "position")]
    channels = tuple(ChannelSpec(role, "motor 1", name, quantity=what) for role, name, what in places)  # type: ignore[arg-type]
    (record,) = read_friction_logs(
        friction_logs.ROBOT, logs(FileSpec("log.csv"), channels=channels), tmp_path, ["1"], {}
    ).records
    assert [(note.code, note.severity) for note in record.notes] == [("records/unused-reference", "information")]
    assert record.rate_hz == friction_logs.RATE


@pytest.mark.parametrize("at", ["joint 1", "body arm z"])
def test_a_disturbance_behind_the_motor_is_refused(at: str, tmp_path: Path) -> None:
    robot = "bodies: [{name: arm, joints: [{name: 1, axis: z, motor: {inertia: 1e-3, ratio: 50}}], inertia: 1}]"
    (tmp_path / "robot.yml").write_text(f"name: one\n{robot}\n")
    np.savetxt(tmp_path / "log.csv", np.random.default_rng(0).standard_normal((300, 3)), header="u,q,d", comments="")
    (tmp_path / "study.yml").write_text(
        "name: pushed\nrobot: robot.yml\nfriction: {passes: detect}\nexperiment:\n  recorded:\n    rate_hz: 100\n"
        "    channels:\n      - {role: u, at: motor 1, channel: u}\n"
        "      - {role: y, at: motor 1, channel: q, quantity: position}\n"
        f"      - {{role: d, at: {at}, channel: d}}\n    files:\n      - {{path: log.csv}}\n"
    )
    with pytest.raises(StudyError) as refused:
        load(tmp_path / "study.yml")
    assert "study.yml:10:" in str(refused.value)
