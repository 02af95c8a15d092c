"""Records and sections from which effects of gears cannot be found: each with the reason."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from plants.refusals import refused
from plants.two_mass_gear import LINES, POSTURE, RATE_HZ, RATIO, SAMPLES, Gear, robot

from elastid.fit.result import Result
from elastid.fit.result_rows import ModificationIndex
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import EXACT
from elastid.nonlinear.gear_characteristics import LOST, coarse_encoders, difference, refusal, unexplained_fraction
from elastid.nonlinear.gear_estimation import GearData
from elastid.nonlinear.hidden_motion_smoother import SmoothedMotion
from elastid.nonlinear.period_model import DriveLines
from elastid.nonlinear.spec import GearsSpec
from elastid.nonlinear.spectra import PeriodLines
from elastid.parameters import Parameter, Parameters
from elastid.response import Response
from elastid.robot import Robot
from elastid.study import load


@dataclass(frozen=True)
class Case:
    """Lines of two experiments whose motion is that of the linear model, with noise, and its response."""

    data: list[PeriodLines]
    drives: list[DriveLines]
    whole: GearData
    result: Result

    @property
    def words(self) -> str:
        return refusal(replace(self.whole, lines=self.data), self.drives, self.result)


def case(gear: Gear | None = None, *, noise: float = 1e-8) -> Case:
    """Two realisations, 200 Nm rms at the excited lines."""
    plant: Robot = robot(Gear() if gear is None else gear)
    numbers = plant.parameters() | {"delay": (0.0, "s")}
    free = ("k_1", "d_1")
    parameters = Parameters(
        tuple(Parameter(name, x, unit, log=name in free, free=name in free) for name, (x, unit) in numbers.items())
    )
    linearisation = Linearisation.of_robot(plant, EXACT, parameters.names)
    none = np.zeros(2, bool)
    result = Result(
        parameters, parameters.x, 1e-6 * np.eye(2), 1.0, 1, 1.0, "converged", "", (), 1, none, np.ones(2), "complex"
    )
    F, random = int(2 * LINES[-1]), np.random.default_rng(1)
    excited = np.isin(np.arange(1, F + 1), LINES)
    U = np.where(excited[:, None, None], 30 * np.exp(2j * np.pi * random.uniform(size=(F, 1, 2))), 0.0)
    freq_hz, place = LINES * RATE_HZ / SAMPLES, ("motor 1",)
    G = Response(freq_hz, np.zeros((len(LINES), 1, 1), complex), place, place, "acceleration", POSTURE)
    scatter = np.full((F, 1), noise**2)
    lines = PeriodLines(
        POSTURE, RATE_HZ, SAMPLES, U, U, *np.zeros((2, 1, 2)), np.array([noise**2]), scatter, excited,
        np.arange(2), np.zeros(1), np.ones(1, bool),
    )  # fmt: skip
    data = GearData([lines], [G], linearisation)
    drives = data.drives(parameters, result.x)
    lines = replace(lines, Y=drives[0].G @ U)
    return Case([lines], drives, replace(data, lines=[lines]), result)


def test_good_records_are_not_refused() -> None:
    """And the linear model leaves nothing of what it has made itself; a force at the motor is left."""
    good = case()
    assert good.words == ""
    assert coarse_encoders(good.data, good.drives) == []
    nothing = SmoothedMotion.start(good.data[0], good.drives[0], 1)
    assert unexplained_fraction(good.whole, good.drives, [nothing], np.ones(1)) < 1e-12
    pushed = replace(nothing, Phi=(0.1 * good.drives[0].B @ good.data[0].U)[..., None])
    assert unexplained_fraction(good.whole, good.drives, [pushed], np.ones(1)) == pytest.approx(0.1)


def test_one_realisation_is_refused() -> None:
    """An effect must predict realisations that it was not fitted to."""
    good = case()
    assert "one realisation" in replace(good, data=[replace(good.data[0], realisation=np.zeros(2, np.int64))]).words


def test_gears_that_are_rigid_within_the_band_are_refused() -> None:
    """A first mode above the lines, with both frequencies."""
    stiff = case(Gear(k=2e8))
    assert "lies above the highest excited line" in stiff.words


def test_a_torque_that_lags_is_refused() -> None:
    """Where a delay explains most of a misfit; not where the fit is none."""
    good = case()
    moved = np.zeros(1), ("s",), (False,), np.array([2e-3])
    late = ModificationIndex("delay", "time", ("delay",), *moved, 1e-5, 9.0, 0.9, np.zeros(2))
    misfit = replace(good.result, status="misfit", indices=(late,))
    assert "torque_lag" in replace(good, result=misfit).words
    assert replace(good, result=replace(misfit, status="converged")).words == ""
    assert "ended as not converged" in replace(good, result=replace(good.result, status="not_converged")).words


def test_records_that_are_not_settled_are_refused() -> None:
    """By how far their periods differ."""
    good = case()
    motion = np.mean(np.abs(good.data[0].Y) ** 2, axis=2)
    apart = {share: replace(good, data=[replace(good.data[0], scatter=share**2 * motion)]) for share in (0.02, 0.2)}
    assert "differ by up to 20 % of the motion" in apart[0.2].words
    assert apart[0.02].words == ""
    noisy = replace(good.data[0], scatter=good.data[0].scatter + motion.mean(), noise=np.array([motion.mean()]))
    assert difference(noisy) < 1e-3  # of an encoder, at all lines alike


def test_an_encoder_that_hides_the_deflection_is_named() -> None:
    """Noise of a fifth of the torsion of the gear, with both sizes."""
    good = case()
    bent = np.abs(good.data[0].Y[good.data[0].excited]).mean()
    (note,) = coarse_encoders(case(noise=3 * bent).data, good.drives)
    assert note.place == "motor 1"


def test_counts_that_are_not_small_against_the_deflection_leave_the_fit_as_it_is() -> None:
    """Of the only gear: nothing is looked for; of fewer counts than that nothing is said."""
    good = case()
    bent = np.sqrt(np.sum(np.mean(np.abs(good.drives[0].moved("gear", 0, good.data[0].U)) ** 2, axis=1)) / 2)
    coarse, fine = (replace(good, data=[replace(good.data[0], count=np.array([part * bent]))]) for part in (0.05, 0.01))
    assert "counts of" in coarse.words
    assert coarse.words.endswith(LOST)
    assert fine.words == ""
    assert RATIO == 100


ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("orders", [(), (1.0, 1.0)])
def test_orders_that_no_turn_has_are_refused(orders: tuple[float, ...]) -> None:
    """None, not positive, or the same twice."""
    with pytest.raises(ValueError, match="orders"):
        GearsSpec(orders=orders)


def test_a_study_of_friction_has_no_gears_to_lay_open() -> None:
    """Nor has one without records of an elastic robot: the section is refused with a reason."""
    study = ROOT / "elastid" / "app" / "templates" / "friction" / "study.yml"
    with refused("study/invalid"):
        load(study, ["gears={}"])
    assert load(ROOT / "configs" / "gear.yml", ["gears={orders: [1, 12]}"]).study.gears == GearsSpec(orders=(1.0, 12.0))
