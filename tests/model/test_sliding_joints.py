"""Joints that slide: closed forms of their dynamics, units in a study, elastic translations beside a driven joint."""

from __future__ import annotations

import numpy as np
import pytest

from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.robot import Body, Joint, Motor, Robot, Spring


def slide(**changes: object) -> Robot:
    """A carriage of 40 kg on a screw of 5 mm pitch, a load of 25 kg behind an elastic translation."""
    screw = 2 * np.pi / 0.005  # rad of the motor per m
    joint = Joint("x", "x", Spring(5e6, 300.0), Motor(2e-3, screw, 1e-4), 20.0, motion="translation")
    elastic = Joint("e", (1, 0, 0), Spring(8e5, 100.0), motion="translation")
    bodies = (Body("carriage", joints=(joint,), mass=40), Body("load", "carriage", joints=(elastic,), mass=25))
    return Robot("slide", bodies, **changes)  # type: ignore[arg-type]


def test_a_driven_slide_is_the_chain_of_three_masses_that_it_looks_like():
    """M, D, K by hand: the rotor as ratio^2 J in kg, springs in N/m between positions."""
    model = serial(slide())
    linear = linearise(model, Configuration("c", [0.3]), model.theta, ("motor x",), "acceleration")
    rotor, damper = 2e-3 * (2 * np.pi / 0.005) ** 2, 1e-4 * (2 * np.pi / 0.005) ** 2
    # Of coordinates x (carriage), e (load on the carriage), x_m (motor, along the slide).
    np.testing.assert_allclose(linear.M, [[65, 25, 0], [25, 25, 0], [0, 0, rotor]], rtol=1e-12)
    np.testing.assert_allclose(linear.K, [[5e6, 0, -5e6], [0, 8e5, 0], [-5e6, 0, 5e6]], rtol=1e-12)
    np.testing.assert_allclose(linear.D, [[320, 0, -300], [0, 100, 0], [-300, 0, 300 + damper]], rtol=1e-12)
    high = frequency_response(linear, linear.theta_ref, np.array([1e5]))[0, 0, 0]
    assert high.real == pytest.approx(1 / rotor, rel=1e-4)
    found = {name: unit for name, (_, unit) in slide().parameters().items() if not name.startswith(("I", "c", "m"))}
    assert found == {
        "k_x": "N/m", "d_x": "N*s/m", "f_x": "N*s/m", "Jm_x": "kg*m^2", "fm_x": "N*m*s/rad",
        "k_e": "N/m", "d_e": "N*s/m", "f_e": "N*s/m",
    }  # fmt: skip
