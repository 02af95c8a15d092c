"""Records without a period by local methods; the choice of a method, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.noise_record import H1, RATE, noise_record, truth
from plants.notes import said
from plants.refusals import refused
from scipy.signal import butter, lfilter

from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec, Method
from elastid.response import Response


@pytest.mark.parametrize("method", ["local_polynomial", "local_rational"])
def test_local_methods_take_one_record_of_noise_from_rest(method: Method) -> None:
    """Full lines; errors as large as stated, and a grid of its own resolution uses the lines between."""
    spec = EstimatorSpec(method=method, quantity="velocity", band_hz=(5.0, 80.0))
    record = noise_record(4000, 1, noise=0.3)
    full, coarse = (estimate([record], each) for each in (spec, replace(spec, resolution_hz=2.0)))
    np.testing.assert_allclose(np.diff(full.freq_hz), RATE / 4000)
    np.testing.assert_allclose(np.diff(coarse.freq_hz), 2.0)
    for response in (full, coarse):
        assert response.total is not None
        ratio = np.abs(response.G - truth(response.freq_hz)) ** 2 / response.total.variance
        assert 0.4 < ratio.mean() < 2
    assert coarse.total is not None
    assert full.total is not None
    assert np.median(coarse.total.variance) < 0.7 * np.median(full.total.variance)


@pytest.mark.parametrize("method", ["h1", "local_rational"])
def test_lines_of_motors_above_the_excitation_hold_the_controller_and_are_left_out(method: Method) -> None:
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
    assert "frf/lines-left-out" in [note.code for note in response.notes]
    np.testing.assert_allclose(np.abs(response.G[5:, 0, 0]), 0.5, atol=0.05)
    for other, own in ((replace(record, inputs=("shaker",)), spec), (record, replace(spec, band_hz=(1.0, 95.0)))):
        every = estimate([other], own)
        assert every.freq_hz[-1] > 90
        assert abs(every.G[-5, 0, 0] + 2) < 0.2


@pytest.mark.parametrize("method", ["auto", "h1", "local_rational"])
def test_a_missing_sample_is_refused_by_every_method_that_reads_it(method: Method) -> None:
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


def _refusals() -> list[tuple[EstimatorSpec, str, EstimatorSpec]]:
    """What is refused, its code, and the remedy."""
    return [
        (replace(H1, method="arithmetic"), "frf/periods", replace(H1, method="auto")),
        (replace(H1, lines="odd"), "frf/periods", replace(H1, lines="full")),
        (replace(H1, transient_periods=1), "frf/periods", H1),
        (replace(H1, segment=15.0), "frf/segment", replace(H1, segment=2.5)),
        (replace(H1, segment=0.01), "frf/segment", replace(H1, segment=0.02)),
    ]


@pytest.mark.parametrize(("wrong", "code", "remedy"), _refusals(), ids=lambda x: x if isinstance(x, str) else "")
def test_every_refusal_names_a_remedy_that_works(wrong: EstimatorSpec, code: str, remedy: EstimatorSpec) -> None:
    """A record of 15 s."""
    record = noise_record(3000, 0, noise=0.1)
    with refused(code):
        estimate([record], wrong)
    assert isinstance(estimate([record], remedy), Response)
