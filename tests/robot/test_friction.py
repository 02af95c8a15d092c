"""Friction that no contact has is refused."""

import pytest

from elastid.base.errors import StudyError
from elastid.robot import Friction, Joint, LuGre, MaxwellSlip, Motor


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        (lambda: Friction(2.0, 1.0, 0.1), "stiction .* 1 N.m, below coulomb .* of 2 N.m"),
        (lambda: Friction(1.0, 2.0), "needs stribeck_velocity"),
        (lambda: Friction(1.0, lugre=LuGre(1e4), maxwell_slip=MaxwellSlip((1e4,), (1.0,), 1.0)), "at most one"),
        (lambda: MaxwellSlip((1e4, 1e4), (0.5, 0.4), 1.0), "sum to 0.9"),
        (lambda: MaxwellSlip((1e4,), (0.5, 0.5), 1.0), "1 numbers of stiffness and 2 shares"),
        (lambda: Motor(1e-3, 10, 0.4, 1.0, friction=Friction(1.0)), "both given"),
        (
            lambda: Motor(1e-3, 1, 0.4, friction=Friction(1.0, 1.5, 1e-3, lugre=LuGre(1e5, 316.0))),
            r"not passive.*>= damping .* = 158 .*got 0.4.*damping_velocity: 0.027",
        ),
        (
            lambda: Joint("1", friction=Friction(1.0, 1.5, 1e-3, lugre=LuGre(1e5, 316.0, 0.05))),
            "damping_velocity is 0.05 .* = 0.02951 rad/s",
        ),
    ],
)
def test_friction_that_no_contact_has_is_refused(wrong: object, word: str) -> None:
    """The message says which number, what it is and what it must be."""
    with pytest.raises((ValueError, StudyError), match=word):
        wrong()
