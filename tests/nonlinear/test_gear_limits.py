"""Records and sections from which effects of gears cannot be found: each with the reason."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from plants.two_mass_gear import LINES, POSTURE, RATE_HZ, SAMPLES, Gear, robot

from elastid.fit.result import Result
from elastid.fit.result_rows import ModificationIndex
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import EXACT
from elastid.nonlinear.gear_estimation import GearData
from elastid.nonlinear.hidden_motion_smoother import SmoothedMotion
from elastid.nonlinear.identify_gears import FALLBACK, coarse_encoders, difference, refusal, unexplained_fraction
from elastid.nonlinear.period_lines import PeriodLines
from elastid.nonlinear.period_model import DriveLines
from elastid.parameters import Parameter, Parameters
from elastid.response import Response


class Case(NamedTuple):
    """Lines of two experiments whose motion is that of the linear model, with noise, and its response."""

    data: GearData
    drives: list[DriveLines]
    result: Result


def case(gear: Gear | None = None, *, noise: float = 1e-8) -> Case:
    """Two realisations, 200 Nm rms at the excited lines."""
    plant = robot(Gear() if gear is None else gear)
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
    return Case(replace(data, lines=[lines]), drives, result)


def test_good_records_are_not_refused() -> None:
    """And the linear model leaves nothing of what it has made itself; a force at the motor is left."""
    good = case()
    assert refusal(*good) == ""
    assert coarse_encoders(good.data.lines, good.drives) == []
    nothing = SmoothedMotion.start(good.data.lines[0], good.drives[0], 1)
    assert unexplained_fraction(good.data, good.drives, [nothing], np.ones(1)) < 1e-12
    pushed = replace(nothing, Phi=(0.1 * good.drives[0].B @ good.data.lines[0].U)[..., None])
    assert unexplained_fraction(good.data, good.drives, [pushed], np.ones(1)) == pytest.approx(0.1)


NO_DATA = np.zeros(1), ("s",), (False,), np.array([2e-3])
LATE = ModificationIndex("delay", "time", ("delay",), *NO_DATA, 1e-5, 9.0, 0.9, np.zeros(2))


def with_lines(good: Case, **changes: object) -> Case:
    """The case with other lines."""
    return good._replace(data=replace(good.data, lines=[replace(good.data.lines[0], **changes)]))


def with_status(good: Case, status: str, *indices: ModificationIndex) -> Case:
    """The case with another end of its fit."""
    return good._replace(result=replace(good.result, status=status, indices=indices))


def power(good: Case) -> np.ndarray:
    """Mean square (F, 1) of the motion."""
    return np.mean(np.abs(good.data.lines[0].Y) ** 2, axis=2)


def counts(good: Case, part: float) -> Case:
    """The case with encoder counts of a part of the rms deflection of its gear."""
    bent = np.sqrt(np.sum(np.mean(np.abs(good.drives[0].motion("gear", 0, good.data.lines[0].U)) ** 2, axis=1)) / 2)
    return with_lines(good, count=np.array([part * bent]))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (lambda good: with_lines(good, realisation=np.zeros(2, np.int64)), "one realisation"),
        (lambda _: case(Gear(k=2e8)), "above the highest excited line"),
        (lambda good: with_status(good, "misfit", LATE), "torque_lag"),
        (lambda good: with_status(good, "converged", LATE), ""),
        (lambda good: with_status(good, "not_converged"), "not converged"),
        (lambda good: with_lines(good, scatter=0.2**2 * power(good)), "20 % of the motion"),
        (lambda good: with_lines(good, scatter=0.02**2 * power(good)), ""),
        (lambda good: counts(good, 0.05), FALLBACK),
        (lambda good: counts(good, 0.01), ""),
    ],
)
def test_what_hides_the_effects_of_gears_is_refused(changed: Callable[[Case], Case], words: str) -> None:
    """One realisation to be fitted to; modes above the lines; a late torque beside a misfit; unsettled; coarse."""
    found = refusal(*changed(case()))
    assert words in found
    assert bool(words) == bool(found)


def test_encoder_noise_hides_deflection_and_is_named() -> None:
    """At all lines alike; a fifth of the torsion of the gear."""
    good = case()
    (lines,), noise = good.data.lines, power(good).mean()
    assert difference(replace(lines, scatter=lines.scatter + noise, noise=np.array([noise]))) < 1e-3
    bent = np.abs(lines.Y[lines.excited]).mean()
    (note,) = coarse_encoders(case(noise=3 * bent).data.lines, good.drives)
    assert note.place == "motor 1"
