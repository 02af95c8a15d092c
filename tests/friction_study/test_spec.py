"""Sections of a study of friction: ranges and lists that make no sense are refused in the words of the user."""

from collections.abc import Callable

import pytest

from elastid.friction_study.spec import (
    AtRestSpec,
    FilterSpec,
    FrictionSpec,
    LoadSpec,
    PassesSpec,
    PreslidingSpec,
    WarmUpSpec,
)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PassesSpec(speeds=(0.0, 1.0)), r"speeds is \[0, 1\]; give \[lowest, highest\], both above 0"),
        (lambda: PassesSpec(window=(1.0, -1.0)), r"window is \[1, -1\]; give \[lower, upper\]"),
        (lambda: PassesSpec(count=4), "count is 4; the numbers of a Stribeck curve need at least 5 passes"),
        (lambda: PreslidingSpec(torque=(0.9, 0.1)), r"torque is \[0.9, 0.1\]; give \[smallest, largest\], above 0"),
        (lambda: AtRestSpec(band_hz=(80.0, 5.0)), r"band_hz is \[80, 5\]; give \[lowest, highest\], above 0"),
        (lambda: AtRestSpec(torque=(1.0,)), "above 0 and below 1"),
        (lambda: WarmUpSpec(speed=1.0, time=300.0, test_every=300.0), "tests must come within the warm-up"),
        (lambda: FrictionSpec(joints=("2", "1", "2")), "joints: 2 is given twice"),
        (lambda: FrictionSpec(loads=(LoadSpec("a"), LoadSpec("a"))), "loads: a is given twice"),
        (lambda: FilterSpec(states=("f", "f+")), "give f, or f\\+ and f-, not both"),
    ],
)
def test_senseless_keys_are_refused(make: Callable[[], object], message: str) -> None:
    """The message names the key, its value and what is expected."""
    with pytest.raises(ValueError, match=message):
        make()


def test_a_window_may_lie_below_zero_and_a_lone_load_need_no_name() -> None:
    """Positions have either sign; the robot as it is has no load to name."""
    assert PassesSpec(window=(-2.0, -1.0)).window == (-2.0, -1.0)
    assert LoadSpec("").payload == 0
