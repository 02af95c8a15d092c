"""Responses at the tool against the prediction: closed form, and bands that hold."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import result
from plants.load_tests import tapped

from elastid.record import Configuration
from elastid.validation.frf_error import predict_response

WHERE = Configuration("tapped", np.array([0.4, -0.6]))
LINES = np.linspace(2, 60, 80)


def test_a_hammer_response_is_the_closed_form() -> None:
    """Without noise the prediction at the true numbers is the measurement, to rounding."""
    each = predict_response(result(), tapped(WHERE, LINES, 0.0, np.random.default_rng(0)))
    np.testing.assert_allclose(each.predicted.G, each.measured.G, rtol=1e-8)
    assert each.inside == 1.0
    assert each.rms_log_db < 1e-6
    assert "force tool x" in each.sentence


@pytest.mark.slow
def test_both_bands_hold_what_they_say() -> None:
    """Fits whose numbers are off by their std, noise of 5 %: 90 to 99.9 % of the lines agree."""
    shares = []
    for seed in range(20):
        fit, rng = result(), np.random.default_rng(seed)
        off = replace(fit, x=fit.x + np.linalg.cholesky(fit.covariance) @ rng.standard_normal(len(fit.x)))
        shares.append(predict_response(off, tapped(WHERE, LINES, 0.05, np.random.default_rng(seed))).inside)
    assert 0.9 < np.mean(shares) < 0.999
