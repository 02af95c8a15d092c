"""Exchanged channels are named; scales, signs and strong coupling are no exchange."""

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused
from plants.two_mass import circular

from elastid.base.arrays import ComplexArray
from elastid.covariance import Covariance
from elastid.frf import checks
from elastid.frf.checks import hit_notes, inconsistency_notes, pulses, separable_lines
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.record import Configuration, Record
from elastid.response import Response

MOTORS = ("motor 1", "motor 2", "motor 3")


def test_each_input_is_held_against_its_own_noise() -> None:
    """The second one is strong, weak but quiet, or absent; the first one is noisier than it throughout."""
    rng = np.random.default_rng(0)
    F, P, noise = 600, 4, np.array([1.0, 1e-5])
    second = np.tile([0.01, 0.001, 0.0], F // 3)
    size = np.stack([np.full(F, 6.0), second], axis=1)[:, :, None] * np.array([[1.0, 1.0], [1.0, -1.0]])
    U = np.exp(2j * np.pi * rng.random((F, 2, 1))) * size
    error = circular(rng, (F, P, 2, 2))
    X = U[:, None] + error * noise[:, None]
    mean, variance = X.mean(axis=1), X.var(axis=1, ddof=1).mean(axis=-1)
    block = Block(mean, mean, None, np.full(2, float(P)), variance, 2 * (P - 1))
    for method in ("arithmetic", "h1"):
        flags = separable_lines(MeanSpectra((block,), np.zeros(0), 0), [[]], method).reshape(-1, 3)
        assert flags[:, :2].mean() > 0.99
        assert flags[:, 2].mean() < 0.02


def test_a_record_that_the_other_realisations_contradict_is_named() -> None:
    """A torque that is 5 % off in one of six experiments; nothing without it, or where periods differ by as much."""
    rng, F, M = np.random.default_rng(2), 40, 3
    G = circular(rng, (F, 2, 2))
    U = circular(rng, (M, F, 2, 2))
    Y = G @ U + 0.01 * circular(rng, U.shape)
    record = Record("", Configuration("b", np.zeros(2)), 0, 0, 1.0, 4, *2 * (MOTORS[:2],), ("position",) * 2,
                    np.zeros((4, 2)), np.zeros((4, 2)))  # fmt: skip
    groups = [[replace(record, name=f"{m}-{e}", realisation=m, experiment=e) for e in range(2)] for m in range(M)]

    def places(U: ComplexArray, noise: float = 0.0) -> list[str]:
        blocks = tuple(Block(U[m], Y[m], None, np.full(2, 3.0), np.zeros((F, 2)), 4) for m in range(M))
        S = 12 * 3 * noise**2 * np.diag([1.0, 1.0, 0.0, 0.0])  # of 12 degrees of freedom, and means of 3 periods
        return [note.place for note in inconsistency_notes(MeanSpectra(blocks, np.tile(S + 0j, (F, 1, 1)), 12), groups)]

    assert places(U) == []
    U[2, :, 0, 1] *= 1.05
    assert places(U) == places(U, 0.01) == ["record 2-1"]
    assert places(U, 0.1) == []


RATE_HZ, WIDTH = 2000.0, 10
STARTS = (400, 4400, 8400)


def record(u: np.ndarray, y: np.ndarray) -> Record:
    names = ("hammer",), ("tip",), ("acceleration",)
    return Record(
        "a", Configuration("bench", np.zeros(0)), 0, 0, RATE_HZ, len(u), *names, u[:, None], y[:, None],
        is_periodic=False,
    )  # fmt: skip


def hits() -> tuple[np.ndarray, np.ndarray]:
    """Three half sines of 100, 80 and 120 N, and a mode of 50 Hz that rings after each."""
    u, y, t = np.zeros(12_000), np.zeros(12_000), np.arange(12_000) / RATE_HZ
    for start, size in zip(STARTS, (100.0, 80.0, 120.0), strict=True):
        u[start : start + WIDTH] = size * np.sin(np.pi * (np.arange(WIDTH) + 0.4) / WIDTH)
        after = np.maximum(t - start / RATE_HZ, 0)
        y += size * np.exp(-3 * after) * np.sin(2 * np.pi * 50.3 * after)
    return u, y


def codes(u: np.ndarray, y: np.ndarray) -> list[str]:
    return [note.code for note in hit_notes(record(u, y))]


def test_clean_hits_and_other_forces_have_no_note() -> None:
    u, y = hits()
    assert codes(u, y) == []
    assert pulses(np.random.default_rng(0).normal(size=5000)) is None
    assert pulses(np.zeros(100)) is None


def test_a_double_hit_is_named_with_its_dips() -> None:
    """A second blow 25 ms later and half as strong makes dips every 40 Hz."""
    u, y = hits()
    u[4450 : 4450 + WIDTH] = 0.5 * u[4400 : 4400 + WIDTH]
    (note,) = hit_notes(record(u, y))
    assert note.code == "frf/hits"
    assert "1 of 3 hits of hammer are double hits, the first at 2.2 s (25 ms apart)" in note.text


@pytest.mark.parametrize(
    ("fault", "code"), [("force", "frf/overload"), ("answer", "frf/overload"), ("begin", "frf/hits"),
                        ("end", "frf/hits")],
)  # fmt: skip
def test_faults_are_named(fault: str, code: str) -> None:
    u, y = hits()
    if fault == "force":
        u = np.minimum(u, 70.0)
    elif fault == "answer":
        y = np.clip(y, -50.0, 50.0)
    elif fault == "begin":
        u, y = u[STARTS[0] + 3 :], y[STARTS[0] + 3 :]
    else:
        u, y = u[: STARTS[2] + 3], y[: STARTS[2] + 3]
    assert codes(u, y) == [code]


def test_records_of_configuration_share_clock_and_locations() -> None:
    """Clocks differ by at most 1e-4."""
    first = record(*hits())
    checks.check_consistency([first, replace(first, rate_hz=RATE_HZ * (1 + 9e-5))])
    for changed in ({"rate_hz": RATE_HZ * (1 - 2e-4)}, {"inputs": MOTORS[:1]}):
        with refused("frf/records"):
            checks.check_consistency([first, replace(first, **changed)])


def test_equal_phases_and_scattered_realisations_have_a_note() -> None:
    """Inputs that differ by 10 % are a repeat; scatter of 0.5 |G| counts at 50 times the noise, not at twice."""
    U = np.random.default_rng(0).normal(size=(99, 1, 1)) + 0j
    blocks = [Block(u, u, None, np.full(1, 2.0), np.zeros((99, 1)), 4) for u in (U, 1.1 * U, U[::-1])]
    assert len(checks.repeated_phase_notes(blocks, 3 * [[record(*hits())]])) == 1
    noise, total = (Covariance(np.full((99, 1, 1), std**2), 4) for std in (0.01, 0.5))
    names = ("motor 1",), ("motor 1",), "position"
    G = Response(np.arange(1.0, 100), np.ones((99, 1, 1)) + 0j, *names, Configuration("b", np.zeros(1)), noise, total)
    noises = (noise, Covariance(total.variance / 4, 4), None)
    assert [len(checks.scatter_notes(replace(G, noise=part))) for part in noises] == [1, 0, 0]
