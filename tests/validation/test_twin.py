"""The torque of a log part by part: shares of known parts come back, over all and by octave."""

import numpy as np
import pytest
from plants.measured import EMPS, measured
from scipy.io import loadmat

from elastid.friction_study.motion import regress_motion
from elastid.friction_study.motion_signals import Motion
from elastid.friction_study.result import JointFriction
from elastid.record import FrictionRecord, FrictionRecords
from elastid.validation.friction_twin import friction_balances
from elastid.validation.torque_balance import DRY, GRAVITY, INERTIA, VISCOUS, torque_balance
from elastid.validation.twin import MOTION, TwinSignal

RATE_HZ, N = 200.0, 2000
J, VISCOUS_COEFFICIENT, COULOMB, COS = 12.0, 30.0, 8.0, 25.0


def test_orthogonal_parts_have_their_power_as_share_and_the_octave_without_a_part_is_left() -> None:
    """Amplitudes 4, 2 and 1 at 3, 6 and 20 Hz: 16, 4 and 1 of 21; the model lacks the last."""
    t = np.arange(N) / RATE_HZ
    slow, middle, fast = (a * np.sin(2 * np.pi * f * t) for a, f in ((4.0, 3.0), (2.0, 6.0), (1.0, 20.0)))
    found = torque_balance(
        "motor 1", "log", "N*m", RATE_HZ, slow + middle + fast, {INERTIA: slow, DRY: middle}, (0.0, 32.0)
    )
    assert found.shares == pytest.approx((16 / 21, 4 / 21))
    assert found.left == pytest.approx(1 / 21)
    assert found.left_without_friction == pytest.approx(5 / 21)
    bands = {(band.low_hz, band.high_hz): band for band in found.bands}
    assert bands[2.0, 4.0].power == pytest.approx(16 / 21, rel=1e-3)
    assert bands[4.0, 8.0].left == pytest.approx(0.0, abs=1e-6)
    assert bands[4.0, 8.0].left_without_friction == pytest.approx(1.0, rel=1e-3)
    assert found.worst is bands[16.0, 32.0]
    assert found.worst.left == pytest.approx(1.0, rel=1e-3)
    np.testing.assert_allclose(found.residual, fast, atol=1e-12)


def known_axis() -> tuple[JointFriction, FrictionRecords, dict[str, np.ndarray]]:
    """A joint whose torque has four known parts, its regression and its log."""
    t = np.arange(20 * 500) / 500.0
    waves = [(0.6, 0.25, 0.3), (0.25, 0.7, 1.0), (0.08, 1.9, 2.0)]
    q = sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in waves)
    v = sum(a * 2 * np.pi * f * np.cos(2 * np.pi * f * t + p) for a, f, p in waves)
    acceleration = sum(-a * (2 * np.pi * f) ** 2 * np.sin(2 * np.pi * f * t + p) for a, f, p in waves)
    parts = {INERTIA: J * acceleration, GRAVITY: COS * np.cos(q)}
    parts |= {VISCOUS: VISCOUS_COEFFICIENT * v, DRY: COULOMB * np.sign(v)}
    noise = np.random.default_rng(0).standard_normal(len(t))
    u = np.sum(list(parts.values()), axis=0) + noise
    record = FrictionRecord("swing", "1", "motion", 500.0, np.asarray(q), np.asarray(u))
    motion = regress_motion(Motion("joint 1", 500.0, record.position, record.torque, turns_against_gravity=True))
    return JointFriction("1", False, motion=motion), FrictionRecords((record,)), parts


def test_the_known_parts_of_a_joint_have_their_shares() -> None:
    """Within 1 % of the torque, by which filter and noise change them; noise in the band is left."""
    joint, records, parts = known_axis()
    (found,) = friction_balances([joint], records)
    assert found.parts == (INERTIA, GRAVITY, VISCOUS, DRY)
    u = records.records[0].torque
    inside = slice(150, -150)
    expected = [float(np.mean(part[inside] * u[inside]) / np.mean(u[inside] ** 2)) for part in parts.values()]
    np.testing.assert_allclose(found.shares, expected, atol=0.01)
    friction = np.mean((parts[VISCOUS] + parts[DRY])[inside] ** 2) / np.mean(u[inside] ** 2)
    assert found.left_without_friction == pytest.approx(friction, rel=0.03)
    assert found.left < 1e-3
    assert sum(found.shares) + found.left == pytest.approx(1.0, abs=1e-3)


def test_half_of_the_force_of_a_real_axis_is_friction_and_a_thousandth_is_left() -> None:
    """Inertia 50 %, viscous friction 24 %, dry friction 27 % of the mean square; above 2.5 Hz all is inertia."""
    data = loadmat(measured(EMPS))
    record = FrictionRecord("log", "1", "motion", 1e3, data["qm"].ravel(), 35.1507 * data["vir"].ravel(), slides=True)
    motion = regress_motion(Motion("joint 1", 1e3, record.position, record.torque, slides=True))
    (found,) = friction_balances([JointFriction("1", True, motion=motion)], FrictionRecords((record,)))
    assert dict(zip(found.parts, found.shares, strict=True)) == pytest.approx(
        {INERTIA: 0.497, VISCOUS: 0.237, DRY: 0.267}, abs=0.003
    )
    # The regression leaves out what is near a reversal.
    assert found.left > motion.chosen.relative_error**2
    assert found.left < 0.001
    assert found.left_without_friction == pytest.approx(0.502, abs=0.003)
    assert all(band.shares[0] > 0.97 for band in found.bands if band.low_hz >= 2.5)
    assert all(band.left < 0.005 for band in found.bands)


def test_the_error_of_a_signal_is_over_the_signal_about_its_mean() -> None:
    """10 % off at 6 Hz, all of 20 Hz missing."""
    t = np.arange(N) / RATE_HZ
    slow, middle, fast = (a * np.sin(2 * np.pi * f * t) for a, f in ((4.0, 3.0), (2.0, 6.0), (1.0, 20.0)))
    signal = TwinSignal(MOTION, "motor 1", "rad", slow + middle + fast + 7.0, slow + 0.9 * middle + 7.0)
    assert signal.error == pytest.approx(np.sqrt((0.2**2 + 1) / 21))
