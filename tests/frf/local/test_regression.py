"""Repeats of one excitation: never worse than one record, and a variance that still holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants import studies
from plants.notes import said

from elastid.frf.local.regression import independent_excitations, merge_repeats, settled_spectra
from elastid.frf.local.response import local_response
from elastid.frf.spec import EstimatorSpec

study = studies.study("local_methods")
SPEC = EstimatorSpec(method="local_rational", quantity="velocity", lines="full", band_hz=(2.0, 35.0))


@pytest.mark.parametrize("spec", [study.LPM, study.LRM], ids=lambda spec: spec.method)
@pytest.mark.parametrize("gain", [0.0, 2.0], ids=["open loop", "closed loop"])
@pytest.mark.parametrize("snr_db", [30.0, 80.0])
def test_three_repeats_of_a_sweep_from_rest_are_better_than_one_and_their_variance_is_true(
    snr_db: float, gain: float, spec: EstimatorSpec
) -> None:
    """The median error falls by sqrt 3 (20 % of it by chance), mean error^2 / total stays below 2.

    At 80 dB most of the error is that of the models, which transient and response hide from the residual.
    """
    found = study.repeats(4, gain, snr_db, spec)
    assert found[3][0] < 1.2 * found[1][0] / np.sqrt(3)
    assert max(ratio for _, ratio in found.values()) < 2.0


def test_a_model_that_is_sufficient_keeps_its_variance() -> None:
    """Two modes of 1 % from rest at 70 dB under random phases, which distinguish response and transient."""
    plant, squares = study.TwoModes(), []
    for seed in range(4):
        response = local_response([plant.from_rest(1, 70.0, np.random.default_rng(seed))], study.LRM, plant.excited)
        assert response.total is not None
        squares.append(np.abs(response.G[:, 0, 0] - plant.G()) ** 2 / response.total.variance[:, 0, 0])
    # An error as large as stated has chi-square / 2: 1 % of the squares are below 0.01 of their mean.
    assert np.mean(squares) == pytest.approx(1.15, abs=0.15)
    assert np.mean(np.array(squares) < 0.01) < 0.02


def test_repeats_without_noise_give_the_response_of_one() -> None:
    """Also with other gains and signs of the sweep; a note says that they count as one."""
    plant, rng = study.SweptAxis(), np.random.default_rng(0)
    one = local_response(plant.measured(1, 2.0, np.inf, rng), SPEC)
    three = local_response(plant.measured(3, 2.0, np.inf, rng, gains=(1.0, -1.0, 0.5)), SPEC)
    np.testing.assert_allclose(three.G, one.G, rtol=1e-6)
    assert "3 records with 1 different excitation: " in " ".join(said(three.notes))


def test_the_noise_of_repeats_is_that_of_all_their_periods() -> None:
    """Settled records of two and three periods: the merged one has the mean of five and its noise."""
    plant, lines = study.SweptAxis(), np.arange(40, 700)
    spectra = []
    for P in (2, 3):
        records = plant.measured(P, 0.0, 20.0, np.random.default_rng(P))
        u, y = (np.concatenate([getattr(each, name) for each in records]) for name in ("u", "y"))
        spectra.append(settled_spectra(replace(records[0], u=u, y=y), lines, "velocity"))
    (merged,) = merge_repeats(spectra, closed=False)
    assert merged.n_periods == pytest.approx(5)
    np.testing.assert_allclose(merged.Y, (2 * spectra[0].Y + 3 * spectra[1].Y) / 5)
    np.testing.assert_allclose(merged.noise, (4 * spectra[0].noise + 9 * spectra[1].noise) / 25)


def test_different_excitations_stay_apart() -> None:
    """New random phases are a new excitation, however alike their powers are."""
    plant, lines = study.TwoModes(N=1024, lines=(6, 300)), np.arange(6, 301)
    spectra = [settled_spectra(plant.from_rest(2, 40.0, np.random.default_rng(s)), lines, "velocity") for s in (0, 1)]
    assert merge_repeats(spectra, closed=False) == spectra


@pytest.mark.parametrize("spec", [study.LPM, study.LRM], ids=lambda spec: spec.method)
def test_repeats_that_start_a_little_later_each_time_are_better_than_one(spec: EstimatorSpec) -> None:
    """0.1 s from one to the next: no gain makes their inputs equal, and within a window they are one excitation."""
    plant, rng = study.SweptAxis(), np.random.default_rng(0)
    spec = replace(spec, lines="full", band_hz=(2.0, 35.0))
    records = []
    for i, each in enumerate(plant.measured(3, 0.0, np.inf, rng)):
        u, y = (np.roll(x, 20 * i, axis=0) for x in (each.u, each.y))
        u[: 20 * i] = y[: 20 * i] = 0.0
        records.append(replace(each, u=u, y=y + 0.03 * y.std() * rng.normal(size=y.shape)))
    one, three = (local_response(some, spec) for some in (records[:1], records))
    errors = [np.median(np.abs(each.G[:, 0, 0] / plant.G(each.freq_hz) - 1)) for each in (one, three)]
    assert errors[1] < errors[0]


def test_random_phases_are_independent_excitations_and_shifted_ones_are_not() -> None:
    """Three experiments of 300 lines, in windows of 12."""
    rng, lines = np.random.default_rng(0), np.arange(300)
    R = np.exp(2j * np.pi * rng.random((3, 300, 1)))
    shifted = R[:1] * np.exp(-2j * np.pi * lines[:, None] * np.array([0.0, 0.01, 0.03])[:, None, None])
    assert independent_excitations(R, 12) == 3
    assert independent_excitations(shifted, 12) == 1
    assert independent_excitations(R[:1], 12) == 1
