"""Torques and positions logged by two recorders that started at unknown times; references as instruments."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from plants.elastic_arm import CONFIGURATIONS, arm
from plants.marks import slow
from plants.measured_robots import R, U, Y, deviation, responses_of
from plants.refusals import refused

from elastid.app.cli import run_command
from elastid.base.arrays import FloatArray
from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.fit.identify import fit_parameters
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.logs.rig import RecordedRig
from elastid.record import Record

RATE, N = 500.0, 1000
LINES = np.arange(5, 120, 2)
FURTHER = tuple(replace(channel, file=2) for channel in (*Y, *R))


def started(x: FloatArray, late: float) -> FloatArray:
    """Periods of a signal (P N, c), each from `late` samples after its first sample on."""
    turn = np.exp(2j * np.pi * np.fft.rfftfreq(N) * late)[:, None]
    return np.fft.irfft(turn * np.fft.rfft(x.reshape(-1, N, x.shape[1]), axis=1), N, axis=1).reshape(x.shape)


def measured(
    folder: Path,
    channels: tuple[ChannelSpec, ...],
    noise: float = 0.0,
    size: tuple[int, int] = (4, 2),
    gain: float = 0.0,
) -> tuple[list[Record], FloatArray]:
    """Records of (periods, realisations), and the samples by which the second file of each started late.

    noise: of a torque on the motors, over the excitation, anew in each period.  gain: of closed loops of 4 Hz.
    """
    rng, f, late, files = np.random.default_rng(0), LINES * RATE / N, [], []
    for p, response in enumerate(responses_of(arm(), CONFIGURATIONS, None, f)):
        G = response.G / (2j * np.pi * f[:, None, None]) ** 2
        S = np.linalg.inv(np.eye(2) + gain * (2e4 + 2e3 * 2j * np.pi * f)[:, None, None] * G)
        sets = [orthogonal_set(np.full((len(f), 2), 10.0), rng) for _ in range(size[1])]
        for m, e in np.ndindex(size[1], 2):
            reference = sets[m][e]
            D = noise * 10 * (rng.normal(size=(size[0], len(f), 2, 2)) @ [1, 1j]) / np.sqrt(2)
            acting = np.einsum("fij,pfj->pfi", S, reference + D)
            spectra = acting - D, np.einsum("fij,pfj->pfi", G, acting), 1e-4 * reference + 0 * D
            signals = np.hstack([np.vstack([synthesise(LINES, x, N) for x in X]) for X in spectra])
            signals[:, :4] += 0.01 * signals[:, :4].std(axis=0) * rng.normal(size=(len(signals), 4))
            late.append(rng.uniform(-100, 100))
            names = [f"{len(late)}{file}.h5" for file in "ab"]
            for name, table in zip(names, (signals, started(signals, late[-1])), strict=True):
                with h5py.File(folder / name, "w") as file:
                    for channel, x in zip((*U, *Y, *R), table.T, strict=True):
                        file[channel.channel] = x
            files.append(FileSpec(names[0], f"c{p + 1}", m, e, also=(names[1],)))
    spec = RecordedSpec(RATE, channels, tuple(files), period_samples=N)
    postures = {f"c{i + 1}": q for i, q in enumerate(CONFIGURATIONS)}
    rig = RecordedRig(arm(), ExperimentSpec(postures, recorded=spec), folder)
    return [rig.measure(experiment) for experiment in rig.experiments], np.array(late)


def check_stiffness(records: list[Record], tolerance: float, *free: str) -> None:
    """Each k that is free, from a start that is off by up to 20 %, within a tolerance and 3 standard deviations."""
    each = [[r for r in records if r.configuration.name == name] for name in ("c1", "c2", "c3")]
    responses = [estimate(of_one, EstimatorSpec(), LINES) for of_one in each]
    selects_joint = [any("method joint" in note.text for note in response.notes) for response in responses]
    assert selects_joint == [records[0].r_is_reference] * 3
    parameters = {name: ParameterSpec() for name in (*free, "k_1", "k_2", "d_1", "d_2", "fm_*")}
    start = arm().with_parameters({"k_1": 2.4e5, "k_2": 2.2e5})
    result = fit_parameters(responses, start, FitSpec(parameters=parameters, starts=1))
    assert result.status in ("converged", "at_bound")
    for name in ("k_1", "k_2"):
        truth = arm().parameters()[name][0]
        assert result.values[name] == pytest.approx(truth, rel=tolerance)
        assert deviation(result, name, truth) < 3


@pytest.mark.parametrize("common", [(), slow(Y), R], ids=["none", "positions", "references"])
def test_two_recorders_with_unknown_offset_give_the_stiffness(common: tuple[ChannelSpec, ...], tmp_path: Path) -> None:
    """Offsets to 0.1 ms by a signal in both files; else to 0.15 ms by torques and accelerations, but for a delay that
    all files share and the fit identifies.
    """
    further = FURTHER if common == R else FURTHER[:2]
    records, late = measured(tmp_path, (*U, *common, *further))
    found = [-float(note.text.split("by ")[1].split()[0]) for r in records for note in r.notes if "lags" in note.text]
    error_ms = (np.array(found) - late) / RATE * 1e3
    assert np.abs(error_ms - error_ms.mean() * (not common)).max() < (0.1 if common else 0.15)
    check_stiffness(records, 0.01, *() if common else ("delay",))


@pytest.mark.parametrize("ratio", [slow(0.1), slow(1.0), 10.0])
def test_reference_as_instrument_gives_stiffness_without_bias(ratio: float, tmp_path: Path) -> None:
    """`auto` selects joint, k is right to 3 std; 96 periods do not bring a tenth of the disturbance above the noise."""
    with refused("frf/inputs-not-separable") if ratio < 1 else nullcontext():
        size = (8, 6 if ratio <= 1 else 3)
        check_stiffness(measured(tmp_path, (*U, *Y, *R), 1 / ratio, size, 1.0)[0], 0.02 / ratio)


@pytest.mark.parametrize(("seed", "code"), [(1, 0), (2, 2)])
def test_check_compares_the_start_of_two_recorders(seed: int, code: int, tmp_path: Path) -> None:
    """The second log has the reference of the first, a quarter of a period later, or another one."""
    references = [np.random.default_rng(i).normal(size=500) for i in (1, seed)]
    for name, r, start in zip("ab", references, (0, 125), strict=True):
        x = np.tile(np.roll(r, start), 4)
        y = np.convolve(x, np.ones(5) / 5)[: len(x)] + 1e-3 * np.random.default_rng(start).normal(size=len(x))
        np.savetxt(tmp_path / f"{name}.csv", np.stack([x, y], 1), delimiter=",", header="r,x", comments="")
    (tmp_path / "study.yml").write_text("""name: two
experiment:
  configurations: {bench: []}
  recorded:
    rate_hz: 500
    period_samples: 500
    channels:
      - {role: u, at: shaker, channel: x, quantity: force, unit: N}
      - {role: r, at: shaker, channel: r, quantity: force, unit: N}
      - {role: r, at: shaker, channel: r, quantity: force, unit: N, file: 2}
      - {role: y, at: point, channel: x, quantity: acceleration, unit: m/s^2, file: 2}
    files: [{path: a.csv, configuration: bench, also: [b.csv]}]
""")
    assert run_command(["check", str(tmp_path / "study.yml")]) == code
