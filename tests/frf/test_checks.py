"""Exchanged channels are named; scales, signs and strong coupling are no exchange."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray
from elastid.frf.checks import separated_lines, unlike_notes
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.record import Configuration, Record

FREQ_HZ = np.linspace(1.0, 60.0, 60)
MOTORS = ("motor 1", "motor 2", "motor 3")


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
