"""Sheets of gears: makers' numbers of magnitudes by closed forms, and gears of an outside plant laid open."""

from dataclasses import replace

import numpy as np
import pytest
from plants.gear_levels import SPEC, linear_fit
from plants.two_mass_gear import LINES, Gear, records, robot

from elastid.fit.load_tests import StaticAgreement
from elastid.fit.result import Result
from elastid.nonlinear.basis_functions import GearEffect
from elastid.nonlinear.gear_characteristics import JointEffects, sheet_of
from elastid.nonlinear.gear_estimation import GearEstimate
from elastid.nonlinear.gear_result import ARCMIN, NOT_EXPLAINED, NOT_OPENED, GearResult, GearSheet, with_gears
from elastid.nonlinear.identify_gears import identify_gears
from elastid.nonlinear.spec import GearsSpec
from elastid.parameters import Parameter, Parameters
from elastid.robot.simplified import with_stiff_joints

K, PEAK = 2e5, 600.0
PARAMETERS = Parameters((Parameter("k_1", K, "N*m/rad", log=True), Parameter("d_1", 60.0, "N*m*s/rad", log=True)))


def plain_fit(x: np.ndarray) -> Result:
    none = np.zeros(2, bool)
    return Result(PARAMETERS, x, 1e-6 * np.eye(2), 1.0, 1, 1.0, "converged", "", (), 1, none, np.ones(2), "complex")


def sheet(found: dict[GearEffect, float], bounds: dict[GearEffect, float] | None = None) -> GearSheet:
    """Of magnitudes with a relative standard deviation, k and d at 1e-3; linear fit: k 10 % larger."""
    x, magnitudes = PARAMETERS.x, np.array([*found.values()])
    covariance = np.diag(np.concatenate([[1e-6, 1e-6], (0.01 * magnitudes) ** 2]))
    scale_std = np.array([0.02 * effect.scale if effect.kind == "gap" else 0.0 for effect in found])
    known = GearEstimate(PARAMETERS, tuple(found), x, magnitudes, covariance, 0.0, (), (), scale_std)
    groups = {(effect,): size for effect, size in (bounds or {}).items()}
    gear = JointEffects(known, robot(Gear()), "1", PEAK)
    return sheet_of(gear, plain_fit(x + np.array([np.log(1.1), 0.0])), groups)


def test_stiffness_by_range_is_the_secant_of_the_spring() -> None:
    """Of k x + k_3 x^3, by the roots of the cubic; at zero torque k, beside that of the linear fit."""
    k_3 = 4e9
    ends = [0.0, *(np.roots([k_3, 0.0, K, -PEAK * i / 3])[-1].real for i in (1, 2, 3))]
    found = sheet({GearEffect("cubic", "1"): k_3})
    for i in range(3):
        number = found.number(f"K{i + 1}_1")
        assert number.value == pytest.approx(PEAK / 3 / (ends[i + 1] - ends[i]), rel=5e-3)
    k, stiffening = found.number("k_1"), found.number("h_1")
    assert (k.value, k.std, k.linear) == (pytest.approx(K), pytest.approx(1e-3 * K), pytest.approx(1.1 * K))
    assert k.value * k.factor == pytest.approx(K / ARCMIN)
    assert stiffening.value == pytest.approx(k_3 * ends[3] ** 2 / K, rel=1e-3)
    assert stiffening.std == pytest.approx(np.hypot(0.01, 1e-3) * stiffening.value, rel=1e-2)


def test_hysteresis_is_the_loop_of_a_maker_s_test() -> None:
    """An element of 5 Nm that slides all the way: 5 Nm to either side, 2 x 5 Nm / k wide where the torque is 0."""
    found = sheet({GearEffect("stop", "1", 1e-4): 5.0})
    torque, width = found.number("H_1"), found.number("Hw_1")
    assert (torque.value, torque.std) == (pytest.approx(5.0), pytest.approx(0.05))
    assert width.value == pytest.approx(2 * 5.0 / K)
    crossings = [
        np.interp(0.0, found.torque[part][order], found.torsion[part][order])
        for part in (slice(None, 200), slice(200, None))
        for order in [np.argsort(found.torque[part])]
    ]
    assert abs(crossings[0] - crossings[1]) == pytest.approx(width.value, rel=1e-3)
    assert found.number("K1_1") is None  # one stiffness at every torque
    assert found.torsion_std[np.argmin(np.abs(found.torque[:200]))] == pytest.approx(0.05 / K, rel=0.05)


def test_a_transmission_error_has_amplitude_and_phase() -> None:
    """3 sin + 4 cos is 5 sin with a phase of atan2(4, 3); std 1 % of each, across and along."""
    found = sheet({GearEffect("error sine", "1", 2.0): 3e-5, GearEffect("error cosine", "1", 2.0): 4e-5})
    number = found.number("e2_1")
    assert (number.value, number.order) == (pytest.approx(5e-5), 2.0)
    assert number.phase == pytest.approx(np.arctan2(4, 3))
    assert number.std == pytest.approx(0.01 * np.hypot(9, 16) / 5 * 1e-5)
    assert number.phase_std == pytest.approx(0.01 * np.hypot(3 * 4, 4 * 3) / 25)
    assert "twice a motor turn" in number.meaning


