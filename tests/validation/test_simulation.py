"""The torque of a log part by part: shares of known parts come back, over all and by octave."""

from dataclasses import replace

import numpy as np
import pytest
from plants.measured import EMPS, measured
from plants.report_values import balance, waves
from scipy.io import loadmat

from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.inverse_dynamics_regression import regress_motion
from elastid.friction_study.motion_signals import Motion
from elastid.friction_study.result import JointFriction
from elastid.validation.friction_simulation import friction_balances
from elastid.validation.log_comparison import DRY, INERTIA, MOTION, VISCOUS, ComparedSignal, LogSimulation


def test_orthogonal_contributions_have_their_power_fraction() -> None:
    """Amplitudes 4, 2 and 1 at 3, 6 and 20 Hz: 16, 4 and 1 of 21; the model lacks the last."""
    (_, middle, fast), found = waves(), balance()
    assert found.fractions == pytest.approx((16 / 21, 4 / 21))
    assert found.unexplained_fraction == pytest.approx(1 / 21)
    assert found.unexplained_without_friction == pytest.approx(5 / 21)
    bands = {(band.low_hz, band.high_hz): band for band in found.bands}
    assert bands[2.0, 4.0].power == pytest.approx(16 / 21, rel=1e-3)
    assert bands[4.0, 8.0].unexplained_fraction == pytest.approx(0.0, abs=1e-6)
    assert bands[4.0, 8.0].unexplained_without_friction == pytest.approx(1.0, rel=1e-3)
    assert found.worst is bands[16.0, 32.0]
    assert found.worst.unexplained_fraction == pytest.approx(1.0, rel=1e-3)
    assert ("Hz" in found.sentence, "Hz" in replace(found, has_rate=False).sentence) == (True, False)
    np.testing.assert_allclose(found.residual, fast, atol=1e-12)
    np.testing.assert_allclose(found.torque_sum((DRY, VISCOUS)), middle, atol=1e-12)


def test_real_axis_has_half_friction_and_small_remainder() -> None:
    """Inertia 50 %, viscous friction 24 %, dry friction 27 % of the mean square; above 2.5 Hz all is inertia."""
    data = loadmat(measured(EMPS))
    record = FrictionRecord("log", "1", "motion", 1e3, data["qm"].ravel(), 35.1507 * data["vir"].ravel(), slides=True)
    motion = regress_motion(Motion("joint 1", 1e3, record.position, record.torque, slides=True))
    (found,) = friction_balances([JointFriction("1", True, motion=motion)], FrictionRecords((record,)))
    assert dict(zip(found.parts, found.fractions, strict=True)) == pytest.approx(
        {INERTIA: 0.497, VISCOUS: 0.237, DRY: 0.267}, abs=0.003
    )
    # The regression leaves out what is near a reversal.
    assert found.unexplained_fraction > motion.regression.relative_error**2
    assert found.unexplained_fraction < 0.001
    assert found.unexplained_without_friction == pytest.approx(0.502, abs=0.003)
    assert all(band.fractions[0] > 0.97 for band in found.bands if band.low_hz >= 2.5)
    assert all(band.unexplained_fraction < 0.005 for band in found.bands)


def test_signal_error_is_relative_to_its_variation() -> None:
    """10 % off at 6 Hz, all of 20 Hz missing."""
    slow, middle, fast = waves()
    signal = ComparedSignal(MOTION, "motor 1", "rad", slow + middle + fast + 7.0, slow + 0.9 * middle + 7.0)
    assert signal.error == pytest.approx(np.sqrt((0.2**2 + 1) / 21))
    assert f" {100 * signal.error:.3g} %" in LogSimulation("log", "torque", 0.5, 1.0, 500.0, (signal,)).sentence
