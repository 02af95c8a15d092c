"""Exchanged channels are named; scales, signs and strong coupling are no exchange."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elastid.base.arrays import ComplexArray
from elastid.frf.checks import channel_notes, separated_lines, unlike_notes
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.record import Configuration, Record
from elastid.response import Covariance, Response

FREQ_HZ = np.linspace(1.0, 60.0, 60)
MOTORS = ("motor 1", "motor 2", "motor 3")


def arm(seed: int, noise: float = 0.0) -> Response:
    """Accelerations of three motors, rigidly and elastically coupled by any positive definite inertia."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6))
    M = A @ A.T + 0.3 * np.eye(6)
    springs = np.diag(rng.uniform(200, 2000, 3))
    K = np.block([[springs, -springs], [-springs, springs]])
    s = 2j * np.pi * FREQ_HZ[:, None, None]
    G = s**2 * np.linalg.inv(M * s**2 + (K + 1e-3 * s * K))[:, :3, :3]
    G = G * (1 + noise * (rng.normal(size=G.shape) + 1j * rng.normal(size=G.shape)))
    return Response(FREQ_HZ, G, MOTORS, MOTORS, "acceleration", Configuration("home", np.zeros(3)))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), scale=st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_no_passive_arm_is_said_to_be_exchanged_whatever_the_scales_of_its_channels(
    seed: int, scale: list[float]
) -> None:
    """The relative gain of a positive definite matrix is at least 1 on its diagonal, in any units."""
    response = arm(seed)
    response = replace(response, G=10 ** np.array(scale)[:, None] * response.G)
    assert not any(note.code == "frf/exchanged-channels" for note in channel_notes(response))


def test_each_input_is_held_against_its_own_noise() -> None:
    """The second one is strong, weak but quiet, or absent; the first one is noisier than it throughout."""
    rng = np.random.default_rng(0)
    F, P, noise = 600, 4, np.array([1.0, 1e-5])
    second = np.tile([0.01, 0.001, 0.0], F // 3)
    size = np.stack([np.full(F, 6.0), second], axis=1)[:, :, None] * np.array([[1.0, 1.0], [1.0, -1.0]])
    U = np.exp(2j * np.pi * rng.random((F, 2, 1))) * size
    error = rng.normal(size=(F, P, 2, 2)) + 1j * rng.normal(size=(F, P, 2, 2))
    X = U[:, None] + error * noise[:, None] / np.sqrt(2)
    mean, variance = X.mean(axis=1), X.var(axis=1, ddof=1).mean(axis=-1)
    block = Block(mean, mean, None, np.full(2, float(P)), variance, 2 * (P - 1))
    flags = separated_lines(MeanSpectra((block,), np.zeros(0), 0), [[]], "arithmetic").reshape(-1, 3)
    assert flags[:, :2].mean() > 0.99
    assert flags[:, 2].mean() < 0.02


def test_a_sign_within_the_noise_is_not_reported() -> None:
    """An inertia turned round, with a standard deviation as large as the response, in any unit; and far below it."""
    place, configuration = ("motor 1",), Configuration("home", np.zeros(1))
    for size in (1e-6, 1.0, 1e6):
        G = -size * np.ones((60, 1, 1))
        for relative, codes in ((1.0, []), (1e-3, ["frf/wrong-sign"])):
            noise = Covariance(np.full(G.shape, (relative * size) ** 2), 10.0)
            turned = Response(FREQ_HZ, G, place, place, "acceleration", configuration, noise)
            assert [note.code for note in channel_notes(turned)] == codes


def test_a_response_of_zeros_is_no_exchange() -> None:
    """Nothing can be said of a singular matrix."""
    response = arm(0)
    assert channel_notes(replace(response, G=0 * response.G)) == ()


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_an_exchange_is_named_whatever_the_units_of_a_channel(size: float) -> None:
    """Nine decades between outputs make the matrix look singular, unless scales are taken out first."""
    response = arm(0)
    G = response.G[:, [0, 2, 1]] * np.array([1.0, size, 1.0])[:, None]
    (note,) = channel_notes(replace(response, G=G))
    assert note.code == "frf/exchanged-channels"
    assert "motor 2" in note.text
    assert "motor 3" in note.text


def test_a_record_that_the_other_realisations_contradict_is_named() -> None:
    """A torque that is 5 % off in one of six experiments; without it nothing is said."""
    rng, F, M = np.random.default_rng(2), 40, 3
    G = rng.normal(size=(F, 2, 2)) + 1j * rng.normal(size=(F, 2, 2))
    U = rng.normal(size=(M, F, 2, 2)) + 1j * rng.normal(size=(M, F, 2, 2))
    Y = G @ U + 0.01 * (rng.normal(size=U.shape) + 1j * rng.normal(size=U.shape))
    record = Record("", Configuration("b", np.zeros(2)), 0, 0, 1.0, 4, *2 * (MOTORS[:2],), ("position",) * 2,
                    np.zeros((4, 2)), np.zeros((4, 2)))  # fmt: skip
    groups = [[replace(record, name=f"{m}-{e}", realisation=m, experiment=e) for e in range(2)] for m in range(M)]

    def places(U: ComplexArray) -> list[str]:
        blocks = [Block(U[m], Y[m], None, np.ones(2), np.zeros((F, 2)), 1) for m in range(M)]
        return [note.place for note in unlike_notes(blocks, groups)]

    assert places(U) == []
    U[2, :, 0, 1] *= 1.05
    assert places(U) == ["record 2-1"]
