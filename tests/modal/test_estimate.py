"""Modes of responses with known ones: none is missed, none is false, and the intervals hold."""

from dataclasses import replace

import numpy as np
import pytest
from modal.structures import BENCH, FREQ_HZ, NATURAL, ZETA, modal_response
from plants.refusals import refused
from scipy.signal import lfilter

from elastid.base.errors import Note
from elastid.experiment.simulated.plant import shake, true_modes
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.modal.estimate import estimate_all_modes, estimate_modes
from elastid.modal.spec import ModalSpec
from elastid.record import Record
from elastid.response import Covariance, Response


def test_an_exponential_window_is_taken_out_of_the_damping() -> None:
    r"""Hits with answers times exp(-t / 0.5 s): the poles of the response have 2 / s more of damping each."""
    tau, t = 0.5, np.arange(2**14) / 400
    poles = 2 * np.pi * NATURAL * (1j * np.sqrt(1 - ZETA**2) - ZETA) - 1 / tau
    G = np.fft.rfft(np.sum(np.exp(np.outer(t, poles)).imag * NATURAL, axis=1))[32:8000:4] / 400
    freq_hz = (np.fft.rfftfreq(len(t), 1 / 400))[32:8000:4]
    response = Response(freq_hz, G[:, None, None], ("u",), ("y",), "velocity", BENCH)
    found = estimate_modes(response, (1, 150), exponential_s=tau)
    damping = [found.zeta[np.argmin(np.abs(found.freq_hz - f))] for f in NATURAL]
    np.testing.assert_allclose(damping, ZETA, rtol=2e-3)


def shaken(seed: int) -> Record:
    """A minute of random force on five modes at 256 Hz, and 1 % of noise on their motion."""
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=16_000), np.zeros(16_000)
    for freq_hz, damping in zip(NATURAL, ZETA, strict=True):
        pole = np.exp(2 * np.pi * freq_hz / 256 * (1j * np.sqrt(1 - damping**2) - damping))
        y += freq_hz * lfilter([0, pole.imag], [1, -2 * pole.real, abs(pole) ** 2], u)
    u, y = u[2000:, None], y[2000:, None]
    y += 0.01 * y.std() * rng.normal(size=y.shape)
    return Record("a", BENCH, 0, 0, 256.0, len(u), ("1",), ("1",), ("velocity",), u, y, is_periodic=False)


@pytest.mark.slow
def test_dampings_by_segments_have_no_leakage() -> None:
    """Five modes of a random shaker by H1, barely resolved: 20 dampings unbiased, too large by 3 % and more without."""
    ratios, without = [], []
    for seed in range(4):
        response = estimate([shaken(seed)], EstimatorSpec(method="h1", quantity="velocity"))
        for values, each in ((ratios, response), (without, replace(response, window="", segment_s=0.0))):
            modes = estimate_modes(each)
            near = [int(np.argmin(np.abs(modes.freq_hz - f))) for f in NATURAL]
            values.append(modes.zeta[near] / ZETA)
    assert abs(np.mean(ratios) - 1) < 0.015
    assert np.mean(without) > 1.03


def test_the_intervals_hold_the_modes_of_whole_records() -> None:
    """Mean square of error over std of frequency and damping, 12 draws of multisines on three masses: at most 2."""
    natural, damping, _ = true_modes()
    errors = []
    for draw in range(12):
        logs = [log for m in range(2) for log in shake(256.0, 2048, 3, 100 + 2 * draw + m)]
        records = [
            Record(
                f"{i}", BENCH, i // 2, i % 2, 256.0, 2048, ("a", "b"), ("1", "2", "3"), ("acceleration",) * 3, *parts
            )
            for i, parts in enumerate((log[:, :2], log[:, 2:]) for log in logs)
        ]
        modes = estimate_modes(estimate(tuple(records), EstimatorSpec(method="arithmetic"), None), max_order=12)
        freq_hz = natural / (2 * np.pi)
        errors.append([(modes.freq_hz - freq_hz) / modes.freq_std, (modes.zeta - damping) / modes.zeta_std])
    assert np.mean(np.square(errors)) < 2


def test_band_without_lines_is_refused_and_study_continues() -> None:
    response = modal_response(FREQ_HZ, NATURAL, ZETA, np.ones((1, 5)))
    with refused("modal/lines", place="configuration bench"):
        estimate_modes(response, band_hz=(40, 41))
    (none,) = estimate_all_modes([response], ModalSpec(band_hz=(40.0, 41.0)))
    assert none.shape_std.shape == none.shapes.shape == (1, 0)


def test_overloaded_hits_have_no_modes_but_those_that_are_named() -> None:
    """A note on clipped hits at the response; of a band alone its modes are found."""
    response = modal_response(FREQ_HZ, NATURAL, ZETA, np.ones((1, 5)), noise=0.01)
    clipped = replace(response, notes=(Note("frf/overload", "3 of 5 hits stay at 20", "record a"),))
    (none,) = estimate_all_modes([clipped], ModalSpec())
    assert none.n_modes == 0
    np.testing.assert_allclose(estimate_modes(clipped, poles_hz=tuple(NATURAL)).freq_hz, NATURAL, rtol=1e-3)


def test_a_roving_hammer_shows_shapes_where_it_hits() -> None:
    """The transposed response of one accelerometer and three hits: the same shapes and intervals, at the inputs."""
    shapes = np.random.default_rng(1).normal(size=(3, 5))
    still = modal_response(FREQ_HZ, NATURAL, ZETA, shapes, noise=0.02)
    uncertain = Covariance(still.std.transpose(0, 2, 1) ** 2, np.inf)
    roving = Response(
        FREQ_HZ, still.G.transpose(0, 2, 1), still.outputs, still.inputs, still.quantity, BENCH, noise=uncertain
    )
    expected, modes = estimate_modes(still), estimate_modes(roving)
    assert modes.places == still.outputs
    np.testing.assert_allclose(modes.freq_hz, expected.freq_hz, rtol=1e-5)
    np.testing.assert_allclose(modes.place_shapes[0], expected.shapes, atol=1e-2)
    np.testing.assert_allclose(modes.place_shapes[1], expected.shape_std, rtol=0.1)
