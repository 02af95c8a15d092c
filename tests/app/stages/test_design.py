"""The stage design: its parts are worked on by any number of processes."""

import json
import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from plants.elastic_arm import arm
from plants.report_values import plan

from elastid.app.stages.design import _reference, _second_amplitude
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.movement import reference
from elastid.experiment.simulated.plant import feed_forward_of, model_of
from elastid.experiment.specs.simulated import CarrierSpec


def test_the_movement_of_a_configuration_is_found_by_any_process() -> None:
    """The work pickles, though equations of motion do not, and gives the same numbers."""
    robot, carrier = arm(), CarrierSpec(amplitude=0.1)
    planned = plan(len(robot.driven))
    configuration = planned.configurations[0]
    work = pickle.loads(pickle.dumps(partial(_reference, planned, carrier, robot)))
    expected = reference(planned, carrier, feed_forward_of(model_of(robot)), configuration)
    np.testing.assert_array_equal(work(configuration).feed_forward, expected.feed_forward)
    assert np.ptp(expected.feed_forward) > 0


def test_a_second_amplitude_is_proposed_as_a_study_takes_it() -> None:
    """At half the torque of the plan, of which each motor has its own."""
    planned = plan(2)
    words = _second_amplitude(replace(planned, R=planned.R * np.array([1.0, 0.5])))
    levels = words.partition("torque_rms: ")[2].partition(", with")[0]
    ((one, two), (half, quarter)) = MultisineSpec(500.0, 2.0, (1.0, 60.0), json.loads(levels)).levels
    assert one == pytest.approx(30 * np.sqrt(73 / 2), rel=5e-3)
    assert (half / one, two / one, quarter / one) == pytest.approx((0.5, 0.5, 0.25), rel=1e-2)
