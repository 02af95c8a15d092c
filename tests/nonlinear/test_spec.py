"""The section `gears` of a study."""

from __future__ import annotations

from pathlib import Path

import pytest
from plants.refusals import refused

from elastid.nonlinear.spec import GearsSpec
from elastid.study import load

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(("orders", "words"), [((), "give one or more"), ((0.0,), "positive"), ((1.0, 1.0), "twice")])
def test_orders_that_no_turn_has_are_refused(orders: tuple[float, ...], words: str) -> None:
    """None, not positive, or the same twice."""
    with pytest.raises(ValueError, match=words):
        GearsSpec(orders=orders)


def test_a_study_of_friction_has_no_gears_to_lay_open() -> None:
    """Nor has one without records of an elastic robot: the section is refused with a reason."""
    study = ROOT / "elastid" / "app" / "templates" / "friction" / "study.yml"
    with refused("study/invalid"):
        load(study, ["gears={}"])
    assert load(ROOT / "configs" / "gear.yml", ["gears={orders: [1, 12]}"]).study.gears == GearsSpec(orders=(1.0, 12.0))
