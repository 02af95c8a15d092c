"""Which parameters a study identifies."""

import math

import pytest

from elastid.base.errors import StudyError
from elastid.fit.setup.parameter_choice import choose
from elastid.fit.spec import FitSpec, ParameterSpec, PriorSpec, TieSpec
from elastid.robot import Body, Joint, Motor, Robot, Spring

ROBOT = Robot(
    "arm",
    (
        Body(
            "link",
            joints=(
                Joint("1", spring=Spring(1e5, 100.0), motor=Motor(1e-3, 100.0, viscous=2e-3)),
                Joint("1x", "x", spring=Spring(2e5)),
            ),
            mass=10.0,
            center_of_mass=(0.1, 0.0, 0.0),
            inertia=(1.0, 1.0, 1.0, 0.0, 0.1, 0.0),
        ),
    ),
)


def parameters(**specs):
    return choose(FitSpec(parameters=specs), ROBOT)


def test_by_default_springs_and_what_damps_them_are_identified():
    """Every stiffness, every damping and motor friction above zero; all else keeps the robot's number."""
    chosen = choose(FitSpec(), ROBOT)
    assert chosen.free_names == ("k_1", "d_1", "fm_1", "k_1x")
    assert chosen["m_link"].value == 10
    assert not chosen["m_link"].free
    assert chosen.names == (*ROBOT.parameters(), "delay")


def test_a_name_wins_over_patterns_and_a_later_pattern_over_an_earlier():
    """k_1 keeps its own start under k_*; k_1x takes that of the last pattern that matches."""
    chosen = choose(
        FitSpec(
            parameters={
                "k_1": ParameterSpec(start=5e4),
                "k_*": ParameterSpec(start=3e5),
                "k_*x": ParameterSpec(start=4e5),
            }
        ),
        ROBOT,
    )
    assert (chosen["k_1"].value, chosen["k_1x"].value) == (5e4, 4e5)


def test_positive_quantities_are_logarithmic_the_others_linear():
    """Centres of mass, products of inertia and the delay may be zero or change sign; the rest may not."""
    chosen = parameters(**{name: ParameterSpec() for name in ("k_1", "m_link", "I_link_x*", "c_link_x", "delay")})
    linear = {p.name for p in chosen.free if not p.log}
    assert linear == {"c_link_x", "I_link_xy", "I_link_xz", "delay"}
    assert (chosen["k_1"].lower, chosen["k_1"].upper) == pytest.approx((1e3, 1e7))
    assert (chosen["delay"].lower, chosen["delay"].upper) == (0.0, 0.01)
    assert math.isinf(chosen["c_link_x"].upper)


def test_fixed_tied_and_known_beforehand():
    """A fixed start is the value, a tie follows, a prior is kept."""
    chosen = parameters(
        k_1=ParameterSpec(prior=PriorSpec(mean=1.1e5, std=0.05)),
        k_1x=ParameterSpec(tie=TieSpec("k_1", 2.0)),
        d_1=ParameterSpec(start=50.0, fixed=True),
        m_link=ParameterSpec(start=9.0, prior=PriorSpec(std=0.02)),
    )
    assert chosen.free_names == ("k_1", "m_link")
    assert chosen["m_link"].value == 9.0
    assert chosen["m_link"].prior.mean == ROBOT.parameters()["m_link"][0]  # without a mean, the robot's number
    assert chosen["d_1"].value == 50
    assert chosen["k_1"].prior.std == 0.05
    assert chosen.as_dict()["k_1x"] == pytest.approx(2e5)


@pytest.mark.parametrize(
    ("specs", "says"),
    [
        ({"k1": ParameterSpec()}, "no parameter k1; did you mean 'k_1'?"),
        ({"q_*": ParameterSpec()}, r"no parameter q_\*; .*there are k_1"),
        ({"d_1x": ParameterSpec()}, r"d_1x: .*the start is 0 N\*m\*s/rad; give a positive one"),
        ({"k_1": ParameterSpec(bounds=(1.0, 2.0))}, "outside its bounds"),
        ({"k_1": ParameterSpec(bounds=(2e5, 1e5))}, "not below"),
        ({"k_1": ParameterSpec(tie=TieSpec("k_9"))}, "tied to k_9, which is not a parameter"),
        ({"k_1": ParameterSpec(prior=PriorSpec(mean=-1.0, std=0.1))}, "mean -1 .*must be positive"),
        ({"k_1": ParameterSpec(fixed=True)}, "nothing is left to identify"),
    ],
)
def test_what_cannot_be_chosen_is_refused_with_the_way_out(specs, says):
    """Unknown names, zero starts, bounds that exclude the start, ties to nothing, nothing free."""
    with pytest.raises(StudyError, match=says):
        parameters(**specs)


def test_friction_may_end_far_above_a_data_sheets_number():
    """Coulomb friction of 0.4 Nm slid at 2 rad/s looks like 0.2 Nms/rad beside 8e-4 viscous (Manutec r3, axis 1)."""
    friction, damping = (parameters(**{name: ParameterSpec()})[name] for name in ("fm_1", "d_1"))
    assert friction.upper >= 0.2 / 8e-4 * friction.value
    assert damping.upper == pytest.approx(100 * damping.value)
