"""The stage design: its parts are worked on by any number of processes."""

import pickle
from functools import partial

import numpy as np
from plants.elastic_arm import arm
from plants.report_values import plan

from elastid.app.stages.design import _reference
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
