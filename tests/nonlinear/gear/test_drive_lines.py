"""The model on the lines of a period against the closed form of two masses."""

import numpy as np
import pytest

from elastid.fit.parameter_choice import choose
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.linearise import Linearisation
from elastid.nonlinear.gear.period_lines import PeriodLines, drive_lines, elastic_joints
from elastid.response import Response
from tests.plants.two_mass_gear import POSTURE, RATE_HZ, SAMPLES, Gear, robot

GEAR = Gear()


def test_forces_at_motor_gear_and_link_move_two_masses_as_they_must() -> None:
    start = robot(GEAR)
    linearisation = Linearisation.of_robot(start)
    parameters = choose(FitSpec(parameters={"k_*": ParameterSpec()}), start, ["rest"])
    F, none = 100, np.zeros((100, 1, 1), complex)
    lines = PeriodLines(
        POSTURE, RATE_HZ, SAMPLES, none, none, *np.zeros((2, 1, 1)), np.ones(1), np.ones((F, 1)), np.ones(F, bool),
        np.zeros(1, np.int64), np.zeros(1),
    )  # fmt: skip
    places = ("motor 1",)
    response = Response(lines.freq_hz, none, places, places, "acceleration", POSTURE)
    drive = drive_lines(lines, linearisation, response, parameters, parameters.x)
    s, g = lines.s, GEAR
    motor, link, spring = g.J_m * s**2 + g.f * s, g.J_l * s**2, g.k + g.d * s
    det = (motor + spring) * (link + spring) - spring**2
    by_place = {"motor": (link + spring) / det, "gear": link / det, "link": spring / det}
    assert elastic_joints(linearisation) == ("1",)
    for place, exact in by_place.items():
        moved = (drive.C @ drive.H @ drive.directions(place, 0))[:, 0]  # type: ignore[arg-type]
        assert moved == pytest.approx(exact, rel=1e-9)
    assert drive.G[:, 0, 0] == pytest.approx(by_place["motor"], rel=1e-9)
    assert np.abs(drive.images).max() < 1e-9 * np.abs(drive.G).max()
    assert (drive.k[0], drive.d[0], drive.torque[0]) == pytest.approx((g.k, g.d, 0.0))
