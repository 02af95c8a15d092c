"""The friction in viscous numbers of a study, their truth, and friction on the terminal."""

from __future__ import annotations

from plants.taken_friction import taken_friction

from elastid.app.identified_robot import SLOPE, VISCOUS, WITH_COULOMB, contents, truth
from elastid.app.stages.estimate import friction_line
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.parameters import Parameter
from elastid.robot import Body, Joint, Motor, Robot, Spring

ROUGH, SMOOTH = Motor(1e-3, 50, 1e-3, coulomb=0.1), Motor(1e-3, 50, 1e-3)
ROBOT = Robot(
    "an elastic axis and two rigid ones",
    (
        Body("a", joints=(Joint("1", "z", Spring(1e4, 10.0), ROUGH, 1.0),), inertia=1.0),
        Body("b", "a", joints=(Joint("2", "y", None, ROUGH, 1.0),), inertia=1.0),
        Body("c", "b", joints=(Joint("3", "y", None, SMOOTH, 1.0),), inertia=1.0),
    ),
)
PARAMETERS = tuple(Parameter(name, 1e-3) for name in ("k_1", "fm_1", "fm_1@warm", "f_1", "fm_2", "f_2", "fm_3"))


def test_a_viscous_number_is_marked_with_the_coulomb_friction_in_it() -> None:
    """Also that of a joint which turns rigidly with its motor; a motor without dry friction has none."""
    assert contents(ROBOT, True, None, PARAMETERS) == {
        "fm_1": WITH_COULOMB,
        "fm_1@warm": WITH_COULOMB,
        "fm_2": WITH_COULOMB,
        "f_2": WITH_COULOMB,
        "fm_3": VISCOUS,
    }


def test_friction_taken_out_leaves_viscous_friction_which_then_has_a_truth() -> None:
    """At motor 1 alone."""
    marked = contents(ROBOT, True, taken_friction(), PARAMETERS)
    assert (marked["fm_1"], marked["fm_2"]) == (SLOPE, WITH_COULOMB)
    known = truth(ROBOT, SimulatedSpec(), (), taken_friction())
    assert known is not None
    assert {"fm_1", "fm_3", "f_3"} <= set(known)
    assert not {"fm_2", "f_2"} & set(known)


def test_of_a_recorded_robot_no_motor_is_known_to_be_without_friction() -> None:
    """Whatever its file says."""
    marked = contents(ROBOT, False, taken_friction(), PARAMETERS)
    assert (marked["fm_1"], marked["fm_2"], marked["fm_3"]) == (SLOPE, WITH_COULOMB, WITH_COULOMB)
    assert "f_1" not in marked
    assert truth(ROBOT, None, ()) is None


def test_no_viscous_friction_that_takes_up_coulomb_friction_is_called_true() -> None:
    """The motor's own, and that of a joint which turns rigidly with a motor: a fit is right not to meet them."""
    known = truth(ROBOT, SimulatedSpec(), ())
    assert known is not None
    assert {"k_1", "d_1", "f_1", "fm_3", "f_3"} <= set(known)
    assert not {"fm_1", "fm_2", "f_2"} & set(known)


def test_the_terminal_has_one_line() -> None:
    """With the levels; nothing where nothing was taken out."""
    line = friction_line(taken_friction())
    assert "motor 1 4.50 ± 0.22 N*m" in line
    assert "at most 3.2 % is left" in line
    assert "motor 2" not in line
