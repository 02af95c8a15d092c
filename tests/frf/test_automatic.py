"""The automatic choice of an estimator: by stated errors, whichever of the candidates is the better one."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from plants.measured import ARM, measured
from plants.noise_record import RATE, Resonances, noise_record, truth
from plants.notes import said
from plants.refusals import refused
from scipy.signal import butter, lfilter

from elastid.frf import automatic
from elastid.frf.estimate import estimate
from elastid.frf.local.response import local_response
from elastid.frf.spec import EstimatorSpec, Method
from elastid.record import Record
from elastid.response import Response

AUTO = EstimatorSpec(quantity="velocity")
LOCAL = replace(AUTO, method="local_rational")
LIGHT = Resonances((30.0,), 0.003)


def _choice(response: Response) -> tuple[str, str]:
    """The method that `auto` chose, and the reason."""
    (text,) = (note.text for note in response.notes if note.code == "frf/method")
    method, _, reason = text.partition("method ")[2].partition(", ")
    return method, reason


def _multisine(periods: int, seed: int, N: int = 400) -> Record:
    """Full random-phase periods from rest through the light resonance, little noise."""
    rng = np.random.default_rng(seed)
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[4:180] = np.exp(2j * np.pi * rng.random(176))
    u = np.tile(np.fft.irfft(spectrum), periods)[:, None]
    y = LIGHT.driven(u)
    y += 1e-3 * y.std() * rng.normal(size=y.shape)
    return replace(noise_record(N, 0, n=1), u=u, y=y, is_periodic=True, period_samples=N)


def test_light_resonance_selects_local_method_and_noise_segments() -> None:
    """Leakage of a segment against the variance of a narrow window; the note has both errors."""
    rng = np.random.default_rng(0)
    record = noise_record(4000, 1, n=1)
    quiet = replace(record, y=LIGHT.driven(record.u))
    noisy = replace(record, y=quiet.y + 3 * quiet.y.std() * rng.normal(size=quiet.y.shape))
    chosen = {name: estimate([each], AUTO) for name, each in (("quiet", quiet), ("noisy", noisy))}
    for name, methods in (("quiet", ("local_rational", "h1")), ("noisy", ("h1", "local_rational"))):
        method, reason = _choice(chosen[name])
        assert (method, methods[1] in reason) == (methods[0], True)
        errors = [float(number) for number in re.findall(r"(\S+) %", reason)]
        assert errors[0] < errors[1]
    np.testing.assert_array_equal(chosen["quiet"].G, estimate([quiet], LOCAL).G)
    np.testing.assert_array_equal(chosen["noisy"].G, estimate([noisy], replace(AUTO, method="h1")).G)


def test_segment_error_includes_leakage() -> None:
    """Of a light resonance without noise, against the truth, at the lines of the preview: within a factor of two."""
    record = noise_record(8000, 2, n=1)
    record = replace(record, y=LIGHT.driven(record.u))
    spec = replace(AUTO, method="h1", segment=1.28)
    h1, local = estimate([record], spec), local_response([record], replace(LOCAL, lines="full"), max_lines=400)
    error, _, _ = automatic.relative_errors(h1, local, has_bias=True)
    inside = local.freq_hz[(local.freq_hz >= h1.freq_hz[0]) & (local.freq_hz <= h1.freq_hz[-1])]
    G = np.interp(inside, h1.freq_hz, h1.G[:, 0, 0].real) + 1j * np.interp(inside, h1.freq_hz, h1.G[:, 0, 0].imag)
    true = np.mean(np.sqrt(np.minimum(1, np.abs(G / LIGHT.G(inside) - 1)))) ** 2
    assert 0.5 * true < error < 2 * true
    assert automatic.relative_errors(h1, local, has_bias=False)[0] < 0.9 * error


def _refused() -> list[tuple[Sequence[Record], EstimatorSpec, str]]:
    lengths = [noise_record(n, i, noise=0.1, realisation=i) for i, n in enumerate((2000, 900))]
    return [(lengths, AUTO, "h1"), ([noise_record(3000, 0, noise=0.1)], replace(AUTO, segment=15.0), "local_rational")]


@pytest.mark.parametrize(("records", "spec", "method"), _refused(), ids=["local_rational", "h1"])
def test_where_one_candidate_refuses_the_records_the_other_is_taken(
    records: Sequence[Record], spec: EstimatorSpec, method: str
) -> None:
    """Records of unequal length; a segment as long as the record."""
    (other,) = {"h1", "local_rational"} - {method}
    chosen, reason = _choice(estimate(records, spec))
    assert (chosen, reason.split()[1]) == (method, other)


def test_a_local_method_that_takes_long_must_be_much_better(monkeypatch: pytest.MonkeyPatch) -> None:
    """A record on which it is a little better, with a limit below its lines; the note has the price."""
    record = noise_record(6000, 0, n=1, noise=0.05)
    assert _choice(estimate([record], AUTO))[0] == "local_rational"
    monkeypatch.setattr("elastid.frf.estimate.AUTOMATIC", replace(automatic.LIMITS, long_lines=1000))
    method, reason = _choice(estimate([record], AUTO))
    assert (method, " 1.5 " in reason) == ("h1", True)
    monkeypatch.setattr("elastid.frf.estimate.AUTOMATIC", replace(automatic.LIMITS, long_lines=1000, long_values=2000))
    method, reason = _choice(estimate([record], AUTO))
    assert (method, " 2999 " in reason) == ("h1", True)


def test_periods_from_rest_select_local_method() -> None:
    """Five periods of a resonance that rings longer: the mean is off by more than three times as much."""
    record = _multisine(5, 0)
    auto, mean = estimate([record], AUTO), estimate([record], replace(AUTO, method="arithmetic"))
    assert _choice(auto)[0] == "local_rational"
    errors = [np.median(np.abs(each.G[:, 0, 0] / LIGHT.G(each.freq_hz) - 1)) for each in (auto, mean)]
    assert errors[0] < errors[1] / 3
    settled = replace(_multisine(12, 0), u=_multisine(12, 0).u[2400:], y=_multisine(12, 0).y[2400:])
    for records, lines in (([record], np.arange(4, 180)), ([settled], None)):
        planned = estimate(records, AUTO, lines)
        np.testing.assert_array_equal(planned.G, estimate(records, replace(AUTO, method="arithmetic"), lines).G)
        assert not any("frf/method" in note for note in said(planned.notes))


@pytest.mark.parametrize("band_hz", [None, (0.3, 15.2)])
def test_a_swept_arm_keeps_its_antiresonance_at_2_45_hz(band_hz: tuple[float, float] | None) -> None:
    """0.0322 of the sampling rate, 2.45 Hz at 76 Hz; segments of h1 put it at 2.375 Hz, one of two lines below 5 Hz."""
    from scipy.io import loadmat

    u, y = np.hsplit(loadmat(measured(ARM))["robot_arm_dat"].astype(float), 2)
    record = replace(noise_record(len(u), 0, n=1), rate_hz=76.0, u=u, y=-y, quantities=("acceleration",))
    response = estimate([record], EstimatorSpec(band_hz=band_hz))
    near = (response.freq_hz > 1.5) & (response.freq_hz < 3.5)
    assert response.freq_hz[near][np.argmin(np.abs(response.G[near, 0, 0]))] == pytest.approx(2.45, abs=0.04)


@pytest.mark.parametrize("method", ["local_polynomial", "local_rational"])
def test_local_methods_take_one_record_of_noise_from_rest(method: Method) -> None:
    """Full lines; errors as large as stated, and a grid of its own resolution uses the lines between."""
    spec = EstimatorSpec(method=method, quantity="velocity", band_hz=(5.0, 80.0))
    record = noise_record(4000, 1, noise=0.3)
    full, coarse = (estimate([record], each) for each in (spec, replace(spec, resolution_hz=2.0)))
    np.testing.assert_allclose(np.diff(full.freq_hz), RATE / 4000)
    np.testing.assert_allclose(np.diff(coarse.freq_hz), 2.0)
    for response in (full, coarse):
        ratio = np.abs(response.G - truth(response.freq_hz)) ** 2 / response.total.variance
        assert 0.4 < ratio.mean() < 2
    assert np.median(coarse.total.variance) < 0.7 * np.median(full.total.variance)


@pytest.mark.parametrize("method", ["h1", "local_rational"])
def test_lines_above_excitation_are_discarded(method: Method) -> None:
    """A motor G = 0.5 z^-1 under u = r - 0.5 y, r up to 20 Hz: above, noise of y alone moves u, and Y / U is -2. A
    shaker's lines stay, as those of a band that is stated."""
    n, rng = 8000, np.random.default_rng(0)
    r, noise = lfilter(*butter(6, 0.2), rng.normal(size=n)), 1e-4 * rng.normal(size=n)
    u, y = np.zeros(n), np.zeros(n)
    for k in range(n):
        y[k] = 0.5 * u[k - 1] + noise[k]
        u[k] = r[k] - 0.5 * y[k]
    record = replace(noise_record(n, 0, 1), u=u[:, None], y=y[:, None])
    spec = EstimatorSpec(method=method, quantity="velocity", resolution_hz=1.0)
    response = estimate([record], spec)
    assert response.freq_hz[-1] < 60
    assert "frf/lines-discarded" in [note.code for note in response.notes]
    np.testing.assert_allclose(np.abs(response.G[5:, 0, 0]), 0.5, atol=0.05)
    for other, own in ((replace(record, inputs=("shaker",)), spec), (record, replace(spec, band_hz=(1.0, 95.0)))):
        every = estimate([other], own)
        assert every.freq_hz[-1] > 90
        assert abs(every.G[-5, 0, 0] + 2) < 0.2


@pytest.mark.parametrize("method", ["auto", "h1", "local_rational"])
def test_missing_sample_is_refused_by_methods_that_read_it(method: Method) -> None:
    """A local method does not read what is beyond the shortest record."""
    spec = EstimatorSpec(method=method, quantity="velocity", band_hz=(5.0, 80.0))
    short, long = noise_record(2000, 0, noise=0.1), noise_record(2040, 1, noise=0.1, realisation=1)
    for missing in (7, 2010):
        u = np.array(long.u)
        u[missing, 1] = np.nan
        records = [short, replace(long, u=u)]
        if missing == 2010 and method != "h1":
            assert "local_rational" in " ".join(said(estimate(records, spec).notes))
        else:
            with refused("records/values", place="record c-r1-e0") as caught:
                estimate(records, spec)
            assert f"sample {missing} " in str(caught.value)