def test_insignificant_effect_has_largest_bound() -> None:
    """And no value; of a hysteresis that the records bend only in part, as much as they would have shown."""
    bounds = {GearEffect("friction", "1"): 0.4, GearEffect("friction", "1", 1e-3): 0.6}
    bounds |= {GearEffect("stop", "1", 1e-4): 0.3, GearEffect("bristle", "1", 6e-3): 1.0}
    found = sheet({}, bounds=bounds)
    friction, torque = found.number("Fc_m1"), found.number("H_1")
    assert not friction.is_significant
    assert friction.bound == 0.6
    assert torque.bound == pytest.approx(1.0 * PEAK / K / 6e-3)
    assert found.number("Hw_1").bound == pytest.approx(2 * torque.bound / K)


def opened(after: float) -> GearResult:
    """A law of a spring beside two parameters; of the motion the linear fit leaves 20 %."""
    effect, magnitude = (GearEffect("cubic", "1"),), np.ones(1)
    return GearResult(PARAMETERS.x, np.eye(3), effect, magnitude, before=0.2, after=after)


def test_misfit_with_small_remainder_is_explained() -> None:
    """V beyond the noise falls with the square of what is left; else the fit stays a misfit and says so."""
    misfit = replace(plain_fit(PARAMETERS.x), status="misfit", cost=101.0, cost_dof=50.0, verdicts=("bad",))
    good = with_gears(misfit, opened(0.02))
    assert (good.status, good.verdicts) == ("converged", ())
    assert good.cost == pytest.approx(1 + 100 * 0.1**2)
    still = with_gears(misfit, opened(0.06))
    assert (still.status, still.cost) == ("misfit", 101.0)
    assert NOT_EXPLAINED in still.message
    refused = GearResult(PARAMETERS.x, np.eye(3), refused="the records are of one realisation")
    assert with_gears(misfit, refused).message.endswith(NOT_OPENED)


def test_effects_of_gears_explain_no_contradiction_by_load_tests() -> None:
    """Static tests do not go into the search: what they contradict stays contradicted."""
    static = StaticAgreement(cause="the base tilts")
    misfit = replace(plain_fit(PARAMETERS.x), status="misfit", cost_dof=50.0, static=static)
    assert with_gears(misfit, opened(0.02)).status == "misfit"


@pytest.mark.slow
def test_a_clean_gear_has_bounds_alone() -> None:
    """Below a hundredth of the torque of 200 Nm rms, and 2 arcsec; its k is that of the linear fit."""
    measured = records(Gear())
    response, linear = linear_fit(Gear(), measured)
    found = identify_gears([measured], [response], linear, robot(Gear()), SPEC, GearsSpec(), planned=LINES)
    (gear,) = found.sheets
    assert [number.name for number in gear.numbers if number.is_significant] == ["k_1", "d_1"]
    bounds = {number.name: number.bound for number in gear.numbers if not number.is_significant}
    assert {"Fc_m1", "Fb_1", "Fcl_m1", "H_1", "Hw_1", "e1_1", "e2_1", "h_1", "r1_1"} <= set(bounds)
    assert max(bounds["Fc_m1"], bounds["Fb_1"], bounds["H_1"]) < 2.0
    assert bounds["e1_1"] < 1e-5
    assert abs(with_gears(linear, found).values["k_1"] / linear.values["k_1"] - 1) < 1e-3


def test_lost_motion_is_the_way_between_the_flanks() -> None:
    """Twice the half width of a free gap; of one that is only softer its missing part. Unseen, a bound."""
    free, soft = (sheet({GearEffect("gap", "1", 2e-4): f}).number("lost_1") for f in (K, 0.5 * K))
    assert (free.value, soft.value) == (pytest.approx(4e-4), pytest.approx(2e-4))
    assert soft.std == pytest.approx(2e-4 * np.sqrt(0.01**2 + 1e-3**2 + 0.02**2))
    bound = sheet({}, bounds={GearEffect("gap", "1", 2e-4): 0.1 * K}).number("lost_1")
    assert bound.bound == pytest.approx(4e-5)
    assert sheet({}, bounds={GearEffect("gap", "1", 2e-4): 1e3 * K}).number("lost_1") is None  # it is never crossed
    assert sheet({GearEffect("gap", "1", 2e-4): K}).number("k_1").meaning == "stiffness beyond the gap"


def test_robot_without_gear_spring_keeps_fit() -> None:
    rigid = with_stiff_joints(robot(Gear()), ["1"])
    found = identify_gears([], [], plain_fit(PARAMETERS.x), rigid, SPEC, GearsSpec())
    assert found.refused
    assert found.sheets == ()
