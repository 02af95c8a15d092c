"""Which effects the records of another simulator show."""

import numpy as np
import pytest

from elastid.nonlinear.gear.find import find_gear_effects
from elastid.nonlinear.gear.levels import Levels
from tests.nonlinear.gear.test_levels import SPEC, linear_fit
from tests.plants.two_mass_gear import LINES, Gear, records, robot


def found(gear: Gear, substeps: int = 6) -> tuple[Levels, dict[str, float]]:
    """What is chosen, and the numbers of the model beside it."""
    measured = records(gear, substeps=substeps)
    response, linear = linear_fit(gear, measured)
    levels = find_gear_effects([measured], [response], linear, robot(gear), SPEC, planned=LINES)
    return levels, linear.parameters.as_dict(levels.x)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gear", "expected"),
    [
        (Gear(), {}),
        (Gear(F_l=30.0), {"behind": 30.0}),
        (Gear(F_m=20.0, F_l=12.0), {"friction": 20.0, "behind": 12.0}),
        (
            Gear(F_m=20.0, F_l=12.0, k_3=2e9, error=2e-5),
            {"friction": 20.0, "behind": 12.0, "cubic": 2e9, "error sine": 2e-5},
        ),
    ],
)
def test_what_a_gear_does_is_found_on_its_side_and_at_its_level(gear: Gear, expected: dict[str, float]) -> None:
    """Levels within 3 % or 3 std, k within 0.1 % and d within 2 %: a linear fit has d 27 % off."""
    # Steps over reversals of a coarser plant are as large as what an error of 2e-5 rad does.
    levels, numbers = found(gear, 24 if gear.error else 6)
    by_kind = {
        effect.kind: (f, std)
        for effect, f, std in zip(levels.effects, levels.levels.tolist(), levels.std.tolist(), strict=True)
    }
    cosine, _ = by_kind.pop("error cosine", (0.0, 0.0))
    assert set(by_kind) == set(expected)
    for kind, (f, std) in by_kind.items():
        assert abs(f - expected[kind]) < max(0.03 * expected[kind], 3 * std), kind
    assert abs(cosine) < 0.03 * expected.get("error sine", 1.0)
    assert numbers["k_1"] == pytest.approx(gear.k, rel=1e-3)
    assert numbers["d_1"] == pytest.approx(gear.d, rel=2e-2)
    assert np.isfinite(levels.covariance).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gear", "expected"),
    [
        (Gear(k_2s=2e7), [("progressive", 2e7, 0.0)]),
        (Gear(gap=1e-4, loose=0.3, F_m=20.0), [("friction", 20.0, 0.0), ("gap", 1.4e5, 1e-4)]),
        (Gear(ranges=((100.0, 1.4), (300.0, 1.7))), [("range", 6e4, 1e-3 * 17 / 14), ("range", 8e4, 5e-4)]),
    ],
)
def test_springs_have_their_law_and_its_ends(gear: Gear, expected: list[tuple[str, float, float]]) -> None:
    """A progressive one, lost motion beside friction, K1 K2 K3: ends within 2 % or 3 std, k at once within 0.05 %."""
    levels, numbers = found(gear)
    every = sorted(
        zip(levels.effects, levels.levels.tolist(), levels.std, levels.scale_std, strict=True),
        key=lambda each: (each[0].kind, each[1]),
    )
    assert [effect.kind for effect, *_ in every] == [kind for kind, *_ in expected]
    for (effect, f, std, scale_std), (kind, level, scale) in zip(every, expected, strict=True):
        assert abs(f - level) < max(0.02 * level, 3 * std), kind
        if scale:
            assert abs(effect.scale - scale) < max(0.02 * scale, 3 * scale_std), kind
    assert numbers["k_1"] == pytest.approx(gear.k, rel=5e-4)
