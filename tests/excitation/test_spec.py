"""Multisines that a study cannot ask for, each refused by the key that is to blame, next to some that it can."""

from typing import Any

import pytest
from plants.refusals import advised

from elastid.excitation.spec import MultisineSpec

KNOWN = {"rate_hz": 500.0, "period": 2.0, "band_hz": (1.0, 60.0), "torque_rms": (20.0, 5.0)}
GOOD = (
    {"rate_hz": 1000 / 3, "period": 3.0},
    {"torque_rms": "limits", "group": 2, "margin": 0.0},
    {"torque_rms": ((20.0, 5.0), (10.0, 5.0))},
    {"spectrum": ((1.0, 0.5), (60.0, 1.0)), "group": 100},
    {"grid": "lines", "lines": (3, 7)},
    {"phases": "schroeder", "grid": "odd"},
    {"flat": "information", "least": 1.0, "band_hz": (1.0, 249.5)},
)
SPOILT = (
    ("period", {"period": 2e6}),
    ("period", {"period": 2.0005}),
    ("band_hz", {"band_hz": (1.0, 250.0)}),
    ("torque_rms", {"torque_rms": (20.0, 0.0)}),
    ("torque_rms", {"torque_rms": ((20.0, 5.0), (20.0, 5.0))}),
    ("lines", {"grid": "lines"}),
    ("lines", {"lines": (3, 7)}),
    ("least", {"least": 0.2}),
    ("flat", {"flat": "information", "torque_rms": ((20.0, 5.0), (10.0, 5.0))}),
    ("flat", {"flat": "information", "power": 1.0}),
    ("flat", {"flat": "information", "spectrum": ((1.0, 0.5),)}),
)


@pytest.mark.parametrize(("key", "keys"), SPOILT, ids=str)
def test_unplayable_multisine_is_refused_by_its_key(key: str, keys: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=key):
        MultisineSpec(**{**KNOWN, **keys})


def test_the_period_that_a_refusal_gives_is_taken():
    known = KNOWN | {"rate_hz": 512.0}
    with pytest.raises(ValueError, match=r"632\.064 samples at 512 Hz") as caught:
        MultisineSpec(**{**known, "period": 1.2345})
    assert MultisineSpec(**{**known, "period": advised(caught, "take")}).period_samples == 632


def test_amplitudes_are_levels_that_are_measured_one_after_the_other() -> None:
    """Two amplitudes are two levels, each a multisine of its own; one amplitude is the multisine itself."""
    two = MultisineSpec(**{**KNOWN, "torque_rms": ((20.0, 5.0), (10.0, 2.5))})
    assert [two.at_amplitude(level).amplitudes for level in (1, 2)] == [((20.0, 5.0),), ((10.0, 2.5),)]
    assert MultisineSpec(**KNOWN).at_amplitude(1).amplitudes == ((20.0, 5.0),)


@pytest.mark.parametrize("keys", GOOD, ids=str)
def test_a_multisine_that_can_be_played_is_taken(keys: dict[str, Any]) -> None:
    assert MultisineSpec(**{**KNOWN, **keys}).period_samples == 1000
