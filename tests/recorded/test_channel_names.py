"""Channels against their names and each other."""

import pytest

from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.channel_guess import doubts_by_names


def motion(name: str, k: int = 1, **keys: object) -> ChannelSpec:
    return ChannelSpec("y", f"motor {k}", name, **({"quantity": "position"} | keys))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        ((ChannelSpec("u", "motor 1", "tau"), motion("tau")), [(1, "channel")]),
        ((ChannelSpec("u", "motor 1", "phi_mot"), motion("trq_mot")), [(0, "channel")]),
        (tuple(motion(f"q_{k}", k, unit="deg" if k == 2 else "rad") for k in (1, 2, 3, 4)), [(1, "unit")]),
        ((motion("Angle [deg]"),), [(0, "unit")]),
        ((motion("Speed [rpm]", unit="deg"),), [(0, "quantity")]),
        ((ChannelSpec("u", "motor 1", "tau"), motion("q", unit="deg")), []),
        ((motion("q_1", 1, unit="deg"), motion("q_2", 2)), []),  # which of two is at fault, nothing says
        ((motion("q_1", 1, unit="mm"), motion("q_2", 2, unit="deg"), motion("q_3", 3, unit="deg")), []),
        ((motion("Angle [deg]", scale=0.01745),), []),
        (tuple(motion("", k, column=k, unit="deg" if k == 2 else "rad") for k in (1, 2, 3, 4)), []),
    ],
)
def test_contradictions_are_found_at_their_channel(
    channels: tuple[ChannelSpec, ...], expected: list[tuple[int, str]]
) -> None:
    assert [(doubt.channel, doubt.key) for doubt in doubts_by_names(channels)] == expected
