"""Robots and records that the search for gear effects refuses."""

from dataclasses import replace

import pytest
from plants.refusals import refused

from elastid.nonlinear.gear.choice import find_gear_effects
from elastid.robot import Body, Joint, Motor, Robot
from tests.nonlinear.gear.test_levels import SPEC, linear_fit
from tests.nonlinear.gear.test_period_lines import record
from tests.plants.two_mass_gear import LINES, Gear, records, robot


@pytest.mark.slow
def test_robots_without_elastic_gears_and_records_without_a_period_are_refused() -> None:
    measured = records(Gear(), experiments=2)
    response, linear = linear_fit(Gear(), measured)
    rigid = Robot("rigid", (Body("link", joints=(Joint("1", "z", motor=Motor(1e-3, 100.0)),), inertia=1.0),))
    with refused("robot/no-spring"):
        find_gear_effects([measured], [response], linear, rigid, SPEC, planned=LINES)
    noise = record()
    endless = [replace(noise, period_samples=noise.n_samples, is_periodic=False)]
    with refused("gears/records", place="configuration a"):
        find_gear_effects([endless], [response], linear, robot(Gear()), SPEC, planned=LINES)
