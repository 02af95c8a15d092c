"""Modes of measured responses of a robot beside those of its model; one that the model lacks is named."""

from dataclasses import replace

import numpy as np
from plants.fitted_models import fitted_model
from plants.two_mass import circular

from elastid.fit.fitted_robot import FittedRobot
from elastid.linear.modes import modes
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.validation.measured_modes import measured_modes

FREQ_HZ = np.arange(24, 480) / 8


def measured(lacking: float) -> FittedRobot:
    """The arm in one configuration, noise of 0.2 %, and a mode of 31.2 Hz and 2 % at motors 2 and 3 that it lacks."""
    fitted = fitted_model("arm")
    first, rng = fitted.measured[0], np.random.default_rng(0)
    empty = Response(
        FREQ_HZ, np.zeros((len(FREQ_HZ), 3, 3), complex), first.inputs, first.outputs, first.quantity,
        Configuration(first.configuration.name, first.configuration.angles),
    )  # fmt: skip
    fitted = replace(fitted, measured=(empty,), models=fitted.models[:1])
    G = fitted.responses[0].G
    omega, natural, shape = 2 * np.pi * FREQ_HZ, 2 * np.pi * 31.2, np.array([0.0, 1.0, 0.8])
    modal = -(omega**2) / (natural**2 - omega**2 + 2j * 0.02 * natural * omega)
    size = lacking * np.abs(G).max() * 0.04
    std = 0.002 * np.sqrt(np.mean(np.abs(G) ** 2))
    noise = std * circular(rng, G.shape)
    G = G + size * modal[:, None, None] * np.outer(shape, shape) + noise
    return replace(fitted, measured=(replace(empty, G=G, noise=Covariance(np.full(G.shape, std**2), np.inf)),))


def test_modes_of_a_right_model_are_found_with_their_shapes() -> None:
    fitted = measured(0.0)
    (found,) = measured_modes(fitted)
    known = modes(fitted.linear[0], fitted.theta_of(found.configuration))
    assert not found.is_missing.any()
    assert found.notes == ()
    assert len(found.freq_hz) >= 3
    for f, model_hz, overlap in zip(found.freq_hz, found.model_hz, found.mac, strict=True):
        assert np.abs(known.freq_hz - f).min() < 0.02 * f
        assert abs(model_hz - f) < 0.02 * f
        assert overlap > 0.8  # two modes within their widths mix
    assert np.median(found.mac) > 0.98


def test_unmodelled_mode_is_named_with_motors() -> None:
    (own,) = measured_modes(measured(1.0))
    (note,) = own.notes
    assert note.code == "validation/missing-mode"
    assert "31.2 Hz" in note.text
    assert "motor 2, motor 3" in note.text
    assert [row for row in own.rows if "missing" in row]
    shown = [[float(row[1]), float(row[3].rstrip(" %"))] for row in own.rows]
    np.testing.assert_allclose(shown, np.stack([own.freq_std, 100 * own.zeta_std], 1) * 1.96, rtol=0.1)
