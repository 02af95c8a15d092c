"""Springs that are not straight are found in the records of another simulator, and nothing else is taken for one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.nonlinear.spectra import gather_lines
from elastid.nonlinear.straightness import Bend, find_bends, straightness_notes
from elastid.nonlinear.take_out import estimate_without_friction
from elastid.response import NOT_STRAIGHT
from tests.nonlinear.test_gear_levels import SPEC
from tests.plants.two_mass_gear import LINES, Gear, records, robot

FILE = robot(Gear(k=1.4e5))  # what is known of the robot before


@cache
def bends(gear: Gear, experiments: int = 4) -> tuple[Bend, ...]:
    """Of the only gear, whose stiffness the file has 30 % off."""
    return tuple(find_bends(gather_lines(records(gear, experiments=experiments), SPEC, LINES), ["motor 1"], FILE))


@pytest.mark.slow
@pytest.mark.parametrize("gear", [Gear(F_m=30.0), Gear(F_m=20.0, F_l=12.0, error=5e-5)])
def test_a_straight_spring_is_left_alone(gear: Gear) -> None:
    """With friction left in at the motor and behind the gear, and a transmission error."""
    assert bends(gear) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gear", "shapes"),
    [
        (Gear(k_3=4e7), ("cubic", "progressive")),
        (Gear(gap=1e-4, loose=0.3), ("gap",)),
        (Gear(ranges=((100.0, 1.4), (300.0, 1.7))), ("cubic", "progressive", "gap")),
        (Gear(F_m=20.0, F_l=12.0, k_3=2e9), ("cubic", "progressive")),
    ],
)
def test_a_spring_that_stiffens_or_has_a_gap_is_found(gear: Gear, shapes: tuple[str, ...]) -> None:
    """From 0.1 % of stiffness on, and beside friction of a tenth of the torque."""
    (bend,) = bends(gear)
    assert bend.shape in shapes
    assert bend.drop > 100


@pytest.mark.slow
def test_the_stiffness_of_an_amplitude_is_as_much_larger_as_its_records_show() -> None:
    """Of tau^3 to first order."""
    gear = Gear(k_3=4e7)
    (bend,) = bends(gear)
    size = bend.torque / gear.k
    x = np.linspace(-4, 4, 4001) * size
    weight = np.exp(-((x / size) ** 2) / 2)
    line = np.average(x**4, weights=weight) / np.average(x**2, weights=weight)
    assert bend.softer == pytest.approx(-gear.k_3 / gear.k * line, rel=0.2)


@pytest.mark.slow
def test_one_realisation_shows_it_between_the_excited_lines() -> None:
    assert bends(Gear(), experiments=1) == ()
    assert len(bends(Gear(k_3=4e9), experiments=1)) == 1


@pytest.mark.slow
def test_a_fit_of_a_spring_that_is_not_straight_does_not_converge_in_silence() -> None:
    """Though V of it is that of the noise; its numbers are those of one amplitude, and it says of which."""
    gear = Gear(k_3=4e8)
    measured = records(gear)
    response = estimate_without_friction(measured, None, SPEC, LINES, robot=FILE)
    (note,) = [note for note in response.notes if note.code == NOT_STRAIGHT]
    assert note.text.startswith("the spring in the gear of motor 1 is not straight: at 2")
    spec = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}, starts=1)
    result = identify([response], FILE, spec)
    assert result.status == "misfit"
    assert result.cost < 1.5 * result.cost_expected
    assert "the numbers are those of this amplitude alone" in result.message
    assert all(verdict.startswith("not to be believed") for verdict in result.verdicts[:2])


@pytest.mark.slow
def test_records_that_do_not_say_have_no_notes() -> None:
    """Without a period, and without the motor's angle."""
    measured = records(Gear(), experiments=2)
    endless = [replace(each, is_periodic=False, period_samples=each.n_samples) for each in measured]
    unseen = [replace(each, outputs=("joint 1",)) for each in measured]
    assert straightness_notes(endless, FILE, SPEC, LINES) == straightness_notes(unseen, FILE, SPEC, LINES) == ()
