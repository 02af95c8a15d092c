"""The friction in viscous numbers of a study, their truth, and friction on the terminal."""

from dataclasses import replace

import pytest
from plants.taken_friction import ROBOT, ROUGH, taken_friction

from elastid.app.identified_robot import with_identified_effects
from elastid.app.parameter_truth import NOT_SIGNIFICANT, SLOPE, parameter_contents, true_values
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.parameters import Parameter, Parameters
from elastid.report.parameter_row import WITH_COULOMB

NAMES = ("k_1", "fm_1", "fm_1@warm", "f_1", "fm_2", "f_2", "fm_3")
PARAMETERS = Parameters(tuple(Parameter(name, 1e-3) for name in NAMES))


def test_recorded_robot_has_motors_of_unknown_friction() -> None:
    marked = parameter_contents(ROBOT, False, taken_friction(), PARAMETERS)
    assert (marked["fm_1"], marked["fm_2"], marked["fm_3"]) == (SLOPE, NOT_SIGNIFICANT, WITH_COULOMB)
    assert "f_1" not in marked
    assert true_values(ROBOT, None, ()) is None


def test_viscous_friction_with_coulomb_part_has_no_truth() -> None:
    """The motor's own, and that of a joint which turns rigidly with a motor: a fit is right not to meet them."""
    known = true_values(ROBOT, SimulatedSpec(), ())
    assert known is not None
    assert {"k_1", "d_1", "f_1", "fm_3", "f_3"} <= set(known)
    assert not {"fm_1", "fm_2", "f_2"} & set(known)


def test_compensated_coulomb_torque_keeps_viscous_friction_of_motor() -> None:
    """No other dry friction of the file is left."""
    first, second, _ = with_identified_effects(ROBOT, taken_friction(), None).driven
    assert first.motor.friction.coulomb == pytest.approx(4.5 / 50)
    assert first.motor.viscous == pytest.approx(ROUGH.viscous)
    assert second.motor == replace(ROUGH, coulomb=0.0)
