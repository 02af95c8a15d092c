"""Periods of an excitation: stated ones confirmed, wrong ones corrected, their absence refused."""

import re
from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis.extra.numpy import arrays
from plants.lab_logs import CHANNELS, ROBOT, N, Signals, measured, multisines, record_of, save_csv, study_of
from plants.measured import KUKA
from plants.measured import measured as record_file
from plants.notes import said
from plants.refusals import refused

from elastid.base.errors import DataError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.logs.repair.periodicity import autocorrelation, find_period, repetition
from elastid.logs.rig import RecordedRig
from elastid.robot import Body, Joint, Motor, Robot, Spring


@pytest.mark.parametrize(("lost", "place"), [(2, 500), (3, 450), (-3, 310)])
def test_samples_that_are_lost_in_three_periods_are_said(lost: int, place: int, tmp_path: Path, log: Signals) -> None:
    """Without time stamps, early and late; not said of a log that lost none and has another period than is stated."""
    rows = np.delete(np.arange(600), np.arange(place, place + lost)) if lost > 0 else np.r_[:place, place + lost : 600]
    save_csv(tmp_path / "log.csv", {name: x[rows] for name, x in log.items()})
    with pytest.raises(DataError) as refusal:
        measured(tmp_path, study_of("log.csv", period_samples=200))
    found = re.search(r"(\d samples are \w+)[^(]* near sample (\d+)", str(refusal.value))
    assert found is not None, refusal.value
    assert found[1] == f"{abs(lost)} samples are {'missing' if lost > 0 else 'duplicated'}"
    assert abs(int(found[2]) - place) < 50
    with refused("records/period-mismatch", holds="200 samples"):
        record_of(tmp_path, {name: x[:600] for name, x in log.items()}, period_samples=202)


AXIS = Robot("axis", (Body("arm", joints=(Joint("1", "z", Spring(1e3), Motor(1e-2)),), inertia=1.0),))
LINES = np.arange(3, 60)


def test_periods_of_different_clocks_are_estimated_together(tmp_path: Path) -> None:
    """200.3 and 200.31 samples, found in each; the same lines, and the response of the axis that moves alone."""
    channels = (CHANNELS[1], ChannelSpec("y", "motor 1", "phi", quantity="position"))
    for name, T in (("a", 200.3), ("b", 200.31)):
        log = multisines(LINES, T, 1203)
        save_csv(tmp_path / f"{name}.csv", {"i1": log["i1"], "phi": 0.2 * log["i1"] * 0.5e-3 * -50.0})
    files = (FileSpec("a.csv", "home"), FileSpec("b.csv", "home", 1))
    rig = RecordedRig(ROBOT, study_of("", channels, files=files, period_samples=None, period="find"), tmp_path)
    records = [rig.measure(e) for e in rig.experiments]
    assert 1e-5 < abs(records[1].rate_hz / records[0].rate_hz - 1) < 1e-4
    G = estimate(records, EstimatorSpec(quantity="position"))
    assert G.n_lines == len(LINES)
    np.testing.assert_allclose(G.G[:, 0, 0], 0.2, rtol=1e-3)


def test_incomplete_second_period_is_used_while_it_repeats(tmp_path: Path) -> None:
    """1.95 periods: two of them, the last 10 samples from the first."""
    whole = multisines(LINES, N, 400)
    record = record_of(tmp_path, {name: x[:390] for name, x in whole.items()})
    assert record.n_periods == 2
    np.testing.assert_allclose(record.u[:, 1], whole["i1"] * 0.5e-3 * -50.0, atol=1e-6 * np.ptp(record.u))
    assert record.discarded_periods == ()


@pytest.mark.parametrize("period", [None, "none"])
def test_without_a_period_the_whole_record_is_one_piece(period: str | None, tmp_path: Path) -> None:
    """Noise, all of its samples; nothing is mended from other periods."""
    rng = np.random.default_rng(0)
    log = {name: rng.normal(size=777) for name in ("i1", "i2", "phi", "w2")}
    record = record_of(tmp_path, log, period_samples=None, period=period)
    assert not record.is_periodic
    assert (record.n_samples, record.period_samples, record.n_periods) == (777, 777, 1)
    np.testing.assert_allclose(record.u[:, 1], log["i1"] * 0.5e-3 * -50.0, rtol=1e-12)
    assert said(record.notes) == ()


def test_a_period_that_is_not_stated_is_advised_of(tmp_path: Path) -> None:
    """Four periods of 200 samples; not where the study says none."""
    save_csv(tmp_path / "log.csv", multisines(LINES, N, 800))
    (note,) = said(measured(tmp_path, study_of("log.csv", period_samples=None)).notes)
    assert "the torques repeat every 200 samples" in note
    assert said(measured(tmp_path, study_of("log.csv", period_samples=None, period="none")).notes) == ()


