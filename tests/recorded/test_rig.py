"""The recorded rig: one experiment read from every file format, and what is wrong with a log said in one message."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.lab_logs import (
    CHANNELS,
    RATE,
    RATIO,
    ROBOT,
    N,
    P,
    U,
    Y,
    measured,
    save_csv,
    study_of,
    write_csv,
    write_hdf5,
    write_matlab,
    write_matlab_73,
)
from plants.notes import said
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, TextFormatSpec
from elastid.recorded.link_side import UNWRAPPED
from elastid.recorded.rig import RecordedRig


def _write_csv_with_a_delimiter_at_every_end(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    save_csv(base / "log.csv", log)
    lines = (base / "log.csv").read_text().splitlines()
    (base / "log.csv").write_text("\r\n".join([lines[0], "", *(f"{line}," for line in lines[1:])]))
    return study_of("log.csv")


def _write_german_csv(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    save_csv(base / "log.txt", log, ";", comma=True, head="Messung 7\n3 Achsen\n")
    return study_of("log.txt", text=TextFormatSpec(";", ",", header_lines=3))


def _write_commented_table(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    np.savetxt(base / "log.dat", np.stack(list(log.values()), axis=1), fmt="%.17g", header="a b c d")
    columns = {"i1": 1, "i2": 2, "phi": 3, "w2": 4}
    channels = tuple(replace(c, channel="", column=columns[c.channel]) for c in CHANNELS)
    return study_of("log.dat", channels, text=TextFormatSpec("whitespace"))


def _write_tab_table_with_units(base: Path, log: dict[str, np.ndarray]) -> ExperimentSpec:
    stamped = ["\t".join(["12:30:01", *(f"{v:.17g}" for v in row), "ok"]) for row in zip(*log.values(), strict=True)]
    (base / "log.tsv").write_text("\n".join(["time\ti1\ti2\tphi\tw2\tstate", "\tmA\tmA\tdeg\trad/s\t", *stamped]))
    return study_of("log.tsv", text=TextFormatSpec("tab"))


WRITERS = [
    write_matlab,
    write_matlab_73,
    write_hdf5,
    write_csv,
    _write_csv_with_a_delimiter_at_every_end,
    _write_german_csv,
    _write_commented_table,
    _write_tab_table_with_units,
]


@pytest.mark.parametrize("write", WRITERS)
def test_every_format_gives_the_same_record_in_si_on_the_link_side(
    write: Callable[[Path, dict[str, np.ndarray]], ExperimentSpec], tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Current * constant * ratio, motor angle / ratio (which is negative), signs, scales, units, order of channels."""
    record = measured(tmp_path, write(tmp_path, log))
    assert record.inputs == ("motor 2", "motor 1")
    assert record.outputs == ("motor 1", "joint 2")
    assert record.quantities == ("position", "velocity")
    expected_u = np.stack([-log["i2"] * 1e-3 * 0.5, log["i1"] * 1e-3 * 0.5 * RATIO], axis=1)
    expected_y = np.stack([np.radians(log["phi"]) / RATIO, 0.1 * log["w2"]], axis=1)
    np.testing.assert_allclose(record.u, expected_u, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(record.y, expected_y, rtol=1e-12, atol=1e-15)
    assert (record.rate_hz, record.period_samples, record.n_periods) == (RATE, N, P)
    assert record.rate_is_known
    assert said(record.notes) == ()


def test_reference_torques_are_put_in_the_order_of_the_inputs(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """r is listed motor 1 first, u motor 2 first."""
    save_csv(tmp_path / "log.csv", log)
    r = (ChannelSpec("r", "motor 1", "i1"), ChannelSpec("r", "motor 2", "i2"))
    record = measured(tmp_path, study_of("log.csv", (*r, *CHANNELS)))
    assert record.r is not None
    np.testing.assert_allclose(record.r, np.stack([log["i2"], log["i1"]], axis=1), rtol=1e-12)


def test_an_encoder_that_starts_again_after_a_turn_is_unwrapped(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Angle modulo 360 deg on the motor side gives the same motion, with a word; its mean turns are lost."""
    save_csv(tmp_path / "whole.csv", log)
    save_csv(tmp_path / "wrapped.csv", log | {"phi": np.mod(log["phi"], 360.0)})
    whole, wrapped = (measured(tmp_path, study_of(f"{name}.csv")) for name in ("whole", "wrapped"))
    np.testing.assert_allclose(wrapped.y[:, 0] - wrapped.y[0, 0], whole.y[:, 0] - whole.y[0, 0], atol=1e-12)
    assert [note.code for note in wrapped.notes] == [UNWRAPPED]


def test_a_counter_of_a_few_bits_is_counted_on(tmp_path: Path, log: dict[str, np.ndarray]) -> None:
    """Counts of 0.01 deg, in 13 bits or in all; a counter that loses 6000 counts once is none that starts again."""
    counts = np.round(100 * log["phi"])
    assert np.ptp(counts) > 2**13 > 4 * np.abs(np.diff(counts)).max()
    channels = tuple(replace(c, scale=0.01) if c.channel == "phi" else c for c in CHANNELS)
    kept = {}
    lost = np.where(np.arange(len(counts)) == 500, 6000, 0)
    for name, phi in {"whole": counts, "bits": counts % 2**13, "lost": counts + np.cumsum(lost)}.items():
        save_csv(tmp_path / f"{name}.csv", log | {"phi": phi})
        kept[name] = measured(tmp_path, study_of(f"{name}.csv", channels))
    np.testing.assert_allclose(np.ptp(kept["bits"].y[:, 0] - kept["whole"].y[:, 0]), 0, atol=1e-12)
    assert UNWRAPPED in [note.code for note in kept["bits"].notes]
    assert UNWRAPPED not in [note.code for note in kept["lost"].notes]


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
        ({"channels": (U, replace(Y, at="body arm z"))}, ("side: motor", "body arm z")),
        ({"channels": (U, replace(Y, unit="N*m"))}, ("phi", "N*m")),
        ({"channels": (U, Y, replace(Y, channel="w2"))}, "motor 1"),
        ({"channels": (U, Y, ChannelSpec("r", "motor 2", "i2"))}, "motor 2"),
        ({"period_samples": 201, "half_wave": True}, ("half_wave", "201")),
    ],
)
def test_a_study_that_does_not_fit_robot_or_files_is_refused_before_anything_is_read(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    """Each with the name at fault and what there is."""
    (tmp_path / "log.csv").write_text("nothing is read")
    with refused("files/missing", "study/recorded", holds=message):
        RecordedRig(ROBOT, study_of("log.csv", **changes), tmp_path)


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
    with pytest.raises(ValueError, match="amplitudes are numbered from 1"):
        FileSpec("log.csv", "home", level=0)
