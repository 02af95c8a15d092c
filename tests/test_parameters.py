"""Names for people, vectors for solvers."""

import math
import pickle

import pytest

from elastid.parameters import Parameter, Parameters, Prior, Tie

SET = Parameters(
    (
        Parameter("k", 200.0, lower=2.0, upper=2e4, log=True),
        Parameter("k_twin", 0.0, tie=Tie("k", 1.5), log=True),
        Parameter("m", 12.0, log=True, free=False),
        Parameter("m_twin", 0.0, tie=Tie("m", 2.0)),
        Parameter("delay", 1e-3, lower=0.0, upper=1e-2),
    )
)


def test_with_values_returns_another_set_and_leaves_the_first():
    """Values flow: the start of the copy moves, that of the original does not."""
    assert SET.with_values({"k": 300.0})["k"].value == 300
    assert SET["k"].value == 200
    with pytest.raises(KeyError, match="no parameter q; there are k, k_twin"):
        SET.with_values({"q": 1.0})


def test_a_set_pickles():
    """Starts run in other processes."""
    assert pickle.loads(pickle.dumps(SET)) == SET


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: Parameter("k", 5.0, lower=6.0, upper=7.0), r"start 5 1 is outside its bounds \[6, 7\]"),
        (lambda: Parameter("k", 0.0, log=True), "must be positive"),
        (lambda: Parameter("k", 1.0, lower=2.0, upper=1.0), "not below"),
        (lambda: Parameter("k", math.nan), "not finite"),
        (lambda: Prior(1.0, 0.0), "fix the parameter"),
        (lambda: Parameters((Parameter("k", 1.0), Parameter("k", 2.0))), "given twice"),
        (lambda: Parameters((Parameter("k", 1.0, tie=Tie("q")),)), "not a parameter"),
        (lambda: Parameters((Parameter("a", 1.0, tie=Tie("b")), Parameter("b", 1.0, tie=Tie("a")))), "tied itself"),
    ],
)
def test_contradictions_are_refused(build, says):
    """Bounds that exclude the start, positive parameters at zero, ties to nothing."""
    with pytest.raises(ValueError, match=says):
        build()


def test_a_posture_has_the_same_parameters_at_every_amplitude():
    """A stand-in of the configuration bent counts in `bent amplitude 2`, and in no other."""
    k, own = Parameter("k", 200.0, log=True), Parameter("k@bent", 300.0, log=True, only=("bent",))
    both = Parameters((k, own))
    assert both.expand(both.x, "bent amplitude 2") == pytest.approx(both.expand(both.x, "bent"))
    assert both.expand(both.x, "bent amplitude 2") == pytest.approx([300.0])
    assert both.expand(both.x, "bent again") == pytest.approx([200.0])
