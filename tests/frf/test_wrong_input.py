"""Records that hold no frequency response are refused by every estimator with a message, and never by a traceback."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused

from elastid.excitation.multisine import orthogonal_set, synthesise
from elastid.frf.estimate import LOCAL, estimate
from elastid.frf.methods import METHODS
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Record

N, PERIODS, LINES = 256, 6, np.arange(3, 60)
Change = Callable[[Record], Record]


def _records(seed: int = 0) -> list[Record]:
    """Two realisations of two experiments, two inputs and outputs, with noise and the torque that was injected."""
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(len(LINES), 2, 2)) + 1j * rng.normal(size=(len(LINES), 2, 2))
    records = []
    for m in range(2):
        for e, U in enumerate(orthogonal_set(np.ones((len(LINES), 2)), rng)):
            r, y = (np.tile(synthesise(LINES, X, N), (PERIODS, 1)) for X in (U, np.einsum("fyu,fu->fy", G, U)))
            u, y = (x + 0.01 * rng.normal(size=x.shape) for x in (r, y))
            name, places = f"m{m}e{e}", ("motor 1", "motor 2")
            quantities = ("acceleration", "acceleration")
            records.append(Record(name, Configuration("c", [0.0]), m, e, 500.0, N, places, places, quantities, u, y, r))
    return records


def _with(channel: int, value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda x: np.where(np.arange(2) == channel, value, x)


def _noise(record: Record) -> Record:
    rng = np.random.default_rng(10 * record.realisation + record.experiment)
    return replace(record, u=rng.normal(size=record.u.shape), y=rng.normal(size=record.y.shape))


NO_INPUT: dict[str, Change] = {
    "no torque": lambda r: replace(r, u=0 * r.u),
    "one motor at rest": lambda r: replace(r, u=_with(1, 0.0)(r.u)),
    "one torque logged twice": lambda r: replace(r, u=np.repeat(r.u[:, :1], 2, axis=1)),
    "noise alone": _noise,
}
ABSURD: dict[str, Change] = {
    "huge torque": lambda r: replace(r, u=1e200 * r.u),
    "huge motion": lambda r: replace(r, y=1e250 * r.y),
    "vanishing torque": lambda r: replace(r, u=1e-200 * r.u),
    "vanishing motion": lambda r: replace(r, y=1e-160 * r.y),
}


@pytest.mark.parametrize("method", [*METHODS, *LOCAL])
@pytest.mark.parametrize("change", NO_INPUT.values(), ids=NO_INPUT)
def test_inputs_that_tell_nothing_are_refused(change: Change, method: str) -> None:
    """By mean over realisations, pooled, and local methods alike; the message names the inputs."""
    with refused("frf/inputs-together", "frf/lines"):
        estimate([change(r) for r in _records()], EstimatorSpec(method=method), LINES)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["arithmetic", "errors_in_variables", "local_rational"])
@pytest.mark.parametrize("change", ABSURD.values(), ids=ABSURD)
def test_sizes_beyond_any_sensor_are_refused_with_their_channel(change: Change, method: str) -> None:
    """A wrong unit, or a placeholder for a missing value; squares of it would overflow."""
    with refused("records/missing-samples", place="record m0e0"):
        estimate([change(r) for r in _records()], EstimatorSpec(method=method), LINES)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_an_output_that_does_not_move_is_named(value: float) -> None:
    """A word with methods that can do without it, a refusal where G would have to be inverted."""
    records = [replace(r, y=_with(1, value)(r.y)) for r in _records()]
    response = estimate(records, EstimatorSpec(method="arithmetic"), LINES)
    (note,) = [note for note in response.notes if note.code == "frf/barely-excited"]
    assert "motor 2" in note.text
    assert np.abs(response.G[:, 1]).max() < 1e-9
    with refused("frf/inputs-together", place="configuration c"):
        estimate(records, EstimatorSpec(method="h2"), LINES)
    assert "frf/barely-excited" not in [n.code for n in estimate(_records(), EstimatorSpec(), LINES).notes]
