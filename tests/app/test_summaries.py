"""What an identification is compared with where the truth is known."""

from __future__ import annotations

from elastid.app.summaries import truth
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.robot import Body, Joint, Motor, Robot, Spring
from elastid.study import Study

ROBOT = Robot(
    "an elastic axis and two rigid ones",
    (
        Body("a", joints=(Joint("1", "z", Spring(1e4, 10.0), Motor(1e-3, 50, 1e-3, coulomb=0.1), 1.0),), inertia=1.0),
        Body("b", "a", joints=(Joint("2", "y", None, Motor(1e-3, 50, 1e-3, coulomb=0.1), 1.0),), inertia=1.0),
        Body("c", "b", joints=(Joint("3", "y", None, Motor(1e-3, 50, 1e-3), 1.0),), inertia=1.0),
    ),
)


def test_no_viscous_friction_that_takes_up_coulomb_friction_is_called_true() -> None:
    """The motor's own, and that of a joint which turns rigidly with a motor: a fit is right not to meet them."""
    known = truth(
        Study("s", experiment=ExperimentSpec({"home": (0.0, 0.0, 0.0)}, simulated=SimulatedSpec()), robot=ROBOT)
    )
    assert known is not None
    assert {"k_1", "d_1", "f_1", "fm_3", "f_3"} <= set(known)
    assert not {"fm_1", "fm_2", "f_2"} & set(known)
