"""The recorded rig: any file format, faults of a log in one message, held torques and known disturbances."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants import friction_logs
from plants.friction_logs import logs, sliding_torque, trapezoids
from plants.lab_logs import CHANNELS, RATE, ROBOT, N, Signals, U, Y, measured, record_of, save_csv, study_of, write_csv
from plants.notes import noted
from plants.refusals import refused

from elastid.excitation.multisine import synthesise
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.logs.friction_logs import read_friction_logs
from elastid.logs.repair import LogReport
from elastid.logs.rig import RecordedRig
from elastid.logs.units_and_sides import UNWRAPPED, link_side, report_drives


@settings(max_examples=25, deadline=None)
@given(bits=st.sampled_from([0, 8, 12, 16]), speed=st.floats(0.01, 0.04), seed=st.integers(0, 99))
def test_an_encoder_that_starts_again_after_a_turn_is_unwrapped(bits: int, speed: float, seed: int) -> None:
    """Angle modulo 360 deg, or a counter modulo 2^bits, on the motor side: the same motion, with a note."""
    turn = 2.0**bits if bits else 360.0
    steps = speed * turn * (1 + np.random.default_rng(seed).uniform(-0.9, 0.9, 400))
    path = np.cumsum(np.round(steps) if bits else steps)
    path[17] = np.nan
    channel = replace(Y, unit="", scale=1e-3) if bits else Y
    log = LogReport("log", ())
    whole = link_side(channel, path, ROBOT, log)
    assert not log.findings.notes
    unwrap = link_side(channel, np.mod(path, turn), ROBOT, log)
    np.testing.assert_allclose(unwrap - unwrap[0], whole - whole[0], atol=1e-9 * np.nanmax(np.abs(whole)))
    assert [note.code for note in log.findings.notes] == [UNWRAPPED]
    jumping, at_rest = np.random.default_rng(seed).uniform(0, turn, 400), np.full(400, turn / 2)
    left, unit = (link_side(channel, x, ROBOT, log) for x in (jumping, at_rest))
    np.testing.assert_allclose(left, jumping * unit / at_rest, rtol=1e-12)


def test_constant_input_is_taken_as_not_excited(tmp_path: Path, log: Signals) -> None:
    """One motor at a time is a lawful experiment; the estimator judges all of them together."""
    (note,) = record_of(tmp_path, log | {"i2": np.full(800, 0.5)}).notes
    assert noted(note) == ("records/input-not-excited", "record home-r0-e0", [2, 2, 0.5])


def test_incomplete_last_period_is_discarded_with_note(tmp_path: Path, log: Signals) -> None:
    """780 samples are 3 periods of 200 and 180 more; also when a window of the file is asked for."""
    save_csv(tmp_path / "log.csv", {k: v[:780] for k, v in log.items()})
    record = measured(tmp_path, study_of("log.csv"))
    assert record.n_samples == 600
    assert noted(record.notes[0]) == ("records/corrected", "record home-r0-e0", [180, 780, 200])
    window = study_of("log.csv", files=(FileSpec("log.csv", "home", samples=(30, 450)),))
    record = measured(tmp_path, window)
    assert record.n_samples == 400
    np.testing.assert_allclose(record.u[0, 0], -log["i2"][30] * 0.5e-3)


@pytest.mark.parametrize(
    ("channel", "change", "code", "holds"),
    [
        ("", lambda x: x[:1], "values", "one row"),  # and not each channel as constant
        ("w2", lambda x: 0 * x + 0.25, "values", "w2"),
        ("w2", lambda x: np.nan * x, "values", "w2"),
        ("w2", lambda x: 1e-300 * x, "values", "w2"),  # too small to compute with
        ("i1", lambda x: np.where(np.arange(len(x)) % 7, np.nan, x), "missing-samples", "85.6%"),
    ],
)
def test_one_row_dead_sensor_and_empty_torque_are_refused(
    channel: str, change: Callable[..., Any], code: str, holds: str, tmp_path: Path, log: Signals
) -> None:
    """A torque that is mostly missing is not said to be without a period."""
    with refused(f"records/{code}", place="log.csv", holds=holds):
        record_of(tmp_path, {name: change(x) if channel in ("", name) else x for name, x in log.items()})


def test_a_motor_side_without_a_gear_is_refused(tmp_path: Path, log: Signals) -> None:
    write_csv(tmp_path, log)
    with refused("study/recorded", holds=("side: motor", "body arm z")):
        measured(tmp_path, study_of("log.csv", channels=(U, replace(Y, at="body arm z"))))


def test_logs_of_two_amplitudes_are_configurations_of_one_posture(tmp_path: Path, log: Signals) -> None:
    """The level of a file makes a response of its own, at the same angles."""
    write_csv(tmp_path, log)
    rig = RecordedRig(
        ROBOT, study_of("log.csv", files=[FileSpec("log.csv", "home", amplitude=i) for i in (1, 2)]), tmp_path
    )
    first, second = (rig.measure(experiment) for experiment in rig.experiments)
    assert (first.configuration.name, second.configuration.name) == ("home", "home amplitude 2")
    np.testing.assert_array_equal(second.configuration.angles, first.configuration.angles)
    np.testing.assert_array_equal(second.u, first.u)


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
def test_hold_of_channel_outranks_hold_of_section(
    tmp_path: Path, log: Signals, section: Any, first: Any, second: Any, held: tuple[float, ...]
) -> None:
    """Y = G H U with H = 1 for a measured current, and the half sample and sinc of the rate for a command."""
    save_csv(tmp_path / "log.csv", log)
    channels = (replace(FIRST, hold=first), replace(SECOND, hold=second), *MOTIONS)
    record = measured(tmp_path, study_of("log.csv", channels, hold=section))
    freq_hz = np.array([RATE / 10])
    expected = np.sinc(0.1 * np.array(held)) * np.exp(-0.1j * np.pi * np.array(held))
    np.testing.assert_allclose(record.hold_response(freq_hz), [expected], rtol=1e-12)


def _notes(r: np.ndarray, u: np.ndarray, N: int | None = N) -> list[str]:
    channels = ChannelSpec("r", "motor 1", "r"), ChannelSpec("u", "motor 1", "u")
    log = LogReport("log", ())
    report_drives(channels, np.stack([r, u], axis=1), N, log)
    return [note.code for note in log.findings.notes]


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


@pytest.mark.parametrize(
    ("second", "places"),
    [
        (lambda one, two: 7.0 - 2.5 * one, ["record home-r0-e0"]),  # neither a factor nor an offset hides it
        (lambda one, two: one + 1e-3 * two, []),  # a part in a thousand of its own
        (lambda one, two: np.full_like(one, 3.0), []),  # a dead current
    ],
)
def test_a_signal_that_was_logged_twice_is_named(
    second: Callable[..., np.ndarray], places: list[str], tmp_path: Path, log: Signals
) -> None:
    notes = record_of(tmp_path, log | {"i2": second(log["i1"], log["i2"])}).notes
    named = [note.place for note in notes if note.code == "records/same-signal" and {"i1", "i2"} < {*note.text.split()}]
    assert named == places


@pytest.mark.parametrize("sign", [1, -1])
def test_pulses_that_are_known_act_with_the_torque(sign: Any, tmp_path: Path) -> None:
    """Of one to five samples, none taken for a spike: in records of a response, and of friction."""
    rng, n, periods = np.random.default_rng(5), 250, 8
    lines = np.arange(4, 80, 5)
    spectra = np.exp(2j * np.pi * rng.random((len(lines), 2)))
    u, q = np.tile(synthesise(lines, spectra, n), (periods, 1)).T
    d = np.zeros(periods * n)
    for start, width in zip(rng.integers(0, periods * n, 12), rng.integers(1, 6, 12), strict=True):
        d[start : start + width] = 5.0
    np.savetxt(tmp_path / "log.csv", np.stack([u, q, d], axis=1), delimiter=",", header="u,q,d", comments="")
    channels = (
        ChannelSpec("u", "motor 1", "u"),
        ChannelSpec("y", "motor 1", "q", quantity="position"),
        ChannelSpec("d", "motor 1", "d", sign=sign),
    )
    recorded = RecordedSpec(100.0, channels, (FileSpec("log.csv", "home"),), period_samples=n)
    rig = RecordedRig(friction_logs.ROBOT, ExperimentSpec({"home": (0.0,)}, recorded=recorded), tmp_path)
    record = rig.measure(rig.experiments[0])
    np.testing.assert_allclose(record.u[:, 0], u + sign * d, atol=1e-9)
    assert record.notes == ()
    spec = logs(FileSpec("log.csv"), channels=channels)
    (of_friction,) = read_friction_logs(friction_logs.ROBOT, spec, tmp_path, ["1"], {}).records
    np.testing.assert_allclose(of_friction.torque, u + sign * d, atol=1e-9)
    np.testing.assert_allclose(of_friction.disturbance, sign * d, atol=1e-9)


def test_a_reference_without_a_controller_is_a_note(tmp_path: Path) -> None:
    q = trapezoids([0.2, 0.5])
    rows = "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(sliding_torque(q), q, strict=True))
    (tmp_path / "log.csv").write_text(f"u,q\n{rows}\n")
    places = [("u", "u", "torque"), ("y", "q", "position"), ("reference", "q", "position")]
    channels = tuple(ChannelSpec(role, "motor 1", name, quantity=what) for role, name, what in places)
    (record,) = read_friction_logs(
        friction_logs.ROBOT, logs(FileSpec("log.csv"), channels=channels), tmp_path, ["1"], {}
    ).records
    assert [(note.code, note.severity) for note in record.notes] == [("records/unused-reference", "information")]
    assert record.rate_hz == friction_logs.RATE


def test_stated_delay_and_low_pass_of_a_torque_are_corrected(tmp_path: Path, log: Signals) -> None:
    """A current that is three samples late has the spectrum of the current itself; role r has no such keys."""
    late = {"i2": np.roll(log["i2"], 3)}
    save_csv(tmp_path / "log.csv", log)
    save_csv(tmp_path / "late.csv", log | late)
    channels = tuple(replace(c, delay=3 / RATE) if c.channel == "i2" else c for c in CHANNELS)
    clean, corrected = (
        measured(tmp_path, study_of(name, channels=each)).u[N : 2 * N]
        for name, each in (("log.csv", CHANNELS), ("late.csv", channels))
    )
    lines = np.arange(3, 60, 2)
    spectra = [np.fft.rfft(u, axis=0)[lines] for u in (clean, corrected)]
    np.testing.assert_allclose(spectra[1], spectra[0], atol=1e-3 * np.abs(spectra[0]).max())
    with pytest.raises(ValueError, match="delay"):
        replace(CHANNELS[0], role="r", delay=1e-3)