def test_logs_without_a_period_are_aligned_by_their_noise(tmp_path: Path) -> None:
    """The second log starts 37 samples earlier and holds the injected torque too."""
    rng = np.random.default_rng(0)
    r, y = rng.normal(size=1000), rng.normal(size=1000)
    save_csv(tmp_path / "a.csv", {"i1": r[37:], "i2": np.zeros(963)})
    save_csv(tmp_path / "b.csv", {"i1": r, "w2": y})
    channels = (
        *CHANNELS[:2],
        replace(CHANNELS[1], role="r", file=2),
        replace(CHANNELS[0], role="r", channel="i1", file=2),
        ChannelSpec("y", "joint 2", "w2", quantity="velocity", file=2),
    )
    files = (FileSpec("a.csv", "home", also=("b.csv",)),)
    record = measured(tmp_path, study_of("", channels, files=files, period_samples=None, period="none"))
    np.testing.assert_allclose(record.y[:, 0], y[37 : 37 + record.n_samples], rtol=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    kind=st.sampled_from(["noise", "walk", "motion", "constant", "holes"]),
    n=st.integers(4, 2501),
    lag=st.integers(1, 2600),
    sign=st.sampled_from([1, -1]),
    seed=st.integers(0, 5),
)
def test_no_log_and_no_period_raises(kind: str, n: int, lag: int, sign: int, seed: int) -> None:
    """Correlations are numbers up to 1, a lag that is advised of lies in the log, and no motion is taken for noise."""
    rng, t = np.random.default_rng(seed), np.arange(n)
    x = rng.normal(size=n)
    if kind == "walk":
        x = np.cumsum(x)
    elif kind == "motion":
        x = sum(np.sin((k + 0.3) * 2 * np.pi * t / 2501 + 6 * rng.random()) for k in range(1, 9)) + np.zeros(n)
    elif kind == "constant":
        x = np.ones(n)
    elif kind == "holes":
        x = np.where(rng.random(n) < 0.2, np.nan, np.sin(0.1 * t))
    for found in (repetition(x[:, None], lag, sign), find_period(x[:, None])):
        assert np.isfinite([found.correlation, found.best_correlation, found.best_samples]).all()
        assert max(abs(found.correlation), found.best_correlation) < 1.01
        assert 0 <= found.best_samples < n
        assert not found.matches_stated_period or found.correlation >= 0.95


@pytest.mark.parametrize("period", [{"period": "find"}, *({"period_samples": n} for n in (320, 804, 1749, 2010, 5000))])
def test_motions_without_repetition_are_refused_with_remedy(period: dict[str, object]) -> None:
    """Whatever the study states; and what the sentence proposes can be measured."""
    channels = (
        ChannelSpec("u", "motor 1", "rec.act_torque_abs_nm", column=1),
        ChannelSpec("y", "motor 1", "rec.act_pos_mot_deg", column=1, quantity="position", unit="deg"),
    )

    def rig(**changes: object) -> RecordedRig:
        recorded = RecordedSpec(250.0, channels, (FileSpec(str(record_file(KUKA)), "home"),), **changes)
        return RecordedRig(AXIS, ExperimentSpec({"home": (0.0,)}, recorded=recorded), Path())

    periodic = rig(**period)
    with refused("records/period-mismatch"):
        periodic.measure(periodic.experiments[0])
    whole = rig(period="none")
    record = whole.measure(whole.experiments[0])
    assert record.n_samples == 2501
    assert estimate([record], EstimatorSpec(method="local_rational", band_hz=(0.0, 10.0))).n_lines > 20


def test_torques_under_a_reference_in_steps_have_no_period() -> None:
    """Controller at 500 Hz, references every 20 ms: the torques' correlation is 0.98 after 10 samples, 0 after 1 s."""
    rng = np.random.default_rng(0)
    t, omega, phase = np.arange(8000), rng.uniform(1.0, 19.0, (6, 1)) / 500, rng.uniform(0, 6.3, (6, 1))
    reference, position = (np.sum(np.sin(omega * x + phase), axis=0) for x in (t - t % 10, t - 6))
    torque = reference - position
    assert autocorrelation(torque)[10] > 0.95
    assert find_period(torque[:, None]).best_samples == 0


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    kind=st.sampled_from(["multisine", "hit"]),
    T=st.floats(300, 400),
    periods=st.floats(2.0, 16.0),
    noise=st.sampled_from([0.0, 0.02, 0.3]),
    scale=st.sampled_from([1e-9, 1e6]),
)
def test_a_period_is_found_however_often_it_is_logged(
    kind: str, T: float, periods: float, noise: float, scale: float
) -> None:
    """To a twentieth of a sample and the noise, in any unit; a stated one off by a hundredth is not confirmed."""
    assume(noise < 0.1 or periods > 6)
    t = np.arange(np.ceil(periods * T))
    x = np.exp(-(((t / T + 0.3) % 1 - 0.5) ** 2) / 2e-4)
    if kind == "multisine":
        x = np.cos(2 * np.pi * np.outer(t / T, LINES) + 6 * np.random.default_rng(1).random(len(LINES))).sum(axis=1)
    log = scale * (x / x.std() + noise * np.random.default_rng(2).standard_normal(len(t)))
    found = find_period(log[:, None])
    assert found.best_samples == pytest.approx(T, abs=0.05 + 0.3 * noise)
    assert found.best_correlation == pytest.approx(1 / (1 + noise**2), abs=0.02)
    off = repetition(log[:, None], round(1.02 * T))
    assert not off.matches_stated_period
    assert off.best_samples == pytest.approx(T, abs=0.05 + 0.3 * noise)


@settings(max_examples=30, deadline=None)
@given(x=arrays(np.float64, st.integers(2, 40), elements=st.integers(-9, 9).map(float) | st.just(np.nan)))
def test_the_autocorrelation_is_its_sum(x: np.ndarray) -> None:
    """Over pairs of samples that are both known."""
    found = autocorrelation(x)
    assert len(found) == len(x) - len(x) // 8
    for lag, rho in enumerate(found):
        a, b = x[: len(x) - lag], x[lag:]
        both = np.isfinite(a) & np.isfinite(b)
        size = np.sqrt(np.sum(a[both] ** 2) * np.sum(b[both] ** 2))
        if size > 0:
            assert rho == pytest.approx(np.sum(a[both] * b[both]) / size, abs=1e-6)
