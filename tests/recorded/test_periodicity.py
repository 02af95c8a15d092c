"""Periods of an excitation: stated ones confirmed, wrong ones corrected, their absence refused."""

import re
from dataclasses import replace
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from plants.lab_logs import CHANNELS, RATE, ROBOT, N, measured, save_csv, study_of
from plants.measured import KUKA
from plants.measured import measured as record_file
from plants.notes import said
from plants.refusals import refused

from elastid.base.errors import DataError
from elastid.excitation.multisine import orthogonal_set
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.recorded.repair.periodicity import find_period, repetition
from elastid.recorded.rig import RecordedRig
from elastid.robot import Body, Joint, Motor, Robot, Spring


@pytest.mark.parametrize(("lost", "place"), [(2, 500), (3, 450), (-3, 310)])
def test_samples_that_are_lost_in_three_periods_are_said(
    lost: int, place: int, tmp_path: Path, log: dict[str, np.ndarray]
) -> None:
    """Without time stamps, early and late; not said of a log that lost none and has another period than is stated."""
    rows = np.delete(np.arange(600), np.arange(place, place + lost)) if lost > 0 else np.r_[:place, place + lost : 600]
    save_csv(tmp_path / "log.csv", {name: x[rows] for name, x in log.items()})
    with pytest.raises(DataError) as refusal:
        measured(tmp_path, study_of("log.csv", period_samples=200))
    found = re.search(r"(\d samples are \w+)[^(]* near sample (\d+)", str(refusal.value))
    assert found is not None, refusal.value
    assert found[1] == f"{abs(lost)} samples are {'lost' if lost > 0 else 'there'}"
    assert abs(int(found[2]) - place) < 50
    save_csv(tmp_path / "log.csv", {name: x[:600] for name, x in log.items()})
    with refused("records/period-mismatch", holds="200 samples"):
        measured(tmp_path, study_of("log.csv", period_samples=202))


def _motion(kind: str, rng: np.random.Generator, n: int = 2501) -> np.ndarray:
    """A motion that does not repeat within n samples."""
    t = np.arange(n)
    if kind == "sum of harmonics of the log":
        return np.asarray(sum(rng.normal() * np.cos(2 * np.pi * (k * t / n + rng.random())) for k in range(1, 8)))
    if kind == "sweep":
        low, high = rng.uniform(1, 5), rng.uniform(8, 40)
        return np.asarray(np.sin(2 * np.pi * (low * t / n + (high - low) * (t / n) ** 2 / 2)))
    knots = np.sort(rng.choice(n - 1, int(rng.integers(6, 25)), replace=False))
    window = np.hanning(int(rng.integers(20, 120)))
    return np.asarray(np.convolve(np.interp(t, knots, rng.normal(size=len(knots))), window / window.sum(), "same"))


@pytest.mark.parametrize("kind", ["sum of harmonics of the log", "sweep", "from point to point"])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.4])
@pytest.mark.slow
def test_no_period_of_a_motion_that_does_not_repeat_is_accepted_for_noise(kind: str, noise: float) -> None:
    """Below a correlation of 0.95, whatever the stated period: what differs is slow, and noise is not."""
    rng = np.random.default_rng(7)
    for _ in range(4):
        x = _motion(kind, rng)
        x = x + noise * x.std() * rng.normal(size=len(x))
        found = [repetition(x[:, None], stated) for stated in range(60, 1300, 40)]
        assert not [each for each in found if each.is_as_stated and each.correlation < 0.95]


AXIS = Robot("axis", (Body("arm", joints=(Joint("1", "z", Spring(1e3), Motor(1e-2)),), inertia=1.0),))
LINES = np.arange(3, 60)


def _log_of_period(T: float, n: int) -> dict[str, np.ndarray]:
    """n samples of four multisines with a period of T samples."""
    U = orthogonal_set(np.ones((len(LINES), 4)), np.random.default_rng(0))[0]
    x = (np.exp(2j * np.pi * np.outer(np.arange(n) / T, LINES)) @ U).real
    return dict(zip(("i1", "i2", "phi", "w2"), x.T, strict=True))


def test_periods_that_differ_by_the_clocks_of_their_logs_are_estimated_together(tmp_path: Path) -> None:
    """200.3 and 200.31 samples, found in each; the same lines, and the response of the axis that moves alone."""
    channels = (CHANNELS[1], ChannelSpec("y", "motor 1", "phi", quantity="position"))
    for name, T in (("a", 200.3), ("b", 200.31)):
        log = _log_of_period(T, 1203)
        save_csv(tmp_path / f"{name}.csv", {"i1": log["i1"], "phi": 0.2 * log["i1"] * 0.5e-3 * -50.0})
    files = (FileSpec("a.csv", "home"), FileSpec("b.csv", "home", 1))
    rig = RecordedRig(ROBOT, study_of("", channels, files=files, period_samples=None, period="find"), tmp_path)
    records = [rig.measure(e) for e in rig.experiments]
    assert 1e-5 < abs(records[1].rate_hz / records[0].rate_hz - 1) < 1e-4
    G = estimate(records, EstimatorSpec(quantity="position"))
    assert G.n_lines == len(LINES)
    np.testing.assert_allclose(G.G[:, 0, 0], 0.2, rtol=1e-3)


