"""Responses at the tool against the prediction: closed form, and bands that hold."""

from dataclasses import replace

import numpy as np
from plants.arm import closed_form, rest, result

from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.validation.agreement import predict_response

WHERE = Configuration("tapped", np.array([0.4, -0.6]))
LINES = np.linspace(2, 60, 80)


def hammer(std: float = 0.0, seed: int = 0) -> Response:
    """Acceleration of the tool by forces on it, own axes; the closed form of the nominal arm with its motors held."""
    M, D, K, J = closed_form(WHERE.angles)
    s = 2j * np.pi * LINES[:, None, None]
    G = s**2 * J @ np.linalg.solve(s**2 * M + s * D + K, J.T.astype(complex))
    angle = float(np.sum(rest(WHERE.angles)))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    G = turn.T @ G @ turn
    rng = np.random.default_rng(seed)
    error = std * np.abs(G) * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape)) / np.sqrt(2)
    noise = Covariance((std * np.abs(G)) ** 2, np.inf) if std else None
    return Response(
        LINES, G + error, ("force tool x", "force tool z"), ("frame tool x", "frame tool z"), "acceleration", WHERE,
        noise=noise, motors="held",
    )  # fmt: skip


def test_a_hammer_response_is_the_closed_form() -> None:
    """Without noise the prediction at the true numbers is the measurement, to rounding."""
    each = predict_response(result(), hammer())
    np.testing.assert_allclose(each.predicted.G, each.measured.G, rtol=1e-8)
    assert each.inside == 1.0
    assert each.rms_log_db < 1e-6
    assert "force tool x" in each.words


def test_both_bands_hold_what_they_say() -> None:
    """Fits whose numbers are off by their std, noise of 5 %: 90 to 99.9 % of the lines agree."""
    shares = []
    for seed in range(20):
        fit, rng = result(), np.random.default_rng(seed)
        off = replace(fit, x=fit.x + np.linalg.cholesky(fit.covariance) @ rng.standard_normal(len(fit.x)))
        shares.append(predict_response(off, hammer(0.05, seed)).inside)
    assert 0.9 < np.mean(shares) < 0.999
