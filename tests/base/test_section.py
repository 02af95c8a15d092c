"""Sections check the bounds that stand beside their keys."""

from dataclasses import replace
from typing import Annotated

import pytest

from elastid.base.section import Key, section
from elastid.base.units import Ratio, Time


@section
class Sample:
    time: Annotated[Time | None, Key("Time.", "longer.", above=0)] = None
    shares: Annotated[tuple[Ratio, ...] | Ratio, Key("Shares.", "more.", least=0)] = 0.0
    count: Annotated[int, Key("Count.", "more.", least=2)] = 2
    band: Annotated[tuple[Ratio, Ratio], Key("Band.", "wider.", rising=True)] = (0.1, 0.9)


@pytest.mark.parametrize(
    "given", [{"time": 0.0}, {"time": float("nan")}, {"shares": (0.5, -0.1)}, {"count": 1}, {"band": (0.5, 0.5)}]
)
def test_a_number_out_of_its_bounds_is_named(given: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"^{next(iter(given))}: "):
        replace(Sample(), **given)


def test_unnamed_first_number_is_refused_with_its_name() -> None:
    with pytest.raises(ValueError, match=r"^time: "):
        Sample(-1.0)