@pytest.mark.parametrize("T", [200.0, 160.4])
def test_a_period_is_found(T: float, tmp_path: Path) -> None:
    """Whole or not, and the record says which."""
    save_csv(tmp_path / "log.csv", _log_of_period(T, 1000))
    record = measured(tmp_path, study_of("log.csv", period_samples=None, period="find"))
    assert record.period_samples == round(T)
    assert record.rate_hz * T / round(T) == pytest.approx(RATE, rel=1e-5)
    assert any("taken as the period" in note for note in said(record.notes))


def test_an_incomplete_second_period_is_used_as_far_as_it_repeats(tmp_path: Path) -> None:
    """1.95 periods: two of them, the last 10 samples from the first."""
    whole = _log_of_period(N, 400)
    save_csv(tmp_path / "log.csv", {name: x[:390] for name, x in whole.items()})
    record = measured(tmp_path, study_of("log.csv"))
    assert record.n_periods == 2
    np.testing.assert_allclose(record.u[:, 1], whole["i1"] * 0.5e-3 * -50.0, atol=1e-6 * np.ptp(record.u))
    assert record.left_out == ()


@pytest.mark.parametrize("period", [None, "none"])
def test_without_a_period_the_whole_record_is_one_piece(period: str | None, tmp_path: Path) -> None:
    """Noise, all of its samples; nothing is mended from other periods."""
    rng = np.random.default_rng(0)
    log = {name: rng.normal(size=777) for name in ("i1", "i2", "phi", "w2")}
    save_csv(tmp_path / "log.csv", log)
    record = measured(tmp_path, study_of("log.csv", period_samples=None, period=period))
    assert not record.is_periodic
    assert (record.n_samples, record.period_samples, record.n_periods) == (777, 777, 1)
    np.testing.assert_allclose(record.u[:, 1], log["i1"] * 0.5e-3 * -50.0, rtol=1e-12)
    assert said(record.notes) == ()


def test_a_period_that_is_not_stated_is_advised_of(tmp_path: Path) -> None:
    """Four periods of 200 samples; not where the study says none."""
    save_csv(tmp_path / "log.csv", _log_of_period(N, 800))
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


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"period": 2.0}, "either period"),
        ({"period_samples": None, "half_wave": True}, "it has no period; give period"),
        ({"period_samples": 1.5}, "1.5 samples; it must be 2"),
        ({"period_samples": None, "period": 2.0, "rate_hz": "unknown"}, "give period_samples instead"),
    ],
)
def test_periods_that_contradict_each_other_are_refused(changes: dict[str, object], says: str) -> None:
    """Two of them, half waves of none, shorter than the samples, in s without a rate."""
    with pytest.raises(ValueError, match=says):
        study_of("log.csv", **changes)


@settings(max_examples=60, deadline=None)
@given(
    kind=st.sampled_from(["noise", "walk", "sine", "motion", "constant", "holes"]),
    n=st.integers(4, 2501),
    lag=st.integers(1, 2600),
    sign=st.sampled_from([1, -1]),
    seed=st.integers(0, 5),
)
def test_no_log_and_no_period_raises(kind: str, n: int, lag: int, sign: int, seed: int) -> None:
    """Correlations are numbers up to 1, a lag that is advised of lies within half of the log."""
    rng, t = np.random.default_rng(seed), np.arange(n)
    x = rng.normal(size=n)
    if kind == "walk":
        x = np.cumsum(x)
    elif kind == "sine":
        x = np.sin(t / (3 + 40 * rng.random()))
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


@pytest.mark.parametrize("period", [{"period": "find"}, *({"period_samples": n} for n in (320, 804, 1749, 2010, 5000))])
def test_motions_that_do_not_repeat_are_refused_with_what_can_be_had(period: dict[str, object]) -> None:
    """Whatever the study states; and what the sentence proposes can be measured."""
    channels = (
        ChannelSpec("u", "motor 1", "rec.act_torque_abs_nm", column=1),
        ChannelSpec("y", "motor 1", "rec.act_pos_mot_deg", column=1, quantity="position", unit="deg"),
    )

    def rig(**changes: object) -> RecordedRig:
        recorded = RecordedSpec(250.0, channels, (FileSpec(str(record_file(KUKA)), "home"),), **changes)  # type: ignore[arg-type]
        return RecordedRig(AXIS, ExperimentSpec({"home": (0.0,)}, recorded=recorded), Path())

    periodic = rig(**period)
    with refused("records/period-mismatch"):
        periodic.measure(periodic.experiments[0])
    whole = rig(period="none")
    record = whole.measure(whole.experiments[0])
    assert record.n_samples == 2501
    assert estimate([record], EstimatorSpec(method="local_rational", band_hz=(0.0, 10.0))).n_lines > 20


@pytest.mark.parametrize("periods", [2, 3, 7, 8, 9, 16])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_period_of_hits_does_not_depend_on_how_many_are_logged(periods: int, noise: float) -> None:
    """A pulse every 4096 samples, to a hundredth of a sample: the last repetition may lie beyond all lags."""
    hit = np.zeros(4096)
    hit[200:206] = 1, 3, 5, 4, 2, 1
    log = np.tile(hit, periods) + noise * np.random.default_rng(periods).standard_normal(4096 * periods)
    assert find_period(log[:, None]).best_samples == pytest.approx(4096, abs=1e-2 + noise)
