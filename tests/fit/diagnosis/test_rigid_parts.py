"""What no response shows is said with its size: a base or a bearing that a model takes as rigid."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from elastid.fit.identify import identify
from elastid.fit.result import FitResult
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring

FREQ = np.linspace(2, 50, 60)
POSTURES = ((0.3, 0.2), (0.9, -0.6), (-0.5, 1.0))
SPEC = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}, starts=2, seed=1)
NOISE = 2e-3


def arm(pedestal: float | None = None) -> Robot:
    """Two links in a vertical plane with elastic gears, on the ground or on a pedestal of that stiffness about y."""
    shoulder = Joint("1", "y", Spring(3e4, 60), Motor(2e-3, 60, 1e-2))
    elbow = Joint("2", "y", Spring(2e4, 40), Motor(1e-3, 60, 1e-2))
    inertias = {"mass": 40.0, "center_of_mass": (0, 0, 0.4), "inertia": (3.0, 3.0, 0.5)}
    upper = Body("upper", *(() if pedestal is None else ("post",)), joints=(shoulder,), **inertias)
    fore = Body("fore", "upper", Placement((0, 0, 0.8)), (elbow,), 25.0, (0.3, 0, 0), 1.0)
    if pedestal is None:
        return Robot("arm", (upper, fore))
    post = Body("post", joints=(Joint("post", "y", Spring(pedestal, 1e-4 * pedestal)),), mass=200.0, inertia=20.0)
    return Robot("arm on a post", (post, upper, fore))


def measured(robot: Robot) -> list[FrequencyResponse]:
    """Responses of the motors in each posture, with noise."""
    rng, model, responses = np.random.default_rng(4), serial(robot), []
    linearisation = Linearisation.of(model)
    for i, angles in enumerate(POSTURES):
        linear = linearisation.at(Configuration(f"c{i}", angles), model.theta, model.inputs, "acceleration")
        exact = to_response(linear, linear.theta_ref, FREQ)
        std = NOISE * np.abs(exact.G)
        error = std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape)) / math.sqrt(2)
        responses.append(replace(exact, G=exact.G + error, noise=Covariance(std**2, np.inf)))
    return responses


def fitted(pedestal: float | None) -> FitResult:
    """The arm on a pedestal, identified as if it stood on the ground."""
    return identify(measured(arm(pedestal)), arm(), SPEC)


def test_a_pedestal_that_no_response_shows_is_within_the_total_with_a_base() -> None:
    """120 times as stiff as the gear: k_1 is off by several of its own std, and by less than two with a usual base."""
    result, k = fitted(120 * 3e4), 3e4
    assert result.status == "converged"
    off = result.values["k_1"] - k
    assert abs(off) > 5 * result.std["k_1"]
    assert abs(off) < 2 * result.std_with_base["k_1"]
    assert result.std_with_base["k_2"] == pytest.approx(result.std["k_2"], rel=1e-6)
    (base,) = [part for part in result.rigid_parts if part.is_base]
    names = [parameter.name for parameter in result.parameters.wanted]
    for name, true, rel in (("k_1", 3e4, 0.1), ("d_1", 60.0, 0.6)):  # the post's inertia damps, too
        stated = float(base.changes[names.index(name)]) * base.stiffness / (120 * 3e4)
        assert math.log(result.values[name] / true) == pytest.approx(stated, rel=rel)


def test_the_stiffness_from_which_on_a_base_is_hidden_is_where_it_moves_by_an_interval() -> None:
    """There the gear is off by 1.96 std; the sentence has both numbers and the advice."""
    result = fitted(None)
    (base,) = [part for part in result.rigid_parts if part.is_base]
    softened = base.stiffness * 1e-2 / base.hidden_from
    assert softened == pytest.approx(1.96 * result.std["k_1"] / result.values["k_1"], rel=0.01)
    (note,) = [note for note in result.notes if note.code == "base-as-rigid"]
    assert "takes 1.00 % from k_1" in note.text
    assert f"{base.hidden_from:.2g} N*m/rad on" in note.text


def test_a_base_that_is_in_the_model_is_not_stated_as_rigid() -> None:
    """The robot's file has its spring."""
    robot = arm(20 * 3e4)
    spec = replace(SPEC, parameters=SPEC.parameters | {"d_post": ParameterSpec(fixed=100.0)})
    result = identify(measured(robot), robot, spec)
    assert not any(part.is_base for part in result.rigid_parts)
    assert result.std_with_base == pytest.approx(result.std)
