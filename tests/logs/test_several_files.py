"""One excitation in several files: the estimate of one long log. A stranger's HDF5 file reads no other file."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from plants.refusals import refused
from scipy.signal import freqz, lfilter

from elastid.experiment.specs.channels import ChannelSpec, Structure
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec, TextFormatSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.logs.files.formats import contents
from elastid.logs.repeated_logs import join_periods
from elastid.logs.rig import RecordedRig
from elastid.record import Record
from elastid.response import Response
from elastid.store.description import describe_artefact

N, RATE = 240, 100.0
LINES = np.arange(5, 81, 4)
# A resonance of 12 Hz with 2 % of damping: its transient takes four periods to vanish.
POLE = np.exp((-0.02 + 1j) * 2 * np.pi * 12 / RATE)
B, A = [0.0, 1.0, 0.5], np.poly([POLE, POLE.conj()]).real
CHANNELS = (
    ChannelSpec("u", "shaker", "force", quantity="force", unit="N"),
    ChannelSpec("y", "tip", "acceleration", quantity="acceleration", unit="m/s^2"),
)
SPEC = EstimatorSpec(method="arithmetic", quantity="acceleration", lines="excited")


def multisine(phases: int = 0) -> np.ndarray:
    """One period (N,) of unit rms; phases: seed of them."""
    angle = np.random.default_rng(phases).uniform(0, 2 * np.pi, len(LINES))
    x = np.cos(2 * np.pi * np.outer(np.arange(N), LINES) / N + angle).sum(axis=1)
    return x / x.std()


def run(samples: int, seed: int, first: int = 0, at_rest: bool = False) -> np.ndarray:
    """Force and acceleration (samples, 2) from a sample of the excitation on; at_rest: the structure is before."""
    force = np.take(multisine(), np.arange(first - 40 * N, first + samples), mode="wrap")
    if at_rest:
        force[: 40 * N] = 0.0
    moved = lfilter(B, A, force)[40 * N :]
    noisy = moved + 0.05 * np.random.default_rng(seed).standard_normal(samples)
    return np.stack([force[40 * N :], noisy], axis=1)


def study(folder: Path, logs: Sequence[np.ndarray], **keys: Any) -> RecordedRig:
    """The rig of some logs of one experiment."""
    for i, log in enumerate(logs):
        rows = "\n".join(f"{a:.17g},{b:.17g}" for a, b in log)
        (folder / f"log_{i}.csv").write_text(f"force,acceleration\n{rows}\n")
    files = tuple(FileSpec(f"log_{i}.csv", "bench") for i in range(len(logs)))
    recorded = RecordedSpec(**({"rate_hz": RATE, "channels": CHANNELS, "files": files, "period_samples": N} | keys))
    return RecordedRig(Structure.from_channels(CHANNELS), ExperimentSpec({"bench": ()}, recorded=recorded), folder)


def record_of(folder: Path, logs: Sequence[np.ndarray], **keys: Any) -> Record:
    rig = study(folder, logs, **keys)
    (experiment,) = rig.experiments
    return rig.measure(experiment)


def errors(response: Response) -> tuple[np.ndarray, np.ndarray]:
    """|error|^2 (F,) of G, and its stated variance."""
    _, truth = freqz(B, A, response.freq_hz, fs=RATE)
    return np.abs(response.G[:, 0, 0] - truth) ** 2, response.noise.variance[:, 0, 0]


@pytest.mark.parametrize("periods", [1, 2, 4])
def test_a_log_that_was_split_is_the_log(periods: int, tmp_path: Path) -> None:
    """Twelve periods in files of one, two or four: the same response, the same variance, to rounding."""
    whole = run(12 * N, seed=1)
    (tmp_path / "whole").mkdir()
    long = estimate([record_of(tmp_path / "whole", [whole])], SPEC)
    join_pieces = record_of(tmp_path, np.split(whole, 12 // periods))
    assert join_pieces.starts == tuple(range(periods, 12, periods))
    parts = estimate([join_pieces], SPEC)
    np.testing.assert_allclose(parts.G, long.G, rtol=1e-9)
    np.testing.assert_allclose(parts.noise.variance, long.noise.variance, rtol=1e-6)


def test_channels_at_two_rates_need_them_stated(tmp_path: Path) -> None:
    """As topics of a bag, or arrays of one file: brought to the lower rate once a channel states its own."""
    signals, files = run(8 * N, 1), (FileSpec("log.npz", "bench"),)
    np.savez(tmp_path / "log.npz", force=signals[:, 0], acceleration=signals[::2, 1])
    with refused("records/channels", holds=("force 1920, acceleration 960", "rate_hz")):
        record_of(tmp_path, [], files=files)
    slow = record_of(tmp_path, [], files=files, channels=(CHANNELS[0], replace(CHANNELS[1], rate_hz=RATE / 2)))
    assert (slow.rate_hz, slow.n_periods) == (RATE / 2, 8)
    spectra = (np.fft.rfft(x)[8 * LINES[LINES < N / 5]] / len(x) for x in (slow.u[:, 0], signals[:, 0]))
    np.testing.assert_allclose(*spectra, rtol=1e-3)


def test_logs_of_any_start_are_aligned(tmp_path: Path) -> None:
    """Each loses the part before its first whole period; a lone period is turned."""
    logs = [run(3 * N, 1), run(3 * N + 50, 2, first=77), run(N, 3, first=191)]
    join_pieces = record_of(tmp_path, logs)
    assert join_pieces.n_periods == 3 + 2 + 1
    np.testing.assert_allclose(join_pieces.u[:, 0], np.tile(join_pieces.u[:N, 0], 6), atol=1e-9)
    assert "3 logs: 3 of log_0.csv, 2 of log_1.csv, 1 of log_2.csv" in str(join_pieces.notes)


def test_every_start_has_a_transient_of_its_own(tmp_path: Path) -> None:
    """Four logs of ten periods from rest, 5 draws: errors are as large as stated."""
    ratio = []
    for seed in range(5):
        logs = [run(10 * N, 10 * seed + i, at_rest=True) for i in range(4)]
        error, variance = errors(estimate([record_of(tmp_path, logs)], SPEC))
        ratio.append(error / variance)
    # 5 draws of 19 lines, complex: std 0.1.
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.3)


def test_a_local_method_takes_each_log_as_a_repeat(tmp_path: Path) -> None:
    """The same as four experiments with the same phases."""
    logs = [run(5 * N, i, at_rest=True) for i in range(4)]
    files = tuple(FileSpec(f"log_{i}.csv", "bench", experiment=i) for i in range(4))
    apart = study(tmp_path, logs, files=files)
    spec = replace(SPEC, method="local_rational")
    responses = [
        estimate([record_of(tmp_path, logs)], spec),
        estimate([apart.measure(experiment) for experiment in apart.experiments], spec),
    ]
    np.testing.assert_allclose(responses[0].G, responses[1].G, rtol=1e-9)


def test_another_excitation_is_refused_with_both_files(tmp_path: Path) -> None:
    """Of other phases, in a third of its power where two periods show the noise, or of another period."""
    third = np.tile(0.82 * multisine() + 0.57 * multisine(7), 2)
    found = {"period_samples": None, "period": "find"}
    for torque, first, holds, keys in (
        (third, 2 * N, "log_1.csv", {}),
        (np.tile(multisine(7), 4), 4 * N, "log_1.csv", {}),
        (np.tile(multisine(3)[: N - 20], 4), 4 * N, ("240", "220", "100"), found),
    ):
        with refused("records/inconsistent", holds=holds):
            record_of(tmp_path, [run(first, 1), torque[:, None] * [1.0, 0.3]], **keys)


def test_a_clean_pair_of_logs_is_never_refused(tmp_path: Path) -> None:
    """300 pairs of torques with noise of up to 0.6 of the excitation, of one to four periods."""
    (tmp_path / "a").mkdir()
    template = record_of(tmp_path / "a", [run(4 * N, 1)])
    rng = np.random.default_rng(4)
    for _ in range(300):
        pair = []
        for periods in rng.integers(1, 5, 2):
            u = np.roll(np.tile(multisine(), periods), int(rng.integers(N)))
            noise = rng.uniform(0, 0.6) * rng.standard_normal(len(u))
            pair.append(replace(template, u=(u + noise)[:, None], y=u[:, None]))
        assert join_periods(pair, ["a.csv", "b.csv"]).n_periods >= 2


@pytest.mark.parametrize("gain", [0.5, 0.88, 0.92, 1.08, 1.12, 2.0])
@pytest.mark.parametrize("unit", [1e-4, 1e4])
def test_different_excitation_is_refused_above_a_tenth(gain: float, unit: float, tmp_path: Path) -> None:
    """In any unit: friction that warms up changes torques by a few per cent."""
    template = record_of(tmp_path, [run(4 * N, 1)])
    first, second = (replace(template, u=size * unit * template.u) for size in (1.0, gain))
    with refused("records/inconsistent") if abs(gain - 1) > 0.1 else nullcontext():
        join_periods([first, second], ["a.csv", "b.csv"])


def test_periods_that_a_log_lacks_are_left_out_of_all(tmp_path: Path) -> None:
    """The first and the third of one log; two of another, since its fourth begins within a period of the first log."""
    logs = [run(4 * N, 1), run(5 * N + 50, 2, first=77)]
    for log, start in ((logs[0], 10), (logs[0], 2 * N + 10), (logs[1], 3 * N)):
        log[start : start + 60] = np.nan
    assert record_of(tmp_path, logs).discarded_periods == (0, 2, 4 + 2, 4 + 3)


def test_a_file_that_reaches_out_is_refused(tmp_path: Path) -> None:
    """As a log, and as a file that claims to be a result of elastid."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.attrs["elastid"] = "frf"
        file["g/a"] = h5py.ExternalLink("secret", "/a")
    for read in (partial(contents, text=TextFormatSpec()), describe_artefact):
        with refused("files/unsafe"):
            read(tmp_path / "log.h5")


def test_links_inside_a_file_are_followed(tmp_path: Path) -> None:
    """A second name of a signal is one; a link that leads nowhere is none."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["axis/torque"] = np.arange(5.0)
        file["torque"], file["gone"] = h5py.SoftLink("/axis/torque"), h5py.SoftLink("/nowhere")
    assert contents(tmp_path / "log.h5", TextFormatSpec()) == {"axis/torque": (5,), "torque": (5,)}
